/* SPDX-License-Identifier: Apache-2.0
 *
 * Compares the optional parts of the integrator (cubic kernel, clipping, rectilinear grids,
 * post-classification, gradient axis) with closed forms, and with itself at finer steps.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "support/compare.h"
#include "support/cubic.h"
#include "support/sample.h"
#include "support/scene.h"
#include "support/truth.h"

static struct test_image integrate(const struct test_scene *s, const struct test_truth_options *o,
                                   double lowpass) {
    struct test_rays rays;
    struct test_image image;
    struct sp_error err;
    if (!test_truth_integrate(&s->info, s->voxels, &s->view, o, &rays, &err))
        fail_msg("%s", err.text);
    assert_true(test_truth_image(&rays, lowpass, s->view.background, &image));
    test_rays_finish(&rays);
    return image;
}

/* Sets the start and the unit direction of the ray through a pixel's centre, in world space. */
static void pixel_ray(const struct sp_view *v, unsigned x, unsigned y, double p[3], double d[3]) {
    double w[3][3], f = test_camera_scale(v);
    double a = (x + 0.5 - 0.5 * v->size[0]) / f, b = (y + 0.5 - 0.5 * v->size[1]) / f;
    bool ortho = v->camera.projection == SP_ORTHOGRAPHIC;
    double norm = ortho ? 1 : sqrt(a * a + b * b + 1);
    test_camera_axes(&v->camera, w);
    for (int c = 0; c < 3; c++) {
        double aside = w[0][c] * a + w[1][c] * b;
        p[c] = v->camera.position[c] + (ortho ? aside : 0);
        d[c] = (w[2][c] + (ortho ? 0 : aside)) / norm;
    }
}

/* Solves m x = v by Cramer's rule. */
static void solve(double m[3][3], const double v[3], double x[3]) {
    double det = 0;
    for (int k = -1; k < 3; k++) {
        double n[3][3], value = 0;
        memcpy(n, m, sizeof n);
        for (int r = 0; r < 3 && k >= 0; r++)
            n[r][k] = v[r];
        for (int c = 0; c < 3; c++) {
            int c1 = (c + 1) % 3, c2 = (c + 2) % 3;
            value += n[0][c] * (n[1][c1] * n[2][c2] - n[1][c2] * n[2][c1]);
        }
        if (k < 0)
            det = value;
        else
            x[k] = value / det;
    }
}

/* How a ray passes a kernel, in the kernel's own space, whose unit is a voxel. */
struct passage {
    double rho;    /* smallest distance from the kernel's centre, voxels */
    double middle; /* distance of that point from the start of the ray, world units */
    double speed;  /* voxels per world unit along the ray */
};

/* Returns how the ray p + l·d passes the kernel at sample i, whose widths are `size`. */
static struct passage compute_passage(const struct sp_grid *g, const uint32_t i[3],
                                      const double size[3], const double p[3], const double d[3]) {
    double m[3][3], at[3], away[3], q[3], e[3];
    test_sample_place(g, i, at);
    for (int r = 0; r < 3; r++) {
        away[r] = p[r] - at[r];
        for (int a = 0; a < 3; a++)
            m[r][a] = g->direction[r][a] * size[a];
    }
    solve(m, away, q);
    solve(m, d, e);
    double qq = 0, qe = 0, ee = 0;
    for (int a = 0; a < 3; a++) {
        qq += q[a] * q[a];
        qe += q[a] * e[a];
        ee += e[a] * e[a];
    }
    return (struct passage){ sqrt(fmax(qq - qe * qe / ee, 0)), -qe / ee, sqrt(ee) };
}

static double phi(double x) {
    return 0.5 * erfc(-x / sqrt(2));
}

/* Returns the optical depth between the distances l0 and l1 along the ray, for a kernel of
 * extinction 1. */
static double depth_between(const struct passage *q, const struct sp_filter *filter, double l0,
                            double l1) {
    double z0 = (l0 - q->middle) * q->speed, z1 = (l1 - q->middle) * q->speed;
    if (l1 <= l0)
        return 0;
    if (filter->kernel == SP_KERNEL_CUBIC)
        return (test_cubic_gathered(q->rho, z1) - test_cubic_gathered(q->rho, z0)) / q->speed;
    double s = filter->sigma;
    return exp(-0.5 * q->rho * q->rho / (s * s)) / (2 * M_PI * s * s) *
           (phi(z1 / s) - phi(z0 / s)) / q->speed;
}

