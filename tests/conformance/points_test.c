/* SPDX-License-Identifier: Apache-2.0
 *
 * Layers of points against the same samples on a grid: a lattice of points of a voxel's size and
 * volume gives the image of the grid, splat by splat, whatever the grid's spacing and direction.
 * That image is held to the integral by the other tests of this folder. Points at random, whose
 * kernels overlap in depth, are held to the integral here: each is composited on its own, or in
 * parts if the view composites slabs.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>

#include <cmocka.h>

#include "classify/transfer.h"
#include "support/compare.h"
#include "support/kernels.h"
#include "support/render.h"

/* The scenes, and the floor of the PSNR between images of points and of splats [dB], half a decibel
 * below the measured value. */
static const struct row {
    const char *name;
    test_scene_fn *make;
    double floor;
} rows[] = {
    { "blobs", test_scene_blobs, 74.9 },
    { "anisotropic", test_scene_anisotropic, 67.5 },
    { "sheared", test_scene_sheared, 73.5 },
    { "left handed", test_scene_left_handed, 71.2 },
    { "orthographic", test_scene_orthographic, 81.0 },
    { "rectilinear", test_scene_rectilinear_blobs, 79.1 },
    { "checkerboard", test_scene_checkerboard, 75.6 },
};
enum { ROWS = sizeof rows / sizeof rows[0] };

/* The lower triangular factor of σ²·A·Aᵀ. */
static void compute_factor(double a[3][3], double sigma, float out[6]) {
    double l[3][3] = { { 0 } };
    for (int r = 0; r < 3; r++)
        for (int c = 0; c <= r; c++) {
            double rest = 0;
            for (int k = 0; k < 3; k++)
                rest += sigma * sigma * a[r][k] * a[c][k];
            for (int k = 0; k < c; k++)
                rest -= l[r][k] * l[c][k];
            l[r][c] = r == c ? sqrt(rest) : rest / l[c][c];
            out[r * (r + 1) / 2 + c] = (float)l[r][c];
        }
}

static double spacing_at(const struct sp_grid *grid, unsigned a, uint32_t i) {
    const double *c = grid->coordinates[a];
    if (!c)
        return grid->spacing[a];
    uint32_t low = i > 0 ? i - 1 : 0, high = i + 1 < grid->dims[a] ? i + 1 : i;
    return (c[high] - c[low]) / (high - low);
}

static void fill_point(const struct sp_grid *grid, const uint32_t at[3], double sigma,
                       const struct sp_elements *to, uint32_t n) {
    double axes[3][3];
    for (unsigned a = 0; a < 3; a++) {
        double spacing = spacing_at(grid, a, at[a]);
        for (int r = 0; r < 3; r++)
            axes[r][a] = grid->direction[r][a] * spacing;
    }
    double det = axes[0][0] * (axes[1][1] * axes[2][2] - axes[1][2] * axes[2][1]) -
                 axes[0][1] * (axes[1][0] * axes[2][2] - axes[1][2] * axes[2][0]) +
                 axes[0][2] * (axes[1][0] * axes[2][1] - axes[1][1] * axes[2][0]);
    for (int r = 0; r < 3; r++) {
        double position = grid->origin[r];
        for (unsigned a = 0; a < 3; a++)
            position += grid->direction[r][a] * (grid->coordinates[a] ? grid->coordinates[a][at[a]]
                                                                      : grid->spacing[a] * at[a]);
        to->positions[n][r] = (float)position;
    }
    compute_factor(axes, sigma, to->factors[n]);
    to->volumes[n] = (float)fabs(det);
}

static double value_of(const struct sp_volume *volume, uint64_t n) {
    const void *v = sp_volume_voxels(volume);
    switch (sp_volume_info(volume)->type) {
    case SP_UINT8:
        return ((const uint8_t *)v)[n];
    case SP_INT8:
        return ((const int8_t *)v)[n];
    case SP_UINT16:
        return ((const uint16_t *)v)[n];
    case SP_INT16:
        return ((const int16_t *)v)[n];
    case SP_INT32:
        return ((const int32_t *)v)[n];
    case SP_FLOAT32:
        return (double)((const float *)v)[n];
    case SP_FLOAT64:
    case SP_TYPE_COUNT:
        break;
    }
    return ((const double *)v)[n];
}

