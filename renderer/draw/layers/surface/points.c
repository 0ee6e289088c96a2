/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/surface/points.h"

#include <math.h>
#include <stdlib.h>

enum { ARRAYS = 10 }; /* of 16 bits per point */

void sp_surface_points_finish(struct sp_surface_points *points) {
    free(points->blocks);
    free(points->at[0]); /* one allocation holds all arrays */
    *points = (struct sp_surface_points){ 0 };
}

static uint64_t array_length(uint64_t count) {
    return count + SURFACE_POINTS_BEYOND;
}

uint64_t sp_surface_points_bytes(const struct sp_surface_points *points) {
    return points->blocks ? array_length(points->count) * ARRAYS * sizeof(uint16_t) +
                                points->block_count * sizeof(struct sp_surface_block)
                          : 0;
}

bool sp_surface_points_allocate(struct sp_surface_points *points) {
    uint64_t length = array_length(points->count);
    uint16_t *all = calloc(length * ARRAYS, sizeof *all);
    for (int a = 0; all && a < 3; a++) {
        points->at[a] = all + length * (uint64_t)a;
        points->area[a] = (int16_t *)all + length * (uint64_t)(3 + a);
        points->normal[a] = (int16_t *)all + length * (uint64_t)(6 + a);
    }
    points->bend = all ? (int16_t *)all + length * 9 : NULL;
    return all;
}

/* Cells that are longer than wide are split into nearly even parts: kernels as long as they are
 * would stick out of curved surfaces. */
void sp_surface_points_split(const struct sp_grid *grid, uint8_t split[3]) {
    double least = fmin(grid->spacing[0], fmin(grid->spacing[1], grid->spacing[2]));
    for (int a = 0; a < 3; a++)
        split[a] = (uint8_t)fmin(rint(grid->spacing[a] / least), SURFACE_SPLIT_MAX);
}
