/* SPDX-License-Identifier: Apache-2.0 */
#include "paths/blend.h"

#include <math.h>
#include <string.h>

#include "common/vectors.h"
#include "paths/blend_transform.h"

/* Linear. The result is never outside [a, b] despite rounding: both may be the end of a range. */
static double mix(double a, double b, double u) {
    double x = u >= 1 ? b : u <= 0 ? a : a * (1 - u) + b * u;
    return fmin(fmax(x, fmin(a, b)), fmax(a, b));
}

static float mix_float(float a, float b, double u) {
    return (float)mix((double)a, (double)b,
                      u); /* rounding is monotonic: the result stays in [a, b] */
}

static void mix_floats(const float *a, const float *b, unsigned count, double u, float *out) {
    for (unsigned i = 0; i < count; i++)
        out[i] = mix_float(a[i], b[i], u);
}

static void mix_numbers(const double *a, const double *b, unsigned count, double u, double *out) {
    for (unsigned i = 0; i < count; i++)
        out[i] = mix(a[i], b[i], u);
}

/* Linear, or `a` until u = 1 if one is automatic (NaN). */
static double mix_set(double a, double b, double u) {
    return isnan(a) || isnan(b) ? (u >= 1 ? b : a) : mix(a, b, u);
}

/* Linear in the logarithm; both are above 0. */
static double mix_log(double a, double b, double u) {
    double x = u >= 1 ? b : u <= 0 ? a : exp(mix(log(a), log(b), u));
    return fmin(fmax(x, fmin(a, b)), fmax(a, b));
}

/* Scales to length 1; returns the length. Lengths whose squares overflow are fine. */
static double normalize(double v[3]) {
    double largest = fmax(fabs(v[0]), fmax(fabs(v[1]), fabs(v[2])));
    if (!(largest > 0) || isinf(largest))
        return largest;
    for (int i = 0; i < 3; i++)
        v[i] /= largest;
    double length = sqrt(srv_dot(v, v));
    for (int i = 0; i < 3; i++)
        v[i] /= length;
    return largest * length;
}

/* The weights of two unit vectors an angle apart: sin((1−u)ω)/sin ω and sin(uω)/sin ω. */
static void slerp_weights(double cosine, double u, double weight[2]) {
    double angle = acos(fmin(fmax(cosine, -1), 1));
    weight[0] = 1 - u;
    weight[1] = u;
    if (sin(angle) < 1e-9) /* so close that the arc equals its chord */
        return;
    weight[0] = sin((1 - u) * angle) / sin(angle);
    weight[1] = sin(u * angle) / sin(angle);
}

/* False for opposite directions: the way between them is undefined. */
static bool mix_direction(const double a[3], const double b[3], double u, double out[3]) {
    double from[3], to[3], weight[2];
    memcpy(from, a, sizeof from);
    memcpy(to, b, sizeof to);
    double length = mix(normalize(from), normalize(to), u);
    if (srv_dot(from, to) < -1 + 1e-9)
        return false;
    slerp_weights(srv_dot(from, to), u, weight);
    for (int i = 0; i < 3; i++)
        out[i] = from[i] * weight[0] + to[i] * weight[1];
    normalize(out);
    for (int i = 0; i < 3; i++)
        out[i] *= length;
    return true;
}

/* The camera. */

struct pose {
    double turn[4]; /* unit quaternion w, x, y, z of the axes right, up, back */
    double distance;
};

static void quaternion_from_axes(double m[3][3], double q[4]) {
    double trace = m[0][0] + m[1][1] + m[2][2];
    int i = m[0][0] > m[1][1] ? 0 : 1;
    i = m[2][2] > m[i][i] ? 2 : i;
    int j = (i + 1) % 3, k = (i + 2) % 3;
    if (trace > 0) { /* the largest component comes from the root: no cancellation */
        double s = 2 * sqrt(1 + trace);
        q[0] = s / 4;
        for (int n = 0; n < 3; n++)
            q[n + 1] = (m[(n + 2) % 3][(n + 1) % 3] - m[(n + 1) % 3][(n + 2) % 3]) / s;
    } else {
        double s = 2 * sqrt(1 + m[i][i] - m[j][j] - m[k][k]);
        q[0] = (m[k][j] - m[j][k]) / s;
        q[i + 1] = s / 4;
        q[j + 1] = (m[j][i] + m[i][j]) / s;
        q[k + 1] = (m[k][i] + m[i][k]) / s;
    }
}

