/* SPDX-License-Identifier: Apache-2.0
 *
 * Triangle meshes on the processor (sp/elements.h). README.md of this folder explains how.
 *
 *   vertices ─► places in the image ─► triangles by tile      sp_mesh_prepare()
 *                                      └─► per tile: samples ─► fragments      kernels.h
 */
#ifndef SP_MESH_MESH_H
#define SP_MESH_MESH_H

#include "base/arena.h"
#include "base/interrupt.h"
#include "base/parallel_for.h"
#include "draw/layers/mesh/kernels.h"

/* All pointers are borrowed until the frame is drawn. */
struct sp_mesh_input {
    const struct sp_view *view;
    const struct sp_layer *layer;       /* of type SP_LAYER_GEOMETRY */
    const struct sp_elements *elements; /* of kind SP_KIND_MESH */
    const struct sp_grid *grid;         /* the grid to which the view's clip box refers */
    const struct sp_camera_transform *camera;
    const struct sp_shade *shade; /* NULL = not lit */
    const struct sp_mesh_kernels *kernels;
    struct sp_interrupt interrupt;
    struct sp_pool *pool;
    struct sp_arena *arena; /* of the frame */
};

/* Prepares a mesh for the tiles of the image. *mesh is valid until the arena is reset, and uses
 * about 16 bytes per vertex and per triangle. SP_ERR_MEMORY, SP_ERR_CANCELLED. */
bool sp_mesh_prepare(const struct sp_mesh_input *input, struct sp_mesh *mesh, struct sp_error *err);

/* Fills the fields that do not depend on the vertices. sp_mesh_prepare() calls this function
 * first. */
void sp_mesh_init(const struct sp_mesh_input *input, struct sp_mesh *mesh);

/* Returns the smallest opacity of the vertices [begin, end), limited to [0, 1]; 1 if the range is
 * empty. */
float sp_mesh_least_opacity(const struct sp_elements *elements, uint32_t begin, uint32_t end);

/* Returns how many sheets of a mesh may be visible, [1, SP_MESH_SHEETS]; an opaque mesh has one.
 * `least`: the smallest opacity of a vertex. */
int sp_mesh_count_sheets(const struct sp_mesh *mesh, float least);

/* Allocates the memory of a worker for the tiles of meshes with at most `sheets` sheets. NULL = out
 * of memory. */
struct sp_mesh_scratch *sp_mesh_scratch_alloc(struct sp_arena *arena, int sheets);

/* Clips a triangle that compute_spans() could not place. Writes its parts that lie beyond the near
 * plane and not too far beside the image, and returns their number. */
enum { SP_MESH_PIECES_MAX = 6 };
int sp_mesh_clip(const struct sp_mesh *mesh, uint32_t triangle,
                 struct sp_mesh_piece pieces[SP_MESH_PIECES_MAX]);

#endif