/* Integrates the cubic kernel in two ways and compares with the published projection of one layer.
 */
static void the_integrals_of_the_cubic_kernel_agree(void **state) {
    (void)state;
    enum { STEPS = 20000 };
    double flat = 0, round = 0, h = TEST_CUBIC_RADIUS / STEPS;
    for (int k = 0; k < STEPS; k++) {
        double r = (k + 0.5) * h;
        round += 4 * M_PI * r * r * test_cubic(r) * h;
        if (k % 10 == 5)
            flat += 2 * M_PI * (k * h) * test_cubic_gathered(k * h, INFINITY) * 10 * h;
    }
    assert_compare(fabs(flat - round), <, 1e-6);
    for (double rho = 0; rho < 1.6; rho += 0.19)
        for (double end = -1.7; end < 1.8; end += 0.31) {
            double sum = 0;
            for (int k = 0; k < STEPS; k++)
                sum += test_cubic(hypot(rho, -1.7 + (end + 1.7) * (k + 0.5) / STEPS));
            assert_compare(fabs(sum * (end + 1.7) / STEPS - test_cubic_gathered(rho, end)), <,
                           2e-8);
        }
    double half = 0, quarter = 0;
    for (int j = -3; j <= 3; j++)
        for (int i = -3; i <= 3; i++) {
            half += test_cubic_gathered(hypot(i - 0.5, j - 0.5), INFINITY);
            quarter += test_cubic_gathered(hypot(i - 0.25, j - 0.25), INFINITY);
        }
    assert_compare(fabs(half - 1.00249), <, 1e-5);
    assert_compare(fabs(quarter - 0.99845), <, 1e-5);
}

static double one_voxel(const void *user, double x, double y, double z) {
    const double *at = user;
    return fabs(x - at[0]) + fabs(y - at[1]) + fabs(z - at[2]) < 1e-6 ? 1 : 0;
}

static const uint32_t single[3] = { 4, 3, 2 };

static void look(struct test_scene *s, bool ortho) {
    test_scene_orbit(s, NULL, 40, 25, 20);
    s->view.camera.projection = ortho ? SP_ORTHOGRAPHIC : SP_PERSPECTIVE;
    s->view.camera.height = 12;
    s->view.camera.fov_y = 40;
    s->view.size[0] = 26;
    s->view.size[1] = 20;
}

/* Compares all pixels of a view of one voxel, cut by the clip planes, with the closed form. */
static void check_single(struct test_scene *s, const double size[3]) {
    const double opacity = (double)0.9F;
    struct sp_view *v = &s->view;
    double largest_alpha = 0;
    test_scene_points(s, (const double[][5]){ { 0, 0.2, 0.4, 0.8, 0 }, { 1, 0.2, 0.4, 0.8, 0.9 } },
                      2);
    struct test_truth_options o = { .samples = 1, .step = 0.04, .radius = 6 };
    struct test_image image = integrate(s, &o, 0);
    for (unsigned y = 0; y < image.height; y++)
        for (unsigned x = 0; x < image.width; x++) {
            double p[3], d[3], from = 0, to = 1000;
            pixel_ray(v, x, y, p, d);
            for (uint32_t k = 0; k < v->clip.plane_count; k++) {
                const struct sp_clip_plane *plane = &v->clip.planes[k];
                double a = -plane->offset, b = 0;
                for (int c = 0; c < 3; c++) {
                    a += plane->normal[c] * p[c];
                    b += plane->normal[c] * d[c];
                }
                if (b > 0)
                    from = fmax(from, -a / b);
                else
                    to = fmin(to, -a / b);
            }
            struct passage q = compute_passage(&s->info.grid, single, size, p, d);
            double alpha = -expm1(log1p(-opacity) * depth_between(&q, &v->filter, from, to));
            const double *got = test_image_at(&image, x, y);
            if (!(fabs(got[3] - alpha) < 2e-6) || !(fabs(got[2] - 0.8 * alpha) < 2e-6))
                fail_msg("pixel (%u,%u): alpha %.8f, expected %.8f; blue %.8f, expected %.8f", x, y,
                         got[3], alpha, got[2], 0.8 * alpha);
            largest_alpha = fmax(largest_alpha, alpha);
        }
    assert_compare(largest_alpha, >, 0.05); /* the voxel is visible */
    test_image_finish(&image);
}