static void pose_of(const struct sp_camera *camera, struct pose *pose) {
    double right[3], up[3], back[3], m[3][3];
    memcpy(up, camera->up, sizeof up);
    normalize(up);
    for (int i = 0; i < 3; i++)
        back[i] = camera->position[i] - camera->target[i];
    pose->distance = normalize(back);
    srv_cross(up, back, right);
    normalize(right);
    srv_cross(back, right, up);
    for (int i = 0; i < 3; i++) {
        m[i][0] = right[i];
        m[i][1] = up[i];
        m[i][2] = back[i];
    }
    quaternion_from_axes(m, pose->turn);
}

static void mix_turn(const double a[4], const double b[4], double u, double q[4]) {
    double weight[2], cosine = 0, square = 0;
    for (int i = 0; i < 4; i++)
        cosine += a[i] * b[i];
    double sign = cosine < 0 ? -1 : 1; /* q and −q are the same rotation: take the shorter way */
    slerp_weights(sign * cosine, u, weight);
    for (int i = 0; i < 4; i++) {
        q[i] = a[i] * weight[0] + sign * b[i] * weight[1];
        square += q[i] * q[i];
    }
    for (int i = 0; i < 4; i++)
        q[i] /= sqrt(square);
}

void srv_blend_camera(const struct sp_camera *a, const struct sp_camera *b, double u,
                      struct sp_camera *out) {
    struct pose from, to;
    double q[4];
    if (u <= 0 || u >= 1) {
        *out = u <= 0 ? *a : *b;
        return;
    }
    pose_of(a, &from);
    pose_of(b, &to);
    mix_turn(from.turn, to.turn, u, q);
    double w = q[0], x = q[1], y = q[2], z = q[3];
    double distance = mix_log(from.distance, to.distance, u);
    const double up[3] = { 2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x) };
    const double back[3] = { 2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y) };
    *out = (struct sp_camera){ .projection = a->projection,
                               .fov_y = mix(a->fov_y, b->fov_y, u),
                               .height = mix_log(a->height, b->height, u),
                               .near = mix_log(a->near, b->near, u) };
    for (int i = 0; i < 3; i++) {
        out->target[i] = mix(a->target[i], b->target[i], u);
        out->position[i] = out->target[i] + distance * back[i];
        out->up[i] = up[i];
    }
}

/* The transfer function: points in the order of their values, linear in between. */

enum { CHANNELS_MAX = 4 };
struct curve {
    uint32_t count;
    double value[SP_TF_POINTS_MAX];
    float y[SP_TF_POINTS_MAX][CHANNELS_MAX];
};

/* Evaluates the curve at x; `next` is its first point at or after x. */
static void sample(const struct curve *curve, uint32_t next, double x, unsigned channels,
                   float *y) {
    if (curve->count == 0) { /* no gradient points: 1 everywhere */
        y[0] = 1;
        return;
    }
    if (next == curve->count || next == 0 || curve->value[next] == x) {
        memcpy(y, curve->y[next == curve->count ? next - 1 : next], channels * sizeof *y);
        return;
    }
    double left = curve->value[next - 1], right = curve->value[next];
    double u =
        (x / 2 - left / 2) / (right / 2 - left / 2); /* halves: the difference may overflow */
    mix_floats(curve->y[next - 1], curve->y[next], channels, u, y);
}

/* Blends at the values of both curves, rising, each value once. Returns their number, which may be
 * above `max`; out NULL = count only. */
static unsigned blend_curves(const struct curve *a, const struct curve *b, double u,
                             unsigned channels, unsigned max, struct curve *out) {
    uint32_t i = 0, j = 0;
    unsigned count = 0;
    while (i < a->count || j < b->count) {
        bool take_a = j == b->count || (i < a->count && a->value[i] <= b->value[j]);
        double x = take_a ? a->value[i] : b->value[j];
        if (out && count < max) {
            float from[CHANNELS_MAX], to[CHANNELS_MAX];
            sample(a, i, x, channels, from);
            sample(b, j, x, channels, to);
            out->value[count] = x;
            mix_floats(from, to, channels, u, out->y[count]);
        }
        count++;
        i += i < a->count && a->value[i] == x;
        j += j < b->count && b->value[j] == x;
    }
    if (out)
        out->count = count < max ? count : max;
    return count;
}

static void points_of(const struct sp_transfer_function *tf, struct curve *curve) {
    curve->count = tf->point_count;
    for (uint32_t i = 0; i < tf->point_count; i++) {
        curve->value[i] = tf->points[i].value;
        memcpy(curve->y[i], tf->points[i].color, sizeof tf->points[i].color);
        curve->y[i][3] = tf->points[i].opacity;
    }
}

