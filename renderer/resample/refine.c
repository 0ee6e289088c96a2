/* SPDX-License-Identifier: Apache-2.0
 *
 * Doubles the samples of a slice along both axes. A sample between two others is the value of the
 * polynomial of degree 5 through its six neighbours,
 *
 *   (3, −25, 150, 150, −25, 3)/256
 *
 * so samples keep their values and thin structures keep their contrast. A sheet half way between
 * two slices is made from six slices in the same way.
 *
 *   read            filter across       filter down
 *   13 rows  ──►    13 rows      ──►    16 rows          of a cell of 8 rows, in 16-bit integers
 *
 * While a cell is filtered, levels are raised by RAISED, so that no overshoot is negative.
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
    USED = ACROSS + TAPS - 1, /* samples of a row */
    READ = (USED + SP_WIDE_SHORT - 1) / SP_WIDE_SHORT * SP_WIDE_SHORT,
    RAISED = 8192
};

/* Narrow integers x, raised as by sp_fetch_…(), to levels: start + ((x − low) << shift)·scale. */
struct scaling {
    uint16_t low, high; /* values are moved into this range */
    uint16_t scale;     /* ·65536 */
    uint16_t start;     /* raised by RAISED */
    int shift;
};

struct source { /* the slices that a sheet is made from */
    int count;
    ptrdiff_t slice[TAPS]; /* where the slices begin [samples] */
    struct scaling scaling;
};

/* The samples around a cell. */
struct rows {
    ptrdiff_t line[ROWS]; /* where they begin [samples] */
    int first;            /* column at which a row is read; < 0: each of `column` on its own */
    int left, right;      /* samples of a row that repeat the slice's first one and its last one */
    ptrdiff_t column[READ];
};

static inline int clamp(int i, int count) {
    return i < 0 ? 0 : i >= count ? count - 1 : i;
}

/* Values beyond the range of the levels are moved into it. */
static void init_scaling(const struct sp_curve *curve, enum sp_type type, struct scaling *s) {
    const bool has_sign = type == SP_INT8 || type == SP_INT16;
    const double largest = type == SP_UINT8 || type == SP_INT8 ? 255 : 65535;
    const double zero = has_sign ? (largest + 1) / 2 : 0, rounding = 1e-6;
    const double levels = CURVE_LEVEL_MAX - CURVE_LEVEL_MIN, base = curve->base + zero;
    double low = fmin(fmax(ceil(base - rounding), 0), largest);
    double high = floor(base + levels / curve->levels_per_unit + rounding);
    high = fmin(fmax(high, low), largest);
    *s = (struct scaling){ .low = (uint16_t)low, .high = (uint16_t)high };
    while (s->shift < 15 && (high - low) * (double)(2 << s->shift) < 65536)
        s->shift++; /* then levels_per_unit is below 1 << shift */
    s->scale = (uint16_t)fmin(rint(curve->levels_per_unit * (65536 >> s->shift)), 65535);
    double level = CURVE_LEVEL_MIN + (low - base) * curve->levels_per_unit;
    s->start = (uint16_t)rint(RAISED + level + 0.5); /* scaling rounds down */
}

static void init_source(const struct sp_resample_open_tile *t, float z, struct source *source) {
    int whole = (int)floorf(z), first = z > (float)whole ? whole - 2 : whole;
    *source = (struct source){ .count = z > (float)whole ? TAPS : 1 };
    for (int k = 0; k < source->count; k++)
        source->slice[k] = (ptrdiff_t)((size_t)clamp(first + k, t->dims[2]) * t->stride[2]);
    if (sp_type_size(t->r->samples->type) <= 2)
        init_scaling(&t->r->curve, t->r->samples->type, &source->scaling);
}

static void init_rows(const struct sp_resample_open_tile *t, int u, int v, struct rows *rows) {
    int first = u - 2, last_first = t->dims[0] - READ;
    for (int j = 0; j < ROWS; j++)
        rows->line[j] = (ptrdiff_t)((size_t)clamp(v - 2 + j, t->dims[1]) * t->stride[1]);
    rows->left = first < 0 ? -first : 0;
    rows->right = first + USED > t->dims[0] ? first + USED - t->dims[0] : 0;
    rows->first = first < 0 ? 0 : first < last_first ? first : last_first;
    if (t->stride[0] == 1 && last_first >= 0 && rows->left < USED && rows->right < USED)
        return;
    rows->first = -1;
    for (int i = 0; i < READ; i++)
        rows->column[i] = (ptrdiff_t)((size_t)clamp(first + i, t->dims[0]) * t->stride[0]);
}

