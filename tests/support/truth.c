/* SPDX-License-Identifier: Apache-2.0 */
#include "support/truth.h"

#include <assert.h>
#include <math.h>
#include <stdint.h>
#include <string.h>
#include <unistd.h>

#include "base/parallel_for.h"
#include "base/vec.h"
#include "data/volume/grid.h"
#include "support/field.h"
#include "support/sample.h"

struct march {
    struct test_field field;
    const struct sp_view *view;
    double w[3][3];         /* world → camera */
    struct sp_mat3 to_axes; /* direction⁻¹ */
    double origin[3];
    double scale, step, sub; /* px per unit of tangent or of world; voxels; px between rays */
    double box[2][3]; /* what the clip box keeps, axis space; infinite where it does not cut */
    struct test_rays *rays;
};

/* A ray of unit speed, in world and in axis space. */
struct ray {
    double start[3], ahead[3]; /* world */
    double p[3], d[3];         /* axis space */
};

static double extinction(const struct sp_transfer_function *tf, double opacity) {
    return -log1p(-opacity) / tf->reference_length;
}

static double length3(const double v[3]) {
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

/* Classifies before interpolation: sets (c_k g_k, g_k). False if the voxel is transparent. */
static bool set_pre(const struct march *m, double value, const double gradient[3],
                    const double place[3], test_quad *numbers) {
    const struct sp_view *view = m->view;
    double color[3], opacity, ahead[3];
    test_classify(&view->transfer_function, value, length3(gradient), color, &opacity);
    if (opacity <= 0)
        return false;
    bool perspective = view->camera.projection == SP_PERSPECTIVE;
    for (int c = 0; c < 3; c++)
        ahead[c] = perspective ? place[c] - view->camera.position[c] : m->w[2][c];
    struct sp_vec3 unit = sp_vec3_normalize(sp_vec3_from(ahead));
    test_shade(view, unit.v, gradient, color);
    double g = extinction(&view->transfer_function, opacity);
    *numbers = (test_quad){ color[0] * g, color[1] * g, color[2] * g, g };
    return true;
}

static void set_voxel(struct march *m, const struct sp_volume_info *info, const void *voxels,
                      const uint32_t i[3]) {
    const struct sp_view *view = m->view;
    const struct sp_camera *camera = &view->camera;
    double value = test_sample(voxels, info->type, test_sample_index(&info->grid, i));
    double place[3], gradient[3] = { 0 };
    test_quad numbers[2];
    if (!isfinite(value))
        return;
    test_sample_place(&info->grid, i, place);
    struct sp_vec3 u = sp_vec3_sub(sp_vec3_from(place), sp_vec3_from(camera->position));
    if (sp_vec3_dot(u, sp_vec3_from(m->w[2])) < camera->near)
        return;
    if (test_needs_gradient(view))
        test_gradient(info, voxels, i, gradient);
    numbers[0] = (test_quad){ value, 1, 0, 0 };
    numbers[1] = (test_quad){ gradient[0], gradient[1], gradient[2], 0 };
    if (view->transfer_function.order == SP_TF_POST || set_pre(m, value, gradient, place, numbers))
        test_field_set(&m->field, i, numbers);
}

/* True if a value in [low, high] has an opacity above 0. */
static bool visible(const void *user, double low, double high) {
    const struct sp_transfer_function *tf = user;
    double color[3], opacity[2];
    for (uint32_t k = 0; k < tf->point_count; k++)
        if (tf->points[k].opacity > 0 && tf->points[k].value >= low && tf->points[k].value <= high)
            return true;
    struct sp_transfer_function flat = *tf;
    flat.gradient_count = 0;
    test_classify(&flat, low, 0, color, &opacity[0]);
    test_classify(&flat, high, 0, color, &opacity[1]);
    return opacity[0] > 0 || opacity[1] > 0;
}

static bool build_field(struct march *m, const struct sp_volume_info *info, const void *voxels,
                        double radius) {
    const uint32_t *dims = info->grid.dims;
    bool post = m->view->transfer_function.order == SP_TF_POST;
    if (!test_field_init(&m->field, &info->grid, &m->view->filter, radius,
                         post && test_needs_gradient(m->view) ? 2 : 1))
        return false;
    for (uint32_t z = 0; z < dims[2]; z++)
        for (uint32_t y = 0; y < dims[1]; y++)
            for (uint32_t x = 0; x < dims[0]; x++)
                set_voxel(m, info, voxels, (uint32_t[3]){ x, y, z });
    if (!test_field_close(&m->field))
        return false;
    if (post)
        test_field_hide(&m->field, visible, &m->view->transfer_function);
    return true;
}

/* Sets emission and extinction (c g, g) at the axis-space point p. False where extinction is 0. */
static bool medium(const struct march *m, const struct ray *ray, const double p[3],
                   test_quad *sum) {
    const struct sp_view *view = m->view;
    test_quad sums[2];
    if (!test_field_at(&m->field, p, sums))
        return false;
    *sum = sums[0];
    if (view->transfer_function.order == SP_TF_POST) {
        double all = sums[0][1], gradient[3] = { 0 }, color[3], opacity;
        if (!(all > 1e-12))
            return false;
        for (int c = 0; c < 3 && m->field.quads > 1; c++)
            gradient[c] = sums[1][c] / all;
        test_classify(&view->transfer_function, sums[0][0] / all, length3(gradient), color,
                      &opacity);
        double g = extinction(&view->transfer_function, opacity) * all;
        if (g > 0)
            test_shade(view, ray->ahead, gradient, color);
        *sum = (test_quad){ color[0] * g, color[1] * g, color[2] * g, g };
    }
    return (*sum)[3] > 0;
}

/* Reduces [*from, *to] to the part where a + b·l ≥ 0. True if it becomes shorter. */
static bool keep(double a, double b, double *from, double *to) {
    double was[2] = { *from, *to };
    if (b > 0)
        *from = fmax(*from, -a / b);
    else if (b < 0)
        *to = fmin(*to, -a / b);
    else if (a < 0)
        *to = *from;
    return *from > was[0] || *to < was[1];
}

/* Reduces an interval of the ray to the part inside the clip box and planes. True if they cut it.
 */
static bool clip_ray(const struct march *m, const struct ray *ray, double *from, double *to) {
    const struct sp_clip *clip = &m->view->clip;
    bool cut = false;
    for (int a = 0; a < 3; a++) {
        if (isfinite(m->box[0][a]))
            cut |= keep(ray->p[a] - m->box[0][a], ray->d[a], from, to);
        if (isfinite(m->box[1][a]))
            cut |= keep(m->box[1][a] - ray->p[a], -ray->d[a], from, to);
    }
    for (uint32_t i = 0; i < clip->plane_count; i++) {
        const double *n = clip->planes[i].normal;
        double a = -clip->planes[i].offset, b = 0;
        for (int c = 0; c < 3; c++) {
            a += n[c] * ray->start[c];
            b += n[c] * ray->ahead[c];
        }
        cut |= keep(a, b, from, to);
    }
    return cut;
}

static void march_ray(const struct march *m, const struct ray *ray, double *rgba) {
    double from, to, through = 1, speed[3]; /* speed: voxels per world unit */
    memset(rgba, 0, 4 * sizeof *rgba);
    if (!test_field_span(&m->field, ray->p, ray->d, &from, &to))
        return;
    bool cut = clip_ray(m, ray, &from, &to);
    for (int a = 0; a < 3; a++)
        speed[a] = ray->d[a] / m->field.axes[a].step;
    double steps = ceil((to - from) * length3(speed) / m->step), dl = (to - from) / steps;
    int nodes = cut ? 2 : 1;
    for (double s = 0; s < steps && through >= 1e-12; s++)
        for (int k = 0; k < nodes; k++) {
            double aside = cut ? (k - 0.5) / sqrt(3) : 0, q[3];
            double l = from + (s + 0.5 + aside) * dl;
            test_quad sum;
            for (int a = 0; a < 3; a++)
                q[a] = ray->p[a] + l * ray->d[a];
            if (!medium(m, ray, q, &sum))
                continue;
            double stopped = -expm1(-sum[3] * dl / nodes) * through;
            for (int c = 0; c < 3; c++)
                rgba[c] += sum[c] / sum[3] * stopped;
            rgba[3] += stopped;
            through -= stopped;
        }
}

static void make_ray(const struct march *m, size_t index, struct ray *ray) {
    const struct sp_view *view = m->view;
    const struct test_image *image = &m->rays->image;
    double x = ((double)(index % image->width) + 0.5) * m->sub - m->rays->margin;
    double y = ((double)(index / image->width) + 0.5) * m->sub - m->rays->margin;
    double a = (x - 0.5 * view->size[0]) / m->scale;
    double b = (y - 0.5 * view->size[1]) / m->scale;
    bool perspective = view->camera.projection == SP_PERSPECTIVE;
    double unit = perspective ? 1 / sqrt(a * a + b * b + 1) : 0;
    struct sp_vec3 start, ahead;
    for (int c = 0; c < 3; c++) {
        double aside = m->w[0][c] * a + m->w[1][c] * b;
        ray->start[c] = view->camera.position[c] + (perspective ? 0 : aside);
        ray->ahead[c] = perspective ? (aside + m->w[2][c]) * unit : m->w[2][c];
        start.v[c] = ray->start[c] - m->origin[c];
        ahead.v[c] = ray->ahead[c];
    }
    start = sp_mat3_apply(&m->to_axes, start);
    ahead = sp_mat3_apply(&m->to_axes, ahead);
    memcpy(ray->p, start.v, sizeof ray->p);
    memcpy(ray->d, ahead.v, sizeof ray->d);
}

static void march_block(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    const struct march *m = user;
    for (size_t i = begin; i < end; i++) {
        struct ray ray;
        make_ray(m, i, &ray);
        march_ray(m, &ray, m->rays->image.rgba + i * 4);
    }
}

/* Box faces at the fractions 0 and 1 do not cut: kernels extend beyond the box of the cells. */
static void init_box(struct march *m, const struct sp_grid *grid) {
    for (unsigned a = 0; a < 3; a++) {
        double extent[2];
        sp_grid_extent(grid, a, extent);
        for (int side = 0; side < 2; side++) {
            double fraction = m->view->clip.box[side][a];
            bool cuts = side ? fraction < 1 : fraction > 0;
            m->box[side][a] = cuts   ? extent[0] + fraction * (extent[1] - extent[0])
                              : side ? INFINITY
                                     : -INFINITY;
        }
    }
}

bool test_truth_integrate(const struct sp_volume_info *info, const void *voxels,
                          const struct sp_view *view, const struct test_truth_options *options,
                          struct test_rays *rays, struct sp_error *err) {
    struct test_truth_options o = options ? *options : (struct test_truth_options){ 0 };
    struct march m = { .view = view, .rays = rays };
    struct sp_mat3 direction;
    double det, cores = (double)sysconf(_SC_NPROCESSORS_ONLN);
    *rays = (struct test_rays){ .samples = o.samples ? o.samples : 3,
                                .margin = o.margin ? o.margin : 5 };
    assert(rays->samples % 2 == 1 && rays->samples <= 15);
    memcpy(direction.m, info->grid.direction, sizeof direction.m);
    m.to_axes = sp_mat3_inverse(&direction, &det);
    if (det == 0)
        return sp_fail(err, SP_ERR_INVALID, "/direction", "the direction matrix is singular");
    memcpy(m.origin, info->grid.origin, sizeof m.origin);
    test_camera_axes(&view->camera, m.w);
    m.scale = test_camera_scale(view);
    m.sub = 1.0 / rays->samples;
    m.step = o.step > 0                                    ? o.step
             : view->transfer_function.order == SP_TF_POST ? 0.1
             : view->filter.kernel == SP_KERNEL_CUBIC      ? 0.2
                                                           : 0.4;
    init_box(&m, &info->grid);
    struct sp_pool *pool = NULL;
    bool ok = build_field(&m, info, voxels, o.radius > 0 ? o.radius : 4.5) &&
              test_image_init(&rays->image, (view->size[0] + 2 * rays->margin) * rays->samples,
                              (view->size[1] + 2 * rays->margin) * rays->samples);
    if (!ok)
        sp_fail(err, SP_ERR_MEMORY, "", "the integrator's field and rays");
    if (ok) {
        unsigned threads = o.threads ? o.threads : (unsigned)fmin(fmax(cores, 1), 64);
        pool = sp_pool_create(threads, err);
        ok = pool != NULL;
    }
    if (ok)
        sp_parallel_for(pool, (size_t)rays->image.width * rays->image.height, 64, march_block, &m);
    sp_pool_destroy(&pool);
    test_field_finish(&m.field);
    if (!ok)
        test_rays_finish(rays);
    return ok;
}

void test_rays_finish(struct test_rays *rays) {
    test_image_finish(&rays->image);
}

/* Convolves one pixel: sums the rays around its centre, weighted by the Gaussian's density times
 * the area of a ray's cell. */
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
