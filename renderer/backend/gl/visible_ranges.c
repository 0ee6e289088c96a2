/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/visible_ranges.h"

#include <float.h>
#include <string.h>

#include "base/minmax.h"
#include "classify/visible_ranges.h"

/* The values that are compared: values of samples, or values of pixels relative to the base. */
struct scale {
    enum sp_type type;
    bool is_post;
    double base;
};

static double value_of(const struct scale *scale, int64_t ordinal) {
    double value = (double)ordinal;
    if (scale->type == SP_FLOAT32) {
        union {
            int32_t bits;
            float real;
        } u = { .bits = (int32_t)ordinal };
        u.bits ^= u.bits < 0 ? INT32_MAX : 0;
        value = (double)u.real;
    }
    return scale->is_post ? (double)(float)(value - scale->base) : value;
}

static void fill_bounds(enum sp_type type, int64_t bounds[2]) {
    static const int64_t all[][2] = {
        [SP_UINT8] = { 0, UINT8_MAX },           [SP_INT8] = { INT8_MIN, INT8_MAX },
        [SP_UINT16] = { 0, UINT16_MAX },         [SP_INT16] = { INT16_MIN, INT16_MAX },
        [SP_INT32] = { INT32_MIN, INT32_MAX },   [SP_FLOAT32] = { -0x7f800000, 0x7f7fffff },
        [SP_FLOAT64] = { INT32_MIN, INT32_MAX },
    };
    memcpy(bounds, all[type], sizeof all[type]);
}

/* Returns the smallest ordinal whose value is above `value` or, with or_equal, equal to it. One
 * beyond the largest ordinal if there is none. */
static int64_t find_first(const struct scale *scale, double value, bool or_equal) {
    int64_t bounds[2];
    fill_bounds(scale->type, bounds);
    int64_t low = bounds[0], high = bounds[1] + 1;
    while (low < high) {
        int64_t middle = low + (high - low) / 2;
        double at = value_of(scale, middle);
        if (at > value || (or_equal && at == value))
            high = middle;
        else
            low = middle + 1;
    }
    return low;
}

void gl_visible_ranges_init(struct gl_visible_ranges *ranges, const struct sp_transfer *transfer) {
    struct sp_visible_ranges values;
    struct scale scale = { .type = transfer->type,
                           .is_post = transfer->tf.order == SP_TF_POST,
                           .base = sp_transfer_base(transfer) };
    int64_t bounds[2];
    fill_bounds(scale.type, bounds);
    if (scale.is_post)
        sp_visible_ranges_init_keys(&values, &transfer->tf, scale.base);
    else
        sp_visible_ranges_init(&values, &transfer->tf);
    ranges->count = 0;
    for (uint32_t i = 0; i < values.count; i++) {
        const struct sp_visible_interval *in = &values.interval[i];
        int64_t low = find_first(&scale, in->low, in->has_low);
        int64_t high = find_first(&scale, in->high, !in->has_high) - 1;
        if (low > bounds[1] || high < bounds[0])
            continue;
        ranges->ends[ranges->count][0] = (int32_t)low;
        ranges->ends[ranges->count++][1] = (int32_t)high;
    }
}

bool gl_visible_ranges_is_possible(const struct sp_volume_info *info) {
    return info->type != SP_FLOAT64 && info->range[1] - info->range[0] < (double)FLT_MAX;
}

bool gl_visible_ranges_write_points(struct gl_buffer *buffer, const struct sp_transfer *transfer,
                                    uint64_t *uploaded, struct sp_error *err) {
    enum { HEAD = 4 };
    float rows[HEAD + 2 * SP_TF_POINTS_MAX][4] = { { 0 } };
    const struct sp_transfer_function *tf = &transfer->tf;
    uint64_t bytes = (HEAD + 2 * (uint64_t)tf->point_count) * sizeof rows[0];
    memcpy(rows[0], &tf->point_count, sizeof tf->point_count);
    for (uint32_t i = 0; i < tf->point_count; i++) {
        const struct sp_tf_point *p = &tf->points[i];
        float(*row)[4] = rows + HEAD + 2 * i;
        row[0][0] = sp_finite_float(p->value - transfer->base);
        if (i + 1 < tf->point_count)
            row[0][1] = sp_finite_float(1 / (p[1].value - p->value));
        row[0][2] = p->opacity;
        memcpy(row[1], p->color, sizeof p->color);
    }
    if (!gl_buffer_reserve(buffer, "points of a transfer function", sizeof rows, 0, GL_USE_STREAM,
                           err))
        return false;
    gl_buffer_write(buffer, rows, bytes);
    *uploaded += bytes;
    return true;
}
