/* SPDX-License-Identifier: Apache-2.0 */
#include "splat/ewa.h"

#include <float.h>
#include <string.h>

#include "splat/exp2.h"
#include "volume/grid.h"

static float bounded(double x) {
    return (float)fmax(-FLT_MAX, fmin(FLT_MAX, x));
}

/* Radius, cut and peak of the kernel; returns its standard deviation in voxels. */
static double init_kernel(struct sp_ewa_frame *frame, const struct sp_filter *filter) {
    double sigma = sp_kernel_sigma(filter), radius = filter->cutoff, peak;
    if (filter->kernel == SP_KERNEL_CUBIC) {
        radius = SP_CUBIC_RADIUS / SP_CUBIC_SIGMA;
        peak = SP_CUBIC_SIGMA * SP_CUBIC_SIGMA * sp_cubic_footprint(0);
    } else {
        peak = 1 / (2 * M_PI * -expm1(-0.5 * radius * radius));
    }
    frame->radius = (float)radius;
    frame->cut = (float)(0.5 * radius * radius) * SP_LOG2E;
    frame->peak = (float)peak;
    frame->flat = (float)(0.8 / sigma);
    return sigma;
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
    bool perspective = camera->projection == SP_PERSPECTIVE;
    *frame = (struct sp_ewa_frame){
        .projection = camera->projection,
        .grid = grid,
        .unit = unit,
        .scale = bounded(perspective ? camera->scale : camera->scale * unit),
        .centre = { (float)camera->centre[0], (float)camera->centre[1] },
        .near = bounded(fmax(camera->near / unit, 1e-3)),
        .lowpass2 = fmaxf((float)(filter->lowpass * filter->lowpass), SP_VARIANCE_MIN),
        .post = view->transfer_function.order == SP_TF_POST,
        .gain = bounded(unit / view->transfer_function.reference_length),
        .size = { (int)view->size[0], (int)view->size[1] },
        .rows = { 0, (int)view->size[1] },
    };
    double sigma = init_kernel(frame, filter);
    for (int r = 0; r < 3; r++) {
        frame->base[r] = base.v[r] / unit;
        for (int a = 0; a < 3; a++) {
            frame->step_hi[r][a] = step.m[r][a] / unit;
            frame->step[r][a] = (float)frame->step_hi[r][a];
            frame->kernel[r][a] = (float)(sigma * frame->step_hi[r][a]);
        }
    }
    for (int i = 0; i < 2; i++)
        frame->ratio_max[i] = SP_EWA_MARGIN * (float)camera->tan_half[i] + SP_EWA_SLACK;
    double across[3] = { 0 };
    for (unsigned a = 0; a < 3; a++) {
        double extent[2];
        sp_grid_extent(grid, a, extent);
        for (int r = 0; r < 3; r++) /* of any corner against any other: an upper bound */
            across[r] += fabs(step.m[r][a]) / grid->spacing[a] * (extent[1] - extent[0]) / unit;
    }
    frame->diameter = sp_vec3_length(sp_vec3_from(across));
}

static inline float clamp(float x, float bound) {
    return x < -bound ? -bound : x > bound ? bound : x;
}

/* The first two rows of J·K and |det J|. inv = 1/u2. */
static inline float project_kernel(const struct sp_ewa_frame *f, const float kernel[3][3],
                                   const float u[3], float inv, float m[2][3]) {
    if (f->projection == SP_ORTHOGRAPHIC) {
        for (int i = 0; i < 2; i++)
            for (int a = 0; a < 3; a++)
                m[i][a] = f->scale * kernel[i][a];
        return f->scale * f->scale;
    }
    float fx = f->scale * inv, ratio[2];
    for (int i = 0; i < 2; i++) {
        ratio[i] = clamp(u[i] * inv, f->ratio_max[i]);
        for (int a = 0; a < 3; a++)
            m[i][a] = fx * (kernel[i][a] - ratio[i] * kernel[2][a]);
    }
    return fx * fx * sqrtf(1 + ratio[0] * ratio[0] + ratio[1] * ratio[1]);
}

