/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>

#include "draw/postconv/shear_tile.h"
#include "frame/resolve.h"
#include "splat/exp2.h"

enum { W = SP_WIDE };
_Static_assert(SHEAR_WIDTH % 16 == 0 && SHEAR_PITCH % 16 == 0, "whole vectors");
_Static_assert(SHEAR_MARGIN % SHEAR_BLOCK == 0 && SHEAR_ROWS % SHEAR_BLOCK == 0, "whole blocks");
_Static_assert(SHEAR_TAPS < SHEAR_BLOCK, "a filter reaches the next block at most");

/* Finds where deposits matter to samples that are not opaque. */
static void find_needed(struct sp_shear_open_tile *t) {
    int blocks = t->shear->tile[1] / SHEAR_BLOCK + 2 * t->reach;
    for (int b = 0; b < blocks; b++) {
        uint32_t live = 0;
        for (int n = b - t->reach; n <= b + t->reach; n++)
            live |= n >= 0 && n < blocks ? t->live[n] : 0;
        t->needed[b] = sp_shear_to_scratch(t, live);
    }
}

void sp_shear_start_tile(struct sp_shear_open_tile *t) {
    const struct sp_shear *shear = t->shear;
    struct sp_shear_scratch *s = t->scratch;
    memset(s->done, 0, sizeof s->done);
    for (int y = 0; y < shear->tile[1]; y++)
        for (int x = 0; x < shear->tile[0]; x++) {
            float a = (float)((t->x + shear->margin + x - shear->centre[0]) / shear->unit[0]);
            float b = (float)((t->y + shear->margin + y - shear->centre[1]) / shear->unit[1]);
            s->length[y][x] = shear->length * sqrtf(1 + a * a + b * b);
            s->done[y][3][x] = 1;
        }
    t->distance = 0;
    for (int b = 0; b < shear->tile[1] / SHEAR_BLOCK; b++)
        t->live[b + t->reach] = (UINT32_C(1) << shear->tile[0] / 16) - 1;
    find_needed(t);
}

/* Writes the weights of filters of a variance per four columns. */
static void make_row(const struct sp_shear_open_tile *t, const float *variance,
                     float (*at)[SHEAR_PITCH], int *taps) {
    const struct sp_shear *shear = t->shear;
    float most = 0;
    for (int x = 0; x < t->columns; x += 4)
        most = variance[x] > most ? variance[x] : most;
    int last = (int)(most * POSTCONV_STEPS) + 1;
    int reach = shear->taps[last < POSTCONV_FILTERS ? last : POSTCONV_FILTERS - 1];
    reach = reach < SHEAR_TAPS ? reach : SHEAR_TAPS;
    *taps = reach > *taps ? reach : *taps;
    for (int x = 0; x < t->columns; x += 4) {
        float v = variance[x] > 0 ? variance[x] * POSTCONV_STEPS : 0;
        int n = v < POSTCONV_FILTERS - 2 ? (int)v : POSTCONV_FILTERS - 2;
        float part = v - (float)n < 1 ? v - (float)n : 1;
        const float *low = shear->filter[n], *high = shear->filter[n + 1];
        for (int k = 0; k <= SHEAR_TAPS; k++) {
            float w = k <= reach ? low[k] + part * (high[k] - low[k]) : 0;
            for (int i = 0; i < 4; i++)
                at[k][x + i] = w;
        }
    }
}

void sp_shear_make_weights(struct sp_shear_open_tile *t, double distance) {
    struct sp_shear_scratch *s = t->scratch;
    t->distance = distance;
    s->diagonal.taps = s->horizontal.taps = s->vertical.taps = 0;
    for (int b = 0; b * SHEAR_BLOCK < t->shear->tile[1] + 2 * t->shear->margin; b++) {
        _Alignas(64) float variance[3][SHEAR_PITCH];
        for (int x = 0; x < t->columns; x += 4) {
            double r[3];
            sp_shear_residual(t->shear, t->x + x + 1.5,
                              t->y + b * SHEAR_BLOCK + 0.5 * (SHEAR_BLOCK - 1), distance, r);
            /* One sign for 16 columns: where it changes, the covariance is tiny. */
            if (x % 16 == 0)
                s->sign[b][x / 16] = r[2] < 0 ? -1 : 1;
            double cross = fmax(0, r[2] * s->sign[b][x / 16]);
            variance[0][x] = (float)(r[0] - cross);
            variance[1][x] = (float)(r[1] - cross);
            variance[2][x] = (float)cross;
        }
        make_row(t, variance[0], s->horizontal.at[b], &s->horizontal.taps);
        make_row(t, variance[1], s->vertical.at[b], &s->vertical.taps);
        make_row(t, variance[2], s->diagonal.at[b], &s->diagonal.taps);
    }
}

/* Filters one block of rows of one vector of columns, in four planes. Samples on both sides of the
 * middle, `step` floats apart, have the same weight. */
