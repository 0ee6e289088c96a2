/* SPDX-License-Identifier: Apache-2.0 */
#include "import/vtk_mesh.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

static const char *const kinds[VTK_CELL_KINDS] = { [VTK_VERTS] = "vertices",
                                                   [VTK_LINES] = "lines",
                                                   [VTK_POLYS] = "polygons",
                                                   [VTK_STRIPS] = "triangle strips" };

struct reading {
    struct vtk_mesh *mesh;
    const struct import_file *file;
    struct sp_error *err;
    uint64_t count; /* of points */
    float (*positions)[3], (*normals)[3], *colors;
    uint32_t *numbers; /* of points in the mesh; UINT32_MAX = none yet */
    enum vtk_cell_kind kind;
};

/* Takes a cell; at[count] are numbers of points that exist. */
typedef bool take_cell(struct reading *r, const double *at, uint64_t count);

static bool fail_memory(const struct reading *r) {
    return sp_fail(r->err, SP_ERR_MEMORY, r->file->shown,
                   "out of memory for the mesh, or more than %d vertices or triangles",
                   SP_ELEMENTS_MAX);
}

static bool read_array(const struct reading *r, struct vtk_array *a, uint64_t count, float *out) {
    a->count = count;
    return vtk_array_check(r->file, a, r->err) &&
           vtk_array_read_floats(r->file, a, out, NULL, r->err);
}

static bool read_points(struct reading *r, const struct vtk_array *points) {
    struct vtk_mesh *m = r->mesh;
    struct vtk_array own = *points;
    const size_t n = (size_t)r->count;
    r->positions = malloc(n * sizeof *r->positions);
    r->numbers = malloc(n * sizeof *r->numbers);
    r->normals = m->normals.type ? malloc(n * sizeof *r->normals) : NULL;
    r->colors = m->colors.type ? malloc(n * m->color_components * sizeof *r->colors) : NULL;
    if (!r->positions || !r->numbers || (m->normals.type && !r->normals) ||
        (m->colors.type && !r->colors))
        return fail_memory(r);
    memset(r->numbers, 0xff, n * sizeof *r->numbers);
    return read_array(r, &own, 3 * r->count, r->positions[0]) &&
           (!r->normals || read_array(r, &m->normals, 3 * r->count, r->normals[0])) &&
           (!r->colors || read_array(r, &m->colors, m->color_components * r->count, r->colors));
}

static void find_color(const struct reading *r, uint64_t point, float color[4]) {
    const struct vtk_mesh *m = r->mesh;
    const float scale = r->colors && m->colors.type->number.kind != IMPORT_FLOAT ? 1 / 255.0f : 1;
    for (unsigned k = 0; k < 4; k++)
        color[k] = !r->colors                ? (k < 3 ? 0.8f : 1)
                   : k < m->color_components ? scale * r->colors[point * m->color_components + k]
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
            find_color(r, point, v.color);
            if (!import_mesh_vertex(&r->mesh->parts.built, &v, number))
                return fail_memory(r);
        }
        numbers[k] = *number;
    }
    return import_mesh_triangle(&r->mesh->parts.built, numbers) || fail_memory(r);
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
    r->mesh->parts.points.count += count;
    r->mesh->parts.points.lines++;
    return true;
}

static bool add_line(struct reading *r, const double *at, uint64_t count) {
    struct import_line_points *p = &r->mesh->parts.points;
    p->counts[p->lines++] = (uint32_t)count;
    for (uint64_t i = 0; i < count; i++, p->count++) {
        memcpy(p->positions[p->count], r->positions[(uint64_t)at[i]], sizeof p->positions[0]);
        find_color(r, (uint64_t)at[i], p->colors[p->count]);
    }
    return true;
}

/* Passes the cells on. `ends` is NULL where each cell begins with its count. */
static bool walk(struct reading *r, const struct vtk_cells *cells, const double *at,
                 const double *ends, take_cell *take) {
    const double total = (double)cells->points.count;
    double begin = 0;
    for (uint64_t i = 0; i < cells->count; i++) {
        const double first = ends ? begin : begin + 1;
        const double end =
            ends ? ends[i + cells->starts_at_0] : first + (begin < total ? at[(uint64_t)begin] : 0);
        if (!(end >= first && end <= total) || (ends && cells->starts_at_0 && ends[0] != 0))
            return import_fail(r->err, SP_ERR_FORMAT, r->file->shown, cells->at, kinds[r->kind],
                               "cell %" PRIu64 " ends at %g, outside [%g, %g]", i, end, first,
                               total);
        for (uint64_t k = (uint64_t)first; k < (uint64_t)end; k++)
            if (!(at[k] >= 0 && at[k] < (double)r->count))
                return import_fail(r->err, SP_ERR_FORMAT, r->file->shown, cells->at, kinds[r->kind],
                                   "cell %" PRIu64 " has the point %g; the file has %" PRIu64
                                   " points, numbered from 0",
                                   i, at[k], r->count);
        if (!take(r, at + (uint64_t)first, (uint64_t)(end - first)))
            return false;
        begin = end;
    }
    return true;
}

