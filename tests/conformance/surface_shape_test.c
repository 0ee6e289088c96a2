/* SPDX-License-Identifier: Apache-2.0
 *
 * Where surfaces lie and which way they face, at one voxel per four pixels; what changes while they
 * turn; and what flat kernels gain over kernels of the volume on a tilted plane (Zwicker et al.
 * 2001, figure 9).
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "support/compare.h"
#include "support/isosurface.h"
#include "support/render.h"
#include "support/sample.h"

static struct test_renderer renderer;

static void surface_view(struct test_scene *scene, double value) {
    struct sp_view *view = &scene->view;
    test_view_init(view);
    view->filter.mode = SP_FILTER_ADAPTIVE;
    view->layer_count = 1;
    view->layers[0] = (struct sp_layer){ .type = SP_LAYER_SURFACE,
                                         .visible = true,
                                         .value = value,
                                         .color = { 1, 1, 1 },
                                         .opacity = 1,
                                         .flatness = INFINITY };
}

/* Three lights of one colour each, so that a pixel's colour gives its normal. */
static void light_by_normal(struct sp_view *view) {
    static const double towards[3][3] = { { 0.6, 0, 0.8 },
                                          { -0.3, 0.52, 0.8 },
                                          { -0.3, -0.52, 0.8 } };
    view->shading =
        (struct sp_shading){ .mode = SP_SHADING_PHONG, .diffuse = 1, .exponent = 1, .reach = 0.2 };
    view->shading.light_count = 3;
    for (int l = 0; l < 3; l++) {
        struct sp_light *light = &view->shading.lights[l];
        *light = (struct sp_light){ .space = SP_LIGHT_CAMERA };
        memcpy(light->direction, towards[l], sizeof light->direction);
        light->color[l] = 1;
    }
}

static double sphere(const void *user, double x, double y, double z) {
    (void)user;
    return 128 + 20 * (11 - sqrt((x - 14.2) * (x - 14.2) + (y - 14.6) * (y - 14.6) +
                                 (z - 14.4) * (z - 14.4)));
}

static void make_sphere(struct test_scene *scene) {
    surface_view(scene, 128);
    assert_true(test_scene_voxels(scene, "sphere", (uint32_t[]){ 30, 30, 30 },
                                  (double[]){ 1, 1, 1 }, SP_FLOAT32, sphere, NULL));
}

/* Lies across the thick slices. */
static double torus(const void *user, double x, double y, double z) {
    (void)user;
    double ring = hypot(x - 20.3, y - 20.1) - 13, across = 3 * (z - 4.6);
    return 128 + 12 * (6.5 - hypot(ring, across));
}

static void make_torus(struct test_scene *scene) {
    surface_view(scene, 128);
    assert_true(test_scene_voxels(scene, "torus", (uint32_t[]){ 42, 42, 10 }, (double[]){ 1, 1, 3 },
                                  SP_FLOAT32, torus, NULL));
}

/* The largest distance between two silhouettes along the rows or columns that cross them steeply.
 */
static double compare_silhouettes(const struct test_image *a, const struct test_image *b,
                                  int *count) {
    const int step[2] = { 1, (int)a->width };
    double worst = 0;
    *count = 0;
    for (unsigned y = 2; y + 3 < a->height; y++)
        for (unsigned x = 2; x + 3 < a->width; x++)
            for (int axis = 0; axis < 2; axis++) {
                const double *p = b->rgba + ((size_t)y * b->width + x) * 4 + 3;
                double change = p[4 * step[axis]] - *p;
                double other = fabs(p[4 * step[!axis]] - p[-4 * step[!axis]]) / 2;
                if ((*p < 0.5) == (p[4 * step[axis]] < 0.5) || fabs(change) < 2 * other)
                    continue;
                double wanted = (0.5 - *p) / change, found = INFINITY;
                const double *q = a->rgba + ((size_t)y * a->width + x) * 4 + 3;
                for (int k = -2; k <= 2; k++) {
                    double from = q[4 * k * step[axis]], to = q[4 * (k + 1) * step[axis]];
                    if ((from < 0.5) == (to < 0.5))
                        continue;
                    double at = k + (0.5 - from) / (to - from);
                    if (fabs(at - wanted) < fabs(found - wanted))
                        found = at;
                }
                worst = fmax(worst, fabs(found - wanted));
                ++*count;
            }
    return worst;
}