static void gradient_of(const struct sp_transfer_function *tf, struct curve *curve) {
    curve->count = tf->gradient_count;
    for (uint32_t i = 0; i < tf->gradient_count; i++) {
        curve->value[i] = tf->gradient[i].magnitude;
        curve->y[i][0] = tf->gradient[i].scale;
    }
}

void srv_blend_count(const struct sp_transfer_function *a, const struct sp_transfer_function *b,
                     unsigned *points, unsigned *gradient) {
    struct curve x, y;
    points_of(a, &x);
    points_of(b, &y);
    *points = blend_curves(&x, &y, 0, CHANNELS_MAX, 0, NULL);
    gradient_of(a, &x);
    gradient_of(b, &y);
    *gradient = blend_curves(&x, &y, 0, 1, 0, NULL);
}

void srv_blend_transfer_function(const struct sp_transfer_function *a,
                                 const struct sp_transfer_function *b, double u,
                                 struct sp_transfer_function *out) {
    struct curve x, y, blended;
    if (u <= 0 || u >= 1) {
        *out = u <= 0 ? *a : *b;
        return;
    }
    *out = (struct sp_transfer_function){ .order = a->order };
    out->reference_length = mix(a->reference_length, b->reference_length, u);
    points_of(a, &x);
    points_of(b, &y);
    blend_curves(&x, &y, u, CHANNELS_MAX, SP_TF_POINTS_MAX, &blended);
    out->point_count = blended.count;
    for (uint32_t i = 0; i < blended.count; i++) {
        out->points[i].value = blended.value[i];
        memcpy(out->points[i].color, blended.y[i], sizeof out->points[i].color);
        out->points[i].opacity = blended.y[i][3];
    }
    gradient_of(a, &x);
    gradient_of(b, &y);
    blend_curves(&x, &y, u, 1, SP_GRADIENT_POINTS_MAX, &blended);
    out->gradient_count = blended.count;
    for (uint32_t i = 0; i < blended.count; i++)
        out->gradient[i] =
            (struct sp_gradient_point){ .magnitude = blended.value[i], .scale = blended.y[i][0] };
}

/* The rest. */

void srv_blend_filter(const struct sp_filter *a, const struct sp_filter *b, double u,
                      struct sp_filter *out) {
    *out = u >= 1 ? *b : *a;
    out->sigma = mix(a->sigma, b->sigma, u);
    out->cutoff = mix(a->cutoff, b->cutoff, u);
    out->lowpass = mix(a->lowpass, b->lowpass, u);
    if (isnan(a->c_max) != isnan(b->c_max))
        return;
    out->c_min = mix(a->c_min, b->c_min, u);
    if (!isnan(a->c_max))
        out->c_max = mix(a->c_max, b->c_max, u);
}

void srv_blend_compositing(const struct sp_compositing_options *a,
                           const struct sp_compositing_options *b, double u,
                           struct sp_compositing_options *out) {
    *out = u >= 1 ? *b : *a;
    out->slab = mix(a->slab, b->slab, u);
    if (a->mode != b->mode)
        return;
    out->zero = mix_set(a->zero, b->zero, u);
    out->absorption = mix_set(a->absorption, b->absorption, u);
    if (isnan(a->absorption) != isnan(b->absorption))
        return;
    out->center = mix_set(a->center, b->center, u);
    out->width = mix_set(a->width, b->width, u);
}

static void blend_lights(const struct sp_shading *a, const struct sp_shading *b, double u,
                         struct sp_shading *out) {
    if (a->light_count != b->light_count)
        return;
    for (uint32_t i = 0; i < a->light_count; i++) {
        const struct sp_light *from = &a->lights[i], *to = &b->lights[i];
        mix_floats(from->color, to->color, 3, u, out->lights[i].color);
        if (from->space == to->space) /* otherwise the directions cannot be compared */
            mix_direction(from->direction, to->direction, u, out->lights[i].direction);
    }
}

void srv_blend_shading(const struct sp_shading *a, const struct sp_shading *b, double u,
                       struct sp_shading *out) {
    *out = u >= 1 ? *b : *a;
    if (u <= 0 || u >= 1)
        return;
    out->ambient = mix(a->ambient, b->ambient, u);
    out->diffuse = mix(a->diffuse, b->diffuse, u);
    out->specular = mix(a->specular, b->specular, u);
    out->exponent = mix(a->exponent, b->exponent, u);
    out->smoothing = mix_set(a->smoothing, b->smoothing, u);
    /* Not from or to 0: the frames between may be of a mode that draws neither. */
    if (a->occlusion > 0 && b->occlusion > 0)
        out->occlusion = mix(a->occlusion, b->occlusion, u);
    if (a->shadow > 0 && b->shadow > 0)
        out->shadow = mix(a->shadow, b->shadow, u);
    out->reach = mix(a->reach, b->reach, u);
    blend_lights(a, b, u, out);
}

