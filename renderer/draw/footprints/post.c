/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/footprints/post.h"

#include <float.h>
#include <string.h>

#include "base/minmax.h"
#include "draw/footprints/tile.h"
#include "splat/exp2.h"

/* Adds the integrals of depth and of colour times depth over [low, high], which contains no point
 * of the transfer function. Four Gauss-Legendre nodes are enough, because the integrand is smooth
 * there. */
static void integrate(const struct sp_transfer_function *tf, double low, double high,
                      double sum[4]) {
    static const double at[4] = { 0.0694318442029737, 0.3300094782075719, 0.6699905217924281,
                                  0.9305681557970263 };
    static const double weight[4] = { 0.1739274225687269, 0.3260725774312731, 0.3260725774312731,
                                      0.1739274225687269 };
    for (int i = 0; i < 4; i++) {
        struct sp_class c;
        sp_transfer_function_eval(tf, low + at[i] * (high - low), &c);
        double depth = (double)c.depth * weight[i] * (high - low);
        sum[0] += depth;
        for (int k = 0; k < 3; k++)
            sum[k + 1] += (double)c.color[k] * depth;
    }
}

static void fill_integral(struct sp_post_curve *c, const struct sp_transfer_function *tf,
                          const double range[2], double base, double (*integral)[4]) {
    const struct sp_tf_point *next = tf->points, *end = next + tf->point_count;
    double low = fmax(next->value, range[0]), high = fmin(end[-1].value, range[1]);
    double step = (high - low) / SP_POST_NODES, sum[4] = { 0 };
    if (!(step > 0) || !isfinite(step))
        return;
    c->first_node = low - base;
    c->nodes_per_unit = 1 / step;
    c->integral = (const double(*)[4])integral;
    for (int i = 0; i < 2; i++) {
        struct sp_class class;
        sp_transfer_function_eval(tf, i ? high : low, &class);
        for (int k = 0; k < 4; k++)
            c->ends[i][k] = (double)class.depth * (k > 0 ? (double)class.color[k - 1] : 1);
    }
    memcpy(integral[0], sum, sizeof sum);
    for (int n = 0; n < SP_POST_NODES; n++) {
        double from = low + n * step, to = low + (n + 1) * step;
        for (; next < end && next->value < to; next++)
            if (next->value > from) {
                integrate(tf, from, next->value, sum);
                from = next->value;
            }
        integrate(tf, from, to, sum);
        memcpy(integral[n + 1], sum, sizeof sum);
    }
}

void sp_post_curve_init(struct sp_post_curve *c, const struct sp_transfer_function *tf,
                        const double range[2], double base, double gradient_unit,
                        double (*integral)[4]) {
    *c = (struct sp_post_curve){ .count = tf->point_count, .gradient_count = tf->gradient_count };
    for (uint32_t i = 0; i < c->count; i++) {
        const struct sp_tf_point *p = &tf->points[i];
        c->value[i] = sp_finite_float(p->value - base);
        c->opacity[i] = p->opacity;
        for (int k = 0; k < 3; k++)
            c->color[i][k] = p->color[k];
        if (i + 1 < c->count)
            c->inverse[i] = sp_finite_float(1 / (p[1].value - p->value));
    }
    float span = c->value[c->count - 1] - c->value[0];
    c->bins_per_unit = span > 0 && span < FLT_MAX ? SP_POST_BINS / span : 0;
    for (uint32_t b = 0, i = 0; b <= SP_POST_BINS; b++) {
        while (i + 1 < c->count && (c->value[i + 1] - c->value[0]) * c->bins_per_unit < (float)b)
            i++;
        c->first[b] = (uint8_t)i;
    }
    for (uint32_t i = 0; i < c->gradient_count; i++) {
        c->magnitude[i] = sp_finite_float(tf->gradient[i].magnitude / gradient_unit);
        c->scale[i] = tf->gradient[i].scale;
    }
    fill_integral(c, tf, range, base, integral);
}