static void one_voxel_has_the_analytic_depth(void **state) {
    (void)state;
    static const double spacings[][3] = { { 1, 1, 1 }, { 1, 1, 4 }, { 0.5, 2, 3 } };
    const double at[3] = { single[0], single[1], single[2] };
    for (int k = 0; k < 3; k++)
        for (int mode = 0; mode < 8; mode++) {
            struct test_scene s;
            test_view_init(&s.view);
            assert_true(test_scene_voxels(&s, "one", (uint32_t[]){ 8, 8, 5 }, spacings[k], SP_UINT8,
                                          one_voxel, at));
            if (k)
                test_scene_direction(&s, (double[]){ 20, 50, -35 }, k == 1 ? 1 : -1, 0.4);
            look(&s, mode & 1);
            s.view.filter.kernel = mode & 2 ? SP_KERNEL_CUBIC : SP_KERNEL_GAUSSIAN;
            if (mode & 4) {
                double middle[3];
                test_sample_place(&s.info.grid, single, middle);
                middle[0] += 0.2;
                test_scene_cut(&s, (double[]){ 1, 0.4, -0.5 }, middle);
                middle[1] -= 0.6;
                test_scene_cut(&s, (double[]){ -0.1, 2, 0.9 }, middle);
            }
            check_single(&s, spacings[k]);
            test_scene_finish(&s);
        }
}

static const double graded[3][8] = {
    { 0, 1, 1.8, 2.4, 3.2, 4.6, 5.4, 6.4 },
    { 0, 1, 2.2, 2.8, 3.6, 4.6, 5.6, 7 },
    { 0, 1.2, 2, 3.4, 4.4 },
};

/* The width of a kernel is the mean of the two gaps beside its sample. */
static void a_voxel_of_a_rectilinear_grid_has_its_local_width(void **state) {
    (void)state;
    const double size[3] = { 0.5 * (4.6 - 2.4), 0.5 * (3.6 - 2.2), 0.5 * (3.4 - 1.2) };
    const double at[3] = { 3.2 - 3.2, 2.8 - 3.5, 2 - 2.2 };
    for (int mode = 0; mode < 4; mode++) {
        struct test_scene s;
        test_view_init(&s.view);
        assert_true(test_scene_rectilinear(&s, "one", (uint32_t[]){ 8, 8, 5 },
                                           (const double *[]){ graded[0], graded[1], graded[2] },
                                           SP_UINT8, one_voxel, at));
        test_scene_direction(&s, (double[]){ 20, 50, -35 }, -1, 0.3);
        look(&s, mode & 1);
        s.view.filter.kernel = mode & 2 ? SP_KERNEL_CUBIC : SP_KERNEL_GAUSSIAN;
        check_single(&s, size);
        test_scene_finish(&s);
    }
}

static double one(const void *user, double x, double y, double z) {
    (void)user, (void)x, (void)y, (void)z;
    return 1;
}

/* Layers of different thickness in a constant field: each adds its own thickness to the depth. */
static void a_rectilinear_slab_has_the_analytic_opacity(void **state) {
    (void)state;
    const double opacity = (double)0.2F;
    struct test_scene s;
    test_view_init(&s.view);
    test_scene_points(&s, (const double[][5]){ { 0, 1, 1, 1, 0 }, { 1, 1, 1, 1, 0.2 } }, 2);
    assert_true(test_scene_rectilinear(&s, "slab", (uint32_t[]){ 24, 24, 8 },
                                       (const double *[]){ NULL, NULL, graded[0] }, SP_UINT8, one,
                                       NULL));
    s.view.camera.projection = SP_ORTHOGRAPHIC;
    s.view.camera.height = 8;
    s.view.size[0] = s.view.size[1] = 8;
    struct test_image image = integrate(&s, &(struct test_truth_options){ .samples = 1 }, 0);
    double deep = 6.4 + 0.5 * 1 + 0.5 * 1, alpha = 1 - pow(1 - opacity, deep);
    for (unsigned k = 0; k < 64; k++)
        assert_compare(fabs(image.rgba[k * 4 + 3] / alpha - 1), <, 4e-4);
    test_image_finish(&image);
    test_scene_finish(&s);
}