/* Moves a row that was read at rows->first to its place, and repeats the samples at its ends. */
static void move_row(const struct rows *rows, int u, uint16_t row[READ]) {
    uint16_t moved[USED];
    for (int i = 0; i < USED; i++) {
        int k = i < rows->left ? rows->left : i < USED - rows->right ? i : USED - rows->right - 1;
        moved[i] = row[u - 2 + k - rows->first];
    }
    memcpy(row, moved, sizeof moved);
}

/* The value between the third and the fourth of six samples. Halves of sums of two stay integers of
 * 16 bits: 150/128 − 25/128 + 3/128 = 1. Rounding loses a quarter of a level on average; 1/65536 of
 * the raised level gives it back. */
#define BETWEEN(type, x)                                                                           \
    type##_average(x[2], x[3]) + type##_scale(type##_average(x[2], x[3]), inner) -                 \
        type##_scale(type##_average(x[1], x[4]), outer) +                                          \
        type##_scale(type##_average(x[0], x[5]), outmost)

static inline sp_wide_short between(const sp_wide_short x[TAPS]) {
    const sp_wide_short zero = { 0 }, inner = zero + (22 * 512 + 1), outer = zero + 25 * 512,
                        outmost = zero + 3 * 512;
    return BETWEEN(sp_wide_short, x);
}

static inline sp_wide_short_half between_half(const sp_wide_short_half x[TAPS]) {
    const sp_wide_short_half zero = { 0 }, inner = zero + (22 * 512 + 1), outer = zero + 25 * 512,
                             outmost = zero + 3 * 512;
    return BETWEEN(sp_wide_short_half, x);
}

static inline sp_wide_short to_level(const struct scaling *s, sp_wide_short x) {
    x = sp_wide_short_max(sp_wide_short_min(x, sp_wide_short_all(s->high)),
                          sp_wide_short_all(s->low));
    return sp_wide_short_scale((x - s->low) << s->shift, sp_wide_short_all(s->scale)) + s->start;
}

/* Reads rows of narrow integers. */
#define READ_ROWS(type, fetch)                                                                     \
    for (int j = 0; j < ROWS; j++) {                                                               \
        const type *from = (const type *)t->voxels + slice + rows->line[j];                        \
        type parts[READ];                                                                          \
        for (int i = 0; rows->first < 0 && i < READ; i++)                                          \
            parts[i] = from[rows->column[i]];                                                      \
        from = rows->first < 0 ? parts : from + rows->first;                                       \
        for (int i = 0; i < READ; i += SP_WIDE_SHORT)                                              \
            sp_wide_short_store(out[j] + i, to_level(&scaling, fetch(from + i)));                  \
    }                                                                                              \
    break

/* The raised level of a value of any type. Values that are not finite have CURVE_LEVEL_NONE. */
static uint16_t level_of(const struct sp_curve *curve, double x) {
    double level = (x - curve->base) * curve->levels_per_unit + CURVE_LEVEL_MIN + 0.5;
    if (!isfinite(x))
        return RAISED + CURVE_LEVEL_NONE;
    return (uint16_t)(RAISED + fmin(fmax(level, CURVE_LEVEL_MIN), CURVE_LEVEL_MAX));
}

/* The same of SP_WIDE floats, which is exact enough if the curve's numbers are floats. */
static inline sp_wide_int levels_of(const struct sp_curve *curve, sp_wide x) {
    const sp_wide low = sp_wide_all(CURVE_LEVEL_MIN), high = sp_wide_all(CURVE_LEVEL_MAX);
    sp_wide level = (x - (float)curve->base) * (float)curve->levels_per_unit + CURVE_LEVEL_MIN;
    level = sp_wide_min(sp_wide_max(level + 0.5f, low), high);
    sp_wide_mask is_finite = sp_wide_lt(sp_wide_abs(x), sp_wide_all(INFINITY));
    return sp_wide_to_int(sp_wide_select(is_finite, level, sp_wide_all(CURVE_LEVEL_NONE))) + RAISED;
}

