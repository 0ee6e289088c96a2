/* SPDX-License-Identifier: Apache-2.0
 *
 * Doubles the samples of a slice along both axes. A sample between two others is the value of the
 * polynomial of degree 5 through its six neighbours,
 *
 *   (3, −25, 150, 150, −25, 3)/256
 *
 * so samples keep their values and thin structures keep their contrast. For a maximum or a minimum
 * it is kept between the two samples beside it (projections.md).
 *
 *   read           double across         (mix)                double down
 *   a row   ──►    a row of the    ──►   rows of six    ──►   two rows of the sheet, from six rows
 *   of codes      slice                 slices, halfway
 *
 * Each row is read and doubled across only in the columns that blocks see, in units of a few
 * columns. Sheets that lie halfway between two slices share these rows: six slices are kept.
 */
#include <limits.h>
#include <math.h>
#include <string.h>

#include "base/fetch.h"
#include "base/minmax.h"
#include "draw/resample/kernels.h"

enum {
    TAPS = RESAMPLE_TAPS,
    BEFORE = TAPS / 2 - 1, /* samples before the first one that is doubled */
    BEHIND = TAPS / 2,
    CHUNK = 128, /* columns that are read at once */
    PENDING = 8, /* parts of rows that are read before they are doubled */
    AHEAD = 2    /* prefetch distance [slices] */
};

/* The samples that blocks see: first and last, per axis. */
struct extents {
    int32_t first[2][RESAMPLE_BLOCKS], last[2][RESAMPLE_BLOCKS];
};

struct region {
    int first[2], last[2];
};

static inline sp_wide_short between(const sp_wide_short x[TAPS]) {
    /* Halves of sums of two stay integers of 16 bits: 150/128 − 25/128 + 3/128 = 1. Rounding loses
     * a quarter of a level on average; 1/65536 of the raised level gives it back. */
    const sp_wide_short zero = { 0 }, inner = zero + (22 * 512 + 1), outer = zero + 25 * 512,
                        outmost = zero + 3 * 512;
    sp_wide_short near = sp_wide_short_average(x[2], x[3]);
    sp_wide_short sum = near + sp_wide_short_scale(near, inner) +
                        sp_wide_short_scale(sp_wide_short_average(x[0], x[5]), outmost);
    return sp_wide_short_subtract(sum,
                                  sp_wide_short_scale(sp_wide_short_average(x[1], x[4]), outer));
}

/* The same where a sample may be none (CURVE_CODE_NONE): then there is none beside it, and
 * the value between two others is their mean. */
static inline sp_wide_short between_known(const sp_wide_short x[TAPS]) {
    const sp_wide_short zero = { 0 }, none = zero + (ROWS_RAISED + CURVE_CODE_NONE);
    const sp_wide_short lowest = zero + (ROWS_RAISED + CURVE_CODE_MIN);
    sp_wide_short inner = sp_wide_short_min(x[2], x[3]), all = inner;
    for (int k = 0; k < TAPS; k++)
        all = sp_wide_short_min(all, x[k]);
    sp_wide_short is_known = (sp_wide_short)(inner >= lowest);
    sp_wide_short has_all = (sp_wide_short)(all >= lowest);
    sp_wide_short value = (between(x) & has_all) | (sp_wide_short_average(x[2], x[3]) & ~has_all);
    return (sp_wide_short_max(value, lowest) & is_known) | (none & ~is_known);
}

/* How samples between others are made. */
struct rule {
    bool has_none;   /* some codes are none */
    bool is_bounded; /* a sample is kept between the two beside it */
};

static inline struct rule rule_of(const struct sp_resample_open_tile *t) {
    return (struct rule){ t->r->reduction.leaves_out, t->r->reduction.is_extreme };
}

static inline sp_wide_short halfway(const sp_wide_short x[TAPS], struct rule rule) {
    sp_wide_short value = rule.has_none ? between_known(x) : between(x);
    if (rule.is_bounded)
        value = sp_wide_short_max(sp_wide_short_min(value, sp_wide_short_max(x[2], x[3])),
                                  sp_wide_short_min(x[2], x[3]));
    return value;
}

/* Takes the first columns from a set of units: the columns of neighbouring units, and of units that
 * the last vector of columns reaches. */
static inline bool pop_columns(uint64_t *units, int unit_bits, int *begin, int *end) {
    const int step = SP_WIDE >> unit_bits > 1 ? SP_WIDE >> unit_bits : 1;
    if (!*units)
        return false;
    int first = __builtin_ctzll(*units), next = first;
    while (next < 64 && *units >> next & 1) {
        next += __builtin_ctzll(~(*units >> next));
        next = first + ((next - first + step - 1) & -step);
    }
    *units = next < 64 ? *units >> next << next : 0;
    *begin = first << unit_bits;
    *end = next << unit_bits;
    return true;
}

