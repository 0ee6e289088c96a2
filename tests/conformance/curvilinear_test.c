/* SPDX-License-Identifier: Apache-2.0
 *
 * Curvilinear grids, as points with the kernels of the grid (data/volume/curvilinear.h). A field
 * sampled on a warped grid gives the image of the same field on a regular grid. The opacity of a
 * ring of constant extinction follows from the length of the ray. The streaks of a curvilinear grid
 * follow their definition (support/streaks.h) and, places aside, equal the streaks of a regular
 * grid. A rectilinear grid has the same streaks as a curvilinear grid with the same nodes.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "data/volume/curvilinear.h"
#include "data/volume/grid.h"
#include "support/compare.h"
#include "support/render.h"
#include "support/streaks.h"

enum { SIDE = 48 };

/* Smooth blobs in [0, SIDE − 1]³, 0 at the border. */
static double field(const double p[3]) {
    static const double blobs[4][4] = {
        { 18, 20, 22, 6 }, { 30, 26, 20, 5 }, { 24, 30, 31, 5.5 }, { 27, 17, 28, 4.5 }
    };
    double sum = 0;
    for (int b = 0; b < 4; b++) {
        double square = 0;
        for (int a = 0; a < 3; a++)
            square += (p[a] - blobs[b][a]) * (p[a] - blobs[b][a]);
        sum += exp(-0.5 * square / (blobs[b][3] * blobs[b][3]));
    }
    return sum;
}

static double field_value(const void *user, double x, double y, double z) {
    (void)user;
    return field((const double[3]){ x, y, z });
}

/* Moves the inner nodes by up to `most` cells; nodes at the border stay on it. */
static void warp(const double i[3], double most, double p[3]) {
    const double turn = 2 * M_PI / (SIDE - 1);
    for (int a = 0; a < 3; a++) {
        double b = i[(a + 1) % 3], c = i[(a + 2) % 3];
        p[a] = i[a] + most * sin(turn * i[a]) * cos(turn * b) * sin(0.5 * turn * c);
    }
}

/* A vortex about the middle that rises; no vectors along its axis. */
static void vector_at(const double p[3], float v[3]) {
    const double x = p[0] - 0.5 * (SIDE - 1), y = p[1] - 0.5 * (SIDE - 1);
    const bool is_still = hypot(x, y) < 2;
    v[0] = is_still ? 0 : (float)-y;
    v[1] = is_still ? 0 : (float)x;
    v[2] = is_still ? 0 : 8;
}

static struct sp_elements allocate(uint32_t count) {
    struct sp_elements e = {
        .shape = { .kind = SP_KIND_POINTS, .count = count, .has_vectors = true },
        .positions = calloc(count, sizeof *e.positions),
        .factors = calloc(count, sizeof *e.factors),
        .values = calloc(count, sizeof *e.values),
        .volumes = calloc(count, sizeof *e.volumes),
        .vectors = calloc(count, sizeof *e.vectors)
    };
    assert_true(e.positions && e.factors && e.values && e.volumes && e.vectors);
    return e;
}

static void release(struct sp_elements *e) {
    free(e->positions);
    free(e->factors);
    free(e->values);
    free(e->volumes);
    free(e->vectors);
}

static struct sp_volume *finish(struct sp_elements *e, const uint32_t dims[3]) {
    assert_int_equal(sp_curvilinear_finish(e, 0, dims), 0);
    struct sp_volume *volume = sp_volume_create_elements(e, "curvilinear", NULL);
    assert_non_null(volume);
    release(e);
    return volume;
}

/* The field on a warped grid, whose middle is the origin. */
static struct sp_volume *make_warped(double most) {
    const uint32_t dims[3] = { SIDE, SIDE, SIDE };
    struct sp_elements e = allocate(SIDE * SIDE * SIDE);
    for (uint32_t n = 0; n < e.shape.count; n++) {
        const double i[3] = { n % SIDE, n / SIDE % SIDE, n / SIDE / SIDE };
        double p[3];
        warp(i, most, p);
        for (int a = 0; a < 3; a++)
            e.positions[n][a] = (float)(p[a] - 0.5 * (SIDE - 1));
        e.values[n] = (float)field(p);
        vector_at(p, e.vectors[n]);
    }
    return finish(&e, dims);
}

