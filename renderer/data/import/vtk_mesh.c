/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/vtk.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

static const char *const kinds[VTK_CELL_KINDS] = { [VTK_VERTS] = "vertices",
                                                   [VTK_LINES] = "lines",
                                                   [VTK_POLYS] = "polygons",
                                                   [VTK_STRIPS] = "triangle strips" };

struct reading { /* of one piece */
    struct vtk_volume *v;
    const struct vtk_piece *piece;
    const struct import_file *file; /* of the piece */
    struct import_mesh_parts *parts;
    struct sp_error *err;
    uint64_t count; /* of points */
    float (*positions)[3], (*normals)[3], *colors;
    unsigned color_components;
    float color_scale;
    uint32_t *numbers; /* of points in the mesh; UINT32_MAX = none yet */
    enum vtk_cell_kind kind;
};

/* Takes a cell; at[count] are numbers of points that exist. */
typedef bool visit_cell(struct reading *r, const double *at, uint64_t count);

static bool fail_memory(const struct reading *r) {
    return sp_fail(r->err, SP_ERR_MEMORY, r->file->title,
                   "out of memory for the mesh, or more than %d vertices or triangles",
                   SP_ELEMENTS_MAX);
}

/* Reads an array of points, of positions with their shift; NULL with *err set on failure. */
static float *read_array(const struct reading *r, const struct vtk_entry *e,
                         struct import_shift *shift) {
    struct vtk_array a = e->array;
    a.count = r->count * e->components;
    if (!vtk_array_check(r->file, &a, r->err))
        return NULL;
    float *out = malloc(a.count * sizeof *out);
    if (!out)
        fail_memory(r);
    if (out && vtk_array_read_floats(r->file, &a, out, shift, r->err))
        return out;
    free(out);
    return NULL;
}

/* The normals or the first colours of the points; NULL = none. */
static const struct vtk_entry *find_points_array(const struct reading *r, bool colors) {
    for (size_t i = 0; i < r->piece->entry_count; i++) {
        const struct vtk_entry *e = &r->v->entries[r->piece->entries + i];
        const bool are_normals = e->role == VTK_NORMALS && e->components == 3;
        if (e->home == VTK_OF_POINTS && (colors ? vtk_is_color(e) : are_normals))
            return e;
    }
    return NULL;
}

static bool read_points(struct reading *r) {
    const struct vtk_entry *at = vtk_find_entry(r->v, r->piece, VTK_POSITIONS, 0, NULL);
    const struct vtk_entry *normals = find_points_array(r, false);
    const struct vtk_entry *colors = find_points_array(r, true);
    const size_t n = (size_t)r->count;
    r->numbers = malloc(n * sizeof *r->numbers);
    if (!r->numbers)
        return fail_memory(r);
    memset(r->numbers, 0xff, n * sizeof *r->numbers);
    r->color_components = colors ? colors->components : 0;
    r->parts->has_colors |= colors != NULL;
    if (colors)
        r->color_scale = (float)import_number_color_scale(colors->array.type->number);
    return (r->positions = (float(*)[3])(void *)read_array(r, at, r->v->file->shift)) != NULL &&
           (!normals || (r->normals = (float(*)[3])(void *)read_array(r, normals, NULL)) != NULL) &&
           (!colors || (r->colors = read_array(r, colors, NULL)) != NULL);
}

static void fill_color(const struct reading *r, uint64_t point, float color[4]) {
    for (unsigned k = 0; k < 4; k++)
        color[k] = !r->colors ? (k < 3 ? 0.8f : 1)
                   : k < r->color_components
                       ? r->color_scale * r->colors[point * r->color_components + k]
                       : 1;
}

static bool add_triangle(struct reading *r, const double corners[3]) {
    uint32_t numbers[3];
    for (int k = 0; k < 3; k++) {
        const uint64_t point = (uint64_t)corners[k];
        uint32_t *number = &r->numbers[point];
        if (*number == UINT32_MAX) {
            struct import_vertex v = { .normal = { 0, 0, 0 } };
            memcpy(v.position, r->positions[point], sizeof v.position);
            if (r->normals)
                memcpy(v.normal, r->normals[point], sizeof v.normal);
            fill_color(r, point, v.color);
            if (!import_mesh_vertex(&r->parts->built, &v, number))
                return fail_memory(r);
        }
        numbers[k] = *number;
    }
    return import_mesh_triangle(&r->parts->built, numbers) || fail_memory(r);
}

