/* SPDX-License-Identifier: Apache-2.0
 *
 * Doubles the samples of a slice along both axes. A sample between two others is the value of the
 * polynomial of degree 5 through its six neighbours,
 *
 *   (3, −25, 150, 150, −25, 3)/256
 *
 * so samples keep their values and thin structures keep their contrast. A sheet half way between
 * two slices is made from six slices in the same way.
 */
#include <math.h>
#include <string.h>

#include "resample/fetch.h"
#include "resample/kernels.h"
#include "volume/sample.h"

enum {
    ACROSS = RESAMPLE_CELL_ACROSS,
    DOWN = RESAMPLE_CELL_DOWN,
    TAPS = 6,
    ROWS = DOWN + TAPS - 1,
    ROW = ACROSS == 8 ? 16 : 32 /* ACROSS + TAPS − 1 and what the last vector reads */
};

static const float tap[3] = { 150 / 256.0f, -25 / 256.0f, 3 / 256.0f };

struct blend { /* the slices that a sheet is made from */
    int count;
    size_t slice[TAPS]; /* where the slices begin [samples] */
    float share[TAPS];
    float weight[TAPS]; /* share times the levels per unit */
    float start;        /* level of value 0 */
};

static inline int clamp(int i, int count) {
    return i < 0 ? 0 : i >= count ? count - 1 : i;
}

static void init_blend(const struct sp_resample_open_tile *t, float z, struct blend *blend) {
    const struct sp_curve *curve = &t->r->curve;
    int whole = (int)floorf(z), first = z > (float)whole ? whole - 2 : whole;
    blend->count = z > (float)whole ? TAPS : 1;
    blend->start = (float)(CURVE_LEVEL_MIN - curve->base * curve->levels_per_unit);
    for (int k = 0; k < blend->count; k++) {
        blend->share[k] = blend->count == 1 ? 1 : tap[k < 3 ? 2 - k : k - 3];
        blend->slice[k] = (size_t)clamp(first + k, t->dims[2]) * t->stride[2];
        blend->weight[k] = blend->share[k] * (float)curve->levels_per_unit;
    }
}

/* Reads ROW samples of narrow integers. `at`: their places in the line; NULL = one after the
 * other. */
#define READ(type, fetch)                                                                          \
    do {                                                                                           \
        const type *from[TAPS] = { NULL };                                                         \
        type parts[TAPS][ROW];                                                                     \
        for (int k = 0; k < blend->count; k++) {                                                   \
            from[k] = (const type *)t->voxels + line + blend->slice[k];                            \
            for (int i = 0; at && i < ROW; i++)                                                    \
                parts[k][i] = from[k][at[i]];                                                      \
            from[k] = at ? parts[k] : from[k];                                                     \
        }                                                                                          \
        for (int i = 0; i < ROW; i += SP_WIDE) {                                                   \
            sp_wide sum = blend->weight[0] * fetch(from[0] + i) + blend->start;                    \
            for (int k = 1; k < blend->count; k++)                                                 \
                sum += blend->weight[k] * fetch(from[k] + i);                                      \
            sp_wide_store(out + i, sum);                                                           \
        }                                                                                          \
    } while (0)

/* The same for types that a float may not hold exactly. Samples that are not finite become
 * CURVE_LEVEL_NONE. */
static void read_wide(const struct sp_resample_open_tile *t, const struct blend *blend, size_t line,
                      const ptrdiff_t *at, float *out) {
    const struct sp_curve *curve = &t->r->curve;
    for (int i = 0; i < ROW; i++) {
        out[i] = 0;
        for (int k = 0; k < blend->count; k++) {
            size_t place = line + blend->slice[k] + (size_t)(at ? at[i] : i);
            double x = sp_sample(t->voxels, t->r->samples->type, place);
            double level = (x - curve->base) * curve->levels_per_unit + CURVE_LEVEL_MIN;
            if (isfinite(x)) /* far beyond all levels, a float would lose what is near them */
                out[i] += blend->share[k] * (float)fmin(fmax(level, -1e6), 1e6);
        }
    }
}

static void read_row(const struct sp_resample_open_tile *t, const struct blend *blend, size_t line,
                     const ptrdiff_t *at, float out[ROW]) {
    switch (t->r->samples->type) {
    case SP_UINT8:
        READ(uint8_t, sp_fetch_uint8);
        break;
    case SP_INT8:
        READ(int8_t, sp_fetch_int8);
        break;
    case SP_UINT16:
        READ(uint16_t, sp_fetch_uint16);
        break;
    case SP_INT16:
        READ(int16_t, sp_fetch_int16);
        break;
    default:
        read_wide(t, blend, line, at, out);
    }
}

