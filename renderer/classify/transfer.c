/* SPDX-License-Identifier: Apache-2.0 */
#include "classify/transfer.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "classify/gradient.h"
#include "data/volume/sample.h"

bool sp_transfer_function_equal_scale(const struct sp_transfer_function *a,
                                      const struct sp_transfer_function *b) {
    if (a->gradient_count != b->gradient_count)
        return false;
    for (uint32_t i = 0; i < a->gradient_count; i++)
        if (a->gradient[i].magnitude != b->gradient[i].magnitude ||
            a->gradient[i].scale != b->gradient[i].scale)
            return false;
    return true;
}

/* Returns the last point whose value is <= `value`. Point 0 must be. */
static uint32_t find_point(const struct sp_transfer_function *tf, double value) {
    uint32_t low = 0, high = tf->point_count;
    while (high - low > 1) {
        uint32_t middle = (low + high) / 2;
        if (tf->points[middle].value <= value)
            low = middle;
        else
            high = middle;
    }
    return low;
}

/* Interpolates on the piece from p to q, which may be the same point. */
static inline void eval_piece(const struct sp_tf_point *p, const struct sp_tf_point *q,
                              double value, struct sp_class *out) {
    double f = 0;
    if (p != q) /* halved, because the difference of two finite numbers need not be finite */
        f = (0.5 * value - 0.5 * p->value) / (0.5 * q->value - 0.5 * p->value);
    for (int c = 0; c < 3; c++)
        out->color[c] = (float)(p->color[c] + f * ((double)q->color[c] - (double)p->color[c]));
    double opacity = p->opacity + f * ((double)q->opacity - (double)p->opacity);
    out->depth = opacity > 0 ? (float)-log1p(-opacity) : 0;
}

void sp_transfer_function_eval(const struct sp_transfer_function *tf, double value,
                               struct sp_class *out) {
    const struct sp_tf_point *p = tf->points, *q = p;
    if (!isfinite(value)) {
        *out = (struct sp_class){ { 0 }, 0 };
        return;
    }
    if (value > p->value) {
        uint32_t i = find_point(tf, value);
        p = q = &tf->points[i];
        if (i + 1 < tf->point_count)
            q++;
    }
    eval_piece(p, q, value, out);
}

double sp_transfer_function_scale(const struct sp_transfer_function *tf, double magnitude) {
    const struct sp_gradient_point *p = tf->gradient;
    uint32_t n = tf->gradient_count, i = 1;
    if (n == 0)
        return 1;
    if (!(magnitude > p[0].magnitude))
        return (double)p[0].scale;
    while (i < n && p[i].magnitude <= magnitude)
        i++;
    if (i == n)
        return (double)p[n - 1].scale;
    double f = (magnitude - p[i - 1].magnitude) / (p[i].magnitude - p[i - 1].magnitude);
    return (double)p[i - 1].scale + f * ((double)p[i].scale - (double)p[i - 1].scale);
}

static bool make_scale(struct sp_transfer *transfer, const struct sp_volume_info *info) {
    if (!transfer->tf.gradient_count)
        return true;
    struct sp_gradient_grid units;
    transfer->scale = malloc((SP_GRADIENT_MAGNITUDES + 1) * sizeof *transfer->scale);
    if (!transfer->scale)
        return false;
    sp_gradient_units_init(&units, info);
    for (uint32_t m = 0; m <= SP_GRADIENT_MAGNITUDES; m++)
        transfer->scale[m] = (float)sp_transfer_function_scale(
            &transfer->tf, sp_gradient_magnitude(&units, m << 22));
    return true;
}

