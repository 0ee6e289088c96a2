/* SPDX-License-Identifier: Apache-2.0 */
#include "splat/ewa.h"

#include <float.h>

#include "splat/exp2.h"

static float bounded(double x) {
    return (float)fmax(-FLT_MAX, fmin(FLT_MAX, x));
}

void sp_ewa_frame_init(struct sp_ewa_frame *frame, const struct sp_camera_frame *camera,
                       const struct sp_grid *grid, const struct sp_view *view) {
    const struct sp_filter *filter = &view->filter;
    struct sp_mat3 step;
    for (int r = 0; r < 3; r++)
        for (int a = 0; a < 3; a++)
            step.m[r][a] = grid->direction[r][a] * grid->spacing[a];
    double unit = cbrt(fabs(sp_mat3_determinant(&step))); /* v = unit³ */
    struct sp_vec3 away = sp_vec3_sub(sp_vec3_from(grid->origin), camera->eye);
    struct sp_vec3 base = sp_mat3_apply(&camera->w, away);
    step = sp_mat3_multiply(&camera->w, &step);
    double lost = exp(-0.5 * filter->cutoff * filter->cutoff);
    bool perspective = camera->projection == SP_PERSPECTIVE;
    *frame = (struct sp_ewa_frame){
        .projection = camera->projection,
        .scale = bounded(perspective ? camera->scale : camera->scale * unit),
        .centre = { (float)camera->centre[0], (float)camera->centre[1] },
        .near = bounded(fmax(camera->near / unit, 1e-3)),
        .lowpass2 = fmaxf((float)(filter->lowpass * filter->lowpass), SP_VARIANCE_MIN),
        .radius = (float)filter->cutoff,
        .cut = (float)(0.5 * filter->cutoff * filter->cutoff) * SP_LOG2E,
        .gain = bounded(unit / (view->transfer_function.reference_length * 2 * M_PI * (1 - lost))),
        .size = { (int)view->size[0], (int)view->size[1] },
        .rows = { 0, (int)view->size[1] },
    };
    for (int r = 0; r < 3; r++) {
        frame->base[r] = base.v[r] / unit;
        for (int a = 0; a < 3; a++) {
            frame->step_hi[r][a] = step.m[r][a] / unit;
            frame->step[r][a] = (float)frame->step_hi[r][a];
            frame->kernel[r][a] = (float)(filter->sigma * frame->step_hi[r][a]);
        }
    }
    for (int i = 0; i < 2; i++)
        frame->ratio_max[i] = SP_EWA_MARGIN * (float)camera->tan_half[i] + SP_EWA_SLACK;
}

static inline float clamp(float x, float bound) {
    return x < -bound ? -bound : x > bound ? bound : x;
}

/* The first two rows of J·K and |det J|. inv = 1/u2. */
static inline float project_kernel(const struct sp_ewa_frame *f, const float u[3], float inv,
                                   float m[2][3]) {
    if (f->projection == SP_ORTHOGRAPHIC) {
        for (int i = 0; i < 2; i++)
            for (int a = 0; a < 3; a++)
                m[i][a] = f->scale * f->kernel[i][a];
        return f->scale * f->scale;
    }
    float fx = f->scale * inv, ratio[2];
    for (int i = 0; i < 2; i++) {
        ratio[i] = clamp(u[i] * inv, f->ratio_max[i]);
        for (int a = 0; a < 3; a++)
            m[i][a] = fx * (f->kernel[i][a] - ratio[i] * f->kernel[2][a]);
    }
    return fx * fx * sqrtf(1 + ratio[0] * ratio[0] + ratio[1] * ratio[1]);
}

/* V̂ + h²I as the mode wants it, in v = (V00, V01, V11); returns its determinant. */
static inline float filter_variance(const float m[2][3], enum sp_filter_mode mode, float h2,
                                    float v[3]) {
    if (mode == SP_FILTER_LOWPASS) {
        v[0] = v[2] = h2;
        v[1] = 0;
        return h2 * h2;
    }
    if (mode == SP_FILTER_RECONSTRUCTION)
        h2 = SP_VARIANCE_MIN;
    float v00 = m[0][0] * m[0][0] + m[0][1] * m[0][1] + m[0][2] * m[0][2];
    float v11 = m[1][0] * m[1][0] + m[1][1] * m[1][1] + m[1][2] * m[1][2];
    float cx = m[0][1] * m[1][2] - m[0][2] * m[1][1];
    float cy = m[0][2] * m[1][0] - m[0][0] * m[1][2];
    float cz = m[0][0] * m[1][1] - m[0][1] * m[1][0];
    v[0] = v00 + h2;
    v[1] = m[0][0] * m[1][0] + m[0][1] * m[1][1] + m[0][2] * m[1][2];
    v[2] = v11 + h2;
    return cx * cx + cy * cy + cz * cz + h2 * (v00 + v11) + h2 * h2;
}