static struct sp_volume *make_points(struct sp_volume *volume, double sigma) {
    const struct sp_grid *grid = &sp_volume_info(volume)->grid;
    const uint32_t count = grid->dims[0] * grid->dims[1] * grid->dims[2];
    struct sp_elements points = { .shape = { .kind = SP_KIND_POINTS, .count = count },
                                  .positions = calloc(count, 3 * sizeof(float)),
                                  .factors = calloc(count, 6 * sizeof(float)),
                                  .values = calloc(count, sizeof(float)),
                                  .volumes = calloc(count, sizeof(float)) };
    assert_true(points.positions && points.factors && points.values && points.volumes);
    for (uint32_t n = 0; n < count; n++) {
        const uint32_t at[3] = { n % grid->dims[0], n / grid->dims[0] % grid->dims[1],
                                 n / grid->dims[0] / grid->dims[1] };
        fill_point(grid, at, sigma, &points, n);
        points.values[n] = (float)value_of(volume, n);
    }
    struct sp_volume *made = sp_volume_create_elements(&points, "points", NULL);
    free(points.positions);
    free(points.factors);
    free(points.values);
    free(points.volumes);
    return made;
}

struct scene {
    struct test_scene scene;
    struct sp_volume *grid, *points;
    struct sp_view view; /* of the points */
};

static void open_scene(const struct row *row, struct scene *s) {
    assert_true(row->make(&s->scene));
    struct sp_view *view = &s->scene.view;
    view->shading.mode = SP_SHADING_NONE;
    view->filter.mode = SP_FILTER_EWA;
    view->compositing.mode = SP_COMPOSITE_SPLAT;
    s->grid = test_scene_volume(&s->scene, NULL);
    assert_non_null(s->grid);
    s->points = make_points(s->grid, view->filter.sigma);
    assert_non_null(s->points);
    s->view = *view;
    s->view.layers[0] = sp_layer_default(SP_LAYER_POINTS);
}

static int compare(const struct test_renderer *renderer, const struct test_target *target,
                   const struct row *row, const struct scene *s) {
    struct test_image wanted, got;
    struct sp_error err = { .code = SP_OK };
    if (!test_render(renderer, s->grid, &s->scene.view, &wanted, &err) ||
        !test_render(renderer, s->points, &s->view, &got, &err))
        fail_msg("%s: %s", row->name, err.text);
    double psnr = test_image_psnr(&got, &wanted);
    printf("%-14s %-8s %-8s %6.2f dB\n", row->name, target->backend, target->isa, psnr);
    if (!(psnr >= row->floor))
        test_image_dump(row->name, &got, &wanted, 10);
    test_image_finish(&wanted);
    test_image_finish(&got);
    return !(psnr >= row->floor);
}

static void points_are_splats(void **state) {
    struct scene scenes[ROWS] = { 0 };
    struct test_target target;
    int failed = 0;
    (void)state;
    for (int i = 0; i < ROWS; i++)
        open_scene(&rows[i], &scenes[i]);
    for (unsigned t = 0; test_target_at(t, &target); t++) {
        struct test_renderer renderer;
        if (!test_renderer_open(&renderer, &target, 2, NULL))
            continue;
        for (int i = 0; i < ROWS; i++)
            failed += compare(&renderer, &target, &rows[i], &scenes[i]);
        test_renderer_close(&renderer);
    }
    for (int i = 0; i < ROWS; i++) {
        sp_volume_unref(&scenes[i].grid);
        sp_volume_unref(&scenes[i].points);
        test_scene_finish(&scenes[i].scene);
    }
    assert_int_equal(failed, 0);
}

static struct test_kernel *make_kernels(const struct sp_volume *points, const struct sp_view *view,
                                        unsigned *count) {
    const struct sp_elements *e = sp_volume_elements(points);
    struct test_kernel *kernels = calloc(e->shape.count, sizeof *kernels);
    assert_non_null(kernels);
    *count = 0;
    for (uint32_t n = 0; n < e->shape.count; n++) {
        struct test_kernel *k = &kernels[*count];
        struct sp_class class;
        sp_transfer_function_eval(&view->transfer_function, (double)e->values[n], &class);
        *k = (struct test_kernel){ .mass = (double)class.depth * (double)e->volumes[n] /
                                           view->transfer_function.reference_length };
        for (int r = 0; r < 3; r++) {
            k->position[r] = (double)e->positions[n][r];
            k->color[r] = (double)class.color[r];
        }
        for (int i = 0; i < 6; i++)
            k->factor[i] = (double)e->factors[n][i];
        *count += k->mass > 0;
    }
    return kernels;
}