/* Reads the rows around the cell at (u, v), in levels. */
static void read_rows(const struct sp_resample_open_tile *t, const struct blend *blend, int u,
                      int v, float rows[ROWS][ROW]) {
    ptrdiff_t at[ROW];
    bool is_run = t->stride[0] == 1 && u >= 2 && u - 2 + ROW <= t->dims[0];
    for (int i = 0; i < ROW && !is_run; i++)
        at[i] = (ptrdiff_t)((size_t)clamp(u - 2 + i, t->dims[0]) * t->stride[0]);
    for (int j = 0; j < ROWS; j++) {
        size_t line = (size_t)clamp(v - 2 + j, t->dims[1]) * t->stride[1];
        if (is_run)
            read_row(t, blend, line + (size_t)(u - 2), NULL, rows[j]);
        else
            read_row(t, blend, line, at, rows[j]);
    }
}

/* The value between p[2·step] and p[3·step]. */
static inline sp_wide between(const float *p, int step) {
    sp_wide sum = (sp_wide_load(p + 2 * step) + sp_wide_load(p + 3 * step)) * tap[0];
    sum += (sp_wide_load(p + step) + sp_wide_load(p + 4 * step)) * tap[1];
    return sum + (sp_wide_load(p) + sp_wide_load(p + 5 * step)) * tap[2];
}

static inline sp_wide_int to_level(sp_wide x, float lowest) {
    x = sp_wide_max(x, sp_wide_all(lowest));
    return sp_wide_to_int(sp_wide_min(x, sp_wide_all(CURVE_LEVEL_MAX)) + 0.5f);
}

/* Writes a row of refined samples: two 16-bit levels per lane. */
static inline void write_row(const float *row, float lowest, int16_t *out) {
    for (int i = 0; i < ACROSS; i += SP_WIDE) {
        sp_wide_int pair = to_level(sp_wide_load(row + 2 + i), lowest);
        pair |= to_level(between(row + i, 1), lowest) << 16;
        memcpy(out + 2 * i, &pair, sizeof pair);
    }
}

static void refine_cell(const struct sp_resample_open_tile *t, struct sp_resample_sheet *sheet,
                        const struct blend *blend, int u, int v) {
    _Alignas(64) float rows[ROWS][ROW], filtered[DOWN][ROW];
    read_rows(t, blend, u, v, rows);
    int16_t *out = sheet->refined + (ptrdiff_t)(2 * (v - sheet->origin[1])) * sheet->width +
                   2 * (u - sheet->origin[0]);
    for (int j = 0; j < DOWN; j++)
        for (int i = 0; i < ROW; i += SP_WIDE)
            sp_wide_store(filtered[j] + i, between(rows[j] + i, ROW));
    for (int j = 0; j < DOWN; j++, out += 2 * sheet->width) {
        write_row(rows[j + 2], t->r->lowest, out);
        write_row(filtered[j], t->r->lowest, out + sheet->width);
    }
    t->scratch->refined += ACROSS * DOWN;
}

/* The cells that a block sees: first and last, per axis. Gradients look half a sample farther, and
 * interpolation one refined sample. */
static void find_cells(const struct sp_resample_open_tile *t, const struct sp_resample_block *block,
                       float s, int first[2], int last[2]) {
    static const float size[2] = { ACROSS, DOWN };
    float min[2], max[2], margin = t->r->needs_gradient ? 1 : 0.5f;
    sp_resample_extent(t, block, s, min, max);
    for (int a = 0; a < 2; a++) {
        first[a] = (int)floorf((min[a] - (t->r->needs_gradient ? 0.5f : 0)) / size[a]);
        last[a] = (int)floorf((max[a] + margin) / size[a]);
    }
}

void sp_resample_refine(const struct sp_resample_open_tile *t, struct sp_resample_sheet *sheet,
                        uint64_t need, float z) {
    uint8_t *is_refined = t->scratch->is_refined;
    struct blend blend;
    int from[2] = { INT32_MAX, INT32_MAX }, to[2] = { INT32_MIN, INT32_MIN };
    int first[2], last[2];
    init_blend(t, z, &blend);
    for (uint64_t left = need; left; left &= left - 1) {
        find_cells(t, &t->scratch->blocks[__builtin_ctzll(left)], sheet->s, first, last);
        for (int a = 0; a < 2; a++) {
            from[a] = first[a] < from[a] ? first[a] : from[a];
            to[a] = last[a] > to[a] ? last[a] : to[a];
        }
    }
    int across = to[0] - from[0] + 1, down = to[1] - from[1] + 1;
    sheet->width = 2 * ACROSS * across + 16; /* not a power of two, which would crowd the cache */
    sheet->origin[0] = from[0] * ACROSS;
    sheet->origin[1] = from[1] * DOWN;
    sheet->last[0] = 2 * ACROSS * across - 2;
    sheet->last[1] = 2 * DOWN * down - 2;
    memset(is_refined, 0, (size_t)across * (size_t)down);
    for (uint64_t left = need; left; left &= left - 1) {
        find_cells(t, &t->scratch->blocks[__builtin_ctzll(left)], sheet->s, first, last);
        for (int j = first[1]; j <= last[1]; j++)
            for (int i = first[0]; i <= last[0]; i++) {
                uint8_t *done = &is_refined[(j - from[1]) * across + i - from[0]];
                if (!*done)
                    refine_cell(t, sheet, &blend, i * ACROSS, j * DOWN);
                *done = 1;
            }
    }
}