/* First and last + 1 of the pixels in [low, high) whose centres lie within ±reach of x; false if
 * there is none, or if something is not a number. */
static inline bool cover(float x, float reach, int low, int high, int16_t *begin, int16_t *end) {
    float first = x - reach + 0.5f, last = x + reach + 0.5f; /* floor of these: begin, end */
    if (!(last >= (float)(low + 1) && first <= (float)high))
        return false;
    int b = first > (float)low ? (int)ceilf(first - 1) : low;
    int e = last < (float)high ? (int)last : high;
    if (b < low)
        b = low;
    *begin = (int16_t)b;
    *end = (int16_t)e;
    return b < e;
}

/* Geometry of one splat: all of *s but depth, emission and sheet. Returns |det J|/√det, or 0 when
 * it does not touch the rows being drawn. */
static inline float place_splat(const struct sp_ewa_frame *f, const float u[3],
                                enum sp_filter_mode mode, struct sp_splat *s) {
    if (!(u[2] >= f->near && u[2] < 1e18f))
        return 0;
    float inv = f->projection == SP_ORTHOGRAPHIC ? 1 : 1 / u[2], m[2][3], v[3];
    s->x = f->centre[0] + f->scale * (u[0] * inv);
    s->y = f->centre[1] + f->scale * (u[1] * inv);
    float det_j = project_kernel(f, u, inv, m);
    float det = filter_variance(m, mode, f->lowpass2, v);
    float rx = f->radius * sqrtf(v[0]), ry = f->radius * sqrtf(v[2]);
    if (!(det < 1e36f) || !cover(s->y, ry, f->rows[0], f->rows[1], &s->y0, &s->y1) ||
        !cover(s->x, rx, 0, f->size[0], &s->x0, &s->x1))
        return 0;
    float root = sqrtf(det), half = 0.5f * SP_LOG2E / det;
    s->a = half * v[2];
    s->b = -2 * half * v[1];
    s->c = half * v[0];
    s->area = (float)M_PI * f->radius * f->radius * root;
    return det_j / root;
}

static void eye_direction(const struct sp_ewa_frame *f, const float u[3], float to_eye[3]) {
    if (f->projection == SP_ORTHOGRAPHIC) {
        to_eye[0] = to_eye[1] = 0;
        to_eye[2] = -1;
        return;
    }
    float inv = -1 / sqrtf(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]);
    for (int r = 0; r < 3; r++)
        to_eye[r] = u[r] * inv;
}

uint32_t sp_ewa_set_up(const struct sp_ewa_frame *f, const struct sp_ewa_run *run,
                       struct sp_splat *out) {
    const struct sp_visible *list = run->list;
    float base[3];
    for (int r = 0; r < 3; r++)
        base[r] = bounded(f->base[r] + f->step_hi[r][0] * run->brick[0] +
                          f->step_hi[r][1] * run->brick[1] + f->step_hi[r][2] * run->brick[2]);
    uint32_t written = 0;
    for (uint32_t place = run->begin; place < run->begin + run->count; place++) {
        uint64_t e = run->first + (run->order ? run->order[place] : place);
        uint16_t local = list->local[e];
        float u[3], x = (float)(local & 15), y = (float)(local >> 4 & 15), z = (float)(local >> 8);
        for (int r = 0; r < 3; r++)
            u[r] = base[r] + f->step[r][0] * x + f->step[r][1] * y + f->step[r][2] * z;
        struct sp_splat *s = &out[written];
        float gain = place_splat(f, u, run->mode, s);
        if (!(gain > 0))
            continue;
        struct sp_class c = sp_transfer_class(run->transfer, list->key[e]);
        float depth = c.depth * f->gain * gain;
        s->depth = depth < SP_DEPTH_MAX ? depth : SP_DEPTH_MAX;
        if (run->shade) {
            float to_eye[3];
            eye_direction(f, u, to_eye);
            sp_shade_apply(run->shade, list->normal[e], to_eye, c.color);
        }
        for (int k = 0; k < 3; k++)
            s->emission[k] = c.color[k] * s->depth;
        s->sheet = run->sheet;
        written++;
    }
    return written;
}