/* Rectilinear coordinates at equal distances give the image of the uniform grid, for both kernels
 * and both orders of classification. */
static void evenly_spaced_coordinates_give_the_uniform_grid(void **state) {
    (void)state;
    double places[28];
    for (int i = 0; i < 28; i++)
        places[i] = i;
    for (int mode = 0; mode < 4; mode++) {
        struct test_scene s;
        assert_true(test_scene_post_lit(&s));
        s.view.size[0] = s.view.size[1] = 16;
        s.view.filter.kernel = mode & 1 ? SP_KERNEL_CUBIC : SP_KERNEL_GAUSSIAN;
        s.view.transfer_function.order = mode & 2 ? SP_TF_POST : SP_TF_PRE;
        struct test_truth_options o = { .samples = 1 };
        struct test_image a = integrate(&s, &o, 0);
        for (int axis = 0; axis < 3; axis++)
            s.info.grid.coordinates[axis] = places;
        struct test_image b = integrate(&s, &o, 0);
        assert_compare(test_image_difference(&a, &b).largest, <, 1e-9);
        test_image_finish(&a);
        test_image_finish(&b);
        test_scene_finish(&s);
    }
}

/* In a constant field that extends beyond the clip box, the optical depth of a ray is proportional
 * to the length of its chord in the box, for any direction of the grid. */
static void a_clip_box_keeps_the_chord_of_the_ray(void **state) {
    (void)state;
    const double opacity = (double)0.2F;
    static const double box[2][3] = { { 0.25, 0.3, 0.4 }, { 0.6, 0.7, 0.75 } };
    for (int mode = 0; mode < 4; mode++) {
        struct test_scene s;
        test_view_init(&s.view);
        test_scene_points(&s, (const double[][5]){ { 0, 1, 1, 1, 0 }, { 1, 1, 1, 1, 0.2 } }, 2);
        assert_true(test_scene_voxels(&s, "box", (uint32_t[]){ 20, 20, 20 },
                                      (double[]){ 1, 1, 0.5 }, SP_UINT8, one, NULL));
        test_scene_direction(&s, (double[]){ 20, 50, -35 }, 1, mode & 2 ? 0.4 : 0);
        look(&s, mode & 1);
        memcpy(s.view.clip.box, box, sizeof box);
        struct test_image image = integrate(&s, &(struct test_truth_options){ .samples = 1 }, 0);
        const struct sp_grid *g = &s.info.grid;
        for (unsigned y = 0; y < image.height; y++)
            for (unsigned x = 0; x < image.width; x++) {
                double m[3][3], p[3], d[3], i[3], e[3], from = 0, to = 1000;
                pixel_ray(&s.view, x, y, p, d);
                for (int r = 0; r < 3; r++) {
                    p[r] -= g->origin[r];
                    for (int a = 0; a < 3; a++)
                        m[r][a] = g->direction[r][a] * g->spacing[a];
                }
                solve(m, p, i);
                solve(m, d, e);
                for (int a = 0; a < 3; a++) { /* faces at -½ + 20·fraction voxels */
                    double l0 = (20 * box[0][a] - 0.5 - i[a]) / e[a];
                    double l1 = (20 * box[1][a] - 0.5 - i[a]) / e[a];
                    from = fmax(from, fmin(l0, l1));
                    to = fmin(to, fmax(l0, l1));
                }
                double alpha = 1 - pow(1 - opacity, fmax(to - from, 0));
                assert_compare(fabs(test_image_at(&image, x, y)[3] - alpha), <, 5e-4);
            }
        test_image_finish(&image);
        test_scene_finish(&s);
    }
}

static double ramp(const void *user, double x, double y, double z) {
    const double *a = user;
    return a[0] * x + a[1] * y + a[2] * z;
}

/* Returns ∫ -ln(1 - o·u) du over u in [0,1]. */
static double mean_extinction(double o) {
    return ((1 - o) * log1p(-o) + o) / o;
}

/* A linear ramp, with a peak of opacity between the values of two samples. No sample has a value in
 * the peak, but post-classification interpolates the ramp and finds it. */