static bool make_pieces(struct sp_transfer *transfer) {
    const struct sp_transfer_function *tf = &transfer->tf;
    struct sp_pieces *pieces = transfer->pieces = calloc(1, sizeof *pieces);
    if (!pieces)
        return false;
    pieces->count = tf->point_count + 1;
    for (uint32_t s = 0; s < pieces->count; s++) {
        const struct sp_tf_point *p = &tf->points[s ? s - 1 : 0];
        bool is_flat = s == 0 || s == tf->point_count;
        const struct sp_tf_point *q = is_flat ? p : p + 1;
        double length = q->value - p->value;
        float least = length > 0 ? (float)(1 / length) : 0;
        pieces->start[s] = (float)(p->value - transfer->base);
        for (int c = 0; c < 4; c++) {
            double from = c < 3 ? (double)p->color[c] : (double)p->opacity;
            double to = c < 3 ? (double)q->color[c] : (double)q->opacity;
            pieces->at[c][s] = (float)from;
            pieces->slope[c][s] = isfinite(least) ? (float)(to - from) * least : 0;
        }
    }
    return true;
}

static bool has_table(enum sp_type type) {
    return type == SP_UINT8 || type == SP_INT8 || type == SP_UINT16 || type == SP_INT16;
}

/* Returns the value that keys of real types are relative to. Keys are most precise there, so it is
 * the lower end of the shortest piece that shows anything, limited to the range of the volume. A
 * distant point with opacity 0 must not cost precision. */
static double choose_base(const struct sp_transfer_function *tf, const double range[2]) {
    double base = tf->points[0].value, shortest = INFINITY;
    for (uint32_t i = 0; i + 1 < tf->point_count; i++) {
        const struct sp_tf_point *p = &tf->points[i];
        double length = p[1].value / 2 - p->value / 2;
        if ((p->opacity > 0 || p[1].opacity > 0) && length < shortest) {
            shortest = length;
            base = p->value;
        }
    }
    return fmax(range[0], fmin(base, range[1]));
}

/* The points between which a value lies, given that calls come with rising values; beyond the ends
 * twice the same. *at: where to go on. */
static void advance_piece(const struct sp_transfer_function *tf, double value, uint32_t *at,
                          const struct sp_tf_point *piece[2]) {
    while (*at + 1 < tf->point_count && tf->points[*at + 1].value <= value)
        ++*at;
    bool is_beyond = !(value > tf->points[0].value) || *at + 1 == tf->point_count;
    piece[0] = &tf->points[*at];
    piece[1] = is_beyond ? piece[0] : piece[0] + 1;
}

static bool is_same_point(const struct sp_tf_point *a, const struct sp_tf_point *b) {
    return a->value == b->value && a->opacity == b->opacity && a->color[0] == b->color[0] &&
           a->color[1] == b->color[1] && a->color[2] == b->color[2];
}

/* like: where pieces that both functions have are copied from; NULL = nowhere. */
static void fill_table(struct sp_transfer *t, const struct sp_transfer *like) {
    const struct sp_tf_point *piece[4] = { NULL }, *last[4] = { NULL };
    uint32_t at = 0, other = 0;
    bool is_same = false;
    if (like && (!like->table || like->first != t->first || like->count != t->count))
        like = NULL;
    for (uint32_t i = 0; i < t->count; i++) {
        double value = (double)t->first + i;
        advance_piece(&t->tf, value, &at, piece);
        if (like)
            advance_piece(&like->tf, value, &other, piece + 2);
        if (like && memcmp(piece, last, sizeof piece) != 0)
            is_same = is_same_point(piece[0], piece[2]) && is_same_point(piece[1], piece[3]);
        memcpy(last, piece, sizeof piece);
        if (is_same)
            t->table[i] = like->table[i];
        else
            eval_piece(piece[0], piece[1], value, &t->table[i]);
        t->is_visible[i] = t->table[i].depth > 0;
    }
}

/* Fills in the limits of the samples. Samples of a volume that is larger than memory may have any
 * value: its range comes from the file, which is not trusted, or from a coarse level. */
