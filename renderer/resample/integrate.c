/* SPDX-License-Identifier: Apache-2.0
 *
 * Composites the interval of the rays between two sheets.
 *
 *   sheet   0      1      2      3         the value half way is that of the polynomial of
 *           ·──────·──┬───·──────·         degree 3 through four sheets; in each half the value
 *                  └half┘                  changes linearly, and the curve's integral classifies it
 */
#include "frame/resolve.h"
#include "light/read.h"
#include "resample/fetch.h"
#include "resample/kernels.h"
#include "splat/exp2.h"

/* SP_WIDE rays in one interval. */
struct interval {
    sp_wide value[3]; /* at its start, in its middle and at its end [levels] */
    float width;      /* s from sheet to sheet */
    float middle;     /* s half way */
    sp_wide length;   /* of the ray inside, reference lengths */
    sp_wide light;    /* transmittance */
    sp_wide color[3]; /* premultiplied */
};

/* 1 − opacity over the length, for a mean optical depth per reference length. */
static inline sp_wide transmit(const struct sp_resample *r, sp_wide depth, sp_wide length) {
    if (r->is_linear)
        return sp_wide_max(1 - depth * length, sp_wide_all(0));
    return sp_wide_exp2(depth * length * -SP_LOG2E);
}

/* The depth of an opacity that is multiplied by `scale`. */
static inline sp_wide scale_depth(sp_wide depth, sp_wide scale) {
    sp_wide opacity = scale * (1 - sp_wide_exp2(depth * -SP_LOG2E));
    return sp_wide_log2(sp_wide_max(1 - opacity, sp_wide_all(1e-30f))) * (-1 / SP_LOG2E);
}

/* The mean of the curve over the interval: over its first half, where the value goes from
 * value[0] to value[1], and over its second one. */
static inline void find_mean(const struct sp_curve *curve, const struct interval *in,
                             sp_wide mean[4]) {
    const sp_wide zero = sp_wide_all(0), top = sp_wide_all(CURVE_BINS), one = sp_wide_all(1);
    sp_wide at[3], beyond[3], above[2], share[2];
    sp_wide_int bin[3];
    for (int k = 0; k < 3; k++) {
        sp_wide x = in->value[k] * curve->bins_per_level + curve->first_bin;
        sp_wide inside = sp_wide_min(sp_wide_max(x, zero), top);
        beyond[k] = x - inside;
        bin[k] = sp_wide_to_int(inside);
        at[k] = sp_wide_from_int(bin[k]);
    }
    for (int k = 0; k < 2; k++) { /* a half is at least one bin wide */
        sp_wide_mask is_equal = ~(sp_wide_lt(at[k], at[k + 1]) | sp_wide_lt(at[k + 1], at[k]));
        at[k + 1] += sp_wide_keep(is_equal, one);
        bin[k + 1] = sp_wide_to_int(at[k + 1]);
        /* It is as wide as the whole bins whose integral is taken, so that quantisation cancels,
         * and what lies below all bins, which is transparent, or above them. */
        sp_wide width = at[k + 1] - at[k];
        share[k] = 0.5f / (sp_wide_abs(width) + sp_wide_abs(beyond[k + 1] - beyond[k]));
        above[k] = sp_wide_max(beyond[k + 1], zero) - sp_wide_max(beyond[k], zero);
        above[k] = share[k] * sp_wide_abs(above[k]);
        share[k] = sp_wide_select(sp_wide_lt(width, zero), -share[k], share[k]);
    }
    sp_fetch_differences((const float(*)[4])curve->integral, bin, share, mean);
    for (int c = 0; c < 4; c++)
        mean[c] += (above[0] + above[1]) * curve->above[c];
}

static inline void classify(const struct sp_resample *r, struct interval *in,
                            const sp_wide *scale) {
    sp_wide sum[4];
    find_mean(&r->curve, in, sum);
    sp_wide depth = scale ? scale_depth(sum[3], *scale) : sum[3];
    in->light = transmit(r, depth, in->length);
    sp_wide weight = (1 - in->light) / sp_wide_max(sum[3], sp_wide_all(1e-20f));
    for (int c = 0; c < 3; c++)
        in->color[c] = weight * sum[c];
}

/* The gradient in the middle of the interval [gradient_unit]. */
static inline void find_gradient(const struct sp_resample_open_tile *t,
                                 struct sp_resample_block *block, int number, int begin,
                                 const sp_wide v[4], float width, sp_wide gradient[3]) {
    static const float share[4] = { -1 / 16.0f, 9 / 16.0f, 9 / 16.0f, -1 / 16.0f };
    sp_wide slope[3] = { sp_wide_all(0), sp_wide_all(0) };
    for (int k = 0; k < 4; k++) {
        int n = number - 1 + k;
        sp_resample_find_slope(t, block, n, begin);
        for (int a = 0; a < 2; a++)
            slope[a] += share[k] * sp_wide_load(block->slope[n & 3][a] + begin);
    }
    /* Along the ray, per slice; what remains of it is along the slices' axis. All three are
     * differences over one sample, so that none of them is blurred more than the others. */
    sp_wide along = (v[2] - v[1]) * (1 / width);
    slope[2] = along - sp_wide_load(block->du + begin) * slope[0] -
               sp_wide_load(block->dv + begin) * slope[1];
    if (t->is_backwards)
        slope[2] = -slope[2];
    for (int w = 0; w < 3; w++) {
        gradient[w] = sp_wide_all(0);
        for (int a = 0; a < 3; a++)
            gradient[w] += t->r->to_world[w][t->axis[a]] * slope[a];
    }
}