static void post_classification_finds_values_between_the_samples(void **state) {
    (void)state;
    const double rise[3] = { 0, 0, 10 }, o = (double)0.8F;
    struct test_scene s;
    test_view_init(&s.view);
    test_scene_points(
        &s, (const double[][5]){ { 61, 1, 0.5, 0, 0 }, { 65, 1, 0.5, 0, 0.8 }, { 69, 1, 1, 0, 0 } },
        3);
    assert_true(test_scene_voxels(&s, "ramp", (uint32_t[]){ 20, 20, 14 }, (double[]){ 1, 1, 1.5 },
                                  SP_UINT8, ramp, rise));
    s.view.camera.projection = SP_ORTHOGRAPHIC;
    s.view.camera.height = 6;
    s.view.size[0] = s.view.size[1] = 4;
    s.view.filter.sigma = 0.9;
    struct test_truth_options fine = { .samples = 1, .step = 0.005 };
    for (int post = 0; post < 2; post++) {
        s.view.transfer_function.order = post ? SP_TF_POST : SP_TF_PRE;
        struct test_image image = integrate(&s, &fine, 0);
        /* Each flank of the peak is 0.4 voxels wide; a voxel is 1.5 world units. */
        double alpha = post ? -expm1(-mean_extinction(o) * 2 * 0.4 * 1.5) : 0;
        for (int k = 0; k < 16; k++)
            assert_compare(fabs(image.rgba[k * 4 + 3] - alpha), <, 2e-4);
        test_image_finish(&image);
    }
    test_scene_finish(&s);
}

/* A ramp has the same gradient everywhere, so the gradient axis multiplies all opacities by the
 * same factor. The magnitude must be right on rotated, sheared and rectilinear grids. */
static void the_gradient_axis_scales_the_opacity(void **state) {
    (void)state;
    double rise[3] = { 3, -2, 1 }, slope = sqrt(14);
    for (int mode = 0; mode < 8; mode++) {
        struct test_scene s;
        test_view_init(&s.view);
        assert_true(test_scene_rectilinear(
            &s, "ramp", (uint32_t[]){ 8, 8, 5 },
            (const double *[]){ graded[0], mode & 1 ? graded[1] : NULL, graded[2] }, SP_FLOAT64,
            ramp, rise));
        /* The magnitude under a shear, from f = a·p, p = D⁻¹t, ∇f = D⁻ᵀa. */
        if (mode & 2) {
            double shear = 0.4, length = sqrt(1 + shear * shear);
            test_scene_direction(&s, (double[]){ 20, 50, -35 }, -1, shear);
            slope = sqrt(9 + 4 + pow(length * rise[2] - shear * rise[0], 2));
        } else {
            slope = sqrt(14);
        }
        look(&s, mode & 1);
        struct sp_transfer_function *tf = &s.view.transfer_function;
        tf->order = mode & 4 ? SP_TF_POST : SP_TF_PRE;
        test_scene_points(&s, (const double[][5]){ { -5, 1, 1, 1, 0 }, { 6, 1, 1, 0, 0.6 } }, 2);
        tf->gradient_count = 3;
        tf->gradient[0] = (struct sp_gradient_point){ 0.5 * slope, 1 };
        tf->gradient[1] = (struct sp_gradient_point){ 0.8 * slope, 0 };
        tf->gradient[2] = (struct sp_gradient_point){ 1.2 * slope, 1 };
        struct test_truth_options o = { .samples = 1 };
        struct test_image a = integrate(&s, &o, 0);
        tf->gradient_count = 0;
        tf->points[1].opacity = 0.3F;
        struct test_image b = integrate(&s, &o, 0);
        double mean, variance;
        test_image_statistics(&b, 3, &mean, &variance);
        assert_compare(mean, >, 0.05);
        assert_compare(test_image_difference(&a, &b).largest, <, 1e-6);
        test_image_finish(&a);
        test_image_finish(&b);
        test_scene_finish(&s);
    }
}

