/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/mesh_parts.h"

#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "data/import/tubes.h"

bool import_mesh_parts_alloc_lines(struct import_mesh_parts *parts, uint64_t points,
                                   uint64_t lines) {
    struct import_line_points *p = &parts->points;
    p->positions = malloc((points + 1) * sizeof *p->positions);
    p->colors = malloc((points + 1) * sizeof *p->colors);
    p->counts = calloc(lines + 1, sizeof *p->counts);
    return p->positions && p->colors && p->counts;
}

static struct import_lines lines_of(const struct import_mesh_parts *parts) {
    return (struct import_lines){ (uint32_t)parts->points.lines, parts->points.counts,
                                  (const float(*)[3])parts->points.positions,
                                  (const float(*)[4])parts->points.colors };
}

bool import_mesh_parts_describe(const struct import_mesh_parts *parts,
                                const struct import_file *file, struct import_header *header,
                                struct sp_error *err) {
    const struct import_lines lines = lines_of(parts);
    uint64_t vertices = parts->built.vertex_count, triangles = parts->built.triangle_count;
    import_tubes_count(&lines, &vertices, &triangles);
    if (vertices > SP_ELEMENTS_MAX || triangles > SP_ELEMENTS_MAX)
        return sp_fail(err, SP_ERR_UNSUPPORTED, file->title,
                       "%" PRIu64 " vertices and %" PRIu64 " triangles are more than %d", vertices,
                       triangles, SP_ELEMENTS_MAX);
    const struct sp_elements_shape shape = { .kind = SP_KIND_MESH,
                                             .count = (uint32_t)triangles,
                                             .vertex_count = (uint32_t)vertices,
                                             .lacks_colors = !parts->has_colors };
    import_header_use_elements(header, &shape);
    header->has_normals = true;
    return true;
}

bool import_mesh_parts_shift(const struct import_mesh_parts *parts, struct import_shift *shift) {
    const struct import_line_points *p = &parts->points;
    return parts->built.vertex_count
               ? import_mesh_shift(&parts->built, shift)
               : p->count &&
                     import_shift_choose(shift, p->positions, sizeof *p->positions, p->count);
}

/* The diagonal of the box around all vertices and points. */
static double measure_diameter(const struct import_mesh_parts *m) {
    const struct import_mesh_builder *b = &m->built;
    double square = 0;
    for (int a = 0; a < 3; a++) {
        double low = INFINITY, high = -INFINITY;
        for (uint64_t i = 0; i < b->vertex_count + m->points.count; i++) {
            const double at = i < b->vertex_count
                                  ? (double)b->vertices[i].position[a]
                                  : (double)m->points.positions[i - b->vertex_count][a];
            low = at < low ? at : low;
            high = at > high && isfinite(at) ? at : high;
        }
        if (high > low && isfinite(low))
            square += (high - low) * (high - low);
    }
    return sqrt(square);
}

void import_mesh_parts_read(const struct import_mesh_parts *parts,
                            const struct sp_elements *elements) {
    const struct import_mesh_builder *b = &parts->built;
    const struct import_lines lines = lines_of(parts);
    for (uint32_t i = 0; i < b->vertex_count; i++) {
        memcpy(elements->positions[i], b->vertices[i].position, sizeof elements->positions[i]);
        memcpy(elements->normals[i], b->vertices[i].normal, sizeof elements->normals[i]);
        memcpy(elements->colors[i], b->vertices[i].color, sizeof elements->colors[i]);
    }
    if (b->triangle_count)
        memcpy(elements->triangles, b->triangles, b->triangle_count * sizeof *b->triangles);
    import_tubes_fill(&lines, IMPORT_TUBE_RADIUS * measure_diameter(parts), elements,
                      b->vertex_count, b->triangle_count);
}

void import_mesh_parts_free(struct import_mesh_parts *parts) {
    import_mesh_free(&parts->built);
    free(parts->points.positions);
    free(parts->points.colors);
    free(parts->points.counts);
    parts->points = (struct import_line_points){ 0 };
}