/* Computes what each of the blocks of `need` sees at s. Gradients look half a sample farther, and
 * interpolation one refined sample. */
static void compute_extents(const struct sp_resample_open_tile *t, uint64_t need, float s,
                            struct extents *extents) {
    const float rounding = 1 / 1024.0f, before = (t->r->needs_gradient ? 0.5f : 0) + rounding,
                behind = before + 0.5f;
    const uint64_t group = (UINT64_C(1) << SP_WIDE) - 1;
    for (int b = 0; b < RESAMPLE_BLOCKS; b += SP_WIDE) {
        sp_wide min[2], max[2];
        if (!(need >> b & group))
            continue;
        sp_resample_extents(t, b, sp_wide_all(s), min, max);
        for (int a = 0; a < 2; a++) {
            sp_wide_int_store(extents->first[a] + b,
                              sp_wide_to_int(sp_wide_floor(min[a] - before)));
            sp_wide_int_store(extents->last[a] + b, sp_wide_to_int(sp_wide_floor(max[a] + behind)));
        }
    }
}

/* Widens a region to what blocks see. */
static void add_extents(const struct extents *extents, uint64_t blocks, struct region *region) {
    for (; blocks; blocks &= blocks - 1) {
        int b = __builtin_ctzll(blocks);
        for (int a = 0; a < 2; a++) {
            int first = extents->first[a][b], last = extents->last[a][b];
            region->first[a] = first < region->first[a] ? first : region->first[a];
            region->last[a] = last > region->last[a] ? last : region->last[a];
        }
    }
}

static const struct region nowhere = { { INT_MAX, INT_MAX }, { INT_MIN, INT_MIN } };

/* Samples of a row in memory, for the units of a region and what vectors write beyond. An odd
 * number of vectors, because powers of two would crowd the cache. */
static int width_of(const struct sp_resample_open_tile *t, const struct region *region) {
    int unit = 1 << t->unit_bits, step = unit > SP_WIDE ? unit : SP_WIDE;
    int columns = region->last[0] - region->first[0] + step;
    return 2 * SP_WIDE * ((columns + SP_WIDE - 1) / SP_WIDE | 1);
}

/* Rounds down to a whole unit. */
static inline int to_unit(const struct sp_resample_open_tile *t, int column) {
    return column & -(1 << t->unit_bits);
}

static void init_sheet(const struct sp_resample_open_tile *t, const struct region *region,
                       struct sp_resample_sheet *sheet) {
    const int size[2] = { 2 * (region->last[0] - region->first[0] + 1),
                          2 * (region->last[1] - region->first[1] + 1) };
    sheet->width = width_of(t, region);
    for (int a = 0; a < 2; a++) {
        sheet->origin[a] = region->first[a];
        float shift = -2.0f * (float)sheet->origin[a], border = 2.0f * (float)(t->dims[a] - 1);
        sheet->shift[a] = shift;
        sheet->first[a] = fmaxf(shift, 0);
        sheet->last[a] = fminf(border + shift, (float)size[a] - 1.002f); /* which has a next one */
    }
}

/* Marks the units that blocks see in each row of the sheet, and the units of the rows that are
 * filtered for it. */
static void mark_needs(const struct sp_resample_open_tile *t, const struct extents *extents,
                       uint64_t need, const struct region *region) {
    uint64_t *seen = t->scratch->seen, *around = t->scratch->around;
    int rows = region->last[1] - region->first[1] + 1;
    memset(seen, 0, (size_t)(rows + TAPS - 1) * sizeof *seen);
    memset(around, 0, (size_t)(rows + TAPS - 1) * sizeof *around);
    for (; need; need &= need - 1) {
        int b = __builtin_ctzll(need);
        int first = (extents->first[0][b] - region->first[0]) >> t->unit_bits;
        int last = (extents->last[0][b] - region->first[0]) >> t->unit_bits;
        uint64_t units = UINT64_MAX >> (63 - (last - first)) << first;
        int begin = extents->first[1][b] - region->first[1];
        int end = extents->last[1][b] - region->first[1] + 1;
        for (int j = begin; j < end; j++)
            seen[j] |= units;
        for (int j = begin; j < end + TAPS - 1; j++)
            around[j] |= units;
    }
}

/* Opens the rows of a slice, so that they hold a region and what is filtered for it. */
static void open_rows(const struct sp_resample_open_tile *t, const struct region *region, int slice,
                      struct sp_resample_rows *rows) {
    int count = region->last[1] - region->first[1] + TAPS;
    rows->slice = slice;
    rows->width = width_of(t, region);
    rows->origin[0] = region->first[0];
    rows->origin[1] = region->first[1] - BEFORE;
    memset(rows->filled, 0, (size_t)count * sizeof *rows->filled);
}