/* A ramp along the line of sight, lit from the camera: N·L = N·H = 1 at every point. */
static void post_classification_shades_with_the_gradient_of_the_field(void **state) {
    (void)state;
    const double rise[3] = { 0, 0, -4 };
    struct test_scene s;
    test_view_init(&s.view);
    test_scene_points(
        &s, (const double[][5]){ { -30, 0.4, 0.2, 0.6, 0.3 }, { 30, 0.4, 0.2, 0.6, 0.3 } }, 2);
    assert_true(test_scene_voxels(&s, "ramp", (uint32_t[]){ 12, 12, 12 }, (double[]){ 1, 1, 1 },
                                  SP_FLOAT32, ramp, rise));
    s.view.camera.projection = SP_ORTHOGRAPHIC;
    s.view.camera.height = 6;
    s.view.size[0] = s.view.size[1] = 4;
    s.view.transfer_function.order = SP_TF_POST;
    s.view.shading = (struct sp_shading){
        .mode = SP_SHADING_PHONG,
        .ambient = 0.3,
        .diffuse = 0.5,
        .specular = 0.2,
        .exponent = 30,
        .reach = 0.2,
        .light_count = 1,
        .lights = { { { 0, 0, 1 }, SP_LIGHT_CAMERA, { 1, 1, 1 } } },
    };
    struct test_image image = integrate(&s, &(struct test_truth_options){ .samples = 1 }, 0);
    for (int k = 0; k < 16; k++)
        for (int c = 0; c < 3; c++) {
            double color = (c == 0 ? 0.4 : c == 1 ? 0.2 : 0.6) * 0.8 + 0.2;
            assert_compare(fabs(image.rgba[k * 4 + c] / image.rgba[k * 4 + 3] - color), <, 1e-6);
        }
    test_image_finish(&image);
    test_scene_finish(&s);
}

/* With a finer step, the image stays the same to CONVERGED dB, or to CONVERGED_POST dB with
 * post-classification: the integrand then has corners where the transfer function has its points.
 * The floors of post-classified images in manifest.c are lower than that. The test renders only the
 * middle CROP × CROP pixels. */
enum { CONVERGED = 90, CONVERGED_POST = 60, CROP = 12 };

static void finer_integration_gives_the_same_image(void **state) {
    (void)state;
    static test_scene_fn *const builds[] = {
        test_scene_cubic,         test_scene_rectilinear_blobs,
        test_scene_clip_plane,    test_scene_clip_box,
        test_scene_clip_edge,     test_scene_clip_corner,
        test_scene_post_peak,     test_scene_post_lit,
        test_scene_gradient_axis, test_scene_near_shell,
        test_scene_layers,
    };
    unsigned failed = 0;
    for (size_t i = 0; i < sizeof builds / sizeof *builds; i++) {
        struct test_scene s;
        assert_true(builds[i](&s));
        struct sp_camera *camera = &s.view.camera;
        camera->fov_y = 360 / M_PI * atan(CROP * tan(camera->fov_y * M_PI / 360) / s.view.size[1]);
        s.view.size[0] = s.view.size[1] = CROP;
        bool post = s.view.transfer_function.order == SP_TF_POST;
        double step = post ? 0.02 : s.view.filter.kernel == SP_KERNEL_CUBIC ? 0.05 : 0.15;
        struct test_truth_options defaults = { .samples = 1 };
        struct test_truth_options finer = { .samples = 1, .step = step, .radius = 6 };
        struct test_image a = integrate(&s, &defaults, 0), b = integrate(&s, &finer, 0);
        double psnr = test_image_psnr(&a, &b);
        print_message("  %-16s default against finer step %.1f dB\n", s.info.name, psnr);
        if (!(psnr > (post ? CONVERGED_POST : CONVERGED))) {
            test_image_dump(s.info.name, &a, &b, 100);
            failed++;
        }
        test_image_finish(&a);
        test_image_finish(&b);
        test_scene_finish(&s);
    }
    assert_int_equal(failed, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_integrals_of_the_cubic_kernel_agree),
        cmocka_unit_test(one_voxel_has_the_analytic_depth),
        cmocka_unit_test(a_voxel_of_a_rectilinear_grid_has_its_local_width),
        cmocka_unit_test(a_rectilinear_slab_has_the_analytic_opacity),
        cmocka_unit_test(evenly_spaced_coordinates_give_the_uniform_grid),
        cmocka_unit_test(a_clip_box_keeps_the_chord_of_the_ray),
        cmocka_unit_test(post_classification_finds_values_between_the_samples),
        cmocka_unit_test(the_gradient_axis_scales_the_opacity),
        cmocka_unit_test(post_classification_shades_with_the_gradient_of_the_field),
        cmocka_unit_test(finer_integration_gives_the_same_image),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
