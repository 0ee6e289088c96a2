/* SPDX-License-Identifier: Apache-2.0
 *
 * Where the layers of a frame's order lie, for the depth of its pixels (frame/depth.h). Layers are
 * thin, so all that a layer adds counts at its middle, which one number d gives for all pixels:
 *
 *   sheets            d = normal·u of the slice in camera space        z = d/(normal·ray)
 *   slabs and splats  d = distance from the eye of the layer's middle  z = d·cos(angle of the ray)
 */
#ifndef SP_SPLAT_LAYER_PLACES_H
#define SP_SPLAT_LAYER_PLACES_H

#include <stdbool.h>

#include "sp/volume.h"
#include "splat/camera.h"

struct sp_layer_places {
    const struct sp_camera_transform *camera;
    bool are_sheets;
    double normal[3];         /* of sheets, in camera space */
    const float *at;          /* of sheets: d by layer [world unit]; borrowed */
    float nearest, thickness; /* otherwise: where layer 0 begins, and its thickness [world unit] */
};

/* Starts the places of sheets along `axis`, and fills d[dims[axis]] by slice, not by layer. The
 * caller sets `at`. */
void sp_layer_places_init_sheets(struct sp_layer_places *places,
                                 const struct sp_camera_transform *camera,
                                 const struct sp_grid *grid, unsigned axis, float *d);

/* Returns d of a layer. */
static inline float sp_layer_places_at(const struct sp_layer_places *places, uint32_t layer) {
    return places->are_sheets ? places->at[layer]
                              : places->nearest + ((float)layer + 0.5f) * places->thickness;
}

/* Fills base and factor (z = base + factor·d) of `count` pixels of the image from (x, y) on. */
void sp_layer_places_row(const struct sp_layer_places *places, int x, int y, int count, float *base,
                         float *factor);

#endif