void srv_blend_clip(const struct sp_clip *a, const struct sp_clip *b, double u,
                    struct sp_clip *out) {
    *out = u >= 1 ? *b : *a;
    if (u <= 0 || u >= 1)
        return;
    for (int corner = 0; corner < 2; corner++)
        mix_numbers(a->box[corner], b->box[corner], 3, u, out->box[corner]);
    if (a->plane_count != b->plane_count)
        return;
    for (uint32_t i = 0; i < a->plane_count; i++)
        if (mix_direction(a->planes[i].normal, b->planes[i].normal, u, out->planes[i].normal))
            out->planes[i].offset = mix(a->planes[i].offset, b->planes[i].offset, u);
}

static void mix_elements(const struct sp_layer *a, const struct sp_layer *b, double u,
                         struct sp_layer *out) {
    out->size = mix(a->size, b->size, u);
    out->opacity = mix_float(a->opacity, b->opacity, u);
    mix_floats(a->color, b->color, 3, u, out->color);
    srv_blend_transform(a->transform, b->transform, u, out->transform);
}

/* Points are mixed one by one if both channels have the same number of them; else they come from
 * `a`. */
static void mix_channel(const struct sp_layer *a, const struct sp_layer *b, double u,
                        struct sp_layer *out) {
    mix_floats(a->color, b->color, 3, u, out->color);
    for (uint32_t i = 0; i < a->point_count && a->point_count == b->point_count; i++) {
        const struct sp_tf_point *p = &a->points[i], *q = &b->points[i];
        out->points[i].value = mix(p->value, q->value, u);
        out->points[i].opacity = mix_float(p->opacity, q->opacity, u);
        mix_floats(p->color, q->color, 3, u, out->points[i].color);
    }
}

static void mix_layers(const struct sp_layer *a, const struct sp_layer *b, double u,
                       struct sp_layer *out) {
    if (a->type == SP_LAYER_SURFACE) {
        out->value = mix(a->value, b->value, u);
        out->opacity = mix_float(a->opacity, b->opacity, u);
        mix_floats(a->color, b->color, 3, u, out->color);
        if (isfinite(a->flatness) && isfinite(b->flatness))
            out->flatness = mix(a->flatness, b->flatness, u);
    }
    if (a->type == SP_LAYER_SHELL) {
        out->low = mix(a->low, b->low, u);
        out->high = mix(a->high, b->high, u);
    }
    if (a->type == SP_LAYER_VECTORS) {
        out->phase = mix(a->phase, b->phase, u);
        out->stretch = mix(a->stretch, b->stretch, u);
        out->density = mix(a->density, b->density, u);
        mix_floats(a->color, b->color, 3, u, out->color);
    }
    if (a->type == SP_LAYER_CHANNEL)
        mix_channel(a, b, u, out);
    else if (a->type >= SP_LAYER_POINTS)
        mix_elements(a, b, u, out);
}

void srv_blend_layers(const struct sp_view *a, const struct sp_view *b, double u,
                      struct sp_view *out) {
    const struct sp_view *from = u >= 1 ? b : a;
    memcpy(out->layers, from->layers, sizeof out->layers);
    out->layer_count = from->layer_count;
    if (u <= 0 || u >= 1 || a->layer_count != b->layer_count)
        return;
    for (uint32_t i = 0; i < a->layer_count; i++)
        if (a->layers[i].type != b->layers[i].type)
            return;
    for (uint32_t i = 0; i < a->layer_count; i++)
        mix_layers(&a->layers[i], &b->layers[i], u, &out->layers[i]);
}

void srv_blend_slices(const struct sp_slices *a, const struct sp_slices *b, double u,
                      struct sp_slices *out) {
    *out = u >= 1 ? *b : *a;
    if (u <= 0 || u >= 1)
        return;
    mix_numbers(a->position, b->position, 3, u, out->position);
    mix_direction(a->normal, b->normal, u, out->normal);
    out->center = mix(a->center, b->center, u);
    out->width = mix(a->width, b->width, u);
}

void srv_blend_time(const struct sp_time *a, const struct sp_time *b, double u,
                    struct sp_time *out) {
    out->step = (uint32_t)lround(mix(a->step, b->step, u));
}

void srv_blend_background(const float a[4], const float b[4], double u, float out[4]) {
    mix_floats(a, b, 4, u, out);
}
