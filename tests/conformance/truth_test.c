/* SPDX-License-Identifier: Apache-2.0
 *
 * Compares the integrator (support/truth.h) with closed forms, and with itself at finer steps. The
 * other conformance tests rely on it.
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

static double one_voxel(const void *user, double x, double y, double z) {
    (void)user;
    return x == 4 && y == 3 && z == 2 ? 1 : 0;
}

/* Sets the world position of the voxel of one_voxel(). */
static void voxel_at(const struct sp_grid *g, double world[3]) {
    static const double i[3] = { 4, 3, 2 };
    for (int r = 0; r < 3; r++) {
        world[r] = g->origin[r];
        for (int a = 0; a < 3; a++)
            world[r] += g->direction[r][a] * g->spacing[a] * i[a];
    }
}

static double determinant(double m[3][3]) {
    return m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) -
           m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
           m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
}

/* Returns the optical depth of a ray through one Gaussian, from its 3×3 variance V'' in world
 * space: with q = p - t_k and P = V''⁻¹,
 *   ∫ G(q + l d) dl = exp(-½(q·Pq - (d·Pq)²/d·Pd)) / (2π √(|V''| d·Pd)).
 * It shares no code with the integrator, which uses a separable sum. */
static double depth_of_one(const struct sp_grid *g, double sigma, double extinction,
                           const double p[3], const double d[3]) {
    double m[3][3], v[3][3] = { { 0 } }, precision[3][3], t[3], q[3], det;
    for (int r = 0; r < 3; r++)
        for (int a = 0; a < 3; a++)
            m[r][a] = g->direction[r][a] * g->spacing[a];
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            for (int a = 0; a < 3; a++)
                v[r][c] += sigma * sigma * m[r][a] * m[c][a];
    det = determinant(v);
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) {
            int r0 = (r + 1) % 3, r1 = (r + 2) % 3, c0 = (c + 1) % 3, c1 = (c + 2) % 3;
            precision[r][c] = (v[r0][c0] * v[r1][c1] - v[r0][c1] * v[r1][c0]) / det;
        }
    voxel_at(g, t);
    for (int a = 0; a < 3; a++)
        q[a] = p[a] - t[a];
    double qq = 0, dq = 0, dd = 0;
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) {
            qq += q[r] * precision[r][c] * q[c];
            dq += d[r] * precision[r][c] * q[c];
            dd += d[r] * precision[r][c] * d[c];
        }
    return extinction * fabs(determinant(m)) * exp(-0.5 * (qq - dq * dq / dd)) /
           (2 * M_PI * sqrt(det * dd));
}

/* Compares all pixels of a view of one voxel with the closed form. */
static void check_one_voxel(struct test_scene *s, double opacity, double length) {
    struct sp_view *v = &s->view;
    double w[3][3], largest_alpha = 0;
    test_scene_points(
        s, (const double[][5]){ { 0, 0.2, 0.4, 0.8, 0 }, { 1, 0.2, 0.4, 0.8, opacity } }, 2);
    v->transfer_function.reference_length = length;
    test_camera_axes(&v->camera, w);
    struct test_truth_options o = { .samples = 1, .step = 0.1, .radius = 6 };
    struct test_image image = integrate(s, &o, 0);
    double g = -log1p(-(double)(float)opacity) / length;
    for (unsigned y = 0; y < image.height; y++)
        for (unsigned x = 0; x < image.width; x++) {
            double a = x + 0.5 - 0.5 * image.width, b = y + 0.5 - 0.5 * image.height, p[3], d[3];
            bool ortho = v->camera.projection == SP_ORTHOGRAPHIC;
            double f = ortho ? image.height / v->camera.height
                             : 0.5 * image.height / tan(v->camera.fov_y * M_PI / 360);
            double norm = ortho ? 1 : sqrt(a * a / f / f + b * b / f / f + 1);
            for (int c = 0; c < 3; c++) {
                double aside = (w[0][c] * a + w[1][c] * b) / f;
                p[c] = v->camera.position[c] + (ortho ? aside : 0);
                d[c] = (w[2][c] + (ortho ? 0 : aside)) / norm;
            }
            double alpha = -expm1(-depth_of_one(&s->info.grid, v->filter.sigma, g, p, d));
            const double *got = test_image_at(&image, x, y);
            assert_compare(fabs(got[3] - alpha), <, 1e-6);
            assert_compare(fabs(got[2] - 0.8 * alpha), <, 1e-6);
            largest_alpha = fmax(largest_alpha, alpha);
        }
    assert_compare(largest_alpha, >, 0.05); /* the voxel is visible */
    test_image_finish(&image);
}