static inline void filter_block(const float *from, float *to, int step, int pitch, int to_pitch,
                                const float (*at)[SHEAR_PITCH], int taps, int rows) {
    sp_wide weight[SHEAR_TAPS + 1];
    for (int k = 0; k <= taps; k++)
        weight[k] = sp_wide_load(at[k]);
    for (int n = 0; n < 4 * rows; n++, from += pitch, to += to_pitch) {
        sp_wide sum = weight[0] * sp_wide_load(from);
        for (int k = 1; k <= taps; k++)
            sum += weight[k] * (sp_wide_load(from + k * step) + sp_wide_load(from - k * step));
        sp_wide_store(to, sum);
    }
}

/* Calls with a number of taps that the compiler knows. */
static void filter_rows(const float *from, float *to, int step, int pitch, int to_pitch,
                        const float (*at)[SHEAR_PITCH], int taps, int rows) {
    switch (taps) {
    case 0:
        filter_block(from, to, step, pitch, to_pitch, at, 0, rows);
        break;
    case 1:
        filter_block(from, to, step, pitch, to_pitch, at, 1, rows);
        break;
    case 2:
        filter_block(from, to, step, pitch, to_pitch, at, 2, rows);
        break;
    case 3:
        filter_block(from, to, step, pitch, to_pitch, at, 3, rows);
        break;
    case 4:
        filter_block(from, to, step, pitch, to_pitch, at, 4, rows);
        break;
    case 5:
        filter_block(from, to, step, pitch, to_pitch, at, 5, rows);
        break;
    case 6:
        filter_block(from, to, step, pitch, to_pitch, at, 6, rows);
        break;
    default:
        filter_block(from, to, step, pitch, to_pitch, at, SHEAR_TAPS, rows);
    }
}

/* (1 − exp(−d))/d for d ≥ 0: the share of its own light that a sheet lets through. */
static inline sp_wide mean_transmittance(sp_wide d) {
    sp_wide series = 1.0f / 5040 - d * (1.0f / 40320);
    series = 1.0f / 120 - d * (1.0f / 720 - d * series);
    series = 1.0f - d * (0.5f - d * (1.0f / 6 - d * (1.0f / 24 - d * series)));
    sp_wide_mask thick = sp_wide_lt(sp_wide_all(1), d);
    if (!sp_wide_any(thick))
        return series;
    sp_wide e = sp_wide_exp2(d * -SP_LOG2E);
    return sp_wide_select(thick, (1.0f - e) / sp_wide_max(d, sp_wide_all(1)), series);
}

/* Composites a block of rows of one vector of columns. */
static void composite(struct sp_shear_scratch *s, const float (*sheet)[W], int y, int x) {
    for (int end = y + SHEAR_BLOCK; y < end; y++, sheet += 4) {
        sp_wide length = sp_wide_load(&s->length[y][x]);
        sp_wide depth = sp_wide_max(length * sp_wide_load(sheet[3]), sp_wide_all(0));
        sp_wide through = sp_wide_load(&s->done[y][3][x]), f = mean_transmittance(depth);
        sp_wide share = f * through * length;
        for (int c = 0; c < 3; c++) {
            float *done = &s->done[y][c][x];
            sp_wide_store(done, sp_wide_load(done) + share * sp_wide_load(sheet[c]));
        }
        sp_wide_store(&s->done[y][3][x], through * sp_wide_max(1.0f - depth * f, sp_wide_all(0)));
    }
}

enum { ROW = 4 * SHEAR_PITCH };

/* Weights of a block of rows from column x on. */
static inline const float (*weights_at(const struct sp_shear_weights *w, int block,
                                       int x))[SHEAR_PITCH] {
    return (const float(*)[SHEAR_PITCH])(const void *)&w->at[block][0][x];
}

/* Filters columns of a block of rows of the grid along the diagonals. Near the first and the last
 * row filters are shorter; no pixel of the tile needs these rows. */
static void filter_diagonally(const struct sp_shear_open_tile *t, int y, uint32_t columns) {
    struct sp_shear_scratch *s = t->scratch;
    int taps = s->diagonal.taps, b = y / SHEAR_BLOCK;
    int rows = t->shear->tile[1] + 2 * t->shear->margin;
    for (; columns; columns &= columns - 1) {
        int first = __builtin_ctz(columns) * 16, step = ROW + s->sign[b][first / 16];
        for (int x = first; x < first + 16 && x < t->columns; x += W) {
            const float(*at)[SHEAR_PITCH] = weights_at(&s->diagonal, b, x);
            if (y > taps && y + SHEAR_BLOCK + taps < rows) {
                filter_rows(&s->grid[y][0][x], &s->block[0][0][x], step, SHEAR_PITCH, SHEAR_PITCH,
                            at, taps, SHEAR_BLOCK);
                continue;
            }
            for (int n = y; n < y + SHEAR_BLOCK; n++) {
                int edge = n < rows - 1 - n ? n : rows - 1 - n;
                int reach = edge > taps ? taps : edge > 1 ? edge - 1 : 0;
                filter_rows(&s->grid[n][0][x], &s->block[n - y][0][x], step, SHEAR_PITCH,
                            SHEAR_PITCH, at, reach, 1);
            }
        }
    }
}