static bool is_float_exact(const struct sp_curve *curve, enum sp_type type) {
    const double most = 1e37;
    return type == SP_FLOAT32 && fabs(curve->base) < most && curve->levels_per_unit < most &&
           curve->levels_per_unit > 1 / most;
}

static void read_wide_rows(const struct sp_resample_open_tile *t, const struct rows *rows,
                           ptrdiff_t slice, uint16_t out[ROWS][READ]) {
    const struct sp_curve *curve = &t->r->curve;
    enum sp_type type = t->r->samples->type;
    const bool is_exact = is_float_exact(curve, type) && rows->first >= 0;
    for (int j = 0; j < ROWS; j++) {
        ptrdiff_t place = slice + rows->line[j];
        for (int i = 0; !is_exact && i < READ; i++) {
            ptrdiff_t column = rows->first < 0 ? rows->column[i] : rows->first + i;
            out[j][i] = level_of(curve, sp_sample(t->voxels, type, (size_t)(place + column)));
        }
        for (int i = 0; is_exact && i < READ; i += SP_WIDE) {
            const float *from = (const float *)t->voxels + place + rows->first;
            sp_wide_int level = levels_of(curve, sp_wide_load(from + i));
            for (int l = 0; l < SP_WIDE; l++)
                out[j][i + l] = (uint16_t)level[l];
        }
    }
}

/* Reads the samples around the cell at column u from a slice, in raised levels. */
static void read_rows(const struct sp_resample_open_tile *t, const struct source *source,
                      const struct rows *rows, ptrdiff_t slice, int u, uint16_t out[ROWS][READ]) {
    const struct scaling scaling = source->scaling; /* nothing that is written changes a copy */
    switch (t->r->samples->type) {
    case SP_UINT8:
        READ_ROWS(uint8_t, sp_fetch_uint8);
    case SP_INT8:
        READ_ROWS(int8_t, sp_fetch_int8);
    case SP_UINT16:
        READ_ROWS(uint16_t, sp_fetch_uint16);
    case SP_INT16:
        READ_ROWS(int16_t, sp_fetch_int16);
    default:
        read_wide_rows(t, rows, slice, out);
    }
    for (int j = 0; rows->first >= 0 && rows->first != u - 2 && j < ROWS; j++)
        move_row(rows, u, out[j]);
}

/* Reads them for a sheet that may lie between two slices. */
static void read_source(const struct sp_resample_open_tile *t, const struct source *source, int u,
                        int v, uint16_t out[ROWS][READ]) {
    _Alignas(64) uint16_t slices[TAPS][ROWS][READ];
    struct rows rows;
    init_rows(t, u, v, &rows);
    if (source->count == 1) {
        read_rows(t, source, &rows, source->slice[0], u, out);
        return;
    }
    for (int k = 0; k < TAPS; k++)
        read_rows(t, source, &rows, source->slice[k], u, slices[k]);
    for (int j = 0; j < ROWS; j++)
        for (int i = 0; i < READ; i += SP_WIDE_SHORT) {
            sp_wide_short x[TAPS];
            for (int k = 0; k < TAPS; k++)
                x[k] = sp_wide_short_load(slices[k][j] + i);
            sp_wide_short_store(out[j] + i, between(x));
        }
}

/* Doubles the samples of a row: the cell's own and those between them, in turns. */
static inline void filter_across(const uint16_t row[READ], uint16_t out[2 * ACROSS]) {
    sp_wide_short_half x[TAPS];
    for (int k = 0; k < TAPS; k++)
        x[k] = sp_wide_short_half_load(row + k);
    sp_fetch_alternate(x[2], between_half(x), out);
}

static inline void write_levels(sp_wide_short x, sp_wide_short lowest, uint16_t *out) {
    x = sp_wide_short_min(sp_wide_short_max(x, lowest),
                          sp_wide_short_all(RAISED + CURVE_LEVEL_MAX));
    sp_wide_short_store(out, x - RAISED);
}