static void make_regular(struct test_scene *scene) {
    static const double points[][5] = { { 0.15, 0.9, 0.3, 0.2, 0 },
                                        { 0.5, 0.3, 0.8, 0.4, 0.05 },
                                        { 1.2, 0.4, 0.6, 1, 0.3 } };
    struct sp_view *view = &scene->view;
    test_view_init(view);
    view->size[0] = view->size[1] = 128;
    view->compositing.mode = SP_COMPOSITE_SPLAT;
    assert_true(test_scene_voxels(scene, "field", (const uint32_t[]){ SIDE, SIDE, SIDE },
                                  (const double[]){ 1, 1, 1 }, SP_FLOAT32, field_value, NULL));
    test_scene_orbit(scene, NULL, 35, 25, 110);
    test_scene_points(scene, points, 3);
}

static void for_each_renderer(void (*check)(const struct test_renderer *, const char *name)) {
    struct test_target target;
    for (unsigned t = 0; test_target_at(t, &target); t++) {
        struct test_renderer renderer;
        if (!test_renderer_open(&renderer, &target, 2, NULL))
            continue;
        check(&renderer, target.isa);
        test_renderer_close(&renderer);
    }
}

/* False if the backend draws no points. */
static bool draws(const struct test_renderer *renderer, const struct sp_view *view) {
    struct sp_error err = { .code = SP_OK };
    if (sp_renderer_supports(renderer->renderer, view, &err))
        return true;
    assert_int_equal(err.code, SP_ERR_UNSUPPORTED);
    return false;
}

/* How far nodes move [cells], and how close the images are [dB], half a decibel below the measured
 * value. Where cells are larger, the kernels blur the field more. */
static const struct { double most, floor; } warps[] = { { 0, 85.4 }, { 1, 62.8 }, { 3, 51.7 } };

static void check_warps(const struct test_renderer *renderer, const char *name) {
    struct test_scene scene;
    make_regular(&scene);
    struct sp_view view = scene.view;
    struct test_image wanted;
    assert_true(test_render_scene(renderer, &scene, &wanted, NULL));
    view.layers[0] = sp_layer_default(SP_LAYER_POINTS);
    for (size_t i = 0; i < sizeof warps / sizeof warps[0]; i++) {
        struct sp_volume *volume = make_warped(warps[i].most);
        struct test_image got;
        if (draws(renderer, &view)) {
            assert_true(test_render(renderer, volume, &view, &got, NULL));
            double psnr = test_image_psnr(&got, &wanted);
            printf("%-8s warped by %g cells: %.2f dB\n", name, warps[i].most, psnr);
            assert_compare(psnr, >=, warps[i].floor);
            test_image_finish(&got);
        }
        sp_volume_unref(&volume);
    }
    test_image_finish(&wanted);
    test_scene_finish(&scene);
}

/* Returns the regular volume with the same vectors, or with turned vectors, which lead away from
 * the axis. */
static struct sp_volume *add_vectors(const struct test_scene *regular, bool is_turned) {
    float(*vectors)[3] = calloc(SIDE * SIDE * SIDE, sizeof *vectors);
    assert_non_null(vectors);
    for (uint32_t n = 0; n < SIDE * SIDE * SIDE; n++) {
        float *v = vectors[n], x;
        vector_at((const double[3]){ n % SIDE, n / SIDE % SIDE, n / SIDE / SIDE }, v);
        x = v[0];
        v[0] = is_turned ? v[1] : x;
        v[1] = is_turned ? -x : v[1];
    }
    struct sp_volume *volume =
        sp_volume_create_vectors(&regular->info.grid, SP_FLOAT32, regular->voxels,
                                 (const float(*)[3])(const void *)vectors, "field", NULL);
    assert_non_null(volume);
    free(vectors);
    return volume;
}

/* The same for streaks. On a warped grid the streaks start at other places, so the images agree
 * less; with turned vectors they agree even less. The definition of streaks is checked below, on
 * all instruction sets. */
static const struct { double most, floor; } streak_warps[] = { { 0, 62.3 }, { 3, 32.8 } };

static double compare_streaks(const struct test_renderer *renderer, const struct sp_view *view,
                              struct sp_volume *a, struct sp_volume *b) {
    struct test_image images[2];
    assert_true(test_render(renderer, a, view, &images[0], NULL));
    assert_true(test_render(renderer, b, view, &images[1], NULL));
    const double psnr = test_image_psnr(&images[0], &images[1]);
    test_image_finish(&images[0]);
    test_image_finish(&images[1]);
    return psnr;
}

