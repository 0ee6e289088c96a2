/* SPDX-License-Identifier: Apache-2.0
 *
 * Iso-surfaces on the GPU. The processor caches the points of a value
 * (draw/layers/surface/points.h) and sorts blocks of points by tile
 * (draw/layers/surface/prepare.c); shaders/passes/draw_surface.glsl does the work of
 * draw/layers/surface/tile.c and adds to the fragments of a band.
 *
 *   points    uploaded once per volume and value
 *   blocks    uploaded for each frame: 48 bytes per visible block, 8 bytes per tile and block
 */
#ifndef GL_SURFACES_H
#define GL_SURFACES_H

#include "backend/gl/band.h"

/* The surfaces of a frame that have points in the image. */
struct gl_surfaces {
    unsigned count;
    struct gl_surface {
        const struct gl_buffer *constants, *points;
        uint32_t most; /* points of a tile of SP_FRAGMENT_TILE px */
    } items[SP_LAYERS_MAX];
    uint32_t at_once;     /* points of a tile per dispatch */
    uint32_t passes;      /* dispatches per band, of all surfaces */
    uint32_t sheet_words; /* words of four that a pixel needs between passes; 0 = a pass each */
};

/* Uploads the data of the surfaces, after the data of the volume. SP_ERR_MEMORY, SP_ERR_BUDGET,
 * SP_ERR_CANCELLED, SP_ERR_UNSUPPORTED. A context must be current, here and below. */
bool gl_surfaces_begin(struct gl_surfaces *surfaces, const struct gl_band *band,
                       struct sp_error *err);

/* Adds the fragments of the surfaces to a band that was started. SP_ERR_CANCELLED,
 * SP_ERR_BACKEND. */
bool gl_surfaces_draw(const struct gl_surfaces *surfaces, struct gl_band *band,
                      struct sp_error *err);

void gl_surfaces_finish(struct gl_state *state);

#endif