static void refine_cell(const struct sp_resample_open_tile *t, struct sp_resample_sheet *sheet,
                        const struct source *source, int u, int v) {
    _Alignas(64) uint16_t rows[ROWS][READ], wide[ROWS][2 * ACROSS];
    const sp_wide_short lowest = sp_wide_short_all(RAISED + (int)t->r->lowest);
    read_source(t, source, u, v, rows);
    for (int j = 0; j < ROWS; j++)
        filter_across(rows[j], wide[j]);
    uint16_t *out = (uint16_t *)sheet->refined +
                    (ptrdiff_t)(2 * (v - sheet->origin[1])) * sheet->width +
                    2 * (u - sheet->origin[0]);
    for (int j = 0; j < DOWN; j++, out += 2 * sheet->width)
        for (int i = 0; i < 2 * ACROSS; i += SP_WIDE_SHORT) {
            sp_wide_short x[TAPS];
            for (int k = 0; k < TAPS; k++)
                x[k] = sp_wide_short_load(wide[j + k] + i);
            write_levels(x[2], lowest, out + i);
            write_levels(between(x), lowest, out + sheet->width + i);
        }
    t->scratch->refined += ACROSS * DOWN;
}

/* The cells that each block sees: first and last, per axis. */
struct cells {
    int32_t first[2][RESAMPLE_BLOCKS], last[2][RESAMPLE_BLOCKS];
};

/* Finds them for the blocks of `need`. Gradients look half a sample farther, and interpolation one
 * refined sample. */
static void find_cells(const struct sp_resample_open_tile *t, uint64_t need, float s,
                       struct cells *cells) {
    static const float size[2] = { (float)ACROSS, (float)DOWN };
    const float before = t->r->needs_gradient ? 0.5f : 0, behind = before + 0.5f;
    const uint64_t group = (UINT64_C(1) << SP_WIDE) - 1;
    for (int b = 0; b < RESAMPLE_BLOCKS; b += SP_WIDE) {
        sp_wide min[2], max[2];
        if (!(need >> b & group))
            continue;
        sp_resample_extents(t, b, sp_wide_all(s), min, max);
        for (int a = 0; a < 2; a++) {
            sp_wide first = sp_wide_floor((min[a] - before) * (1 / size[a]));
            sp_wide last = sp_wide_floor((max[a] + behind) * (1 / size[a]));
            sp_wide_int_store(cells->first[a] + b, sp_wide_to_int(first));
            sp_wide_int_store(cells->last[a] + b, sp_wide_to_int(last));
        }
    }
}

void sp_resample_refine(const struct sp_resample_open_tile *t, struct sp_resample_sheet *sheet,
                        uint64_t need, float z) {
    uint8_t *is_refined = t->scratch->is_refined;
    struct source source;
    struct cells cells;
    int from[2] = { INT32_MAX, INT32_MAX }, to[2] = { INT32_MIN, INT32_MIN };
    init_source(t, z, &source);
    find_cells(t, need, sheet->s, &cells);
    for (uint64_t left = need; left; left &= left - 1) {
        int b = __builtin_ctzll(left);
        for (int a = 0; a < 2; a++) {
            from[a] = cells.first[a][b] < from[a] ? cells.first[a][b] : from[a];
            to[a] = cells.last[a][b] > to[a] ? cells.last[a][b] : to[a];
        }
    }
    int across = to[0] - from[0] + 1, down = to[1] - from[1] + 1;
    sheet->width = 2 * ACROSS * across + 16; /* not a power of two, which would crowd the cache */
    sheet->origin[0] = from[0] * ACROSS;
    sheet->origin[1] = from[1] * DOWN;
    const int size[2] = { 2 * (int)ACROSS * across, 2 * (int)DOWN * down };
    for (int a = 0; a < 2; a++) {
        float shift = -2.0f * (float)sheet->origin[a], border = 2.0f * (float)(t->dims[a] - 1);
        sheet->shift[a] = shift;
        sheet->first[a] = fmaxf(shift, 0);
        sheet->last[a] = fminf(border + shift, (float)size[a] - 1.002f); /* which has a next one */
    }
    memset(is_refined, 0, (size_t)across * (size_t)down);
    for (uint64_t left = need; left; left &= left - 1) {
        int b = __builtin_ctzll(left);
        for (int j = cells.first[1][b]; j <= cells.last[1][b]; j++)
            for (int i = cells.first[0][b]; i <= cells.last[0][b]; i++) {
                uint8_t *done = &is_refined[(j - from[1]) * across + i - from[0]];
                if (!*done)
                    refine_cell(t, sheet, &source, i * ACROSS, j * DOWN);
                *done = 1;
            }
    }
}