/* Filters columns of a block of rows across. */
static void filter_across(const struct sp_shear_open_tile *t, int y, const float *from,
                          uint32_t columns) {
    struct sp_shear_scratch *s = t->scratch;
    int margin = t->shear->margin;
    for (; columns; columns &= columns - 1) {
        int first = __builtin_ctz(columns) * 16;
        for (int x = first; x < first + 16; x += W)
            filter_rows(from + margin + x, &s->across[y][0][x], 1, SHEAR_PITCH, SHEAR_WIDTH,
                        weights_at(&s->horizontal, y / SHEAR_BLOCK, margin + x), s->horizontal.taps,
                        SHEAR_BLOCK);
    }
}

/* Filters columns of a block of rows down and composites them. */
static void finish_block(const struct sp_shear_open_tile *t, int y, uint32_t columns) {
    struct sp_shear_scratch *s = t->scratch;
    int margin = t->shear->margin;
    for (; columns; columns &= columns - 1) {
        int first = __builtin_ctz(columns) * 16;
        for (int x = first; x < first + 16; x += W) {
            _Alignas(64) float sheet[SHEAR_BLOCK * 4][W];
            filter_rows(&s->across[y][0][x], sheet[0], 4 * SHEAR_WIDTH, SHEAR_WIDTH, W,
                        weights_at(&s->vertical, y / SHEAR_BLOCK, margin + x), s->vertical.taps,
                        SHEAR_BLOCK);
            composite(s, sheet, y - margin, x);
        }
    }
}

/* Clears the touched part of the grid. */
static void clear_grid(struct sp_shear_open_tile *t, int blocks) {
    for (int b = 0; b < blocks; b++) {
        for (uint32_t m = t->touched[b]; m; m &= m - 1)
            for (int y = b * SHEAR_BLOCK; y < (b + 1) * SHEAR_BLOCK; y++)
                for (int p = 0; p < 4; p++)
                    memset(&t->scratch->grid[y][p][__builtin_ctz(m) * 16], 0, 16 * sizeof(float));
        t->touched[b] = 0;
    }
}

void sp_shear_close_layer(struct sp_shear_open_tile *t) {
    struct sp_shear_scratch *s = t->scratch;
    int blocks = t->shear->tile[1] / SHEAR_BLOCK + 2 * t->reach;
    uint32_t done[SHEAR_BLOCKS + 2] = { 0 }; /* by block + 1: columns of the tile */
    for (int b = t->reach; b < blocks - t->reach; b++) {
        for (int n = b - t->reach; n <= b + t->reach; n++)
            done[b + 1] |= t->touched[n];
        done[b + 1] = sp_shear_to_tile(t, done[b + 1]) & t->live[b];
    }
    for (int b = 0; b < blocks; b++) {
        uint32_t columns = done[b] | done[b + 1] | done[b + 2];
        int y = b * SHEAR_BLOCK;
        const float *from = s->grid[y][0];
        if (columns && s->diagonal.taps) {
            filter_diagonally(t, y, sp_shear_to_scratch(t, columns));
            from = s->block[0][0];
        }
        filter_across(t, y, from, columns);
        if (b > 0)
            finish_block(t, y - SHEAR_BLOCK, done[b]);
    }
    clear_grid(t, blocks);
}

bool sp_shear_is_visible(struct sp_shear_open_tile *t) {
    uint32_t any = 0;
    for (int b = 0; b < t->shear->tile[1] / SHEAR_BLOCK; b++) {
        uint32_t *live = &t->live[b + t->reach], left = 0;
        for (uint32_t m = *live; m; m &= m - 1) {
            int first = __builtin_ctz(m) * 16;
            sp_wide most = sp_wide_all(0);
            for (int y = b * SHEAR_BLOCK; y < (b + 1) * SHEAR_BLOCK; y++)
                for (int x = first; x < first + 16; x += W)
                    most = sp_wide_max(most, sp_wide_load(&t->scratch->done[y][3][x]));
            if (sp_wide_any(sp_wide_le(sp_wide_all(SP_TRANSMITTANCE_MIN), most)))
                left |= m & -m;
        }
        any |= *live = left;
    }
    find_needed(t);
    return any != 0;
}

void sp_shear_finish_tile(const struct sp_shear_open_tile *t) {
    const struct sp_shear *shear = t->shear;
    int left = t->x + shear->margin, top = t->y + shear->margin;
    for (int y = 0; y < shear->tile[1] && top + y < shear->size[1]; y++)
        for (int x = 0; x < shear->tile[0] && left + x < shear->size[0]; x++) {
            float *to = shear->plane +
                        4 * ((size_t)(top + y) * (size_t)shear->size[0] + (size_t)(left + x));
            for (int c = 0; c < 4; c++)
                to[c] = t->scratch->done[y][c][x];
        }
}