/* The eye among the points: those close to it are exact, and voxels of a grid are affine. Therefore
 * rays through the points are the reference. */
static void points_around_the_eye_are_exact(void **state) {
    const double floor = 65.1;
    const struct row row = { "inside", test_scene_inside, floor };
    struct scene s = { 0 };
    struct test_target target;
    struct test_image wanted;
    unsigned count;
    int failed = 0;
    (void)state;
    open_scene(&row, &s);
    struct test_kernel *kernels = make_kernels(s.points, &s.view, &count);
    const double h = (double)s.view.filter.lowpass;
    assert_true(test_kernels_render(kernels, count, &s.view, h * h, &wanted));
    test_image_over(&wanted, s.view.background);
    for (unsigned t = 0; test_target_at(t, &target); t++) {
        struct test_renderer renderer;
        struct test_image got;
        if (!test_renderer_open(&renderer, &target, 2, NULL))
            continue;
        assert_true(test_render(&renderer, s.points, &s.view, &got, NULL));
        const double psnr = test_image_psnr(&got, &wanted);
        printf("among %u points, %s %s: %.2f dB\n", count, target.backend, target.isa, psnr);
        if (!(psnr >= floor))
            test_image_dump(row.name, &got, &wanted, 10);
        failed += !(psnr >= floor);
        test_image_finish(&got);
        test_renderer_close(&renderer);
    }
    free(kernels);
    test_image_finish(&wanted);
    sp_volume_unref(&s.grid);
    sp_volume_unref(&s.points);
    test_scene_finish(&s.scene);
    assert_int_equal(failed, 0);
}

/* Points in a cube, as far apart as their kernels are wide. */
enum { RANDOM = 216, PIXELS = 32 };
static const double side = 9, deviation = 0.7, width = 11; /* of the cube, a kernel, the image */

struct cloud {
    struct sp_elements elements; /* of the arrays below */
    float positions[RANDOM][3], factors[RANDOM][6], values[RANDOM], volumes[RANDOM];
    struct sp_volume *volume;
    struct sp_view view;
};

static double random_in(unsigned *seed, double low, double high) {
    *seed = *seed * 1664525u + 1013904223u;
    return low + (high - low) * (*seed >> 8) / 16777216.0;
}

/* Their values are 0 or 1: two colours, of the same opacity over one kernel's deviation. */
static void open_cloud(struct cloud *c, double opacity) {
    unsigned seed = 3;
    *c = (struct cloud){ .elements = { .shape = { .kind = SP_KIND_POINTS, .count = RANDOM },
                                       .positions = c->positions,
                                       .factors = c->factors,
                                       .values = c->values,
                                       .volumes = c->volumes } };
    for (int i = 0; i < RANDOM; i++) {
        for (int a = 0; a < 3; a++) {
            c->positions[i][a] = (float)random_in(&seed, -side / 2, side / 2);
            c->factors[i][a * (a + 3) / 2] = (float)deviation;
        }
        c->values[i] = (float)(i % 2);
        c->volumes[i] = 3;
    }
    c->volume = sp_volume_create_elements(&c->elements, "random", NULL);
    assert_non_null(c->volume);
    test_view_init(&c->view);
    c->view.size[0] = c->view.size[1] = PIXELS;
    c->view.layers[0] = sp_layer_default(SP_LAYER_POINTS);
    c->view.filter.lowpass = 0;
    c->view.filter.cutoff = 4;
    c->view.camera.projection = SP_ORTHOGRAPHIC;
    c->view.camera.height = width;
    c->view.transfer_function.reference_length = deviation;
    c->view.transfer_function.point_count = 2;
    for (int i = 0; i < 2; i++)
        c->view.transfer_function.points[i] =
            (struct sp_tf_point){ i, { (float)i, 0.5f, 1 - (float)i }, (float)opacity };
}