/* A view of streaks. */
static struct sp_view make_streaks(struct test_scene *scene) {
    make_regular(scene);
    struct sp_view view = scene->view;
    view.layers[0] = sp_layer_default(SP_LAYER_VECTORS);
    view.layers[0].density = 0.5;
    return view;
}

static void check_streaks(const struct test_renderer *renderer, const char *name) {
    struct test_scene scene;
    if (strcmp(name, "scalar") != 0 && strcmp(name, "auto") != 0)
        return;
    const struct sp_view view = make_streaks(&scene);
    struct sp_volume *regular = add_vectors(&scene, false), *turned = add_vectors(&scene, true);
    for (size_t i = 0; i < 2 && draws(renderer, &view); i++) {
        struct sp_volume *volume = make_warped(streak_warps[i].most);
        const double same = compare_streaks(renderer, &view, volume, regular);
        const double other = compare_streaks(renderer, &view, volume, turned);
        printf("%-8s streaks, warped by %g cells: %.2f dB; other vectors %.2f dB\n", name,
               streak_warps[i].most, same, other);
        assert_compare(same, >=, streak_warps[i].floor);
        assert_compare(other, <=, same - 1.5);
        sp_volume_unref(&volume);
    }
    sp_volume_unref(&regular);
    sp_volume_unref(&turned);
    test_scene_finish(&scene);
}

static void streaks_of_a_warped_grid_look_the_same(void **state) {
    (void)state;
    for_each_renderer(check_streaks);
}

/* Distances from the first sample that grow from one to the next, twelve times in all. */
static void grade(double length, uint32_t count, double *at) {
    for (uint32_t i = 0; i < count; i++)
        at[i] = length * expm1(log(12) * i / (count - 1)) / 11;
}

/* Returns the field at the nodes of a rectilinear grid: as a grid, or as points. */
static struct sp_volume *make_graded(const struct test_scene *regular, bool are_points) {
    const uint32_t dims[3] = { SIDE, SIDE, SIDE };
    double at[SIDE];
    struct sp_elements e = allocate(SIDE * SIDE * SIDE);
    struct sp_grid grid = regular->info.grid;
    grade(SIDE - 1, SIDE, at);
    for (int a = 0; a < 3; a++)
        grid.coordinates[a] = at;
    for (uint32_t n = 0; n < e.shape.count; n++) {
        const double p[3] = { at[n % SIDE], at[n / SIDE % SIDE], at[n / SIDE / SIDE] };
        for (int a = 0; a < 3; a++)
            e.positions[n][a] = (float)(p[a] - 0.5 * (SIDE - 1));
        e.values[n] = (float)field(p);
        vector_at(p, e.vectors[n]);
    }
    struct sp_volume *rectilinear = sp_volume_create_vectors(
        &grid, SP_FLOAT32, e.values, (const float(*)[3])(const void *)e.vectors, "field", NULL);
    struct sp_volume *points = finish(&e, dims);
    assert_non_null(rectilinear);
    sp_volume_unref(are_points ? &rectilinear : &points);
    return are_points ? points : rectilinear;
}

static void check_graded(const struct test_renderer *renderer, const char *name) {
    struct test_scene scene;
    if (strcmp(name, "scalar") != 0 && strcmp(name, "auto") != 0)
        return;
    const struct sp_view view = make_streaks(&scene);
    if (draws(renderer, &view)) {
        struct sp_volume *grid = make_graded(&scene, false), *points = make_graded(&scene, true);
        const double psnr = compare_streaks(renderer, &view, points, grid);
        printf("%-8s streaks of a rectilinear grid: %.2f dB\n", name, psnr);
        assert_compare(psnr, >=, 59.7); /* half a decibel below the measured value */
        sp_volume_unref(&grid);
        sp_volume_unref(&points);
    }
    test_scene_finish(&scene);
}

static void streaks_of_a_rectilinear_grid_look_the_same(void **state) {
    (void)state;
    for_each_renderer(check_graded);
}

