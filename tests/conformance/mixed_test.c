/* SPDX-License-Identifier: Apache-2.0
 *
 * Elements of another volume inside of a translucent one, against a closed form: fog before and
 * behind a Gaussian, a point and a triangle that fill the middle of the image. Frames of everything
 * against brute force (mixed.h). And the errors of layers that name a volume.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "conformance/mixed.h"
#include "support/compare.h"
#include "support/render.h"

enum { SIDE = 32, PIXELS = 64 };

static const double extinction = 0.05;
static const float fog_color[3] = { 0.2f, 0.4f, 0.8f }, own_color[3] = { 0.9f, 0.5f, 0.1f };

static double one(const void *user, double x, double y, double z) {
    (void)user, (void)x, (void)y, (void)z;
    return 1;
}

/* Fog of SIDE cells, seen along z, in front of black. */
static void make_fog(struct test_scene *scene) {
    struct sp_view *view = &scene->view;
    test_view_init(view);
    assert_true(test_scene_voxels(scene, "fog", (const uint32_t[]){ SIDE, SIDE, SIDE },
                                  (const double[]){ 1, 1, 1 }, SP_FLOAT32, one, NULL));
    view->size[0] = view->size[1] = PIXELS;
    for (int c = 0; c < 4; c++)
        view->background[c] = c == 3;
    view->transfer_function.reference_length = 1;
    view->transfer_function.point_count = 1;
    view->transfer_function.points[0] = (struct sp_tf_point){
        1, { fog_color[0], fog_color[1], fog_color[2] }, (float)-expm1(-extinction)
    };
    view->camera = (struct sp_camera){ .projection = SP_ORTHOGRAPHIC,
                                       .position = { 0, 0, -100 },
                                       .up = { 0, -1, 0 },
                                       .fov_y = 30,
                                       .height = SIDE,
                                       .near = 1 };
}

/* One element around the origin, wide and flat, of opacity 0.9 in its middle. */
static struct sp_volume *make_element(enum sp_kind kind) {
    float positions[3][3] = { { 0, 0, 0 } }, factors[1][6] = { { 8, 0, 8, 0, 0, 0 } };
    float values[1] = { 1 }, volumes[1], opacities[1] = { 0.9f }, harmonics[3];
    float normals[3][3] = { { 0 } }, colors[3][4];
    uint32_t triangles[1][3] = { { 0, 1, 2 } };
    struct sp_elements e = { .shape = { .kind = kind, .count = 1 },
                             .positions = positions,
                             .factors = factors,
                             .values = values,
                             .volumes = volumes,
                             .opacities = opacities,
                             .harmonics = harmonics,
                             .normals = normals,
                             .colors = colors,
                             .triangles = triangles };
    /* A point has the fog's extinction: its depth ln 10 is spread over 2π·8² with the cutoff's
     * share. */
    volumes[0] = (float)(log(10) / extinction * 2 * M_PI * 64 * -expm1(-4.5));
    for (int c = 0; c < 3; c++)
        harmonics[c] = (own_color[c] - 0.5f) / 0.28209479f;
    if (kind == SP_KIND_MESH) {
        e.shape.vertex_count = 3;
        for (int v = 0; v < 3; v++) {
            positions[v][0] = (float)(20 * cos(v * 2 * M_PI / 3));
            positions[v][1] = (float)(20 * sin(v * 2 * M_PI / 3));
            for (int c = 0; c < 4; c++)
                colors[v][c] = c == 3 ? 0.9f : own_color[c];
        }
    }
    struct sp_volume *volume = sp_volume_create_elements(&e, "element", NULL);
    assert_non_null(volume);
    return volume;
}

/* All targets that this machine has; the first one is the reference. They live through all tests,
 * because software GL takes seconds to compile shaders. */
enum { TARGETS_MAX = 12 };
static struct {
    struct test_target target;
    struct test_renderer renderer;
} opened[TARGETS_MAX];
static unsigned opened_count;