/* The colour of a ray along z, in slabs of that thickness. The camera looks along +z with -y up. */
static void integrate(const struct cloud *c, double opacity, double x, double y, double thickness,
                      double rgba[4]) {
    const double extinction = -log1p(-opacity) / deviation, end = side / 2 + 5 * deviation;
    double through = 1, depths[RANDOM];
    for (int i = 0; i < RANDOM; i++) {
        const double dx = x - (double)c->positions[i][0], dy = y - (double)c->positions[i][1];
        depths[i] = 3 * extinction / (2 * M_PI * deviation * deviation) *
                    exp(-(dx * dx + dy * dy) / (2 * deviation * deviation));
    }
    for (double z = -end; z < end; z += thickness) {
        double sum = 0, colors[3] = { 0, 0, 0 };
        for (int i = 0; i < RANDOM; i++) {
            const double from = (z - (double)c->positions[i][2]) / (deviation * M_SQRT2);
            if (depths[i] < 1e-6 || from > 4 || from + thickness / deviation < -4)
                continue;
            const double part =
                0.5 * depths[i] * (erf(from + thickness / (deviation * M_SQRT2)) - erf(from));
            sum += part;
            colors[0] += part * (i % 2);
            colors[1] += part * 0.5;
            colors[2] += part * (1 - i % 2);
        }
        for (int k = 0; k < 3 && sum > 0; k++)
            rgba[k] += through * -expm1(-sum) * colors[k] / sum;
        through *= exp(-sum);
    }
    rgba[3] = 1 - through;
}

static void draw_integral(const struct cloud *c, double opacity, double thickness,
                          struct test_image *image) {
    const double pixel = width / PIXELS;
    assert_true(test_image_init(image, PIXELS, PIXELS));
    for (unsigned y = 0; y < PIXELS; y++)
        for (unsigned x = 0; x < PIXELS; x++)
            integrate(c, opacity, (x + 0.5 - PIXELS / 2.0) * pixel,
                      (y + 0.5 - PIXELS / 2.0) * pixel, thickness, test_image_at(image, x, y));
}

/* Opacity over a deviation; floors of points drawn as wholes, and in slabs of 1 and 1/3 of their
 * size [dB], half a decibel below the measured value. Slabs as thick as a deviation, whose sums are
 * exact, would have 87, 62 and 47 dB. */
static const struct {
    double opacity, floors[3];
} random_rows[] = { { 0.05, { 62.1, 78.4, 86.5 } },
                    { 0.3, { 36.1, 51.9, 65.4 } },
                    { 0.9, { 20.3, 33.8, 46.4 } } };
enum { RANDOM_ROWS = sizeof random_rows / sizeof *random_rows };

static void set_slabs(struct sp_view *view, int choice) {
    view->compositing.mode = choice ? SP_COMPOSITE_SLAB : SP_COMPOSITE_SHEET;
    view->compositing.slab = choice == 2 ? 1.0 / 3 : 1;
}

static int check_random(const struct test_renderer *renderer, const struct test_target *target,
                        int row, struct cloud *cloud, const struct test_image *exact) {
    int failed = 0;
    for (int choice = 0; choice < 3; choice++) {
        struct test_image image;
        struct sp_error err = { .code = SP_OK };
        set_slabs(&cloud->view, choice);
        if (!test_render(renderer, cloud->volume, &cloud->view, &image, &err))
            fail_msg("%s: %s", target->backend, err.text);
        const double psnr = test_image_psnr(&image, exact);
        const double floor = random_rows[row].floors[choice];
        printf("opacity %.2f, slabs %d  %-8s %-8s %6.2f dB\n", random_rows[row].opacity, choice,
               target->backend, target->isa, psnr);
        if (!(psnr >= floor))
            test_image_dump("random", &image, exact, 10);
        failed += !(psnr >= floor);
        test_image_finish(&image);
    }
    return failed;
}

static void points_at_random_are_close_to_the_integral(void **state) {
    static struct cloud clouds[RANDOM_ROWS];
    struct test_image exact[RANDOM_ROWS];
    struct test_target target;
    int failed = 0;
    (void)state;
    for (int i = 0; i < RANDOM_ROWS; i++) {
        open_cloud(&clouds[i], random_rows[i].opacity);
        draw_integral(&clouds[i], random_rows[i].opacity, deviation / 6, &exact[i]);
    }
    for (unsigned t = 0; test_target_at(t, &target); t++) {
        struct test_renderer renderer;
        if (!test_renderer_open(&renderer, &target, 2, NULL))
            continue;
        for (int i = 0; i < RANDOM_ROWS; i++)
            failed += check_random(&renderer, &target, i, &clouds[i], &exact[i]);
        test_renderer_close(&renderer);
    }
    for (int i = 0; i < RANDOM_ROWS; i++) {
        test_image_finish(&exact[i]);
        sp_volume_unref(&clouds[i].volume);
    }
    assert_int_equal(failed, 0);
}

