/* SPDX-License-Identifier: Apache-2.0 */
#include "support/truth.h"

#include <assert.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/parallel_for.h"
#include "base/vec.h"

enum { TAPS_MAX = 41 }; /* radius·σ up to 20 voxels */

/* Σ over kernels is four sums at once: emission R, G, B and extinction. */
typedef double quad __attribute__((vector_size(32), aligned(32)));

/* The classified voxels in index space, with `pad` empty ones around. */
struct field {
    size_t dims[3];
    int pad, reach;         /* reach: kernels of 2·reach + 1 voxels an axis count at a sample */
    quad *voxels;           /* (c_k g_k, g_k), i0 fastest */
    unsigned char *near_by; /* 1 where a sample nearest to this voxel may see something */
    double sigma;
    double lattice[TAPS_MAX]; /* exp(-k²/2σ²)/√(2π)σ for k = -reach … reach */
};

struct march {
    struct field field;
    const struct sp_view *view;
    double w[3][3];             /* world → camera */
    struct sp_mat3 to_index;    /* M⁻¹ */
    double origin[3], scale[2]; /* of the grid; px per unit of tangent or of world */
    double step, sub;           /* voxels; px between rays */
    struct test_rays *rays;
};

double test_sample(const void *voxels, enum sp_type type, size_t index) {
    switch (type) {
    case SP_UINT8:
        return ((const uint8_t *)voxels)[index];
    case SP_INT8:
        return ((const int8_t *)voxels)[index];
    case SP_UINT16:
        return ((const uint16_t *)voxels)[index];
    case SP_INT16:
        return ((const int16_t *)voxels)[index];
    case SP_INT32:
        return ((const int32_t *)voxels)[index];
    case SP_FLOAT32:
        return (double)((const float *)voxels)[index];
    case SP_FLOAT64:
        return ((const double *)voxels)[index];
    case SP_TYPE_COUNT:
        break;
    }
    assert(!"a sample type that is none");
    return 0;
}

void test_classify(const struct sp_transfer_function *tf, double value, double color[3],
                   double *opacity) {
    const struct sp_tf_point *p = tf->points, *q = p;
    double f = 0;
    uint32_t last = tf->point_count - 1;
    if (value >= p[last].value) {
        p = q = p + last;
    } else if (value > p->value) {
        while (q->value <= value)
            q++;
        p = q - 1;
        f = (value - p->value) / (q->value - p->value);
    }
    for (int c = 0; c < 3; c++)
        color[c] = (1 - f) * (double)p->color[c] + f * (double)q->color[c];
    *opacity = (1 - f) * (double)p->opacity + f * (double)q->opacity;
}

void test_camera_axes(const struct sp_camera *camera, double w[3][3]) {
    struct sp_vec3 forward = sp_vec3_normalize(
        sp_vec3_sub(sp_vec3_from(camera->target), sp_vec3_from(camera->position)));
    struct sp_vec3 right = sp_vec3_normalize(sp_vec3_cross(forward, sp_vec3_from(camera->up)));
    struct sp_vec3 down = sp_vec3_cross(forward, right);
    memcpy(w[0], right.v, sizeof right.v);
    memcpy(w[1], down.v, sizeof down.v);
    memcpy(w[2], forward.v, sizeof forward.v);
}

static struct sp_mat3 index_to_world(const struct sp_grid *grid) {
    struct sp_mat3 m;
    for (int r = 0; r < 3; r++)
        for (int a = 0; a < 3; a++)
            m.m[r][a] = grid->direction[r][a] * grid->spacing[a];
    return m;
}

static struct sp_vec3 voxel_world(const struct sp_grid *grid, const uint32_t i[3]) {
    struct sp_mat3 m = index_to_world(grid);
    struct sp_vec3 p = sp_mat3_apply(&m, (struct sp_vec3){ { i[0], i[1], i[2] } });
    return sp_vec3_add(p, sp_vec3_from(grid->origin));
}

static size_t field_at(const struct field *f, size_t x, size_t y, size_t z) {
    return x + f->dims[0] * (y + f->dims[1] * z);
}