/* Root of the mean square of the angle between normals [degrees], where the three lights reach the
 * surface and it covers the pixel. */
static double compare_normals(const struct test_scene *scene, const struct test_isosurface *iso,
                              const struct test_image *image) {
    double sum = 0, light[3][3];
    int count = 0;
    for (uint32_t l = 0; l < 3; l++)
        test_light_direction(&scene->view, l, light[l]);
    for (unsigned y = 0; y < image->height; y++)
        for (unsigned x = 0; x < image->width; x++) {
            struct test_iso_hit hit;
            double eye[3], ahead[3], length = 0, facing = 0, worst = 1, error = 0;
            const double *p = test_image_at(image, x, y);
            test_isosurface_ray(iso, x + 0.5, y + 0.5, eye, ahead);
            if (p[3] < 0.999 || !test_isosurface_hits(iso, eye, ahead, 0, 128, &hit, 1))
                continue;
            for (int r = 0; r < 3; r++)
                length += hit.normal[r] * hit.normal[r];
            for (int r = 0; r < 3; r++)
                facing += hit.normal[r] * ahead[r];
            for (int l = 0; l < 3; l++) { /* the gradient points away from the eye */
                double dot = 0;
                for (int r = 0; r < 3; r++)
                    dot -= light[l][r] * hit.normal[r] / sqrt(length) * (facing < 0 ? -1 : 1);
                worst = fmin(worst, dot);
                error += (p[l] / p[3] - dot) * (p[l] / p[3] - dot);
            }
            if (worst < 0.1)
                continue;
            /* The lights' directions are nearly orthogonal: Σ (l·Δ)² lies between 0.54 and 1.92
             * of |Δ|²; the mean is 1. */
            sum += error;
            count++;
        }
    assert_compare(count, >, 500);
    return sqrt(sum / count) * 180 / M_PI;
}

static void silhouettes_and_normals_are_exact(void **state) {
    (void)state;
    void (*const make[2])(struct test_scene *) = { make_sphere, make_torus };
    for (int i = 0; i < 2; i++)
        for (int parallel = 0; parallel < 2; parallel++) {
            struct test_scene scene = { 0 };
            struct test_isosurface iso;
            struct test_image got, wanted;
            const double height = i ? 46 : 30;
            const double cell = i ? cbrt(3) : 1;
            make[i](&scene);
            light_by_normal(&scene.view);
            scene.view.size[0] = scene.view.size[1] = (uint32_t)(4 * height / cell);
            test_scene_orbit(&scene, NULL, 20, i ? 50 : 30, 160);
            scene.view.camera.fov_y = 2 * atan(height / 2 / 160) * 180 / M_PI;
            scene.view.camera.height = height;
            scene.view.camera.projection = parallel ? SP_ORTHOGRAPHIC : SP_PERSPECTIVE;
            assert_true(test_render_scene(&renderer, &scene, &got, NULL));
            assert_true(test_isosurface_init(&iso, &scene));
            assert_true(test_isosurface_render(&iso, 2, 0.5, &wanted));
            int edges;
            double edge = compare_silhouettes(&got, &wanted, &edges);
            double angle = compare_normals(&scene, &iso, &got);
            printf("%s %s: silhouette within %.2f px (%d places), normals %.2f degrees rms\n",
                   scene.info.name, parallel ? "parallel" : "perspective", edge, edges, angle);
            if (!(edge < 0.5 && angle < 1))
                test_image_dump(scene.info.name, &got, &wanted, 4);
            assert_compare(edges, >, 100);
            assert_compare(edge, <, 0.5);
            assert_compare(angle, <, 1);
            test_isosurface_finish(&iso);
            test_image_finish(&got);
            test_image_finish(&wanted);
            test_scene_finish(&scene);
        }
}

/* Root of the mean square of a − 2·b + c. */
static double bend_of(const struct test_image frames[3]) {
    double sum = 0;
    size_t n = (size_t)frames[0].width * frames[0].height * 4;
    for (size_t i = 0; i < n; i++) {
        double d = frames[0].rgba[i] - 2 * frames[1].rgba[i] + frames[2].rgba[i];
        sum += d * d;
    }
    return sqrt(sum / (double)n);
}

