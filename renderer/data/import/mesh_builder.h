/* SPDX-License-Identifier: Apache-2.0
 *
 * A mesh while it is read, in as little memory as possible: equal vertices become one, and a vertex
 * without a normal gets the mean normal of the triangles around it.
 *
 *   init ─► vertex, triangle … ─► finish ─► arrays
 */
#ifndef SP_IMPORT_MESH_BUILDER_H
#define SP_IMPORT_MESH_BUILDER_H

#include <stdbool.h>
#include <stdint.h>

#include "data/import/shift.h"

/* Triangles at a vertex belong to one smooth surface if their normals differ by less than this. */
#define IMPORT_SMOOTH_DEGREES 40

struct import_vertex {
    float position[3], normal[3], color[4]; /* normal 0 = not known */
};

/* All memory is owned. */
struct import_mesh_builder {
    struct import_vertex *vertices;
    uint32_t vertex_count;
    uint32_t (*triangles)[3];
    uint32_t triangle_count;
    uint32_t *table, table_size; /* open addressing: vertex + 1, 0 = free */
};

/* Functions return false if there is no memory, or more than SP_ELEMENTS_MAX. */
bool import_mesh_vertex(struct import_mesh_builder *builder, const struct import_vertex *vertex,
                        uint32_t *number);
bool import_mesh_triangle(struct import_mesh_builder *builder, const uint32_t vertices[3]);

/* import_shift_choose() for the vertices. */
bool import_mesh_shift(const struct import_mesh_builder *builder, struct import_shift *shift);

/* Finds the normals that are not known. */
bool import_mesh_finish(struct import_mesh_builder *builder);

void import_mesh_free(struct import_mesh_builder *builder);

#endif
