/* SPDX-License-Identifier: Apache-2.0 */
#include "surface/window.h"

#include <math.h>

#include "volume/grid.h"

/* Scales values so that the largest difference from the iso-value is about 2: neither squares nor
 * differences overflow. Halves keep the largest doubles finite. */
static double find_scale(const struct sp_volume_info *info, double value) {
    double scale =
        2 / fmax(fabs(info->range[1] / 2 - value / 2), fabs(info->range[0] / 2 - value / 2));
    return scale < (double)INFINITY ? scale : 1;
}

/* The part of a row that is inside the volume: samples [from, to) of the window. */
struct part {
    int from, to;
    uint64_t first; /* sample of the volume at `from` */
};

#define READ(name, type)                                                                           \
    case name: {                                                                                   \
        const type *from = (const type *)sp_volume_voxels(volume) + part->first;                   \
        for (int x = part->from; x < part->to; x++) {                                              \
            float f = (float)(((double)from[x - part->from] / 2 - value / 2) * scale);             \
            row[x] = fabsf(f) < INFINITY ? f : NAN;                                                \
        }                                                                                          \
    } break

static void read_row(float *row, const struct sp_volume *volume, const struct part *part,
                     double value, double scale) {
    for (int x = 0; x < SURFACE_WINDOW; x++)
        row[x] = NAN;
    switch (sp_volume_info(volume)->type) {
        READ(SP_UINT8, uint8_t);
        READ(SP_INT8, int8_t);
        READ(SP_UINT16, uint16_t);
        READ(SP_INT16, int16_t);
        READ(SP_INT32, int32_t);
        READ(SP_FLOAT32, float);
        READ(SP_FLOAT64, double);
    case SP_TYPE_COUNT:
        break;
    }
}
#undef READ

void sp_surface_window_read(struct sp_surface_window *window, const struct sp_volume *volume,
                            double value, const uint32_t corner[3]) {
    const struct sp_grid *grid = &sp_volume_info(volume)->grid;
    const double scale = find_scale(sp_volume_info(volume), value);
    int from[3], to[3];
    for (unsigned a = 0; a < 3; a++) {
        int64_t last = (int64_t)grid->dims[a] - corner[a] + 1;
        from[a] = corner[a] ? 0 : 1;
        to[a] = last < SURFACE_WINDOW ? (int)last : SURFACE_WINDOW;
        for (int i = 0; i < SURFACE_WINDOW; i++) {
            int64_t k = (int64_t)corner[a] + i - 1;
            bool has_next = k >= 0 && k + 1 < (int64_t)grid->dims[a];
            window->gap[a][i] = has_next ? (float)(sp_grid_distance(grid, a, (uint32_t)k + 1) -
                                                   sp_grid_distance(grid, a, (uint32_t)k))
                                         : 1;
        }
    }
    for (int z = 0; z < SURFACE_WINDOW; z++)
        for (int y = 0; y < SURFACE_WINDOW; y++) {
            bool is_inside = z >= from[2] && z < to[2] && y >= from[1] && y < to[1];
            struct part part = { from[0], is_inside ? to[0] : from[0], 0 };
            if (is_inside)
                part.first = (((uint64_t)corner[2] + (uint64_t)z - 1) * grid->dims[1] + corner[1] +
                              (uint64_t)y - 1) *
                                 grid->dims[0] +
                             corner[0] + (uint64_t)from[0] - 1;
            read_row(window->f[z][y], volume, &part, value, scale);
        }
}

static float slope_along(float before, float here, float after, const float gap[2]) {
    float low = (here - before) / gap[0], high = (after - here) / gap[1];
    bool has_low = fabsf(low) < INFINITY, has_high = fabsf(high) < INFINITY;
    if (has_low && has_high) /* of the parabola through the three */
        return (low * gap[1] + high * gap[0]) / (gap[0] + gap[1]);
    return has_low ? low : has_high ? high : 0;
}

void sp_surface_window_slope(const struct sp_surface_window *window, int x, int y, int z,
                             float slope[3]) {
    const float *here = &window->f[z + 1][y + 1][x + 1];
    const int step[3] = { 1, SURFACE_WINDOW, SURFACE_WINDOW * SURFACE_WINDOW };
    const int at[3] = { x, y, z };
    for (int a = 0; a < 3; a++)
        slope[a] = slope_along(here[-step[a]], *here, here[step[a]], &window->gap[a][at[a]]);
}