/* Measures the changes from frame to frame that are not even: flicker would add to them. */
static void turning_does_not_flicker(void **state) {
    (void)state;
    double most = 0;
    for (int start = 0; start < 3; start++) {
        struct test_image got[3], wanted[3];
        for (int k = 0; k < 3; k++) {
            struct test_scene scene = { 0 };
            struct test_isosurface iso;
            make_torus(&scene);
            scene.view.shading.mode = SP_SHADING_PHONG;
            scene.view.size[0] = scene.view.size[1] = 48;
            test_scene_orbit(&scene, NULL, 20 + 31 * start + 0.7 * k, 40, 110);
            assert_true(test_render_scene(&renderer, &scene, &got[k], NULL));
            assert_true(test_isosurface_init(&iso, &scene));
            assert_true(test_isosurface_render(&iso, 4, 0.5, &wanted[k]));
            test_isosurface_finish(&iso);
            test_scene_finish(&scene);
        }
        double ratio = bend_of(got) / bend_of(wanted);
        printf("turning: uneven change %.4f, of the truth %.4f\n", bend_of(got), bend_of(wanted));
        most = fmax(most, ratio);
        for (int k = 0; k < 3; k++) {
            test_image_finish(&got[k]);
            test_image_finish(&wanted[k]);
        }
    }
    assert_compare(most, <, 1.5);
}

/* A thin plate with slots half of whose width is seen. */
static double plate(const void *user, double x, double y, double z) {
    (void)user, (void)x;
    double slot = fabs(fmod(y + 0.5, 6) - 3) - 1.5; /* negative in the slot */
    return 128 + 60 * fmin(0.6 - fabs(z - 3), slot);
}

/* Contrast of rows of a tilted plate: the largest less the smallest coverage over a period. */
static double contrast_at(double flatness, double height, unsigned rows, double *mean) {
    struct test_scene scene = { 0 };
    struct test_image image;
    double low = 1, high = 0;
    surface_view(&scene, 128);
    scene.view.shading.mode = SP_SHADING_NONE;
    scene.view.layers[0].flatness = flatness;
    assert_true(test_scene_voxels(&scene, "plate", (uint32_t[]){ 24, 240, 7 },
                                  (double[]){ 1, 1, 1 }, SP_FLOAT32, plate, NULL));
    scene.view.size[0] = 16;
    scene.view.size[1] = 160;
    /* Seen along z at 50°, tilted about x. */
    struct sp_camera *camera = &scene.view.camera;
    const double tilt = 50 * M_PI / 180;
    camera->projection = SP_ORTHOGRAPHIC;
    camera->height = height;
    for (int r = 0; r < 3; r++)
        camera->target[r] = camera->up[r] = camera->position[r] = 0;
    camera->position[1] = -300 * sin(tilt);
    camera->position[2] = -300 * cos(tilt);
    camera->up[1] = 1;
    assert_true(test_render_scene(&renderer, &scene, &image, NULL));
    *mean = 0;
    for (unsigned y = 80 - rows / 2; y < 80 + rows / 2; y++) {
        double alpha = test_image_at(&image, 8, y)[3];
        low = fmin(low, alpha);
        high = fmax(high, alpha);
        *mean += alpha / rows;
    }
    test_image_finish(&image);
    test_scene_finish(&scene);
    return high - low;
}

static void flat_kernels_are_sharper(void **state) {
    (void)state;
    double mean[3], disc = contrast_at(INFINITY, 100, 16, &mean[0]);
    double volume = contrast_at(1, 100, 16, &mean[1]);
    printf("tilted plate: contrast %.3f with discs, %.3f with kernels of the volume\n", disc,
           volume);
    assert_compare(disc, >, 1.05 * volume);
    /* Where a pixel is wider than a period, the pattern vanishes, and no other pattern appears. */
    double far = contrast_at(INFINITY, 1600, 8, &mean[2]);
    printf("far away: contrast %.3f, mean %.3f\n", far, mean[2]);
    assert_compare(far, <, 0.25 * disc);
    assert_compare(fabs(mean[2] - mean[0]), <, 0.1);
}

static int open_all(void **state) {
    (void)state;
    return !test_renderer_open(&renderer, &(struct test_target){ "cpu", "auto" }, 2, NULL);
}

static int close_all(void **state) {
    (void)state;
    test_renderer_close(&renderer);
    return 0;
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(silhouettes_and_normals_are_exact),
        cmocka_unit_test(turning_does_not_flicker),
        cmocka_unit_test(flat_kernels_are_sharper),
    };
    return cmocka_run_group_tests(tests, open_all, close_all);
}
