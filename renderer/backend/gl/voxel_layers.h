/* SPDX-License-Identifier: Apache-2.0
 *
 * A shell, or a layer of vectors, on the GPU. The processor keeps its voxels and sorts those that
 * are not hidden front to back (voxels/order.h); shaders/24_voxels.glsl does the work of
 * voxels/set_up.c and voxels/tile.c.
 *
 *   voxels    uploaded for each frame, in order: 24 bytes each, and 8 per tile that they touch
 */
#ifndef GL_VOXEL_LAYERS_H
#define GL_VOXEL_LAYERS_H

#include "backend/gl/band.h"

/* A shell or a layer of vectors, ready to be drawn in one frame. */
struct gl_voxel_drawing {
    enum gl_voxel_layer kind;
    bool is_drawn;    /* it has voxels */
    bool is_alone;    /* nothing else is in the frame: it is composited, and makes no fragments */
    uint32_t most;    /* voxels of a tile of SP_FRAGMENT_TILE px */
    uint32_t at_once; /* of these per dispatch */
    uint32_t passes;  /* dispatches per band */
    uint32_t words;   /* words of four that a pixel needs between them */
    unsigned program;
};

/* Uploads what the frame needs, after the volume's data. SP_ERR_MEMORY, SP_ERR_BUDGET,
 * SP_ERR_CANCELLED, SP_ERR_UNSUPPORTED. A context must be current, here and below. */
bool gl_voxel_layer_begin(struct gl_voxel_drawing *voxels, const struct gl_band *band,
                          enum gl_voxel_layer kind, struct sp_error *err);

/* Adds the layer to a band that was started. SP_ERR_CANCELLED, SP_ERR_BACKEND. */
bool gl_voxel_layer_draw(const struct gl_voxel_drawing *voxels, struct gl_band *band,
                         struct sp_error *err);

void gl_voxel_layers_finish(struct gl_state *state);

#endif