static void one_voxel_has_the_analytic_depth(void **state) {
    (void)state;
    static const double spacings[][3] = { { 1, 1, 1 }, { 1, 1, 4 }, { 0.5, 2, 3 } };
    for (int k = 0; k < 3; k++)
        for (int ortho = 0; ortho < 2; ortho++)
            for (int turn = 0; turn < 3; turn++) {
                struct test_scene s;
                test_view_init(&s.view);
                assert_true(test_scene_voxels(&s, "one", (uint32_t[]){ 8, 8, 5 }, spacings[k],
                                              SP_UINT8, one_voxel, NULL));
                if (turn)
                    test_scene_direction(&s, (double[]){ 20, 50, -35 }, turn == 1 ? 1 : -1,
                                         turn == 1 ? 0.5 : 0);
                test_scene_orbit(&s, NULL, 40, 25, 20);
                s.view.camera.projection = ortho ? SP_ORTHOGRAPHIC : SP_PERSPECTIVE;
                s.view.camera.height = 12;
                s.view.camera.fov_y = 40;
                s.view.size[0] = 26;
                s.view.size[1] = 20;
                s.view.filter.sigma = 0.5 + 0.25 * k;
                check_one_voxel(&s, 0.9, 0.25 + k);
                test_scene_finish(&s);
            }
}

static double one(const void *user, double x, double y, double z) {
    (void)user, (void)x, (void)y, (void)z;
    return 1;
}

/* The optical depth of n layers of a constant field is extinction · n · spacing, up to the ripple
 * of the field. */
static void constant_field_has_the_analytic_opacity(void **state) {
    (void)state;
    for (int k = 0; k < 4; k++) {
        struct test_scene s;
        double spacing = k < 2 ? 1 : 3, opacity = k % 2 ? 0.6 : 0.05, length = 1 + k;
        unsigned layers = 3 + 2 * (unsigned)k;
        test_view_init(&s.view);
        test_scene_points(&s, (const double[][5]){ { 0, 1, 1, 1, 0 }, { 1, 1, 1, 1, opacity } }, 2);
        assert_true(test_scene_voxels(&s, "slab", (uint32_t[]){ 24, 24, layers },
                                      (double[]){ 1, 1, spacing }, SP_UINT8, one, NULL));
        s.view.transfer_function.reference_length = length;
        s.view.camera.projection = SP_ORTHOGRAPHIC;
        s.view.camera.height = 8;
        s.view.size[0] = s.view.size[1] = 16;
        struct test_truth_options o = { .samples = 1 };
        struct test_image image = integrate(&s, &o, 0);
        double alpha = 1 - pow(1 - (double)(float)opacity, layers * spacing / length);
        for (unsigned y = 0; y < 16; y++)
            for (unsigned x = 0; x < 16; x++)
                assert_compare(fabs(test_image_at(&image, x, y)[3] / alpha - 1), <, 4e-4);
        test_image_finish(&image);
        test_scene_finish(&s);
    }
}

/* The convolution leaves a constant unchanged and adds its variance to the variance of a
 * Gaussian. */
static void low_pass_is_a_unit_gaussian(void **state) {
    (void)state;
    struct test_rays rays = { .samples = 3, .margin = 5 };
    struct test_image image;
    static const float background[4] = { 0 };
    assert_true(test_image_init(&rays.image, (32 + 10) * 3, (24 + 10) * 3));
    for (unsigned y = 0; y < rays.image.height; y++)
        for (unsigned x = 0; x < rays.image.width; x++) {
            double px = (x + 0.5) / 3 - 5 - 16, py = (y + 0.5) / 3 - 5 - 12;
            double *p = test_image_at(&rays.image, x, y);
            p[0] = 1;
            p[3] = exp(-0.5 * (px * px / 4 + py * py / 9)) / (2 * M_PI * 6);
        }
    assert_true(test_truth_image(&rays, 1, background, &image));
    for (unsigned y = 4; y < 20; y++)
        for (unsigned x = 4; x < 28; x++) {
            double px = x + 0.5 - 16, py = y + 0.5 - 12;
            double want = exp(-0.5 * (px * px / 5 + py * py / 10)) / (2 * M_PI * sqrt(50));
            assert_compare(fabs(test_image_at(&image, x, y)[0] - 1), <, 2e-6);
            assert_compare(fabs(test_image_at(&image, x, y)[3] - want), <, 2e-6);
        }
    test_image_finish(&image);
    test_rays_finish(&rays);
}

/* A red layer and a blue layer, with a gap between them. */
static double two_layers(const void *user, double x, double y, double z) {
    (void)user, (void)x, (void)y;
    return z < 3 ? 1 : z >= 9 ? 2 : 0;
}

