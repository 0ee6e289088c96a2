/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/footprints/tile_depth.h"

void sp_tile_depth_add(struct sp_tile *tile, int pixel, float share, float z) {
    struct sp_tile_depth *depth = tile->depth;
    float base, factor, *moment[2] = { &depth->moment[0][0][0], &depth->moment[1][0][0] };
    sp_layer_places_row(depth->places, tile->x + pixel % SP_TILE, tile->y + pixel / SP_TILE, 1,
                        &base, &factor);
    const float d = (z - base) / factor;
    if (isnan(depth->origin))
        depth->origin = d;
    moment[0][pixel] += share * (d - depth->origin);
    moment[1][pixel] += share * (d - depth->origin) * (d - depth->origin);
}