/* A stretched polar grid of one value: cells of many shapes, and of all directions. */
static struct sp_volume *make_fan(void) {
    enum { RADII = 14, ANGLES = 16, HEIGHTS = 9 };
    const uint32_t dims[3] = { RADII, ANGLES, HEIGHTS };
    struct sp_elements e = allocate(RADII * ANGLES * HEIGHTS);
    for (uint32_t n = 0; n < e.shape.count; n++) {
        const double height = n / (RADII * ANGLES), i = n % RADII;
        const double radius = 4 + 0.5 * i + 0.08 * i * i, angle = 0.25 * (n / RADII % ANGLES);
        const double p[3] = { radius * cos(angle), radius * sin(angle),
                              1.5 * height - 6 + 0.2 * radius };
        for (int a = 0; a < 3; a++)
            e.positions[n][a] = (float)p[a];
        e.values[n] = 1;
        e.vectors[n][0] = n % 19 ? (float)-p[1] : 0;
        e.vectors[n][1] = n % 19 ? (float)(p[0] + 2) : 0;
        e.vectors[n][2] = n % 19 ? (float)p[2] : 0;
    }
    return finish(&e, dims);
}

/* A turned rectilinear grid of one value. */
static struct sp_volume *make_box(void) {
    enum { NX = 14, NY = 16, NZ = 9 };
    double x[NX], y[NY], z[NZ];
    const double c = cos(0.5), s = sin(0.5);
    struct sp_elements e = allocate(NX * NY * NZ);
    grade(20, NX, x);
    grade(18, NY, y);
    grade(14, NZ, z);
    const struct sp_grid grid = { .dims = { NX, NY, NZ },
                                  .spacing = { 20.0 / (NX - 1), 18.0 / (NY - 1), 14.0 / (NZ - 1) },
                                  .origin = { -4, -12, -6 },
                                  .direction = { { c, -s, 0 }, { s, c, 0 }, { 0, 0, 1 } },
                                  .coordinates = { x, y, z } };
    for (uint32_t n = 0; n < e.shape.count; n++) {
        const double p[3] = { x[n % NX], y[n / NX % NY], z[n / (NX * NY)] };
        e.values[n] = 1;
        e.vectors[n][0] = n % 19 ? (float)(8 - p[1]) : 0;
        e.vectors[n][1] = n % 19 ? (float)(p[0] - 9) : 0;
        e.vectors[n][2] = n % 19 ? (float)(p[2] - 5) : 0;
    }
    struct sp_volume *volume = sp_volume_create_vectors(
        &grid, SP_FLOAT32, e.values, (const float(*)[3])(const void *)e.vectors, "box", NULL);
    release(&e);
    assert_non_null(volume);
    return volume;
}

static const float fan_color[3] = { 0.3f, 0.8f, 0.5f };
static const double fan_extinction = 0.12;

static void make_fan_view(struct sp_view *view, int n) {
    test_view_init(view);
    view->size[0] = view->size[1] = 80;
    view->camera.position[0] = 12;
    view->camera.position[2] = -45;
    view->camera.projection = n & 1 ? SP_ORTHOGRAPHIC : SP_PERSPECTIVE;
    view->camera.height = 26;
    view->transfer_function.point_count = 1;
    view->transfer_function.points[0] = (struct sp_tf_point){
        1, { fan_color[0], fan_color[1], fan_color[2] }, (float)-expm1(-fan_extinction)
    };
    view->layers[0] = sp_layer_default(SP_LAYER_VECTORS);
    view->layers[0].style = n & 1 ? SP_VECTORS_BLEND : SP_VECTORS_MODULATE;
    view->layers[0].stretch = 2.5;
    view->layers[0].density = 0.8;
    view->layers[0].phase = 0.3;
}

/* Draws the streaks by their definition. */
static void draw_truth(const struct sp_volume *volume, const struct sp_view *view,
                       struct test_image *image) {
    struct test_streaks *streaks =
        test_streaks_create(volume, view, &view->layers[0], fan_extinction, fan_color);
    assert_non_null(streaks);
    struct test_hit *hits = calloc(test_streaks_count(streaks), sizeof *hits);
    assert_true(hits && test_image_init(image, view->size[0], view->size[1]));
    for (unsigned y = 0; y < image->height; y++)
        for (unsigned x = 0; x < image->width; x++) {
            double *rgba = test_image_at(image, x, y);
            const unsigned count = test_streaks_hits(streaks, x + 0.5, y + 0.5, hits);
            for (unsigned i = 0; i < count; i++) {
                const double part = (1 - rgba[3]) * hits[i].alpha;
                for (int c = 0; c < 3; c++)
                    rgba[c] += part * hits[i].color[c];
                rgba[3] += part;
            }
        }
    free(hits);
    test_streaks_destroy(&streaks);
}

/* By style, of the fan and of the box; half a decibel below the measured value. */
static const double truth_floors[2][2] = { { 96.7, 101.7 }, { 69.8, 73 } };