/* The third row: along the ray. */
static void project_depth(const struct sp_ewa_frame *f, const float kernel[3][3], const float u[3],
                          float inv, float m[3]) {
    float ratio[2] = { 0, 0 };
    if (f->projection == SP_PERSPECTIVE)
        for (int i = 0; i < 2; i++)
            ratio[i] = clamp(u[i] * inv, f->ratio_max[i]);
    float scale = 1 / sqrtf(1 + ratio[0] * ratio[0] + ratio[1] * ratio[1]);
    for (int a = 0; a < 3; a++)
        m[a] = (ratio[0] * kernel[0][a] + ratio[1] * kernel[1][a] + kernel[2][a]) * scale;
}

static inline float cross_squared(const float m[2][3]) {
    float cx = m[0][1] * m[1][2] - m[0][2] * m[1][1];
    float cy = m[0][2] * m[1][0] - m[0][0] * m[1][2];
    float cz = m[0][0] * m[1][1] - m[0][1] * m[1][0];
    return cx * cx + cy * cy + cz * cz;
}

/* V̂ + h²I in v = (V00, V01, V11); returns its determinant. */
static inline float variance(const float m[2][3], float h2, float v[3]) {
    float v00 = m[0][0] * m[0][0] + m[0][1] * m[0][1] + m[0][2] * m[0][2];
    float v11 = m[1][0] * m[1][0] + m[1][1] * m[1][1] + m[1][2] * m[1][2];
    v[0] = v00 + h2;
    v[1] = m[0][0] * m[1][0] + m[0][1] * m[1][1] + m[0][2] * m[1][2];
    v[2] = v11 + h2;
    return cross_squared(m) + h2 * (v00 + v11) + h2 * h2;
}

/* Swan et al. (1997), section 4.3: scales m, as one, so that the smaller variance of V̂ is at least
 * h². */
static void widen(float m[2][3], float h2) {
    float v[3], det = variance(m, 0, v), half = 0.5f * (v[0] + v[2]);
    float apart = sqrtf(0.25f * (v[0] - v[2]) * (v[0] - v[2]) + v[1] * v[1]);
    float smaller = det / (half + apart); /* half − apart would cancel */
    if (!(smaller < h2))
        return;
    float scale = sqrtf(h2 / fmaxf(smaller, 1e-12f * h2));
    for (int i = 0; i < 2; i++)
        for (int a = 0; a < 3; a++)
            m[i][a] *= scale;
}

/* The variance of the footprint as the mode wants it; returns its determinant. *h2: what of it is
 * low-pass filter. */