/* The rows of a slice. Where sheets between slices need them, the rows of six slices are kept: they
 * hold all units that blocks see of these sheets. */
static struct sp_resample_rows *rows_of(const struct sp_resample_open_tile *t,
                                        const struct region *sheet, int slice) {
    struct sp_resample_rows *rows = &t->scratch->rows[t->sheets_per_slice == 1 ? 0 : slice % TAPS];
    struct region region = nowhere;
    struct extents extents;
    if (t->sheets_per_slice == 1) {
        open_rows(t, sheet, slice, rows);
        return rows;
    }
    if (rows->slice == slice)
        return rows;
    for (int k = -1; k <= 1; k += 2) {
        compute_extents(t, t->alive, sp_resample_s(t, (float)(slice + k * TAPS / 2)), &extents);
        add_extents(&extents, t->alive, &region);
    }
    region.first[0] = to_unit(t, region.first[0] - 1);
    region.first[1]--;
    region.last[0]++;
    region.last[1]++;
    open_rows(t, &region, slice, rows);
    return rows;
}

/* Doubles the samples of a row: its own and those between them, in turns. */
static inline void double_across(const uint16_t *from, int count, uint16_t *out, struct rule rule) {
    for (int i = 0; i < count; i += SP_WIDE_SHORT) {
        sp_wide_short x[TAPS], both[2];
        for (int k = 0; k < TAPS; k++)
            x[k] = sp_wide_short_load(from + i + k);
        sp_fetch_alternate(x[BEFORE], halfway(x, rule), both);
        sp_wide_short_store(out + 2 * i, both[0]);
        if (i + SP_WIDE < count)
            sp_wide_short_store(out + 2 * i + SP_WIDE_SHORT, both[1]);
    }
}

/* Parts of rows that have been read. They are doubled some time later, because a vector that is
 * read across two others waits until these have reached the cache. */
struct pending {
    int count;
    struct rule rule;
    int columns[PENDING];
    uint16_t *out[PENDING];
    _Alignas(64) uint16_t codes[PENDING][ROWS_MEMORY];
};

static void double_pending(struct pending *pending) {
    const struct rule rule = pending->rule;
    for (int i = 0; i < pending->count; i++) {
        const uint16_t *codes = pending->codes[i] + ROWS_MARGIN;
        uint16_t *out = pending->out[i];
        int columns = pending->columns[i];
        if (rule.has_none)
            double_across(codes, columns, out, (struct rule){ true, rule.is_bounded });
        else if (rule.is_bounded)
            double_across(codes, columns, out, (struct rule){ false, true });
        else
            double_across(codes, columns, out, (struct rule){ false, false });
    }
    pending->count = 0;
}

/* Fills units of a row. */
static inline void fill_row(const struct sp_resample_open_tile *t, struct sp_resample_rows *rows,
                            int j, uint64_t units, struct pending *pending) {
    uint16_t *out = rows->doubled + (ptrdiff_t)j * rows->width;
    ptrdiff_t line =
        (ptrdiff_t)((size_t)rows->slice * t->stride[2] +
                    (size_t)sp_clampi(rows->origin[1] + j, 0, t->dims[1] - 1) * t->stride[1]);
    int begin, end;
    rows->filled[j] |= units;
    while (pop_columns(&units, t->unit_bits, &begin, &end))
        for (int i = begin; i < end; i += CHUNK) {
            int k = pending->count++, columns = end - i < CHUNK ? end - i : CHUNK;
            pending->columns[k] = columns;
            pending->out[k] = out + 2 * i;
            sp_rows_read(&t->reader, line, rows->origin[0] + i - BEFORE, columns + TAPS - 1,
                         pending->codes[k] + ROWS_MARGIN);
            if (pending->count == PENDING)
                double_pending(pending);
        }
}

/* Returns the rows of a slice with what the sheet needs of them. */
static struct sp_resample_rows *fill_rows(const struct sp_resample_open_tile *t,
                                          const struct region *sheet, int slice) {
    struct sp_resample_rows *rows = rows_of(t, sheet, slice);
    int count = sheet->last[1] - sheet->first[1] + TAPS;
    int first = sheet->first[1] - BEFORE - rows->origin[1];
    int shift = (sheet->first[0] - rows->origin[0]) >> t->unit_bits;
    struct pending pending;
    pending.count = 0;
    pending.rule = rule_of(t);
    for (int j = 0; j < count; j++) {
        uint64_t units = t->scratch->around[j] << shift & ~rows->filled[first + j];
        if (units)
            fill_row(t, rows, first + j, units, &pending);
    }
    double_pending(&pending);
    return rows;
}