static inline sp_wide length_of(const sp_wide v[3]) {
    return sp_wide_sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

/* The scale of the opacity at the gradient's magnitude. */
static inline sp_wide gradient_scale(const struct sp_transfer_function *tf, sp_wide magnitude) {
    sp_wide scale;
    for (int i = 0; i < SP_WIDE; i++)
        scale[i] = (float)sp_transfer_function_scale(tf, (double)magnitude[i]);
    return scale;
}

/* Unit vectors to the eye, in camera space, from SP_WIDE pixels of a row. */
static inline void find_eye(const struct sp_camera_transform *camera, float x, float y,
                            sp_wide to_eye[3]) {
    const sp_wide zero = sp_wide_all(0), one = sp_wide_all(1);
    float inverse = 1 / (float)camera->scale;
    to_eye[0] = to_eye[1] = zero;
    to_eye[2] = -one;
    if (camera->projection == SP_ORTHOGRAPHIC)
        return;
    sp_wide column = sp_wide_from_int(sp_wide_int_count() & (RESAMPLE_BLOCK - 1));
    sp_wide row = sp_wide_from_int(sp_wide_int_count() >> 3);
    sp_wide right = (column + (x - (float)camera->centre[0])) * inverse;
    sp_wide down = (row + (y - (float)camera->centre[1])) * inverse;
    sp_wide scale = -one / sp_wide_sqrt(right * right + down * down + 1);
    to_eye[0] = right * scale;
    to_eye[1] = down * scale;
    to_eye[2] = scale;
}

/* The shares of ambient light and of the first light that arrive at the middle of an interval. They
 * are read about a cell before it, on the eye's side of its surface. A gradient as small as noise
 * is no surface. */
static inline void find_share(const struct sp_resample_open_tile *t,
                              const struct sp_resample_block *block, int begin, float s,
                              const sp_wide world[3], sp_wide magnitude, const sp_wide to_eye[3],
                              sp_wide share[2]) {
    const struct sp_resample *r = t->r;
    const struct sp_light_field *light = r->light;
    const float to_front = 0.75f, off_surface = 0.5f; /* cells */
    const sp_wide zero = sp_wide_all(0);
    sp_wide at[3], move[3], side = zero, firm = magnitude * r->light_firmness;
    firm = sp_wide_min(firm * firm, sp_wide_all(1)) * off_surface;
    at[t->axis[0]] = sp_wide_load(block->u + begin) + s * sp_wide_load(block->du + begin);
    at[t->axis[1]] = sp_wide_load(block->v + begin) + s * sp_wide_load(block->dv + begin);
    at[t->axis[2]] = sp_wide_all(t->is_backwards ? t->reference - s : t->reference + s);
    for (int k = 0; k < 3; k++) {
        const float *w = r->shade->to_camera[k];
        side += to_eye[k] * (w[0] * world[0] + w[1] * world[1] + w[2] * world[2]);
    }
    side = sp_wide_select(sp_wide_lt(side, zero), -firm, firm);
    for (int c = 0; c < 3; c++) {
        move[c] = side * world[c];
        for (int k = 0; k < 3; k++)
            move[c] += r->shade->to_camera[k][c] * to_eye[k] * to_front;
    }
    for (int a = 0; a < 3; a++) {
        const float *o = light->offset[a];
        at[a] = at[a] * r->light_scale + r->light_first + o[0] * move[0] + o[1] * move[1] +
                o[2] * move[2];
    }
    sp_light_read(light, at, share);
    share[0] = 1 - light->occlusion * (1 - share[0] * (1 / 255.0f));
    share[1] = 1 - light->shadow * (1 - share[1] * (1 / 255.0f));
}

/* Lights the interval's colour by its gradient. */
static inline void shade(const struct sp_resample_open_tile *t,
                         const struct sp_resample_block *block, int begin, struct interval *in,
                         const sp_wide gradient[3], sp_wide magnitude, const int at[2]) {
    const struct sp_resample *r = t->r;
    const sp_wide tiny = sp_wide_all(1e-20f);
    float x = (float)(t->x + at[0] + begin % RESAMPLE_BLOCK) + 0.5f;
    float y = (float)(t->y + at[1] + begin / RESAMPLE_BLOCK) + 0.5f;
    sp_wide world[3], to_eye[3], color[3], opacity = 1 - in->light;
    sp_wide inverse = sp_wide_keep(sp_wide_lt(tiny, magnitude), 1 / sp_wide_max(magnitude, tiny));
    for (int c = 0; c < 3; c++) {
        world[c] = gradient[c] * inverse;
        color[c] = in->color[c] / sp_wide_max(opacity, tiny);
    }
    find_eye(r->camera, x, y, to_eye);
    if (r->light) {
        sp_wide share[2];
        find_share(t, block, begin, in->middle, world, magnitude, to_eye, share);
        sp_shade_occluded(r->shade, world, to_eye, share, color);
    } else {
        sp_shade_direction(r->shade, world, to_eye, color);
    }
    for (int c = 0; c < 3; c++)
        in->color[c] = sp_wide_keep(sp_wide_lt(tiny, opacity), color[c] * opacity);
}

/* Cuts the interval [s, s + step] to the part of the rays inside all half spaces. */
static inline void cut(const struct sp_resample_block *block, int begin, float s,
                       struct interval *in) {
    const sp_wide zero = sp_wide_all(0), one = sp_wide_all(1);
    sp_wide from = (sp_wide_load(block->begin + begin) - s) * (1 / in->width);
    sp_wide to = (sp_wide_load(block->end + begin) - s) * (1 / in->width);
    from = sp_wide_min(sp_wide_max(from, zero), one);
    to = sp_wide_max(sp_wide_min(to, one), from);
    sp_wide first = in->value[0], change = in->value[2] - first;
    sp_wide bend = in->value[1] - (first + 0.5f * change), middle = 0.5f * (from + to);
    in->value[0] = first + from * change + 4 * from * (1 - from) * bend;
    in->value[1] = first + middle * change + 4 * middle * (1 - middle) * bend;
    in->value[2] = first + to * change + 4 * to * (1 - to) * bend;
    in->length *= to - from;
}

/* Composites the interval behind what SP_WIDE pixels have. */
static inline void add_interval(const struct sp_resample_open_tile *t,
                                struct sp_resample_block *block, int number, int begin,
                                const sp_wide v[4], struct interval *in, const int at[2]) {
    const struct sp_resample *r = t->r;
    sp_wide gradient[3] = { 0 }, magnitude = sp_wide_all(0), scale = magnitude;
    bool is_scaled = r->view->transfer_function.gradient_count > 0;
    if (r->needs_gradient) {
        find_gradient(t, block, number, begin, v, in->width, gradient);
        magnitude = length_of(gradient);
    }
    if (is_scaled)
        scale = gradient_scale(&r->view->transfer_function, magnitude * r->gradient_unit);
    classify(r, in, is_scaled ? &scale : NULL);
    if (r->shade)
        shade(t, block, begin, in, gradient, magnitude, at);
    sp_wide light = sp_wide_load(block->light + begin);
    for (int c = 0; c < 3; c++) {
        float *color = block->color[c] + begin;
        sp_wide_store(color, sp_wide_load(color) + light * in->color[c]);
    }
    sp_wide_store(block->light + begin, light * in->light);
}

bool sp_resample_integrate(const struct sp_resample_open_tile *t, struct sp_resample_block *block,
                           int number, const int at[2]) {
    const float *visible = t->r->curve.visible;
    float s = sp_resample_sheet_s(t, number), e = sp_resample_sheet_s(t, number + 1);
    bool is_whole = block->inside[0] <= s && e <= block->inside[1], is_alive = false;
    for (int i = 0; i < RESAMPLE_PIXELS; i += SP_WIDE) {
        const sp_wide dark = sp_wide_all(SP_TRANSMITTANCE_MIN);
        if (!sp_wide_any(sp_wide_lt(dark, sp_wide_load(block->light + i))))
            continue;
        is_alive = true;
        sp_wide v[4];
        for (int k = 0; k < 4; k++)
            v[k] = sp_wide_load(block->value[(number - 1 + k) & 3] + i);
        struct interval in;
        in.value[0] = v[1];
        in.value[1] = (v[1] + v[2]) * (9 / 16.0f) - (v[0] + v[3]) * (1 / 16.0f);
        in.value[1] = sp_wide_max(in.value[1], sp_wide_all(t->r->lowest)); /* it overshoots */
        in.value[2] = v[2];
        sp_wide low = sp_wide_min(sp_wide_min(v[1], v[2]), in.value[1]);
        sp_wide high = sp_wide_max(sp_wide_max(v[1], v[2]), in.value[1]);
        if (!sp_wide_any(sp_wide_lt(sp_wide_all(visible[0]), high) &
                         sp_wide_lt(low, sp_wide_all(visible[1]))))
            continue;
        in.width = e - s;
        in.middle = 0.5f * (s + e);
        in.length = sp_wide_load(block->length + i) * in.width;
        if (!is_whole)
            cut(block, i, s, &in);
        add_interval(t, block, number, i, v, &in, at);
    }
    return is_alive;
}