/* Spreads the marks of `near_by` by `reach` along one axis. */
static bool spread(struct field *f, int axis) {
    size_t count = f->dims[0] * f->dims[1] * f->dims[2];
    size_t stride = axis == 0 ? 1 : axis == 1 ? f->dims[0] : f->dims[0] * f->dims[1];
    unsigned char *was = malloc(count);
    if (!was)
        return false;
    memcpy(was, f->near_by, count);
    for (size_t i = 0; i < count; i++) {
        if (!was[i])
            continue;
        long at = (long)(i / stride % f->dims[axis]);
        for (long k = -f->reach; k <= f->reach; k++)
            if (at + k >= 0 && at + k < (long)f->dims[axis])
                f->near_by[(size_t)((long)i + k * (long)stride)] = 1;
    }
    free(was);
    return true;
}

static void classify_voxel(struct march *m, const struct sp_volume_info *info, const void *voxels,
                           const struct test_truth_options *o, const uint32_t i[3]) {
    const struct sp_grid *grid = &info->grid;
    const struct sp_camera *camera = &m->view->camera;
    size_t index = i[0] + grid->dims[0] * (i[1] + (size_t)grid->dims[1] * i[2]);
    double value = test_sample(voxels, info->type, index), color[3], opacity;
    if (!isfinite(value))
        return;
    test_classify(&m->view->transfer_function, value, color, &opacity);
    if (opacity <= 0)
        return;
    struct sp_vec3 u = sp_vec3_sub(voxel_world(grid, i), sp_vec3_from(camera->position));
    if (sp_vec3_dot(u, sp_vec3_from(m->w[2])) < camera->near)
        return;
    double g = -log1p(-opacity) / m->view->transfer_function.reference_length;
    if (o->emission)
        o->emission(o->user, i, color);
    struct field *f = &m->field;
    size_t to = field_at(f, i[0] + (size_t)f->pad, i[1] + (size_t)f->pad, i[2] + (size_t)f->pad);
    f->voxels[to] = (quad){ color[0] * g, color[1] * g, color[2] * g, g };
    f->near_by[to] = 1;
}

static bool field_build(struct march *m, const struct sp_volume_info *info, const void *voxels,
                        const struct test_truth_options *o, double radius, struct sp_error *err) {
    struct field *f = &m->field;
    f->sigma = m->view->filter.sigma;
    /* A sample is at most half a voxel from the nearest one. */
    f->reach = (int)ceil(radius * f->sigma - 0.5 - 1e-9);
    f->reach = f->reach < 1 ? 1 : f->reach > TAPS_MAX / 2 ? TAPS_MAX / 2 : f->reach;
    f->pad = 2 * f->reach + 1;
    for (int k = -f->reach; k <= f->reach; k++)
        f->lattice[k + f->reach] =
            exp(-0.5 * k * k / (f->sigma * f->sigma)) / (sqrt(2 * M_PI) * f->sigma);
    size_t count = 1;
    for (int a = 0; a < 3; a++)
        count *= f->dims[a] = info->grid.dims[a] + 2 * (size_t)f->pad;
    f->voxels = aligned_alloc(sizeof(quad), count * sizeof(quad));
    f->near_by = calloc(count, 1);
    if (!f->voxels || !f->near_by)
        return sp_fail(err, SP_ERR_MEMORY, "", "the integrator's field of %zu voxels", count);
    memset(f->voxels, 0, count * sizeof(quad));
    for (uint32_t z = 0; z < info->grid.dims[2]; z++)
        for (uint32_t y = 0; y < info->grid.dims[1]; y++)
            for (uint32_t x = 0; x < info->grid.dims[0]; x++)
                classify_voxel(m, info, voxels, o, (uint32_t[3]){ x, y, z });
    for (int a = 0; a < 3; a++)
        if (!spread(f, a))
            return sp_fail(err, SP_ERR_MEMORY, "", "the integrator's marks");
    return true;
}

/* The normal densities at the 2·reach + 1 lattice points around an offset `d` in [-½, ½]:
 * exp(-(k-d)²/2σ²) = exp(-d²/2σ²)·exp(d/σ²)^k·exp(-k²/2σ²). */
static void weights(const struct field *f, double d, double *w) {
    double s = 1 / (f->sigma * f->sigma), middle = exp(-0.5 * d * d * s), up = exp(d * s);
    double right = middle, left = middle, down = 1 / up;
    w[f->reach] = middle * f->lattice[f->reach];
    for (int k = 1; k <= f->reach; k++) {
        right *= up;
        left *= down;
        w[f->reach + k] = right * f->lattice[f->reach + k];
        w[f->reach - k] = left * f->lattice[f->reach - k];
    }
}

