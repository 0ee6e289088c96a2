/* SPDX-License-Identifier: Apache-2.0 */
#include "splat/extent.h"

#include "data/volume/grid.h"

static const float along_ray = 0.7f; /* |correlation| above which a plane bounds the depth */

static void add_plane(struct sp_clip_frame *clip, const struct sp_camera_transform *camera,
                      struct sp_vec3 normal, double offset, double unit) {
    double length = sp_vec3_length(normal);
    struct sp_vec3 n = sp_vec3_scale(normal, 1 / length);
    struct sp_vec3 c = sp_mat3_apply(&camera->w, n);
    double o = (offset / length - sp_vec3_dot(n, camera->eye)) / unit;
    struct sp_clip_half *to = &clip->planes[clip->count++];
    for (int i = 0; i < 3; i++)
        to->normal[i] = (float)c.v[i];
    to->offset = (float)fmax(-1e30, fmin(1e30, o));
}

/* Divides by the largest component first, so that squares neither overflow nor underflow. */
static double scaled(const double v[3], struct sp_vec3 *out) {
    double largest = fmax(fabs(v[0]), fmax(fabs(v[1]), fabs(v[2])));
    for (int i = 0; i < 3; i++)
        out->v[i] = v[i] / largest;
    return largest;
}

void sp_clip_frame_init(struct sp_clip_frame *clip, const struct sp_camera_transform *camera,
                        const struct sp_grid *grid, const struct sp_clip *view, double unit) {
    double det;
    struct sp_mat3 d = sp_grid_directions(grid);
    struct sp_mat3 inverse = sp_mat3_inverse(&d, &det);
    struct sp_vec3 origin = sp_vec3_from(grid->origin);
    clip->count = 0;
    for (unsigned a = 0; a < 3; a++) {
        /* Row a of the inverse maps a world position to the distance along axis a. */
        struct sp_vec3 n = sp_vec3_from(inverse.m[a]);
        double extent[2], at = sp_vec3_dot(n, origin);
        sp_grid_extent(grid, a, extent);
        double length = extent[1] - extent[0];
        if (view->box[0][a] > 0)
            add_plane(clip, camera, n, at + extent[0] + view->box[0][a] * length, unit);
        if (view->box[1][a] < 1)
            add_plane(clip, camera, sp_vec3_scale(n, -1),
                      -(at + extent[0] + view->box[1][a] * length), unit);
    }
    for (uint32_t i = 0; i < view->plane_count; i++) {
        struct sp_vec3 n;
        double scale = scaled(view->planes[i].normal, &n);
        add_plane(clip, camera, n, view->planes[i].offset / scale, unit);
    }
}

static float dot(const float a[3], const float b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static float square(float x) {
    return x * x;
}

/* |a × b|² */
static float cross2(const float a[3], const float b[3]) {
    return square(a[1] * b[2] - a[2] * b[1]) + square(a[2] * b[0] - a[0] * b[2]) +
           square(a[0] * b[1] - a[1] * b[0]);
}

/* Variance along the ray given the pixel: det(V + h²·diag(1,1,0)) / det(V̂ + h²I), a sum of
 * positive terms. */
static float depth_variance(const struct sp_kernel_place *p) {
    const float(*m)[3] = p->m;
    float volume = m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) -
                   m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
                   m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
    float h2 = p->h2, all = volume * volume + h2 * (cross2(m[1], m[2]) + cross2(m[0], m[2])) +
                            h2 * h2 * dot(m[2], m[2]);
    return fmaxf(all / p->det, 1e-12f);
}

/* (V̂ + h²I)⁻¹ (x, y) */
static void regress(const struct sp_kernel_place *p, float x, float y, float out[2]) {
    out[0] = p->inverse[0] * x + p->inverse[1] * y;
    out[1] = p->inverse[1] * x + p->inverse[2] * y;
}

void sp_extent_span(const struct sp_kernel_place *p, struct sp_span *span) {
    regress(p, dot(p->m[0], p->m[2]), dot(p->m[1], p->m[2]), span->slope);
    span->distance = p->distance;
    span->sharpness = 1 / sqrtf(depth_variance(p));
    span->reach = p->radius * sqrtf(dot(p->m[2], p->m[2]));
}

static void cut_by(const struct sp_kernel_place *p, const float q[3], float e,
                   struct sp_cut_plane *out) {
    float c[2] = { dot(p->m[0], q), dot(p->m[1], q) }, q2 = dot(q, q);
    regress(p, c[0], c[1], out->k);
    /* An edge is never sharper than a hundredth of the kernel's width. */
    float variance = fmaxf(q2 - c[0] * out->k[0] - c[1] * out->k[1], 1e-4f * q2);
    float joint =
        dot(p->m[2], q) - dot(p->m[0], p->m[2]) * out->k[0] - dot(p->m[1], p->m[2]) * out->k[1];
    float correlation = joint / sqrtf(variance * depth_variance(p)), scale = 1 / sqrtf(variance);
    out->e = e * scale;
    out->k[0] *= scale;
    out->k[1] *= scale;
    out->side = correlation > along_ray ? 1 : correlation < -along_ray ? -1 : 0;
}

int sp_extent_cut(const struct sp_kernel_place *p, const struct sp_clip_frame *clip,
                  struct sp_cut *cut) {
    int count = 0;
    float tail = fmaxf(p->radius, SP_CUT_TAIL);
    for (uint32_t i = 0; i < clip->count; i++) {
        const struct sp_clip_half *h = &clip->planes[i];
        float q[3], e = dot(h->normal, p->u) - h->offset;
        for (int a = 0; a < 3; a++)
            q[a] = p->kernel[0][a] * h->normal[0] + p->kernel[1][a] * h->normal[1] +
                   p->kernel[2][a] * h->normal[2];
        float deviation = sqrtf(dot(q, q));
        if (!(e > -tail * deviation))
            return -1;
        if (e < tail * deviation)
            cut_by(p, q, e, &cut->planes[count++]);
    }
    return count;
}