/* Where the rows that are filtered for a region begin. */
static const uint16_t *start_of(const struct sp_resample_rows *rows, const struct region *region) {
    return rows->doubled + (ptrdiff_t)(region->first[1] - BEFORE - rows->origin[1]) * rows->width +
           2 * (region->first[0] - rows->origin[0]);
}

/* Makes the rows of a sheet half way between the third and the fourth of six slices. */
static void mix_rows(const struct sp_resample_open_tile *t, const struct region *region,
                     struct sp_resample_rows *const slices[TAPS], struct sp_resample_rows *out) {
    const struct rule rule = rule_of(t);
    const uint16_t *from[TAPS];
    int count = region->last[1] - region->first[1] + TAPS, begin, end;
    open_rows(t, region, INT_MIN, out);
    for (int k = 0; k < TAPS; k++)
        from[k] = start_of(slices[k], region);
    for (int j = 0; j < count; j++) {
        uint16_t *to = out->doubled + (ptrdiff_t)j * out->width;
        for (uint64_t units = t->scratch->around[j];
             pop_columns(&units, t->unit_bits, &begin, &end);)
            for (int i = 2 * begin; i < 2 * end; i += SP_WIDE_SHORT) {
                sp_wide_short x[TAPS];
                for (int k = 0; k < TAPS; k++)
                    x[k] = sp_wide_short_load(from[k] + i);
                sp_wide_short_store(to + i, halfway(x, rule));
            }
        for (int k = 0; k < TAPS; k++)
            from[k] += slices[k]->width;
    }
}

static inline void write_codes(sp_wide_short x, sp_wide_short lowest, uint16_t *out) {
    x = sp_wide_short_min(sp_wide_short_max(x, lowest),
                          sp_wide_short_all(ROWS_RAISED + CURVE_CODE_MAX));
    sp_wide_short_store(out, x - ROWS_RAISED);
}

/* Doubles rows down into the sheet. */
static void double_down(const struct sp_resample_open_tile *t, const struct region *region,
                        const struct sp_resample_rows *rows, struct sp_resample_sheet *sheet) {
    const struct rule rule = rule_of(t);
    const sp_wide_short lowest = sp_wide_short_all(ROWS_RAISED + (int)t->r->lowest);
    const uint16_t *from = start_of(rows, region);
    const ptrdiff_t width = rows->width, next = sheet->width;
    uint16_t *out = (uint16_t *)sheet->refined;
    int begin, end, count = 0;
    for (int j = 0; j <= region->last[1] - region->first[1]; j++, from += width, out += 2 * next)
        for (uint64_t units = t->scratch->seen[j];
             pop_columns(&units, t->unit_bits, &begin, &end);) {
            for (int i = 2 * begin; i < 2 * end; i += SP_WIDE_SHORT) {
                sp_wide_short x[TAPS];
                for (int k = 0; k < TAPS; k++)
                    x[k] = sp_wide_short_load(from + k * width + i);
                write_codes(x[BEFORE], lowest, out + i);
                write_codes(halfway(x, rule), lowest, out + next + i);
            }
            count += end - begin;
        }
    t->scratch->refined += (unsigned)count;
}

void sp_resample_start_sheets(struct sp_resample_open_tile *t) {
    for (int k = 0; k < TAPS; k++)
        t->scratch->rows[k].slice = INT_MIN;
    sp_rows_init(&t->reader, &t->r->curve, t->voxels, t->r->samples->type, t->dims[0],
                 t->stride[0]);
    t->reader.blocks = t->r->samples->blocks;
    t->reader.axis = (unsigned)t->axis[0];
    t->reader.ahead = (t->is_backwards ? -AHEAD : AHEAD) * (ptrdiff_t)t->stride[2];
}

void sp_resample_refine(const struct sp_resample_open_tile *t, struct sp_resample_sheet *sheet,
                        uint64_t need, float z) {
    struct sp_resample_rows *slices[TAPS], *rows;
    struct region region = nowhere;
    struct extents extents;
    int whole = (int)floorf(z);
    compute_extents(t, need, sheet->s, &extents);
    add_extents(&extents, need, &region);
    region.first[0] = to_unit(t, region.first[0]);
    init_sheet(t, &region, sheet);
    mark_needs(t, &extents, need, &region);
    if (z > (float)whole) {
        for (int k = 0; k < TAPS; k++)
            slices[k] = fill_rows(t, &region, sp_clampi(whole - BEFORE + k, 0, t->dims[2] - 1));
        rows = &t->scratch->rows[TAPS];
        mix_rows(t, &region, slices, rows);
    } else {
        rows = fill_rows(t, &region, sp_clampi(whole, 0, t->dims[2] - 1));
    }
    double_down(t, &region, rows, sheet);
}