static float gradient_scale(const struct sp_post_curve *c, float magnitude) {
    uint32_t n = c->gradient_count, i = 1;
    if (n == 0)
        return 1;
    if (!(magnitude > c->magnitude[0]))
        return c->scale[0];
    while (i < n && c->magnitude[i] <= magnitude)
        i++;
    if (i == n)
        return c->scale[n - 1];
    float f = (magnitude - c->magnitude[i - 1]) / (c->magnitude[i] - c->magnitude[i - 1]);
    return c->scale[i - 1] + f * (c->scale[i] - c->scale[i - 1]);
}

/* −ln(1 − a), a in [0, 1). */
static float depth_of(float a) {
    if (a < 0.03f)
        return a * (1 + a * (0.5f + a * (1.0f / 3 + a * 0.25f)));
    return -0.693147181f * sp_log2(1 - a);
}

/* Computes the opacity and the colour at one value. */
static struct sp_class class_at(const struct sp_post_curve *c, float value) {
    uint32_t i = 0, j = 0;
    float f = 0;
    struct sp_class class = { { 0 }, 0 };
    if (value > c->value[0]) {
        float bin = (value - c->value[0]) * c->bins_per_unit;
        i = c->first[bin < SP_POST_BINS ? (int)bin : SP_POST_BINS];
        while (i + 1 < c->count && c->value[i + 1] <= value)
            i++;
        while (i > 0 && c->value[i] > value) /* rounding moved the value into the next bin */
            i--;
        j = i + 1 < c->count ? i + 1 : i;
        f = (value - c->value[i]) * c->inverse[i];
        f = f < 1 ? f : 1;
    }
    class.depth = depth_of(c->opacity[i] + f * (c->opacity[j] - c->opacity[i]));
    for (int k = 0; k < 3; k++)
        class.color[k] = c->color[i][k] + f * (c->color[j][k] - c->color[i][k]);
    return class;
}

/* Returns the integrals from the first node to a value. */
static void integral_at(const struct sp_post_curve *c, double value, double sum[4]) {
    double at = (value - c->first_node) * c->nodes_per_unit, beyond = 0;
    const double *held = c->ends[at >= 0];
    if (at < 0 || at >= SP_POST_NODES) {
        double limit = at < 0 ? 0 : SP_POST_NODES;
        beyond = (at - limit) / c->nodes_per_unit;
        at = limit;
    }
    int i = at < SP_POST_NODES ? (int)at : SP_POST_NODES - 1;
    for (int k = 0; k < 4; k++)
        sum[k] = c->integral[i][k] + (at - i) * (c->integral[i + 1][k] - c->integral[i][k]) +
                 beyond * held[k];
}

/* Returns the mean over [value − half, value + half]. */
static struct sp_class class_around(const struct sp_post_curve *c, float value, float half) {
    double low[4], high[4];
    struct sp_class class = { { 0 }, 0 };
    integral_at(c, (double)value - (double)half, low);
    integral_at(c, (double)value + (double)half, high);
    double depth = high[0] - low[0];
    if (!(depth > 0))
        return class;
    class.depth = (float)(depth / (2 * (double)half));
    for (int k = 0; k < 3; k++)
        class.color[k] = (float)((high[k + 1] - low[k + 1]) / depth);
    return class;
}

struct sp_class sp_post_class(const struct sp_post_curve *c, float value, float half,
                              float magnitude) {
    bool is_point = !c->integral || !((double)half * c->nodes_per_unit > 0.5);
    struct sp_class class = is_point ? class_at(c, value) : class_around(c, value, half);
    float scale = class.depth > 0 ? gradient_scale(c, magnitude) : 1;
    if (scale < 1)
        class.depth = depth_of(scale * (1 - sp_exp2(-SP_LOG2E * class.depth)));
    return class;
}

/* SP_WIDE pixels of a row of sums, as means along their rays through the slab. */
struct means {
    sp_wide gradient[3], length, to_eye[3];
    sp_wide value, half; /* half of the interval of scalar values along the ray */
};