static bool add_polygon(struct reading *r, const double *at, uint64_t count) {
    for (uint64_t i = 2; i < count; i++)
        if (!add_triangle(r, (double[]){ at[0], at[i - 1], at[i] }))
            return false;
    return true;
}

/* Every other triangle of a strip is turned. */
static bool add_strip(struct reading *r, const double *at, uint64_t count) {
    for (uint64_t i = 2; i < count; i++)
        if (!add_triangle(r, (double[]){ at[i - 2], at[i - 1 + i % 2], at[i - i % 2] }))
            return false;
    return true;
}

static bool count_line(struct reading *r, const double *at, uint64_t count) {
    (void)at;
    r->parts->points.count += count;
    r->parts->points.lines++;
    return true;
}

static bool add_line(struct reading *r, const double *at, uint64_t count) {
    struct import_line_points *p = &r->parts->points;
    p->counts[p->lines++] = (uint32_t)count;
    for (uint64_t i = 0; i < count; i++, p->count++) {
        memcpy(p->positions[p->count], r->positions[(uint64_t)at[i]], sizeof p->positions[0]);
        fill_color(r, (uint64_t)at[i], p->colors[p->count]);
    }
    return true;
}

/* Passes the cells on. `ends` is NULL where each cell begins with its count. */
static bool walk(struct reading *r, const struct vtk_cells *cells, const double *at,
                 const double *ends, visit_cell *visit) {
    const double total = (double)cells->points.count;
    double begin = 0;
    for (uint64_t i = 0; i < cells->count; i++) {
        const double first = ends ? begin : begin + 1;
        const double end =
            ends ? ends[i + cells->starts_at_0] : first + (begin < total ? at[(uint64_t)begin] : 0);
        if (!(end >= first && end <= total) || (ends && cells->starts_at_0 && ends[0] != 0))
            return import_fail(r->err, SP_ERR_FORMAT, r->file->title, cells->at, kinds[r->kind],
                               "cell %" PRIu64 " ends at %g, outside [%g, %g]", i, end, first,
                               total);
        for (uint64_t k = (uint64_t)first; k < (uint64_t)end; k++)
            if (!(at[k] >= 0 && at[k] < (double)r->count))
                return import_fail(r->err, SP_ERR_FORMAT, r->file->title, cells->at, kinds[r->kind],
                                   "cell %" PRIu64 " has the point %g; the file has %" PRIu64
                                   " points, numbered from 0",
                                   i, at[k], r->count);
        if (!visit(r, at + (uint64_t)first, (uint64_t)(end - first)))
            return false;
        begin = end;
    }
    return true;
}

static double *read_numbers(const struct reading *r, struct vtk_array *a) {
    return vtk_array_check(r->file, a, r->err) ? vtk_array_read_numbers(r->file, a, r->err) : NULL;
}

/* Enlarges the arrays: the lines of a piece follow the lines of earlier pieces. */
static bool grow_lines(struct reading *r, uint64_t points, uint64_t lines) {
    struct import_mesh_parts more = { .points = { .count = 0 } };
    struct import_line_points *p = &r->parts->points;
    if (points > SP_ELEMENTS_MAX || !import_mesh_parts_alloc_lines(&more, points, lines)) {
        import_mesh_parts_free(&more);
        return false;
    }
    if (p->count)
        memcpy(more.points.positions, p->positions, p->count * sizeof *p->positions);
    if (p->count)
        memcpy(more.points.colors, p->colors, p->count * sizeof *p->colors);
    if (p->lines)
        memcpy(more.points.counts, p->counts, p->lines * sizeof *p->counts);
    free(p->positions);
    free(p->colors);
    free(p->counts);
    p->positions = more.points.positions;
    p->colors = more.points.colors;
    p->counts = more.points.counts;
    return true;
}

static bool add_lines(struct reading *r, const struct vtk_cells *cells, const double *at,
                      const double *ends) {
    struct import_line_points *p = &r->parts->points;
    const uint64_t points = p->count, lines = p->lines;
    if (!walk(r, cells, at, ends, count_line))
        return false;
    const uint64_t all_points = p->count, all_lines = p->lines;
    p->count = points;
    p->lines = lines;
    return grow_lines(r, all_points, all_lines) ? walk(r, cells, at, ends, add_line)
                                                : fail_memory(r);
}

