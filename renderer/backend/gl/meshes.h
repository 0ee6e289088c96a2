/* SPDX-License-Identifier: Apache-2.0
 *
 * Triangle meshes on the GPU (draw/layers/mesh/). Their vertices and triangles are uploaded once.
 *
 *   place_triangles  triangle → tiles       ┐ per batch of triangles
 *   bins.h           triangles by tile      ┘
 *   draw_mesh        tile → samples → fragments of the band; one dispatch per sheet, or more
 */
#ifndef GL_MESHES_H
#define GL_MESHES_H

#include "backend/gl/band.h"

enum { GL_MESH_ROUNDS = 40 }; /* most rounds of the shader's loop per triangle and tile */

/* The meshes of a frame that have triangles. */
struct gl_meshes {
    unsigned count;
    struct gl_mesh {
        const struct gl_buffer *constants, *vertices, *triangles;
        uint32_t triangle_count, sheets;
    } items[SP_LAYERS_MAX];
    uint32_t dispatches; /* per band, at most */
    uint32_t words; /* uvec4 words per pixel that are kept between dispatches; 0 = one per mesh */
};

/* Uploads the meshes of the frame. SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED,
 * SP_ERR_UNSUPPORTED. A context must be current, here and below. */
bool gl_meshes_begin(struct gl_meshes *meshes, const struct gl_band *band, struct sp_error *err);

/* Divides the meshes into dispatches. */
void gl_meshes_divide(struct gl_meshes *meshes, const struct gl_pieces *pieces);

/* Reserves memory for the triangles of a band. SP_ERR_MEMORY, SP_ERR_BUDGET. */
bool gl_meshes_reserve(const struct gl_meshes *meshes, const struct gl_band *band,
                       struct sp_error *err);

/* Adds the fragments of the meshes to a band that was started. SP_ERR_CANCELLED, SP_ERR_BACKEND. */
bool gl_meshes_draw(const struct gl_meshes *meshes, struct gl_band *band, struct sp_error *err);

void gl_meshes_finish(struct gl_state *state);

#endif
