/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/resample/rows.h"

#include "base/fetch.h"
#include <math.h>
#include <string.h>

/* Values beyond the range of the codes are moved into it. */
static void init_scaling(const struct sp_curve *curve, enum sp_type type,
                         struct sp_rows_scaling *s) {
    const bool has_sign = type == SP_INT8 || type == SP_INT16;
    const double largest = type == SP_UINT8 || type == SP_INT8 ? 255 : 65535;
    const double zero = has_sign ? (largest + 1) / 2 : 0, rounding = 1e-6;
    const double codes = CURVE_CODE_MAX - CURVE_CODE_MIN, base = curve->base + zero;
    double low = fmin(fmax(ceil(base - rounding), 0), largest);
    double high = floor(base + codes / curve->codes_per_unit + rounding);
    high = fmin(fmax(high, low), largest);
    *s = (struct sp_rows_scaling){ .low = (uint16_t)low, .high = (uint16_t)high };
    while (s->shift < 15 && (high - low) * (double)(2 << s->shift) < 65536)
        s->shift++; /* then codes_per_unit is below 1 << shift */
    s->scale = (uint16_t)fmin(rint(curve->codes_per_unit * (65536 >> s->shift)), 65535);
    double code = CURVE_CODE_MIN + (low - base) * curve->codes_per_unit;
    s->start = (uint16_t)rint(ROWS_RAISED + code + 0.5); /* scaling rounds down */
}

/* The samples are floats, and so are the curve's numbers; is that exact enough? */
static bool is_float_exact(const struct sp_curve *curve, enum sp_type type) {
    const double most = 1e37;
    return type == SP_FLOAT32 && fabs(curve->base) < most && curve->codes_per_unit < most &&
           curve->codes_per_unit > 1 / most;
}

void sp_rows_init(struct sp_rows *rows, const struct sp_curve *curve, const void *voxels,
                  enum sp_type type, int count, size_t stride) {
    *rows = (struct sp_rows){ .curve = curve,
                              .voxels = voxels,
                              .type = type,
                              .size = (int)sp_type_size(type),
                              .is_float_exact = is_float_exact(curve, type),
                              .count = count,
                              .stride = (ptrdiff_t)stride };
    if (rows->size <= 2)
        init_scaling(curve, type, &rows->scaling);
}

static inline void write_narrow(const struct sp_rows_scaling *s, sp_wide_short x, uint16_t *out) {
    x = sp_wide_short_max(sp_wide_short_min(x, sp_wide_short_all(s->high)),
                          sp_wide_short_all(s->low));
    x = sp_wide_short_scale((x - s->low) << s->shift, sp_wide_short_all(s->scale));
    sp_wide_short_store(out, x + s->start);
}

/* Writes codes in [CURVE_CODE_MIN, CURVE_CODE_MAX], which may lie beyond the codes of the curve.
 * Values that are not finite, or stand for missing data, have CURVE_CODE_NONE. */
static inline void write_codes(sp_wide code, sp_wide_mask is_finite, uint16_t *out) {
    const sp_wide low = sp_wide_all(CURVE_CODE_MIN), high = sp_wide_all(CURVE_CODE_MAX);
    code = sp_wide_min(sp_wide_max(code + (CURVE_CODE_MIN + 0.5f), low), high);
    code = sp_wide_select(is_finite, code, sp_wide_all(CURVE_CODE_NONE));
    sp_wide_int_store_short(out, sp_wide_to_int(code) + ROWS_RAISED);
}

static inline void write_floats(const struct sp_curve *curve, const float *from, uint16_t *out) {
    sp_wide x = sp_wide_load(from);
    const float low = nextafterf((float)curve->data[0], -INFINITY),
                high = nextafterf((float)curve->data[1], INFINITY);
    sp_wide_mask is_data = sp_wide_lt(sp_wide_all(low), x) & sp_wide_lt(x, sp_wide_all(high));
    write_codes((x - (float)curve->base) * (float)curve->codes_per_unit, is_data, out);
}

/* Numbers that need the range of doubles. */
#define WRITE_DOUBLES(curve, from, out)                                                            \
    do {                                                                                           \
        float code[SP_WIDE], zero[SP_WIDE];                                                        \
        for (int l = 0; l < SP_WIDE; l++) {                                                        \
            double x = (double)(from)[l];                                                          \
            code[l] = (float)((x - (curve)->base) * (curve)->codes_per_unit);                      \
            const bool is_data = x >= (curve)->data[0] && x <= (curve)->data[1];                   \
            zero[l] = is_data ? (float)(x - x) : NAN; /* also NaN if x is not finite */            \
        }                                                                                          \
        write_codes(sp_wide_load(code), sp_wide_eq(sp_wide_load(zero), sp_wide_all(0)), out);      \
    } while (0)

