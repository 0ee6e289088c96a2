/* SPDX-License-Identifier: Apache-2.0
 *
 * Layers that are drawn splat by splat on the GPU: shells, vectors, points and trained Gaussians.
 *
 *   depth_order.h  elements of clouds, front to back    once per frame
 *   set_up_splats  voxel or element ─► record, tiles    ┐ splat_list/set_up.c, cloud/set_up.c
 *   bins.h         records by tile, in order            │ per batch
 *   draw_splats    ─► image, or fragments               ┘ splat_list/tile.c
 *
 * The processor sorts voxels (draw/layers/splat_list/order.h) and uploads them for each frame: 24
 * bytes each. Elements of clouds stay on the GPU. For levels of detail the processor chooses some
 * of them: 4 bytes each.
 */
#ifndef GL_SPLAT_LAYERS_H
#define GL_SPLAT_LAYERS_H

#include "backend/gl/band.h"

enum {
    GL_SPLAT_ROUNDS = 16,      /* most loop rounds of a pixel per splat */
    GL_SPLAT_RECORD_BYTES = 80 /* largest size of a record, without its span */
};

/* The layers of a frame that have splats. */
struct gl_splat_layers {
    unsigned count;
    struct gl_splats {
        const struct gl_splats_made *made;
        const struct gl_buffer *constants, *order, *choice, *elements, *harmonics;
    } items[SP_LAYERS_MAX];
    bool is_alone;  /* the frame has nothing else: splats are composited and make no fragments */
    bool is_sorted; /* the elements of clouds are sorted */
    uint32_t dispatches; /* per band */
    uint32_t words;      /* words of four that a pixel keeps between dispatches; 0 = none */
};

/* Uploads the data of the layers. SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED,
 * SP_ERR_UNSUPPORTED. A context must be current, here and below. */
bool gl_splat_layers_begin(struct gl_splat_layers *layers, const struct gl_band *band,
                           struct sp_error *err);

/* Divides the layers into dispatches. */
void gl_splat_layers_divide(struct gl_splat_layers *layers, const struct gl_pieces *pieces);

/* Reserves memory for the records of a band. SP_ERR_MEMORY, SP_ERR_BUDGET. */
bool gl_splat_layers_reserve(const struct gl_splat_layers *layers, const struct gl_band *band,
                             struct sp_error *err);

/* Adds the layers to a band that was started. SP_ERR_CANCELLED, SP_ERR_BACKEND. */
bool gl_splat_layers_draw(struct gl_splat_layers *layers, struct gl_band *band,
                          struct sp_error *err);

void gl_splat_layers_finish(struct gl_state *state);

#endif
