/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/surface/samples.h"

#include <math.h>
#include <string.h>

#include "base/wide.h"
#include "data/volume/grid.h"

/* From samples of the volume to numbers around 0. */
struct mapping {
    double value, scale;
    /* For samples of 8 and 16 bits: the smallest float from the iso-value on, which no sample lies
     * between. */
    float small_value, small_scale;
};

/* Scales values so that the largest difference from the iso-value is about 2: neither squares nor
 * differences overflow. Halves keep the largest doubles finite. */
static struct mapping compute_mapping(const struct sp_volume_info *info, double value) {
    double scale =
        2 / fmax(fabs(info->range[1] / 2 - value / 2), fabs(info->range[0] / 2 - value / 2));
    struct mapping m = { .value = value, .scale = scale < (double)INFINITY ? scale : 1 };
    m.small_value = (float)value;
    if ((double)m.small_value < value)
        m.small_value = nextafterf(m.small_value, INFINITY);
    m.small_scale = (float)(m.scale / 2);
    return m;
}

static inline float map_small(float x, const struct mapping *m) {
    return (x - m->small_value) * m->small_scale;
}

static inline float map_any(double x, const struct mapping *m) {
    float f = (float)((x / 2 - m->value / 2) * m->scale);
    return fabsf(f) < INFINITY ? f : NAN;
}

/* The part of a row that is inside the volume: samples [from, to) of the row. */
struct part {
    int from, to;
    uint64_t first; /* sample of the volume at `from` */
};

/* Whole rows have a length that the compiler knows. */
#define READ(name, type, map)                                                                      \
    case name: {                                                                                   \
        const type *from = (const type *)sp_volume_voxels(volume) + part->first;                   \
        type copy[SURFACE_SAMPLES_ROW] = { 0 };                                                    \
        if (part->to - part->from == SURFACE_SAMPLES)                                              \
            memcpy(copy, from, SURFACE_SAMPLES * sizeof *from);                                    \
        else                                                                                       \
            memcpy(copy + part->from, from, (size_t)(part->to - part->from) * sizeof *from);       \
        for (int x = 0; x < SURFACE_SAMPLES_ROW; x++)                                              \
            row[x] = map(copy[x], m);                                                              \
    } break

static void read_row(float row[SURFACE_SAMPLES_ROW], const struct sp_volume *volume,
                     const struct part *part, const struct mapping *m) {
    switch (sp_volume_info(volume)->type) {
        READ(SP_UINT8, uint8_t, map_small);
        READ(SP_INT8, int8_t, map_small);
        READ(SP_UINT16, uint16_t, map_small);
        READ(SP_INT16, int16_t, map_small);
        READ(SP_INT32, int32_t, map_any);
        READ(SP_FLOAT32, float, map_any);
        READ(SP_FLOAT64, double, map_any);
    case SP_TYPE_COUNT:
        break;
    }
    for (int x = 0; x < part->from; x++)
        row[x] = NAN;
    for (int x = part->to; x < SURFACE_SAMPLES; x++)
        row[x] = NAN;
}
#undef READ

void sp_surface_samples_read(struct sp_surface_samples *samples, const struct sp_volume *volume,
                             double value, const uint32_t corner[3]) {
    const struct sp_grid *grid = &sp_volume_info(volume)->grid;
    const struct mapping mapping = compute_mapping(sp_volume_info(volume), value);
    int from[3], to[3];
    for (unsigned a = 0; a < 3; a++) {
        int64_t last = (int64_t)grid->dims[a] - corner[a] + 1;
        from[a] = corner[a] ? 0 : 1;
        to[a] = last < SURFACE_SAMPLES ? (int)last : SURFACE_SAMPLES;
        for (int i = 0; i < SURFACE_SAMPLES_ROW; i++) {
            int64_t k = (int64_t)corner[a] + i - 1;
            bool has_next = k >= 0 && k + 1 < (int64_t)grid->dims[a];
            samples->gap[a][i] = has_next ? (float)(sp_grid_distance(grid, a, (uint32_t)k + 1) -
                                                    sp_grid_distance(grid, a, (uint32_t)k))
                                          : 1;
        }
    }
    for (int z = 0; z < SURFACE_SAMPLES; z++)
        for (int y = 0; y < SURFACE_SAMPLES; y++) {
            bool is_inside = z >= from[2] && z < to[2] && y >= from[1] && y < to[1];
            struct part part = { from[0], is_inside ? to[0] : from[0], 0 };
            if (is_inside)
                part.first = (((uint64_t)corner[2] + (uint64_t)z - 1) * grid->dims[1] + corner[1] +
                              (uint64_t)y - 1) *
                                 grid->dims[0] +
                             corner[0] + (uint64_t)from[0] - 1;
            read_row(samples->f[z][y], volume, &part, &mapping);
        }
}