/* How many points the cells have where only their ends tell. */
static bool set_count(const struct reading *r, struct vtk_cells *cells, const double *ends) {
    const double last = ends[cells->ends.count - 1];
    if (!(last >= 0 && last <= 3.0 * SP_ELEMENTS_MAX))
        return import_fail(r->err, SP_ERR_FORMAT, r->file->title, cells->at, kinds[r->kind],
                           "the last cell ends at %g, outside [0, %.0f]", last,
                           3.0 * SP_ELEMENTS_MAX);
    cells->points.count = (uint64_t)last;
    return true;
}

static bool read_cells(struct reading *r, enum vtk_cell_kind kind) {
    struct vtk_cells own = r->piece->cells[kind], *cells = &own;
    double *at = NULL, *ends = NULL;
    r->kind = kind;
    if (cells->count == 0)
        return true;
    bool ok = !cells->ends.type || (ends = read_numbers(r, &cells->ends)) != NULL;
    if (ok && ends && cells->points.type && cells->points.count == 0)
        ok = set_count(r, cells, ends);
    if (ok && (!cells->points.type || cells->points.count == 0))
        ok = import_fail(r->err, SP_ERR_FORMAT, r->file->title, cells->at, kinds[kind],
                         "%" PRIu64 " cells have no points", cells->count);
    ok = ok && (at = read_numbers(r, &cells->points)) != NULL &&
         (kind == VTK_LINES   ? add_lines(r, cells, at, ends)
          : kind == VTK_POLYS ? walk(r, cells, at, ends, add_polygon)
                              : walk(r, cells, at, ends, add_strip));
    free(at);
    free(ends);
    return ok;
}

/* Points without a cell are not drawn, and a mesh has colours but no values. */
static void warn(const struct vtk_volume *v, struct import_header *header) {
    const struct import_file *file = v->file;
    uint64_t vertices = 0;
    for (size_t p = 0; p < v->piece_count; p++)
        vertices += v->pieces[p].cells[VTK_VERTS].count;
    if (vertices)
        import_warn(file->warnings,
                    "The %" PRIu64 " cells that are vertices are not drawn, only the surfaces and "
                    "lines.",
                    vertices);
    if (header->value_name[0])
        import_warn(file->warnings,
                    "The values \"%.40s\" are not shown on the surface; %.60s?field=%.40s shows "
                    "the points with them.",
                    header->value_name, file->title, header->value_name);
}

bool vtk_mesh_is_there(const struct vtk_volume *v) {
    for (size_t p = 0; p < v->piece_count; p++) {
        const struct vtk_cells *cells = v->pieces[p].cells;
        if (cells[VTK_LINES].count || cells[VTK_POLYS].count || cells[VTK_STRIPS].count)
            return true;
    }
    return false;
}

static bool read_piece(struct vtk_volume *v, const struct vtk_piece *piece, struct sp_error *err) {
    struct reading r = { .v = v,
                         .piece = piece,
                         .parts = &v->mesh.parts,
                         .err = err,
                         .count = piece->count,
                         .file = vtk_open_file(v, piece->file, err) };
    const bool ok = r.file && read_points(&r) && read_cells(&r, VTK_POLYS) &&
                    read_cells(&r, VTK_STRIPS) && read_cells(&r, VTK_LINES);
    free(r.positions);
    free(r.normals);
    free(r.colors);
    free(r.numbers);
    return ok;
}

static bool read_pieces(struct vtk_volume *v, struct sp_error *err) {
    import_mesh_parts_free(&v->mesh.parts);
    for (size_t p = 0; p < v->piece_count; p++)
        if (v->pieces[p].count && !read_piece(v, &v->pieces[p], err))
            return false;
    return true;
}

bool vtk_mesh_open(struct vtk_volume *v, struct import_header *header, struct sp_error *err) {
    struct import_mesh_parts *parts = &v->mesh.parts;
    do {
        if (!read_pieces(v, err))
            return false;
    } while (import_mesh_parts_shift(parts, v->file->shift));
    if (!import_mesh_finish(&parts->built))
        return fail_memory(&(struct reading){ .file = v->file, .err = err });
    warn(v, header);
    import_header_add_other(header, header->value_name);
    memset(header->value_name, 0, sizeof header->value_name);
    memset(header->vector_name, 0, sizeof header->vector_name);
    memset(header->other_vectors, 0, sizeof header->other_vectors);
    return import_mesh_parts_describe(parts, v->file, header, err);
}