/* Samples that lie in blocks. */
static void read_blocks(const struct sp_rows *rows, ptrdiff_t line, int begin, int count,
                        void *parts) {
    const size_t width = rows->blocks->dims[0], height = rows->blocks->dims[1], at = (size_t)line;
    uint32_t place[3] = { (uint32_t)(at % width), (uint32_t)(at / width % height),
                          (uint32_t)(at / width / height) };
    place[rows->axis] += (uint32_t)begin;
    sp_blocks_read(rows->blocks, rows->axis, place, (size_t)count, parts);
}

/* Reads samples begin to end − 1, which lie inside the row, into out[0…]. Vectors that would reach
 * beyond the row are read before its end. Samples that are not neighbours are gathered first. */
#define READER(name, voxel, lanes, write)                                                          \
    static void read_##name(const struct sp_rows *rows, ptrdiff_t line, int begin, int end,        \
                            uint16_t *out) {                                                       \
        const voxel *from = rows->voxels;                                                          \
        int last = rows->count - (lanes)-begin, count = end - begin;                               \
        voxel parts[ROWS_LENGTH + (lanes)];                                                        \
        if (!rows->blocks)                                                                         \
            from += line + begin * rows->stride;                                                   \
        if (rows->blocks || rows->stride != 1 || rows->count < (lanes)) {                          \
            if (rows->blocks)                                                                      \
                read_blocks(rows, line, begin, count, parts);                                      \
            for (int i = 0; i < count && !rows->blocks; i++)                                       \
                parts[i] = from[i * rows->stride];                                                 \
            memset(parts + count, 0, (lanes) * sizeof *parts);                                     \
            from = parts;                                                                          \
            last = count;                                                                          \
        }                                                                                          \
        for (int i = 0; i < count; i += (lanes)) {                                                 \
            int at = i < last ? i : last;                                                          \
            write;                                                                                 \
        }                                                                                          \
    }

READER(uint8, uint8_t, SP_WIDE_SHORT,
       write_narrow(&rows->scaling, sp_fetch_uint8(from + at), out + at))
READER(int8, int8_t, SP_WIDE_SHORT,
       write_narrow(&rows->scaling, sp_fetch_int8(from + at), out + at))
READER(uint16, uint16_t, SP_WIDE_SHORT,
       write_narrow(&rows->scaling, sp_fetch_uint16(from + at), out + at))
READER(int16, int16_t, SP_WIDE_SHORT,
       write_narrow(&rows->scaling, sp_fetch_int16(from + at), out + at))
READER(int32, int32_t, SP_WIDE, WRITE_DOUBLES(rows->curve, from + at, out + at))
READER(float32, float, SP_WIDE, write_floats(rows->curve, from + at, out + at))
READER(wide_float32, float, SP_WIDE, WRITE_DOUBLES(rows->curve, from + at, out + at))
READER(float64, double, SP_WIDE, WRITE_DOUBLES(rows->curve, from + at, out + at))

static void read_inside(const struct sp_rows *rows, ptrdiff_t line, int begin, int end,
                        uint16_t *out) {
    switch (rows->type) {
    case SP_UINT8:
        read_uint8(rows, line, begin, end, out);
        break;
    case SP_INT8:
        read_int8(rows, line, begin, end, out);
        break;
    case SP_UINT16:
        read_uint16(rows, line, begin, end, out);
        break;
    case SP_INT16:
        read_int16(rows, line, begin, end, out);
        break;
    case SP_INT32:
        read_int32(rows, line, begin, end, out);
        break;
    case SP_FLOAT32:
        if (rows->is_float_exact)
            read_float32(rows, line, begin, end, out);
        else
            read_wide_float32(rows, line, begin, end, out);
        break;
    case SP_FLOAT64:
        read_float64(rows, line, begin, end, out);
        break;
    case SP_TYPE_COUNT:
        break;
    }
}

/* Prefetches samples, which may lie outside of the voxels. */
static inline void prefetch(const struct sp_rows *rows, ptrdiff_t at, int count) {
    enum { CACHE_LINE = 64 };
    const uintptr_t from = (uintptr_t)rows->voxels + (uintptr_t)(at * rows->size);
    for (int i = 0; i < count * rows->size + CACHE_LINE - 1; i += CACHE_LINE)
        __builtin_prefetch((const void *)(from + (unsigned)i));
}

void sp_rows_read(const struct sp_rows *rows, ptrdiff_t line, int first, int count, uint16_t *out) {
    int left = first < 0 ? -first : 0;
    int right = first + count > rows->count ? first + count - rows->count : 0;
    if (!rows->blocks)
        prefetch(rows, line + rows->ahead + first, count);
    read_inside(rows, line, first + left, first + count - right, out + left);
    for (int i = 0; i < left; i++)
        out[i] = out[left];
    for (int i = count - right; i < count; i++)
        out[i] = out[count - right - 1];
}