/* Σ_k (c_k g_k, g_k) r_k at a point of padded index space; false where nothing is near. */
static bool field_sample(const struct field *f, const double p[3], quad *sum) {
    double wx[TAPS_MAX], wy[TAPS_MAX], wz[TAPS_MAX];
    long base[3];
    for (int a = 0; a < 3; a++) {
        base[a] = (long)floor(p[a] + 0.5);
        if (base[a] < f->reach || base[a] >= (long)f->dims[a] - f->reach)
            return false;
    }
    if (!f->near_by[field_at(f, (size_t)base[0], (size_t)base[1], (size_t)base[2])])
        return false;
    weights(f, p[0] - (double)base[0], wx);
    weights(f, p[1] - (double)base[1], wy);
    weights(f, p[2] - (double)base[2], wz);
    int taps = 2 * f->reach + 1;
    quad all = { 0 };
    for (int z = 0; z < taps; z++) {
        quad plane = { 0 };
        for (int y = 0; y < taps; y++) {
            const quad *v = f->voxels + field_at(f, (size_t)(base[0] - f->reach),
                                                 (size_t)(base[1] - f->reach + y),
                                                 (size_t)(base[2] - f->reach + z));
            quad row = { 0 };
            for (int x = 0; x < taps; x++)
                row += wx[x] * v[x];
            plane += wy[y] * row;
        }
        all += wz[z] * plane;
    }
    *sum = all;
    return true;
}

/* Where the ray p + l·d lies inside the padded box, l ≥ 0; false if nowhere. */
static bool clip_to_field(const struct field *f, const double p[3], const double d[3], double *from,
                          double *to) {
    *from = 0;
    *to = INFINITY;
    for (int a = 0; a < 3; a++) {
        double low = f->reach, high = (double)f->dims[a] - 1 - f->reach;
        if (fabs(d[a]) < 1e-300) {
            if (p[a] < low || p[a] > high)
                return false;
            continue;
        }
        double l0 = (low - p[a]) / d[a], l1 = (high - p[a]) / d[a];
        *from = fmax(*from, fmin(l0, l1));
        *to = fmin(*to, fmax(l0, l1));
    }
    return *from < *to;
}

/* The integral along one ray; p and d (per world unit) in padded index space. */
static void march_ray(const struct march *m, const double p[3], const double d[3], double *rgba) {
    double from, to, through = 1;
    memset(rgba, 0, 4 * sizeof *rgba);
    if (!clip_to_field(&m->field, p, d, &from, &to))
        return;
    double voxels = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]); /* a world unit */
    double steps = ceil((to - from) * voxels / m->step), dl = (to - from) / steps;
    for (double s = 0; s < steps; s++) {
        double l = from + (s + 0.5) * dl, q[3];
        quad sum;
        for (int a = 0; a < 3; a++)
            q[a] = p[a] + l * d[a];
        if (!field_sample(&m->field, q, &sum) || sum[3] <= 0)
            continue;
        double stopped = -expm1(-sum[3] * dl) * through;
        for (int c = 0; c < 3; c++)
            rgba[c] += sum[c] / sum[3] * stopped;
        rgba[3] += stopped;
        through -= stopped;
        if (through < 1e-12)
            break;
    }
}

static void march_block(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    const struct march *m = user;
    const struct sp_view *view = m->view;
    const struct test_image *image = &m->rays->image;
    for (size_t i = begin; i < end; i++) {
        double x = ((double)(i % image->width) + 0.5) * m->sub - m->rays->margin;
        double y = ((double)(i / image->width) + 0.5) * m->sub - m->rays->margin;
        double a = (x - 0.5 * view->size[0]) / m->scale[0];
        double b = (y - 0.5 * view->size[1]) / m->scale[1];
        bool perspective = view->camera.projection == SP_PERSPECTIVE;
        double unit = perspective ? 1 / sqrt(a * a + b * b + 1) : 0;
        struct sp_vec3 start, ahead;
        for (int c = 0; c < 3; c++) {
            double aside = m->w[0][c] * a + m->w[1][c] * b;
            start.v[c] = view->camera.position[c] - m->origin[c] + (perspective ? 0 : aside);
            ahead.v[c] = perspective ? (aside + m->w[2][c]) * unit : m->w[2][c];
        }
        start = sp_mat3_apply(&m->to_index, start);
        ahead = sp_mat3_apply(&m->to_index, ahead);
        for (int c = 0; c < 3; c++)
            start.v[c] += m->field.pad;
        march_ray(m, start.v, ahead.v, image->rgba + i * 4);
    }
}

