/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/surface/focus.h"

#include <math.h>

#include "data/volume/grid.h"

void sp_surface_focus_place(const struct sp_surface_focus *focus, const uint32_t corner[3],
                            uint32_t cells, struct sp_surface_frame_cell *out) {
    const struct sp_ewa_frame *f = focus->frame;
    double at[3], length[3];
    for (unsigned a = 0; a < 3; a++) {
        const uint32_t last = f->grid->dims[a] - 1, end = corner[a] + cells;
        at[a] = sp_grid_distance(f->grid, a, corner[a]) / f->grid->spacing[a];
        length[a] =
            sp_grid_distance(f->grid, a, end < last ? end : last) / f->grid->spacing[a] - at[a];
    }
    for (int r = 0; r < 3; r++) {
        double u = f->base[r];
        for (int a = 0; a < 3; a++) {
            u += f->step_hi[r][a] * at[a];
            out->edges[a][r] = (float)(f->step_hi[r][a] * length[a]);
        }
        out->u[r] = (float)u;
    }
}

/* False if the image shows nothing of the ball around u. Kernels reach a little farther: less than
 * the margin of ratio_max. */
static bool is_in_image(const struct sp_ewa_frame *f, const float u[3], float radius) {
    const float depth = u[2] + radius;
    return depth > 0.5f * f->near && fabsf(u[0]) - radius < f->ratio_max[0] * depth &&
           fabsf(u[1]) - radius < f->ratio_max[1] * depth;
}

static float bounded(float size, float least) {
    return size < 1 ? size > least ? size : least : 1;
}

void sp_surface_focus_sizes(const struct sp_surface_focus *focus,
                            const struct sp_surface_frame_cell *cell, const float start[3],
                            const float size[3], float sizes[2]) {
    float u[3], square = 0, reach = 0;
    for (int r = 0; r < 3; r++) {
        float half = 0;
        u[r] = cell->u[r];
        for (int a = 0; a < 3; a++) {
            u[r] += cell->edges[a][r] * (start[a] + size[a] / 2);
            half += fabsf(cell->edges[a][r] * size[a] / 2);
        }
        square += u[r] * u[r];
        reach += half * half;
    }
    const float distance = sqrtf(square), radius = sqrtf(reach);
    const bool is_seen = is_in_image(focus->frame, u, radius);
    sizes[0] = is_seen ? bounded(focus->growth * (distance - radius), focus->least) : 1;
    sizes[1] = is_seen ? bounded(focus->growth * (distance + radius), focus->least) : 1;
}

void sp_surface_focus_block(const struct sp_surface_focus *focus, const uint32_t corner[3],
                            float sizes[2]) {
    const float start[3] = { 0 }, size[3] = { 1, 1, 1 };
    struct sp_surface_frame_cell block;
    sp_surface_focus_place(focus, corner, SURFACE_BLOCK, &block);
    sp_surface_focus_sizes(focus, &block, start, size, sizes);
}
