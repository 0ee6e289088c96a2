/* SPDX-License-Identifier: Apache-2.0
 *
 * The mean extinction of each cell (extinction.c). Each sample is classified once per slice of
 * cells: its place and the integral up to there. The mean depth between two neighbours is then a
 * quotient of differences.
 *
 *   rows of samples ─► place, sum, mean of the bin ─► pairs along three axes ─► cells
 */
#include <math.h>

#include "base/wide.h"
#include "classify/transfer.h"
#include "data/volume/missing.h"
#include "data/volume/sample.h"
#include "draw/light/kernels.h"
#include "splat/exp2.h"

/* Of the samples along a row. A place in a bin is the bin's begin, as that of its sum. */
struct row {
    float *place, *sum, *mean; /* place NaN: the sample is not finite */
    float *value;              /* filled if the opacity depends on the gradient */
    bool is_clear;             /* sums and means are 0 */
};

struct worker {
    const struct sp_light_cells *c;
    struct row rows[LIGHT_PER_CELL_MAX + 1][LIGHT_PER_CELL_MAX + 1]; /* [across][along slices] */
    float *depth[LIGHT_PER_CELL_MAX][LIGHT_PER_CELL_MAX]; /* of the rows of a cell, by position */
    float *passed[3];                                     /* sums over columns along each axis */
    size_t count;                                         /* positions per row */
    uint32_t slice;
};

#define PLACE(type, real)                                                                          \
    for (size_t i = 0; i < count; i++) {                                                           \
        real at = ((real)((const type *)c->voxels)[first + i] - (real)c->low) * (real)scale;       \
        at = at < (real)-far ? (real)-far : at;                                                    \
        place[i] = (float)(at > (real)far ? (real)far : at);                                       \
    }

#define PLACE_SHORT(type)                                                                          \
    if (c->fits_floats)                                                                            \
        PLACE(type, float)                                                                         \
    else                                                                                           \
        PLACE(type, double)

/* Places of the samples from `first` on. Doubles where floats do not hold all values. */
static void compute_places(const struct sp_light_cells *c, uint64_t first, size_t count,
                           float *place) {
    const double far = 1e9, scale = c->per_unit;
    switch (c->info->type) {
        SP_SHORT_CASES(PLACE_SHORT)
    case SP_INT32:
        PLACE(int32_t, double)
        break;
    case SP_FLOAT32:
        PLACE(float, double)
        break;
    case SP_FLOAT64:
        PLACE(double, double)
        break;
    case SP_TYPE_COUNT:
        break;
    }
    for (size_t i = 0; sp_missing_are_holes(c->info) && i < count; i++) {
        const double value = sp_sample(c->voxels, c->info->type, first + i);
        if (!(value >= c->info->data[0] && value <= c->info->data[1]))
            place[i] = NAN;
    }
}

static void load_places(const struct worker *w, uint64_t first, struct row *row) {
    const struct sp_light_cells *c = w->c;
    size_t samples = c->info->grid.dims[0], count = w->count;
    if (c->is_even) {
        compute_places(c, first, samples < count ? samples : count, row->place);
        for (size_t i = samples; i < count; i++)
            row->place[i] = row->place[samples - 1];
    } else {
        for (size_t i = 0; i < count; i++)
            compute_places(c, first + c->sample[0][i], 1, row->place + i);
    }
    for (size_t i = count; i < count + LIGHT_PAD; i++)
        row->place[i] = row->place[count - 1];
    for (size_t i = 0; c->tf->gradient_count && i < count; i++)
        row->value[i] = (float)sp_sample(c->voxels, c->info->type, first + c->sample[0][i]);
    for (size_t i = count; c->tf->gradient_count && i < count + LIGHT_PAD; i++)
        row->value[i] = row->value[count - 1];
}

static void load_row(const struct worker *w, uint32_t across, uint32_t along, struct row *row) {
    const struct sp_light_cells *c = w->c;
    const uint32_t *dims = c->info->grid.dims;
    const sp_wide zero = sp_wide_all(0), last = sp_wide_all(LIGHT_BINS);
    load_places(w, ((uint64_t)c->sample[2][along] * dims[1] + c->sample[1][across]) * dims[0], row);
    row->is_clear = true;
    for (size_t i = 0; i < w->count + 1; i += SP_WIDE) {
        sp_wide place = sp_wide_load(row->place + i), sum = zero, mean = zero;
        if (sp_wide_any(sp_wide_le(sp_wide_all(c->first_visible), place))) {
            sp_wide inside = sp_wide_min(sp_wide_max(place, zero), last);
            sp_wide bin = sp_wide_floor(inside), beyond = place - inside;
            sp_wide entry = sp_wide_select(sp_wide_lt(place, zero), zero, bin + 1);
            mean = sp_wide_gather(c->means, sp_wide_to_int(entry));
            sum = sp_wide_gather(c->sums, sp_wide_to_int(entry)) + beyond * mean;
            place = bin + beyond;
            row->is_clear = false;
        }
        sp_wide_store(row->place + i, place);
        sp_wide_store(row->sum + i, sum);
        sp_wide_store(row->mean + i, mean);
    }
}