static double *read_numbers(const struct reading *r, struct vtk_array *a) {
    return vtk_array_check(r->file, a, r->err) ? vtk_array_read_numbers(r->file, a, r->err) : NULL;
}

static bool take_lines(struct reading *r, const struct vtk_cells *cells, const double *at,
                       const double *ends) {
    struct import_mesh_parts *parts = &r->mesh->parts;
    if (!walk(r, cells, at, ends, count_line))
        return false;
    if (parts->points.count > SP_ELEMENTS_MAX ||
        !import_mesh_parts_alloc_lines(parts, parts->points.count, parts->points.lines))
        return fail_memory(r);
    parts->points.count = parts->points.lines = 0;
    return walk(r, cells, at, ends, add_line);
}

/* How many points the cells have where only their ends tell. */
static bool find_count(const struct reading *r, struct vtk_cells *cells, const double *ends) {
    const double last = ends[cells->ends.count - 1];
    if (!(last >= 0 && last <= 3.0 * SP_ELEMENTS_MAX))
        return import_fail(r->err, SP_ERR_FORMAT, r->file->shown, cells->at, kinds[r->kind],
                           "the last cell ends at %g, outside [0, %.0f]", last,
                           3.0 * SP_ELEMENTS_MAX);
    cells->points.count = (uint64_t)last;
    return true;
}

static bool read_cells(struct reading *r, enum vtk_cell_kind kind) {
    struct vtk_cells *cells = &r->mesh->cells[kind];
    double *at = NULL, *ends = NULL;
    r->kind = kind;
    if (cells->count == 0)
        return true;
    bool ok = !cells->ends.type || (ends = read_numbers(r, &cells->ends)) != NULL;
    if (ok && ends && cells->points.type && cells->points.count == 0)
        ok = find_count(r, cells, ends);
    if (ok && (!cells->points.type || cells->points.count == 0))
        ok = import_fail(r->err, SP_ERR_FORMAT, r->file->shown, cells->at, kinds[kind],
                         "%" PRIu64 " cells have no points", cells->count);
    ok = ok && (at = read_numbers(r, &cells->points)) != NULL &&
         (kind == VTK_LINES   ? take_lines(r, cells, at, ends)
          : kind == VTK_POLYS ? walk(r, cells, at, ends, add_polygon)
                              : walk(r, cells, at, ends, add_strip));
    free(at);
    free(ends);
    return ok;
}

/* Points without a cell are not drawn, and a mesh has colours but no values. */
static void warn(const struct vtk_mesh *m, const struct import_file *file,
                 struct import_header *header) {
    if (m->cells[VTK_VERTS].count)
        import_warn(file->warnings,
                    "The %" PRIu64 " cells that are vertices are not drawn, only the surfaces and "
                    "lines.",
                    m->cells[VTK_VERTS].count);
    if (m->has_cell_data)
        import_warn(file->warnings, "Data of cells are not read.");
    if (header->value_name[0])
        import_warn(file->warnings,
                    "The values \"%.40s\" are not shown on the surface; %.60s?field=%.40s shows "
                    "the points with them.",
                    header->value_name, file->shown, header->value_name);
}

bool vtk_mesh_is_there(const struct vtk_mesh *mesh) {
    return mesh->cells[VTK_LINES].count || mesh->cells[VTK_POLYS].count ||
           mesh->cells[VTK_STRIPS].count;
}

bool vtk_mesh_open(struct vtk_mesh *m, const struct import_file *file,
                   const struct vtk_array *points, uint64_t count, struct import_header *header,
                   struct sp_error *err) {
    struct reading r = { .mesh = m, .file = file, .err = err, .count = count };
    bool ok = read_points(&r, points) && read_cells(&r, VTK_POLYS) && read_cells(&r, VTK_STRIPS) &&
              read_cells(&r, VTK_LINES);
    free(r.positions);
    free(r.normals);
    free(r.colors);
    free(r.numbers);
    if (!ok)
        return false;
    if (!import_mesh_finish(&m->parts.built))
        return fail_memory(&r);
    warn(m, file, header);
    import_header_add_other(header, header->value_name);
    memset(header->value_name, 0, sizeof header->value_name);
    memset(header->vector_name, 0, sizeof header->vector_name);
    memset(header->other_vectors, 0, sizeof header->other_vectors);
    return import_mesh_parts_describe(&m->parts, file, header, err);
}