static int open_targets(void **state) {
    struct test_target target;
    struct sp_error err;
    (void)state;
    for (unsigned t = 0; test_target_at(t, &target) && opened_count < TARGETS_MAX; t++) {
        opened[opened_count].target = target;
        if (test_renderer_open(&opened[opened_count].renderer, &target, 2, &err))
            opened_count++;
        else
            printf("skipped: %s %s: %s\n", target.backend, target.isa, err.text);
    }
    return 0;
}

static int close_targets(void **state) {
    (void)state;
    while (opened_count)
        test_renderer_close(&opened[--opened_count].renderer);
    return 0;
}

static struct sp_volume *element; /* found under the id "element" */

static struct sp_volume *find_element(void *user, const char *id) {
    (void)user;
    return strcmp(id, "element") == 0 ? sp_volume_ref(element) : NULL;
}

static struct sp_frame *draw(const struct test_renderer *renderer, struct sp_volume *fog,
                             const struct sp_view *view, struct sp_error *err) {
    const struct sp_render_options options = { .format = SP_RGBAF32, .find = find_element };
    return sp_renderer_render(renderer->renderer, fog, view, renderer->pool, &options, err);
}

/* Fog of a thickness, then the element, then fog. A point has the colour of the fog. */
static void check_middle(const struct sp_frame *frame, const char *what, double front,
                         const float color[3]) {
    const float *pixel = (const float *)(const void *)frame->pixels +
                         4 * ((size_t)PIXELS / 2 * (frame->stride_bytes / 16) + PIXELS / 2);
    const double slab = 0.02; /* half a cell of fog */
    double before = exp(-extinction * front), behind = exp(-extinction * (SIDE - front));
    for (int c = 0; c < 3; c++) {
        double fog = (double)fog_color[c];
        double expected =
            (1 - before) * fog + before * (0.9 * (double)color[c] + 0.1 * (1 - behind) * fog);
        if (fabs((double)pixel[c] - expected) > slab)
            fail_msg("%s, channel %d: %.4f, expected %.4f", what, c, (double)pixel[c], expected);
    }
}

static void elements_lie_inside_the_fog(void **state) {
    static const struct {
        const char *name;
        enum sp_kind kind;
        enum sp_layer_type layer;
    } kinds[] = { { "points", SP_KIND_POINTS, SP_LAYER_POINTS },
                  { "gaussians", SP_KIND_GAUSSIANS, SP_LAYER_GAUSSIANS },
                  { "geometry", SP_KIND_MESH, SP_LAYER_GEOMETRY } };
    struct test_scene scene;
    (void)state;
    make_fog(&scene);
    struct sp_volume *fog = test_scene_volume(&scene, NULL);
    struct sp_view view = scene.view;
    view.layer_count = 2;
    for (unsigned t = 0; t < opened_count; t++)
        for (int k = 0; k < 3; k++) {
            struct sp_error err = { .code = SP_OK };
            element = make_element(kinds[k].kind);
            view.layers[1] = sp_layer_default(kinds[k].layer);
            strcpy(view.layers[1].id, "element");
            for (int place = -12; place <= 12; place += 12) {
                view.layers[1].transform[11] = place;
                struct sp_frame *frame = draw(&opened[t].renderer, fog, &view, &err);
                if (!frame)
                    fail_msg("%s, %s: %s", opened[t].target.backend, kinds[k].name, err.text);
                check_middle(frame, kinds[k].name, 0.5 * SIDE + place,
                             k == 0 ? fog_color : own_color);
                sp_frame_unref(&frame);
            }
            sp_volume_unref(&element);
        }
    sp_volume_unref(&fog);
    test_scene_finish(&scene);
}

static void draw_mixed(unsigned t, struct mixed_frame *f, struct test_image *image) {
    const struct sp_render_options options = { .format = SP_RGBAF32,
                                               .find = mixed_find,
                                               .user = f };
    const struct test_renderer *r = &opened[t].renderer;
    struct sp_error err = { .code = SP_OK };
    struct sp_frame *frame =
        sp_renderer_render(r->renderer, f->medium.volume, &f->medium.view, r->pool, &options, &err);
    if (!frame)
        fail_msg("%s %s: %s", opened[t].target.backend, opened[t].target.isa, err.text);
    assert_true(test_image_from_frame(image, frame));
    sp_frame_unref(&frame);
}