/* The mean depth between samples and their neighbours. */
static inline sp_wide between(sp_wide place, sp_wide sum, sp_wide mean, const struct row *row,
                              size_t at) {
    sp_wide distance = sp_wide_load(row->place + at) - place;
    sp_wide quotient = (sp_wide_load(row->sum + at) - sum) * sp_wide_inverse(distance);
    sp_wide middle = 0.5f * (sp_wide_load(row->mean + at) + mean);
    sp_wide_mask is_far = sp_wide_le(sp_wide_all(1), sp_wide_abs(distance));
    return sp_wide_keep(sp_wide_eq(distance, distance), sp_wide_select(is_far, quotient, middle));
}

/* The depth of an opacity that is scaled by the gradient. */
static float scale_depth(const struct sp_light_cells *c, const float value[4], float depth) {
    double square = 0;
    for (int a = 0; a < 3; a++) {
        double slope = ((double)value[a + 1] - (double)value[0]) / c->width[a];
        square += isfinite(slope) ? slope * slope : 0;
    }
    double opacity = -expm1(-(double)depth) * sp_transfer_function_scale(c->tf, sqrt(square));
    return (float)-log1p(-fmin(opacity, 1 - 1e-12));
}

/* The depths at the positions of a row: means over the pairs with the next neighbours. */
static void compute_depths(const struct worker *w, const struct row *row, const struct row *across,
                           const struct row *along, float *out) {
    for (size_t i = 0; i + 1 < w->count; i += SP_WIDE) {
        sp_wide place = sp_wide_load(row->place + i);
        sp_wide sum = sp_wide_load(row->sum + i), mean = sp_wide_load(row->mean + i);
        sp_wide depth = between(place, sum, mean, row, i + 1);
        depth += between(place, sum, mean, across, i);
        depth = (depth + between(place, sum, mean, along, i)) * (1.0f / 3);
        for (int k = 0; w->c->tf->gradient_count && k < SP_WIDE; k++) {
            const float value[4] = { row->value[i + (size_t)k], row->value[i + (size_t)k + 1],
                                     across->value[i + (size_t)k], along->value[i + (size_t)k] };
            if (depth[k] > 0)
                depth[k] = scale_depth(w->c, value, depth[k]);
        }
        sp_wide_store(out + i, depth);
    }
}

/* Adds what passes columns along an axis to *passed. The depth of a column is the sum over the
 * `count` rows that lie `step` pointers apart; or, with one row, over `joined` positions. */
static void add_columns(float *const *rows, size_t step, unsigned count, unsigned joined,
                        size_t length, float scale, float *passed) {
    float sums[SP_WIDE];
    for (size_t i = 0; i < length; i += SP_WIDE) {
        sp_wide depth = sp_wide_all(0);
        if (joined > 1) {
            for (size_t k = 0; k < SP_WIDE; k++) {
                sums[k] = 0;
                for (unsigned q = 0; q < joined && i + k < length; q++)
                    sums[k] += rows[0][(i + k) * joined + q];
            }
            depth = sp_wide_load(sums);
        } else {
            for (unsigned q = 0; q < count; q++)
                depth += sp_wide_load(rows[q * step] + i);
        }
        sp_wide share = sp_wide_all(1);
        if (sp_wide_any(sp_wide_lt(sp_wide_all(0), depth)))
            share = sp_wide_exp2(depth * scale);
        sp_wide_store(passed + i, sp_wide_load(passed + i) + share);
    }
}

/* The share of a cell that clipping keeps. */
static float compute_kept(const struct sp_light_cells *c, const uint32_t cell[3]) {
    double share = 1;
    for (int h = 0; h < c->half_count; h++) {
        const struct sp_light_half *half = &c->halves[h];
        double distance = -half->offset;
        for (int a = 0; a < 3; a++)
            distance += half->normal[a] * cell[a];
        share *= fmin(fmax(distance + 0.5, 0), 1);
    }
    return (float)share;
}

/* What clipping leaves of a depth. */
static float clip_depth(const struct sp_light_cells *c, const uint32_t cell[3], float depth) {
    return depth > 0 ? -log1pf(compute_kept(c, cell) * expm1f(-depth)) : 0;
}

/* The depths of a row of cells. Light that passes beside matter in a cell counts: for each axis,
 * the depth comes from the mean transmittance of the columns of positions. */