/* A cube of many points whose values are random. Only the upper half of the values is visible. */
static struct sp_volume *make_noise(void) {
    enum { MANY = 110592 };
    const float gap = 1.0f / 48;
    unsigned seed = 5;
    struct sp_elements e = { .shape = { .kind = SP_KIND_POINTS, .count = MANY } };
    e.positions = calloc(MANY, sizeof *e.positions);
    e.factors = calloc(MANY, sizeof *e.factors);
    e.values = calloc(MANY, sizeof *e.values);
    e.volumes = calloc(MANY, sizeof *e.volumes);
    assert_true(e.positions && e.factors && e.values && e.volumes);
    for (int i = 0; i < MANY; i++) {
        for (int a = 0; a < 3; a++) {
            e.positions[i][a] = (float)random_in(&seed, -0.5, 0.5);
            e.factors[i][a * (a + 3) / 2] = (float)deviation * gap;
        }
        e.values[i] = (float)random_in(&seed, 0, 1);
        e.volumes[i] = gap * gap * gap;
    }
    struct sp_volume *volume = sp_volume_create_elements(&e, "noise", NULL);
    free(e.positions);
    free(e.factors);
    free(e.values);
    free(e.volumes);
    assert_non_null(volume);
    return volume;
}

static void see_noise(struct sp_view *view) {
    test_view_init(view);
    view->size[0] = view->size[1] = 96;
    view->layers[0] = sp_layer_default(SP_LAYER_POINTS);
    view->camera.projection = SP_ORTHOGRAPHIC;
    view->camera.height = 1;
    view->transfer_function.reference_length = 0.2;
    view->transfer_function.point_count = 3;
    for (int i = 0; i < 3; i++) {
        const float k = (float)i;
        view->transfer_function.points[i] =
            (struct sp_tf_point){ 0.5 * i, { k / 2, 0.5f, i == 1 }, i == 2 ? 0.9f : 0 };
    }
}

/* Level 0 has all points. The floors are half a decibel below the measured value. If merged points
 * had the colours of their mean values, levels 1 and 2 would have 11.5 and 6.5 dB. */
static int check_levels(const struct test_renderer *renderer, const struct test_target *target,
                        struct sp_volume *volume) {
    static const double floors[3] = { 0, 33.6, 27.4 };
    struct test_image images[3];
    struct sp_view view;
    struct sp_error err = { .code = SP_OK };
    int failed = 0;
    see_noise(&view);
    view.level_of_detail = SP_LOD_OFF;
    for (unsigned level = 0; level < 3; level++) {
        const struct sp_render_options options = { .format = SP_RGBAF32, .mip_level = level };
        struct sp_frame *frame =
            sp_renderer_render(renderer->renderer, volume, &view, renderer->pool, &options, &err);
        if (!frame || !test_image_from_frame(&images[level], frame))
            fail_msg("%s: %s", target->backend, err.text);
        sp_frame_unref(&frame);
        const double psnr = test_image_psnr(&images[level], &images[0]);
        printf("level %u  %-8s %-8s %6.2f dB\n", level, target->backend, target->isa, psnr);
        if (level && !(psnr >= floors[level]))
            test_image_dump("levels", &images[level], &images[0], 10);
        failed += level && !(psnr >= floors[level]);
    }
    for (int i = 0; i < 3; i++)
        test_image_finish(&images[i]);
    return failed;
}

static void levels_look_like_all_points(void **state) {
    struct sp_volume *volume = make_noise();
    struct test_target target;
    int failed = 0;
    (void)state;
    for (unsigned t = 0; test_target_at(t, &target); t++) {
        struct test_renderer renderer;
        if (!test_renderer_open(&renderer, &target, 2, NULL))
            continue;
        failed += check_levels(&renderer, &target, volume);
        test_renderer_close(&renderer);
    }
    sp_volume_unref(&volume);
    assert_int_equal(failed, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(points_are_splats),
        cmocka_unit_test(points_around_the_eye_are_exact),
        cmocka_unit_test(points_at_random_are_close_to_the_integral),
        cmocka_unit_test(levels_look_like_all_points),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