static void the_nearer_layer_hides_the_farther(void **state) {
    (void)state;
    struct test_scene s;
    test_view_init(&s.view);
    test_scene_points(
        &s,
        (const double[][5]){
            { 0, 1, 0, 0, 0 }, { 1, 1, 0, 0, 0.7 }, { 1.001, 0, 0, 1, 0.7 }, { 2, 0, 0, 1, 0.7 } },
        4);
    assert_true(test_scene_voxels(&s, "two", (uint32_t[]){ 24, 24, 12 }, (double[]){ 1, 1, 1 },
                                  SP_UINT8, two_layers, NULL));
    s.view.camera.projection = SP_ORTHOGRAPHIC;
    s.view.camera.height = 4;
    s.view.size[0] = s.view.size[1] = 4;
    struct test_truth_options o = { .samples = 1, .step = 0.05 };
    double through = pow(1 - (double)0.7F, 3);
    for (int side = -1; side <= 1; side += 2) {
        s.view.camera.position[2] = 100 * side;
        struct test_image image = integrate(&s, &o, 0);
        const double *p = test_image_at(&image, 2, 2);
        double near = side < 0 ? p[0] : p[2], far = side < 0 ? p[2] : p[0];
        assert_compare(fabs(near - (1 - through)), <, 1e-3);
        assert_compare(fabs(far - through * (1 - through)), <, 1e-3);
        assert_compare(fabs(p[3] - (1 - through * through)), <, 1e-3);
        test_image_finish(&image);
    }
    test_scene_finish(&s);
}

/* With half the step, nearly twice the rays and a wider kernel, the image stays the same to
 * CONVERGED dB. The test renders only the middle CROP × CROP pixels, to take only a few seconds. */
enum { CONVERGED = 90, CROP = 12 };

static void finer_integration_gives_the_same_image(void **state) {
    (void)state;
    static const struct {
        test_scene_fn *build;
        double lowpass;
    } cases[] = {
        { test_scene_thin_shells, 0 },  { test_scene_anisotropic, 0 },
        { test_scene_checkerboard, 1 }, { test_scene_oblique, 0 },
        { test_scene_phantom, 0 },      { test_scene_sheared, 1 },
        { test_scene_wide_kernel, 0 },
    };
    unsigned failed = 0;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct test_scene s;
        assert_true(cases[i].build(&s));
        struct sp_camera *camera = &s.view.camera;
        camera->fov_y = 360 / M_PI * atan(CROP * tan(camera->fov_y * M_PI / 360) / s.view.size[1]);
        s.view.size[0] = s.view.size[1] = CROP;
        unsigned n = cases[i].lowpass > 0 ? 3 : 1;
        struct test_truth_options defaults = { .samples = n };
        struct test_truth_options finer = { .samples = 2 * n - 1, .step = 0.2, .radius = 6 };
        struct test_image a = integrate(&s, &defaults, cases[i].lowpass);
        struct test_image b = integrate(&s, &finer, cases[i].lowpass);
        double psnr = test_image_psnr(&a, &b);
        print_message("  %-16s low-pass %g: default against finer step %.1f dB\n", s.info.name,
                      cases[i].lowpass, psnr);
        if (!(psnr > CONVERGED)) {
            test_image_dump(s.info.name, &a, &b, 100);
            failed++;
        }
        test_image_finish(&a);
        test_image_finish(&b);
        test_scene_finish(&s);
    }
    assert_int_equal(failed, 0);
}

static void psnr_matches_its_definition(void **state) {
    (void)state;
    struct test_image a, b;
    assert_true(test_image_init(&a, 7, 5));
    assert_true(test_image_init(&b, 7, 5));
    assert_true(isinf(test_image_psnr(&a, &b)));
    for (int i = 0; i < 7 * 5 * 4; i++)
        b.rgba[i] = 0.1;
    assert_compare(fabs(test_image_psnr(&a, &b) - 20), <, 1e-9);
    b.rgba[17] = -0.5;
    struct test_difference d = test_image_difference(&a, &b);
    assert_compare(d.largest, ==, 0.5);
    assert_compare(d.x, ==, 4);
    assert_compare(d.y, ==, 0);
    assert_compare(d.channel, ==, 1);
    assert_compare(d.b, ==, -0.5);
    b.rgba[3] = NAN;
    assert_true(isnan(test_image_psnr(&a, &b)));
    test_image_finish(&a);
    test_image_finish(&b);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(psnr_matches_its_definition),
        cmocka_unit_test(one_voxel_has_the_analytic_depth),
        cmocka_unit_test(constant_field_has_the_analytic_opacity),
        cmocka_unit_test(low_pass_is_a_unit_gaussian),
        cmocka_unit_test(the_nearer_layer_hides_the_farther),
        cmocka_unit_test(finer_integration_gives_the_same_image),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