void sp_surface_samples_compare(const struct sp_surface_samples *samples,
                                struct sp_surface_bits *out) {
    const sp_wide zero = sp_wide_all(0), infinity = sp_wide_all(INFINITY);
    for (int z = 0; z < SURFACE_SLOPES; z++)
        for (int y = 0; y < SURFACE_SLOPES; y++) {
            sp_wide_int inside = { 0 }, finite = { 0 };
            for (int x = 0; x < SURFACE_SLOPES; x += SP_WIDE) {
                sp_wide f = sp_wide_load(&samples->f[z + 1][y + 1][x + 1]);
                sp_wide_int bit = sp_wide_int_all(1 << x) << sp_wide_int_count();
                inside |= sp_wide_le(zero, f) & bit;
                finite |= sp_wide_lt(sp_wide_abs(f), infinity) & bit;
            }
            int32_t in = 0, good = 0;
            for (int i = 0; i < SP_WIDE; i++) {
                in |= inside[i];
                good |= finite[i];
            }
            out->inside[z][y] = in & ((1 << SURFACE_SLOPES) - 1);
            out->finite[z][y] = good & ((1 << SURFACE_SLOPES) - 1);
        }
}

/* Of the parabola through three samples, or of a line through two. gap: before and after. */
static inline sp_wide slope_along(sp_wide before, sp_wide here, sp_wide after, sp_wide inverse_low,
                                  sp_wide inverse_high, sp_wide share) {
    const sp_wide infinity = sp_wide_all(INFINITY);
    sp_wide low = (here - before) * inverse_low, high = (after - here) * inverse_high;
    sp_wide_mask has_low = sp_wide_lt(sp_wide_abs(low), infinity);
    sp_wide_mask has_high = sp_wide_lt(sp_wide_abs(high), infinity);
    low = sp_wide_select(has_low, low, sp_wide_keep(has_high, high));
    high = sp_wide_select(has_high, high, low);
    return low + share * (high - low);
}

void sp_surface_samples_slopes(const struct sp_surface_samples *samples,
                               struct sp_surface_slopes *out) {
    enum { ROW = SURFACE_SAMPLES_ROW };
    static const int steps[3] = { 1, ROW, ROW * SURFACE_SAMPLES };
    float inverse[3][ROW], share[3][ROW] = { { 0 } };
    for (int a = 0; a < 3; a++)
        for (int i = 0; i < ROW; i++) {
            inverse[a][i] = 1 / samples->gap[a][i];
            if (i)
                share[a][i] =
                    samples->gap[a][i - 1] / (samples->gap[a][i - 1] + samples->gap[a][i]);
        }
    float *to[3] = { out->along[0], out->along[1], out->along[2] };
    for (int z = 1; z <= SURFACE_SLOPES; z++)
        for (int y = 1; y <= SURFACE_SLOPES; y++) {
            const int at[3] = { 0, y, z };
            for (int x = 1; x <= SURFACE_SLOPES; x += SP_WIDE) {
                const float *f = &samples->f[z][y][x];
                const sp_wide here = sp_wide_load(f);
                for (int a = 0; a < 3; a++) {
                    const float *i = &inverse[a][at[a]], *s = &share[a][at[a]];
                    sp_wide slope =
                        slope_along(sp_wide_load(f - steps[a]), here, sp_wide_load(f + steps[a]),
                                    a ? sp_wide_all(i[-1]) : sp_wide_load(i + x - 1),
                                    a ? sp_wide_all(*i) : sp_wide_load(i + x),
                                    a ? sp_wide_all(*s) : sp_wide_load(s + x));
                    sp_wide_store(to[a] + x - 1, slope);
                }
            }
            for (int a = 0; a < 3; a++)
                to[a] += SURFACE_SLOPES_ROW;
        }
}
