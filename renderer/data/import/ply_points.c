/* SPDX-License-Identifier: Apache-2.0
 *
 * Points with a scalar each in PLY files.
 *
 * Why this parser is our own: parsers.md.
 */
#include "data/import/number.h"
#include "data/import/ply.h"
#include "data/import/points.h"

static bool find_columns(const struct ply *ply, const char *names[PLY_PROPERTIES_MAX],
                         struct import_columns *columns) {
    const struct ply_element *vertex = ply_find(ply, "vertex");
    for (unsigned i = 0; i < vertex->properties; i++) {
        const struct ply_property *p = &ply->properties[vertex->first + i];
        names[i] = p->length.size ? NULL : p->name;
    }
    return import_columns_find(ply->file, names, vertex->properties, columns);
}

/* Programs that know only meshes write points as the vertices of a mesh without faces. */
static bool matches(const struct ply *ply) {
    const struct ply_element *face = ply_find(ply, "face"), *vertex = ply_find(ply, "vertex");
    return (!face || (face->count == 0 && vertex && vertex->count > 0)) &&
           ply_column(ply, vertex, "x") >= 0;
}

/* The largest whole number that a colour can have; 0 = its values decide, as those of floating
 * point do. */
static double color_most(const struct ply_property *color) {
    double low, high;
    if (!import_number_is_whole(color->number))
        return 0;
    import_number_range(color->number, &low, &high);
    return color->number.size <= 2 ? high : 0;
}

static bool open_points(struct ply *ply, struct import_header *header, struct sp_error *err) {
    const struct ply_element *vertex = ply_find(ply, "vertex");
    const char *names[PLY_PROPERTIES_MAX];
    struct import_columns columns;
    if (!ply_check_count(ply, vertex, err))
        return false;
    if (!find_columns(ply, names, &columns))
        return import_fail(err, SP_ERR_FORMAT, ply->file->title, ply->begin, "vertex",
                           "the property y or z is missing, or a list; vertices need the numbers "
                           "x, y and z");
    import_columns_use(&columns, names, vertex->properties, (uint32_t)vertex->count, header);
    if (header->are_colored_points)
        header->color_most =
            color_most(&ply->properties[vertex->first + (unsigned)columns.color[0]]);
    if (ply_find(ply, "face"))
        import_warn(ply->file->warnings,
                    "The file declares a mesh with no faces; its vertices are drawn as points.");
    return true;
}

static bool read_points(const struct ply *ply, const struct sp_elements *e,
                        const struct import_progress *progress, struct sp_error *err) {
    const char *names[PLY_PROPERTIES_MAX];
    struct import_columns columns;
    if (!find_columns(ply, names, &columns))
        return false;
    struct ply_rows *rows = ply_rows_open(ply, ply_find(ply, "vertex"), -1, err);
    bool ok = rows != NULL;
    for (uint32_t i = 0; ok && i < e->shape.count; i++) {
        const double *row = ply_rows_next(rows, err);
        ok = row != NULL;
        if (ok)
            import_columns_copy(&columns, row, e, i);
        if (i % 4096 == 0)
            import_report(progress, (uint64_t)i * 4 * sizeof(float));
    }
    ply_rows_close(rows);
    return ok;
}

const struct ply_content ply_points = { matches, open_points, read_points };