/* Layers in another order of the view give the same image. */
static void check_order(struct mixed_frame *f, const struct test_image *reference) {
    struct sp_view *view = &f->medium.view;
    struct test_image image;
    for (uint32_t i = 0; i < view->layer_count / 2; i++) {
        const struct sp_layer last = view->layers[view->layer_count - 1 - i];
        view->layers[view->layer_count - 1 - i] = view->layers[i];
        view->layers[i] = last;
    }
    draw_mixed(0, f, &image);
    const double psnr = test_image_psnr(reference, &image);
    printf("%-12s layers reversed %6.2f dB\n", "", psnr);
    assert_compare(psnr, >, 60);
    test_image_finish(&image);
}

static void everything_is_drawn_in_order_of_depth(void **state) {
    int failed = 0;
    (void)state;
    for (size_t i = 0; i < manifest_mixed_count; i++) {
        const struct manifest_mixed *row = &manifest_mixed[i];
        struct mixed_frame frame;
        struct test_image truth, reference;
        mixed_open(&frame, row);
        assert_true(mixed_truth(&frame, &truth));
        for (unsigned t = 0; t < opened_count; t++) {
            struct test_image image;
            draw_mixed(t, &frame, &image);
            if (t == 0)
                draw_mixed(0, &frame, &reference);
            const double psnr = test_image_psnr(&truth, &image);
            const double same = test_image_psnr(&reference, &image);
            printf("%-12s %-4s %-7s %6.2f dB, from scalar %6.2f dB\n", row->name,
                   opened[t].target.backend, opened[t].target.isa, psnr, same);
            if (!(psnr >= row->floor && same >= row->target_floor)) {
                test_image_dump(row->name, &image, &truth, 10);
                failed++;
            }
            test_image_finish(&image);
        }
        check_order(&frame, &reference);
        test_image_finish(&reference);
        test_image_finish(&truth);
        mixed_close(&frame);
    }
    assert_int_equal(failed, 0);
}

static void names_of_volumes_must_be_right(void **state) {
    const struct test_renderer *renderer = &opened[0].renderer;
    struct test_scene scene;
    struct sp_error err;
    (void)state;
    make_fog(&scene);
    struct sp_volume *fog = test_scene_volume(&scene, NULL);
    struct sp_view view = scene.view;
    element = make_element(SP_KIND_MESH);
    view.layer_count = 2;
    view.layers[1] = sp_layer_default(SP_LAYER_GAUSSIANS);
    assert_null(draw(renderer, fog, &view, &err)); /* the fog has none */
    assert_int_equal(err.code, SP_ERR_INVALID);
    assert_string_equal(err.place, "/layers/1/type");
    strcpy(view.layers[1].id, "nowhere");
    assert_null(draw(renderer, fog, &view, &err));
    assert_int_equal(err.code, SP_ERR_VOLUME_UNKNOWN);
    assert_string_equal(err.place, "/layers/1/id");
    strcpy(view.layers[1].id, "element");
    assert_null(draw(renderer, fog, &view, &err)); /* triangles */
    assert_int_equal(err.code, SP_ERR_INVALID);
    assert_string_equal(err.place, "/layers/1/id");
    view.layers[1].visible = false; /* what is hidden may be missing */
    struct sp_frame *frame = draw(renderer, fog, &view, &err);
    assert_non_null(frame);
    sp_frame_unref(&frame);
    sp_volume_unref(&element);
    sp_volume_unref(&fog);
    test_scene_finish(&scene);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(elements_lie_inside_the_fog),
        cmocka_unit_test(everything_is_drawn_in_order_of_depth),
        cmocka_unit_test(names_of_volumes_must_be_right),
    };
    return cmocka_run_group_tests(tests, open_targets, close_targets);
}
