/* SPDX-License-Identifier: Apache-2.0
 *
 * Depth of a tile's pixels (frame/depth.h): a layer counts at its middle (splat/layer_places.h). */
#ifndef SP_FOOTPRINTS_TILE_DEPTH_H
#define SP_FOOTPRINTS_TILE_DEPTH_H

#include <math.h>

#include "draw/footprints/tile.h"
#include "frame/depth.h"
#include "splat/layer_places.h"

/* The depth of a tile so far. */
struct sp_tile_depth {
    const struct sp_layer_places *places;
    _Alignas(64) float moment[2][SP_TILE][SP_TILE]; /* of d − origin */
    float origin;                                   /* NaN = nothing is shown yet */
};

/* Adds what one pixel of the tile shows at depth z; share: T α. */
void sp_tile_depth_add(struct sp_tile *tile, int pixel, float share, float z);

/* Returns d − origin of a layer. The first layer that shows something sets the origin. */
static inline float sp_tile_depth_at(struct sp_tile_depth *depth, uint32_t layer) {
    const float d = sp_layer_places_at(depth->places, layer);
    if (isnan(depth->origin))
        depth->origin = d;
    return d - depth->origin;
}

/* Adds what one pixel of the tile shows of a layer; share: T α. */
static inline void sp_tile_depth_add_layer(struct sp_tile_depth *depth, int pixel, float share,
                                           uint32_t layer) {
    const float d = sp_tile_depth_at(depth, layer);
    float *moment[2] = { &depth->moment[0][0][0], &depth->moment[1][0][0] };
    moment[0][pixel] += share * d;
    moment[1][pixel] += share * d * d;
}

#endif