static void check_truth_of(const struct test_renderer *renderer, const char *name, bool is_box) {
    struct sp_volume *volume = is_box ? make_box() : make_fan();
    for (int n = 0; n < 2; n++) {
        struct test_image got, wanted;
        struct sp_view view;
        make_fan_view(&view, n);
        if (!draws(renderer, &view))
            continue;
        draw_truth(volume, &view, &wanted);
        assert_true(test_render(renderer, volume, &view, &got, NULL));
        const double psnr = test_image_psnr(&got, &wanted);
        printf("%-8s streaks of the %s, choice %d: %.2f dB\n", name, is_box ? "box" : "fan", n,
               psnr);
        if (psnr < truth_floors[is_box][n])
            test_image_dump("curvilinear-streaks", &got, &wanted, 10);
        assert_compare(psnr, >=, truth_floors[is_box][n]);
        test_image_finish(&got);
        test_image_finish(&wanted);
    }
    sp_volume_unref(&volume);
}

static void check_truth(const struct test_renderer *renderer, const char *name) {
    check_truth_of(renderer, name, false);
    check_truth_of(renderer, name, true);
}

static void streaks_are_those_of_their_definition(void **state) {
    (void)state;
    for_each_renderer(check_truth);
}

static void a_warped_grid_shows_the_same_field(void **state) {
    (void)state;
    for_each_renderer(check_warps);
}

/* A ring of height 20 between the radii 20 and 60 that one value fills. */
static struct sp_volume *make_ring(void) {
    enum { RADII = 40, ANGLES = 180, HEIGHTS = 20 };
    const uint32_t dims[3] = { RADII, ANGLES, HEIGHTS };
    struct sp_elements e = allocate(RADII * ANGLES * HEIGHTS);
    for (uint32_t n = 0; n < e.shape.count; n++) {
        double radius = 20.5 + n % RADII, angle = 2 * M_PI * (n / RADII % ANGLES) / (ANGLES - 1);
        e.positions[n][0] = (float)(radius * cos(angle));
        e.positions[n][1] = (float)(radius * sin(angle));
        e.positions[n][2] = (float)(n / (RADII * ANGLES)) - 9.5f;
        e.values[n] = 1;
    }
    return finish(&e, dims);
}

/* Looks along the axis of the ring: rays between the radii pass through 20 of it. */
static void check_ring(const struct test_renderer *renderer, const char *name) {
    struct sp_volume *volume = make_ring();
    struct test_image image;
    struct sp_view view;
    test_view_init(&view);
    view.size[0] = view.size[1] = 128;
    view.layers[0] = sp_layer_default(SP_LAYER_POINTS);
    view.transfer_function.reference_length = 10;
    view.transfer_function.point_count = 1;
    view.transfer_function.points[0] = (struct sp_tf_point){ 1, { 1, 1, 1 }, 0.5f };
    view.camera = (struct sp_camera){ .projection = SP_ORTHOGRAPHIC,
                                      .position = { 0, 0, -100 },
                                      .up = { 0, -1, 0 },
                                      .fov_y = 30,
                                      .height = 128,
                                      .near = 1 };
    const double expected = 1 - 0.5 * 0.5; /* twice the reference length */
    double least = 1, most = 0;
    if (draws(renderer, &view)) {
        assert_true(test_render(renderer, volume, &view, &image, NULL));
        for (unsigned y = 0; y < 128; y++)
            for (unsigned x = 0; x < 128; x++) {
                double radius = hypot(x - 63.5, y - 63.5), alpha = test_image_at(&image, x, y)[3];
                if (radius < 24 || radius > 56) /* the kernels of the borders are smooth */
                    continue;
                least = fmin(least, alpha);
                most = fmax(most, alpha);
            }
        printf("%-8s opacity %.4f to %.4f, expected %.4f\n", name, least, most, expected);
        assert_compare(least, >=, 0.98 * expected);
        assert_compare(most, <=, 1.02 * expected);
        test_image_finish(&image);
    }
    sp_volume_unref(&volume);
}

static void a_ring_has_the_opacity_of_its_height(void **state) {
    (void)state;
    for_each_renderer(check_ring);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_warped_grid_shows_the_same_field),
        cmocka_unit_test(a_ring_has_the_opacity_of_its_height),
        cmocka_unit_test(streaks_of_a_warped_grid_look_the_same),
        cmocka_unit_test(streaks_of_a_rectilinear_grid_look_the_same),
        cmocka_unit_test(streaks_are_those_of_their_definition),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
