/* SPDX-License-Identifier: Apache-2.0
 *
 * A mesh that a reader has in memory: triangles, and lines that become tubes behind them.
 */
#ifndef SP_IMPORT_MESH_PARTS_H
#define SP_IMPORT_MESH_PARTS_H

#include "data/import/format.h"
#include "data/import/mesh_builder.h"

/* Owns its memory. All zero = empty. */
struct import_mesh_parts {
    struct import_mesh_builder built;
    bool has_colors; /* the file gives some vertices a colour */
    struct import_line_points {
        uint64_t count, lines;
        float (*positions)[3];
        float (*colors)[4];
        uint32_t *counts; /* by line */
    } points;             /* of lines, one after another */
};

/* Allocates the points of lines; counts are 0. False if there is no memory. */
bool import_mesh_parts_alloc_lines(struct import_mesh_parts *parts, uint64_t points,
                                   uint64_t lines);

/* Calls import_header_use_elements(), with normals. Refuses more than a volume may have. */
bool import_mesh_parts_describe(const struct import_mesh_parts *parts,
                                const struct import_file *file, struct import_header *header,
                                struct sp_error *err);

/* import_shift_choose() for the vertices, or the points of lines where there are none. */
bool import_mesh_parts_shift(const struct import_mesh_parts *parts, struct import_shift *shift);

/* Fills elements of the shape that the header describes. */
void import_mesh_parts_read(const struct import_mesh_parts *parts,
                            const struct sp_elements *elements);

void import_mesh_parts_free(struct import_mesh_parts *parts);

#endif