/* Computes the unit vectors towards the eye in camera space, along the rays of the pixels from (x,
 * y) on. */
static inline void eye_direction(const struct sp_post *post, int x, int y, sp_wide to_eye[3]) {
    sp_wide u = sp_wide_all(0);
    float v = 0;
    if (post->perspective) {
        u = (sp_wide_from_int(sp_wide_int_count() + x) + 0.5f - post->centre[0]) / post->focal;
        v = ((float)y + 0.5f - post->centre[1]) / post->focal;
    }
    sp_wide inv = -1 / sp_wide_sqrt(u * u + v * v + 1);
    for (int k = 0; k < 3; k++)
        to_eye[k] =
            inv * (post->to_camera[0][k] * u + post->to_camera[1][k] * v + post->to_camera[2][k]);
}

static inline void compute_means(const struct sp_post *post, int x, int y, const sp_wide sums[5],
                                 struct means *m) {
    sp_wide inv = 1 / sums[0], along = sp_wide_all(0);
    for (int k = 0; k < 3; k++)
        m->gradient[k] = sums[k + 1] * inv;
    m->length = sp_wide_sqrt(m->gradient[0] * m->gradient[0] + m->gradient[1] * m->gradient[1] +
                             m->gradient[2] * m->gradient[2]);
    eye_direction(post, x, y, m->to_eye);
    for (int k = 0; k < 3; k++)
        along += m->to_eye[k] * m->gradient[k];
    m->value = sums[4] * inv;
    m->half = sp_wide_abs(along) * post->half;
}

static inline void shade(const struct sp_shade *shade, const struct means *m, sp_wide color[3]) {
    sp_wide_mask has_length = sp_wide_lt(sp_wide_all(1e-12f), m->length);
    sp_wide normal[3], scale = sp_wide_keep(has_length, 1 / m->length);
    for (int k = 0; k < 3; k++)
        normal[k] = m->gradient[k] * scale;
    sp_shade_direction(shade, normal, m->to_eye, color);
}

/* Classifies the lanes in `bits`, one by one, because their table entries are not contiguous. */
static void classify(const struct sp_post_curve *curve, const struct means *m, unsigned bits,
                     sp_wide *depth, sp_wide color[3]) {
    float value[SP_WIDE], half[SP_WIDE], length[SP_WIDE], to[4][SP_WIDE] = { { 0 } };
    sp_wide_store(value, m->value);
    sp_wide_store(half, m->half);
    sp_wide_store(length, m->length);
    for (; bits; bits &= bits - 1) {
        int i = __builtin_ctz(bits);
        struct sp_class c = sp_post_class(curve, value[i], half[i], length[i]);
        to[0][i] = c.depth;
        for (int k = 0; k < 3; k++)
            to[k + 1][i] = c.color[k];
    }
    *depth = sp_wide_load(to[0]);
    for (int k = 0; k < 3; k++)
        color[k] = sp_wide_load(to[k + 1]);
}

void sp_post_classify(const struct sp_post *post, int x, int y, float *sums, int begin, int end) {
    enum { S = SP_TILE };
    for (int i = begin & -SP_WIDE; i < end; i += SP_WIDE) {
        sp_wide at[5], depth, color[3];
        struct means m;
        for (int k = 0; k < 5; k++)
            at[k] = sp_wide_load(sums + k * S + i);
        unsigned bits = sp_wide_mask_bits(sp_wide_lt(sp_wide_all(1e-12f), at[0]));
        compute_means(post, x + i, y, at, &m);
        classify(&post->curve, &m, bits, &depth, color);
        if (post->shade && sp_wide_any(sp_wide_lt(sp_wide_all(0), depth)))
            shade(post->shade, &m, color);
        depth *= at[0];
        sp_wide_mask counts = sp_wide_lt(sp_wide_all(0), depth);
        sp_wide_store(sums + i, sp_wide_keep(counts, depth));
        for (int k = 0; k < 3; k++)
            sp_wide_store(sums + (k + 1) * S + i, sp_wide_keep(counts, color[k] * depth));
    }
}
