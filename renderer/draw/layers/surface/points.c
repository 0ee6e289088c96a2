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

uint64_t sp_surface_points_words(const struct sp_surface_points *points) {
    return array_length(points->count) * ARRAYS;
}

void sp_surface_points_lay_out(struct sp_surface_points *points, uint16_t *memory) {
    const uint64_t length = array_length(points->count);
    for (int a = 0; a < 3; a++) {
        points->at[a] = memory + length * (uint64_t)a;
        points->area[a] = (int16_t *)memory + length * (uint64_t)(3 + a);
        points->normal[a] = (int16_t *)memory + length * (uint64_t)(6 + a);
    }
    points->bend = (int16_t *)memory + length * 9;
}

bool sp_surface_points_allocate(struct sp_surface_points *points) {
    uint16_t *all = calloc(sp_surface_points_words(points), sizeof *all);
    if (all)
        sp_surface_points_lay_out(points, all);
    return all;
}

/* Cells that are longer than wide are split into nearly even parts: kernels as long as they are
 * would stick out of curved surfaces. */
void sp_surface_points_split(const struct sp_grid *grid, uint8_t split[3]) {
    double least = fmin(grid->spacing[0], fmin(grid->spacing[1], grid->spacing[2]));
    for (int a = 0; a < 3; a++)
        split[a] = (uint8_t)fmin(rint(grid->spacing[a] / least), SURFACE_SPLIT_MAX);
}