static void fill_limits(const struct sp_volume_info *info, double limits[2]) {
    static const double ends[][2] = { [SP_UINT8] = { 0, UINT8_MAX },
                                      [SP_INT8] = { INT8_MIN, INT8_MAX },
                                      [SP_UINT16] = { 0, UINT16_MAX },
                                      [SP_INT16] = { INT16_MIN, INT16_MAX } };
    memcpy(limits, info->whole.dims[0] ? ends[info->type] : info->range, sizeof ends[0]);
}

int32_t sp_transfer_first(const struct sp_volume_info *info) {
    double limits[2];
    fill_limits(info, limits);
    return (int32_t)limits[0];
}

bool sp_transfer_init(struct sp_transfer *transfer, const struct sp_transfer_function *tf,
                      const struct sp_volume_info *info, const struct sp_transfer *like,
                      struct sp_error *err) {
    *transfer =
        (struct sp_transfer){ .tf = *tf, .type = info->type, .base = choose_base(tf, info->range) };
    if (!make_scale(transfer, info))
        return sp_fail(err, SP_ERR_MEMORY, "/transfer_function/gradient",
                       "out of memory for its table");
    if (!has_table(info->type)) {
        if (make_pieces(transfer))
            return true;
        sp_transfer_finish(transfer);
        return sp_fail(err, SP_ERR_MEMORY, "/transfer_function", "out of memory for its pieces");
    }
    double limits[2];
    fill_limits(info, limits);
    transfer->first = (int32_t)limits[0];
    transfer->count = (uint32_t)((int32_t)limits[1] - transfer->first) + 1;
    transfer->table = malloc(transfer->count * sizeof *transfer->table);
    transfer->is_visible = malloc(transfer->count);
    if (!transfer->table || !transfer->is_visible) {
        sp_transfer_finish(transfer);
        return sp_fail(err, SP_ERR_MEMORY, "/transfer_function", "out of memory for its table");
    }
    fill_table(transfer, like);
    return true;
}

void sp_transfer_finish(struct sp_transfer *transfer) {
    free(transfer->table);
    free(transfer->is_visible);
    free(transfer->scale);
    free(transfer->pieces);
    *transfer = (struct sp_transfer){ 0 };
}

bool sp_transfer_same_voxels(const struct sp_transfer *a, const struct sp_transfer *b) {
    if (a->type != b->type || a->first != b->first || a->count != b->count)
        return false;
    bool is_post = a->tf.order == SP_TF_POST; /* then values between samples count as well */
    if (a->tf.order != b->tf.order)
        return false;
    if (a->table && !is_post)
        return b->table && memcmp(a->is_visible, b->is_visible, a->count) == 0;
    const struct sp_transfer_function *p = &a->tf, *q = &b->tf;
    if (p->point_count != q->point_count)
        return false;
    for (uint32_t i = 0; i < p->point_count; i++)
        if (p->points[i].value != q->points[i].value ||
            (p->points[i].opacity > 0) != (q->points[i].opacity > 0))
            return false;
    return true;
}

static void key_of_real(const struct sp_transfer *t, double value, uint32_t *key,
                        uint8_t *visible) {
    struct sp_class c;
    union {
        float value;
        uint32_t bits;
    } u = { .value = (float)(value - t->base) };
    sp_transfer_function_eval(&t->tf, value, &c);
    *key = u.bits;
    *visible = c.depth > 0 && isfinite(u.value);
}

#define FIND_KEYS(T)                                                                               \
    for (size_t i = 0; i < count; i++)                                                             \
    keys[i] = (uint32_t)(((const T *)voxels)[begin + i] - t->first)

void sp_transfer_keys(const struct sp_transfer *t, const void *voxels, size_t begin, size_t count,
                      uint32_t *keys, uint8_t *visible) {
    switch (t->type) {
        SP_SHORT_CASES(FIND_KEYS)
    default:
        for (size_t i = 0; i < count; i++)
            key_of_real(t, sp_sample(voxels, t->type, begin + i), &keys[i], &visible[i]);
        return;
    }
    for (size_t i = 0; i < count; i++)
        visible[i] = t->is_visible[keys[i]];
}