static void join_cells(const struct worker *w, uint32_t row, float *out) {
    const struct sp_light_cells *c = w->c;
    const unsigned n = c->per_cell;
    const size_t cells = c->dims[0] - 2;
    for (int a = 0; a < 3; a++)
        for (size_t i = 0; i < w->count + LIGHT_PAD; i++)
            w->passed[a][i] = 0;
    for (unsigned j = 0; j < n; j++)
        for (unsigned k = 0; k < n; k++)
            add_columns(&w->depth[j][k], 0, 1, n, cells, c->column_depth[0], w->passed[0]);
    for (unsigned k = 0; k < n; k++) {
        add_columns(&w->depth[0][k], LIGHT_PER_CELL_MAX, n, 1, w->count - 1, c->column_depth[1],
                    w->passed[1]);
        add_columns(w->depth[k], 1, n, 1, w->count - 1, c->column_depth[2], w->passed[2]);
    }
    for (size_t i = 0; i < cells; i++)
        for (unsigned a = 1; a < 3; a++) {
            float sum = 0;
            for (unsigned q = 0; q < n; q++)
                sum += w->passed[a][i * n + q];
            w->passed[a][i] = sum;
        }
    for (size_t i = 0; i < cells; i += SP_WIDE) {
        sp_wide depth = sp_wide_all(0);
        for (int a = 0; a < 3; a++)
            depth -=
                c->per_column[a] *
                sp_wide_log2(sp_wide_max(sp_wide_load(w->passed[a] + i) * (1.0f / (float)(n * n)),
                                         sp_wide_all(1e-37f)));
        sp_wide_store(w->passed[0] + i, sp_wide_max(depth, sp_wide_all(0)));
    }
    for (size_t i = 0; i < cells; i++)
        out[i + 1] = w->passed[0][i];
    for (uint32_t i = 1; c->half_count && i <= cells; i++)
        out[i] = clip_depth(c, (const uint32_t[3]){ i, row, w->slice }, out[i]);
}

/* Writes a row of cells; is_clear: nothing is there. */
static void write_cells(const struct worker *w, uint32_t row, bool is_clear) {
    const struct sp_light_cells *c = w->c;
    size_t first = ((size_t)w->slice * c->dims[1] + row) * c->dims[0];
    float *out = c->extinction + first;
    uint32_t *field = c->field + first;
    for (uint32_t i = 0; i < c->dims[0]; i++) {
        out[i] = 0;
        field[i] = 0xffffffu;
    }
    if (is_clear)
        return;
    join_cells(w, row, out);
    for (uint32_t i = 1; i + 1 < c->dims[0]; i++) {
        float clear = sp_exp2(out[i] * -SP_LOG2E) * 255 + 0.5f;
        field[i] = 0xffffu | (uint32_t)(int32_t)(clear > 1 ? clear : 1) << 16;
    }
}

static void compute_row(struct worker *w, uint32_t row) {
    const unsigned n = w->c->per_cell;
    const uint32_t along = (w->slice - 1) * n, across = (row - 1) * n;
    bool is_clear = true;
    for (unsigned k = 0; k <= n; k++) {
        struct row begin = w->rows[0][k];
        w->rows[0][k] = w->rows[n][k]; /* where the previous cell ended */
        w->rows[n][k] = begin;
        for (unsigned j = row == 1 ? 0 : 1; j <= n; j++)
            load_row(w, across + j, along + k, &w->rows[j][k]);
        for (unsigned j = 0; j <= n; j++)
            is_clear = is_clear && w->rows[j][k].is_clear;
    }
    for (unsigned k = 0; !is_clear && k < n; k++)
        for (unsigned j = 0; j < n; j++)
            compute_depths(w, &w->rows[j][k], &w->rows[j + 1][k], &w->rows[j][k + 1],
                           w->depth[j][k]);
    write_cells(w, row, is_clear);
}

void sp_light_compute_cells(const struct sp_light_cells *c, uint32_t slice, unsigned worker) {
    const unsigned n = c->per_cell;
    const size_t length = sp_light_row_floats(c->dims[0] - 2, n);
    float *memory = c->rows + worker * c->worker_floats;
    struct worker w = { .c = c, .slice = slice, .count = (size_t)(c->dims[0] - 2) * n + 1 };
    bool is_border = slice == 0 || slice + 1 == c->dims[2];
    for (unsigned j = 0; j <= n; j++)
        for (unsigned k = 0; k <= n; k++) {
            w.rows[j][k] = (struct row){ memory, memory + length, memory + 2 * length,
                                         memory + 3 * length, true };
            memory += 4 * length;
        }
    for (unsigned j = 0; j < n; j++)
        for (unsigned k = 0; k < n; k++, memory += length)
            w.depth[j][k] = memory;
    for (int a = 0; a < 3; a++, memory += length)
        w.passed[a] = memory;
    for (uint32_t row = 0; row < c->dims[1]; row++)
        if (is_border || row == 0 || row + 1 == c->dims[1])
            write_cells(&w, row, true);
        else
            compute_row(&w, row);
}