bool test_truth_integrate(const struct sp_volume_info *info, const void *voxels,
                          const struct sp_view *view, const struct test_truth_options *options,
                          struct test_rays *rays, struct sp_error *err) {
    struct test_truth_options o = options ? *options : (struct test_truth_options){ 0 };
    struct march m = { .view = view, .rays = rays, .step = o.step > 0 ? o.step : 0.4 };
    struct sp_mat3 to_world = index_to_world(&info->grid);
    double det, cores = (double)sysconf(_SC_NPROCESSORS_ONLN);
    *rays = (struct test_rays){ .samples = o.samples ? o.samples : 3,
                                .margin = o.margin ? o.margin : 5 };
    assert(rays->samples % 2 == 1 && rays->samples <= 15);
    m.to_index = sp_mat3_inverse(&to_world, &det);
    if (det == 0)
        return sp_fail(err, SP_ERR_INVALID, "/direction", "the direction matrix is singular");
    memcpy(m.origin, info->grid.origin, sizeof m.origin);
    test_camera_axes(&view->camera, m.w);
    m.scale[0] = m.scale[1] = view->camera.projection == SP_PERSPECTIVE
                                  ? 0.5 * view->size[1] / tan(view->camera.fov_y * M_PI / 360)
                                  : view->size[1] / view->camera.height;
    m.sub = 1.0 / rays->samples;
    struct sp_pool *pool = NULL;
    bool ok = field_build(&m, info, voxels, &o, o.radius > 0 ? o.radius : 4.5, err);
    if (ok && !test_image_init(&rays->image, (view->size[0] + 2 * rays->margin) * rays->samples,
                               (view->size[1] + 2 * rays->margin) * rays->samples))
        ok = sp_fail(err, SP_ERR_MEMORY, "", "the integrator's rays");
    if (ok) {
        unsigned threads = o.threads ? o.threads : (unsigned)fmin(fmax(cores, 1), 64);
        pool = sp_pool_create(threads, err);
        ok = pool != NULL;
    }
    if (ok)
        sp_parallel_for(pool, (size_t)rays->image.width * rays->image.height, 64, march_block, &m);
    sp_pool_destroy(&pool);
    free(m.field.voxels);
    free(m.field.near_by);
    if (!ok)
        test_rays_finish(rays);
    return ok;
}

void test_rays_finish(struct test_rays *rays) {
    test_image_finish(&rays->image);
}

/* One pixel: Σ over rays around its centre of the Gaussian's density times the cell's area. */
static void convolve_pixel(const struct test_rays *rays, double h, unsigned x, unsigned y,
                           double *rgba) {
    int n = (int)rays->samples, reach = h > 0 ? (int)ceil(5 * h * n) : 0;
    int cx = ((int)x + (int)rays->margin) * n + n / 2,
        cy = ((int)y + (int)rays->margin) * n + n / 2;
    double scale = h > 0 ? 1 / (sqrt(2 * M_PI) * h * n) : 1, k = h > 0 ? -0.5 / (h * h * n * n) : 0;
    for (int j = -reach; j <= reach; j++) {
        double row[4] = { 0 }, wy = scale * exp(k * j * j);
        for (int i = -reach; i <= reach; i++) {
            int px = cx + i, py = cy + j;
            if (px < 0 || py < 0 || px >= (int)rays->image.width || py >= (int)rays->image.height)
                continue;
            const double *p = test_image_at(&rays->image, (unsigned)px, (unsigned)py);
            double wx = scale * exp(k * i * i);
            for (int c = 0; c < 4; c++)
                row[c] += wx * p[c];
        }
        for (int c = 0; c < 4; c++)
            rgba[c] += wy * row[c];
    }
}

bool test_truth_image(const struct test_rays *rays, double lowpass, const float background[4],
                      struct test_image *image) {
    unsigned width = rays->image.width / rays->samples - 2 * rays->margin;
    unsigned height = rays->image.height / rays->samples - 2 * rays->margin;
    assert(5 * lowpass <= rays->margin);
    if (!test_image_init(image, width, height))
        return false;
    for (unsigned y = 0; y < height; y++)
        for (unsigned x = 0; x < width; x++)
            convolve_pixel(rays, lowpass, x, y, test_image_at(image, x, y));
    test_image_over(image, background);
    return true;
}