static inline float filter_variance(const struct sp_ewa_frame *f, enum sp_filter_mode mode,
                                    float m[2][3], float *h2, float v[3]) {
    *h2 = f->lowpass2;
    switch (mode) {
    case SP_FILTER_LOWPASS:
        v[0] = v[2] = *h2;
        v[1] = 0;
        return *h2 * *h2;
    case SP_FILTER_SWAN:
        widen(m, *h2);
        *h2 = SP_VARIANCE_MIN;
        break;
    case SP_FILTER_RECONSTRUCTION:
    case SP_FILTER_NONE:
        *h2 = SP_VARIANCE_MIN;
        break;
    case SP_FILTER_EWA:
    case SP_FILTER_ADAPTIVE:
        break;
    }
    return variance(m, *h2, v);
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

/* The same for centres in [x − reach, x + reach): of a width of one pixel there is just one. */
static bool cover_flat(float x, float reach, int low, int high, int16_t *begin, int16_t *end) {
    float first = ceilf(x - reach - 0.5f), last = ceilf(x + reach - 0.5f);
    if (!(last > (float)low && first < (float)high))
        return false;
    *begin = (int16_t)fmaxf(first, (float)low);
    *end = (int16_t)fminf(last, (float)high);
    return *begin < *end;
}

/* A voxel on its way to the image. */
struct place {
    float u[3];
    const float (*kernel)[3]; /* rows of K */
    float inv;                /* 1/u2 */
    float m[2][3], h2;
};

/* A flat rectangle: 1.6 voxels wide, at least a pixel, so that a small one covers the nearest pixel
 * and no other. Returns 1/its area. */
static float place_flat(const struct sp_ewa_frame *f, const float v[3], struct sp_splat *s) {
    float rx = fmaxf(f->flat * sqrtf(v[0]), 0.5f), ry = fmaxf(f->flat * sqrtf(v[2]), 0.5f);
    if (!cover_flat(s->y, ry, f->rows[0], f->rows[1], &s->y0, &s->y1) ||
        !cover_flat(s->x, rx, 0, f->size[0], &s->x0, &s->x1))
        return 0;
    s->a = s->b = s->c = 0;
    s->area = 4 * rx * ry;
    return 1 / s->area;
}

/* Geometry of one splat: all of *s but what it adds. Returns |det J| times the footprint's value at
 * its centre, or 0 when it does not touch the rows being drawn. */
static inline float place_splat(const struct sp_ewa_frame *f, struct place *p,
                                enum sp_filter_mode mode, struct sp_splat *s) {
    if (!(p->u[2] >= f->near && p->u[2] < 1e18f))
        return 0;
    float v[3];
    p->inv = f->projection == SP_ORTHOGRAPHIC ? 1 : 1 / p->u[2];
    s->x = f->centre[0] + f->scale * (p->u[0] * p->inv);
    s->y = f->centre[1] + f->scale * (p->u[1] * p->inv);
    float det_j = project_kernel(f, p->kernel, p->u, p->inv, p->m);
    float det = filter_variance(f, mode, p->m, &p->h2, v);
    if (!(det < 1e36f))
        return 0;
    if (mode == SP_FILTER_NONE)
        return det_j * place_flat(f, v, s);
    float rx = f->radius * sqrtf(v[0]), ry = f->radius * sqrtf(v[2]);
    if (!cover(s->y, ry, f->rows[0], f->rows[1], &s->y0, &s->y1) ||
        !cover(s->x, rx, 0, f->size[0], &s->x0, &s->x1))
        return 0;
    float root = sqrtf(det), half = 0.5f * SP_LOG2E / det;
    s->a = half * v[2];
    s->b = -2 * half * v[1];
    s->c = half * v[0];
    s->area = (float)M_PI * f->radius * f->radius * root;
    return det_j * f->peak / root;
}

/* Span and cuts of a splat that was placed; false when the clipping planes leave nothing. */
static bool place_extent(const struct sp_ewa_frame *f, const struct place *p,
                         const struct sp_splats *out, uint32_t n) {
    struct sp_kernel_place k = { .h2 = p->h2, .radius = f->radius };
    float v[3];
    memcpy(k.u, p->u, sizeof k.u);
    memcpy(k.kernel, p->kernel, sizeof k.kernel);
    memcpy(k.m, p->m, sizeof p->m);
    project_depth(f, p->kernel, p->u, p->inv, k.m[2]);
    k.det = variance(p->m, p->h2, v);
    k.inverse[0] = v[2] / k.det;
    k.inverse[1] = -v[1] / k.det;
    k.inverse[2] = v[0] / k.det;
    k.distance = sp_ewa_distance(f, p->u);
    if (out->cut) {
        int cuts = sp_extent_cut(&k, &f->clip, &out->cut[n]);
        if (cuts < 0)
            return false;
        out->splat[n].cuts = (uint32_t)cuts;
    }
    if (out->span)
        sp_extent_span(&k, &out->span[n]);
    return true;
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

float sp_ewa_distance(const struct sp_ewa_frame *f, const float u[3]) {
    if (f->projection == SP_ORTHOGRAPHIC)
        return u[2];
    return sqrtf(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]);
}

/* What entry e adds at the centre of its footprint; `gain` turns the depth of a class into τ. False
 * when that is nothing. */
static bool write_sums(const struct sp_ewa_frame *f, const struct sp_ewa_run *run, uint64_t e,
                       const float u[3], float gain, struct sp_splat *s) {
    uint32_t gradient = run->list->normal ? sp_visible_normal(run->list, e) : 0;
    struct sp_class c = sp_transfer_class_at(run->transfer, sp_visible_key(run->list, e), gradient);
    float depth = c.depth * gain;
    if (!(depth > 0))
        return false;
    s->depth = depth < SP_DEPTH_MAX ? depth : SP_DEPTH_MAX;
    if (run->shade) {
        float to_eye[3];
        eye_direction(f, u, to_eye);
        sp_shade_apply(run->shade, gradient, to_eye, c.color);
    }
    for (int k = 0; k < 3; k++)
        s->emission[k] = c.color[k] * s->depth;
    return true;
}

void sp_ewa_brick_init(struct sp_ewa_brick *brick, const struct sp_ewa_frame *f,
                       const uint32_t first[3]) {
    static const float even[SP_BRICK] = { 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15 };
    static const float ones[SP_BRICK] = { 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1 };
    const struct sp_grid *grid = f->grid;
    double base[3] = { f->base[0], f->base[1], f->base[2] };
    for (unsigned a = 0; a < 3; a++) {
        double inv = 1 / grid->spacing[a], start = first[a];
        brick->at[a] = even;
        brick->size[a] = ones;
        if (grid->coordinates[a]) {
            start = sp_grid_distance(grid, a, first[a]) * inv;
            for (uint32_t i = 0; i < SP_BRICK && first[a] + i < grid->dims[a]; i++) {
                double at = sp_grid_distance(grid, a, first[a] + i) * inv;
                brick->own[a][0][i] = (float)(at - start);
                brick->own[a][1][i] = (float)(sp_grid_local_spacing(grid, a, first[a] + i) * inv);
            }
            brick->at[a] = brick->own[a][0];
            brick->size[a] = brick->own[a][1];
        }
        for (int r = 0; r < 3; r++)
            base[r] += f->step_hi[r][a] * start;
    }
    for (int r = 0; r < 3; r++)
        brick->base[r] = bounded(base[r]);
}

/* Kernel columns times the local spacings; returns the cell's volume over the mean one's. */
static float stretch(const struct sp_ewa_frame *f, const struct sp_ewa_brick *brick, uint16_t local,
                     float kernel[3][3]) {
    float size[3] = { brick->size[0][local & 15], brick->size[1][local >> 4 & 15],
                      brick->size[2][local >> 8] };
    for (int r = 0; r < 3; r++)
        for (int a = 0; a < 3; a++)
            kernel[r][a] = f->kernel[r][a] * size[a];
    return size[0] * size[1] * size[2];
}

/* The same for pixels that will be classified: length, scalar and gradient. */
static void write_scalar(const struct sp_ewa_run *run, uint64_t e, float length,
                         struct sp_splat *s) {
    s->depth = length < SP_DEPTH_MAX ? length : SP_DEPTH_MAX;
    s->value = sp_transfer_value(run->transfer, sp_visible_key(run->list, e)) * s->depth;
    if (!run->list->normal)
        return;
    float direction[3];
    uint32_t packed = sp_visible_normal(run->list, e);
    sp_gradient_unpack(packed, direction);
    for (int k = 0; k < 3; k++)
        s->emission[k] = direction[k] * sp_gradient_share(packed) * s->depth;
}

uint32_t sp_ewa_set_up(const struct sp_ewa_frame *f, const struct sp_ewa_run *run,
                       const struct sp_splats *out) {
    bool has_extent = out->span || out->cut, is_rectilinear = sp_grid_is_rectilinear(f->grid);
    uint32_t written = 0;
    float kernel[3][3], volume = 1;
    struct place place = { .kernel = f->kernel };
    struct sp_ewa_brick brick;
    sp_ewa_brick_init(&brick, f, run->brick);
    for (uint32_t n = run->begin; n < run->begin + run->count; n++) {
        uint64_t e = run->first + (run->order ? run->order[n] : n);
        uint16_t local = run->local[n - run->begin];
        sp_ewa_brick_place(&brick, f, local, place.u);
        if (is_rectilinear) {
            volume = stretch(f, &brick, local, kernel);
            place.kernel = (const float(*)[3])kernel;
        }
        struct sp_splat *s = &out->splat[written];
        float gain = place_splat(f, &place, run->mode, s);
        if (!(gain > 0) || (has_extent && !place_extent(f, &place, out, written)))
            continue;
        s->cuts = out->cut ? s->cuts : 0;
        if (f->post)
            write_scalar(run, e, gain * f->gain * volume, s);
        else if (!write_sums(f, run, e, place.u, gain * f->gain * volume, s))
            continue;
        s->sheet = run->sheet;
        written++;
    }
    return written;
}
