/* SPDX-License-Identifier: Apache-2.0
 *
 * Channels: the volume and other volumes on its grid, mixed (draw/resample/README.md). Every
 * instruction set against the integral through both fields by brute force; what a mixture must not
 * depend on.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "support/compare.h"
#include "support/interpolant.h"
#include "support/interpolated.h"
#include "support/render.h"
#include "support/sample.h"

enum { FIELDS = 3, STEPS = 12 };

static const char *const ids[FIELDS] = { "one", "two", "three" };

struct rig {
    struct test_scene scenes[FIELDS]; /* on one grid, of several types */
    struct sp_volume *volumes[FIELDS];
    struct sp_volume *elsewhere; /* on another grid */
};

static double field(const void *user, double x, double y, double z) {
    static const double centres[FIELDS][3] = { { 12, 16, 14 }, { 20, 15, 16 }, { 15, 20, 18 } };
    const int i = *(const int *)user;
    const double *c = centres[i];
    const double dx = x - c[0], dy = y - c[1], dz = z - c[2];
    return 200 * exp(-(dx * dx + dy * dy + dz * dz) / (60 + 20 * i));
}

static struct sp_volume *find_volume(void *user, const char *id) {
    const struct rig *rig = user;
    for (int i = 0; i < FIELDS; i++)
        if (strcmp(id, ids[i]) == 0)
            return sp_volume_ref(rig->volumes[i]);
    return strcmp(id, "elsewhere") == 0 ? sp_volume_ref(rig->elsewhere) : NULL;
}

static int setup(void **state) {
    static struct rig rig;
    static const enum sp_type types[FIELDS] = { SP_UINT8, SP_UINT16, SP_FLOAT32 };
    const uint32_t dims[3] = { 32, 34, 30 };
    const double spacing[3] = { 1, 0.9, 1.2 }, turn[3] = { 20, 35, 50 };
    struct sp_error err;
    for (int i = 0; i < FIELDS; i++) {
        struct test_scene *scene = &rig.scenes[i];
        test_view_init(&scene->view);
        assert_true(test_scene_voxels(scene, ids[i], dims, spacing, types[i], field, &i));
        test_scene_direction(scene, turn, 1, 0);
        if (!(rig.volumes[i] = test_scene_volume(scene, &err)))
            fail_msg("%s", err.text);
    }
    struct sp_volume_info other = rig.scenes[0].info;
    other.grid.origin[1] += 0.5;
    if (!(rig.elsewhere =
              sp_volume_create(&other.grid, other.type, rig.scenes[0].voxels, "elsewhere", &err)))
        fail_msg("%s", err.text);
    *state = &rig;
    return 0;
}

static int teardown(void **state) {
    struct rig *rig = *state;
    for (int i = 0; i < FIELDS; i++) {
        sp_volume_unref(&rig->volumes[i]);
        test_scene_finish(&rig->scenes[i]);
    }
    sp_volume_unref(&rig->elsewhere);
    return 0;
}

static const struct sp_tf_point colors[FIELDS][2] = {
    { { 20, { 1, 0.2f, 0.1f }, 0 }, { 180, { 1, 0.2f, 0.1f }, 0.3f } },
    { { 30, { 0.1f, 1, 0.2f }, 0 }, { 190, { 0.2f, 0.9f, 0.3f }, 0.4f } },
    { { 25, { 0.1f, 0.2f, 1 }, 0 }, { 150, { 0.3f, 0.2f, 1 }, 0.2f } },
};

static struct sp_layer *add_channel(struct sp_view *view, int i) {
    struct sp_layer *layer = &view->layers[view->layer_count++];
    *layer = sp_layer_default(SP_LAYER_CHANNEL);
    snprintf(layer->id, sizeof layer->id, "%s", ids[i]);
    layer->point_count = 2;
    memcpy(layer->points, colors[i], sizeof colors[i]);
    return layer;
}

/* Shows the fields from `first` on, in turn: the first one as the volume, the others as channels.
 */
static void make_view(struct rig *rig, int first, int count, struct sp_view *view) {
    struct test_scene *scene = &rig->scenes[first % FIELDS];
    struct sp_transfer_function *tf = &scene->view.transfer_function;
    test_view_init(&scene->view);
    test_scene_orbit(scene, NULL, 30, 20, 75);
    tf->point_count = 2;
    memcpy(tf->points, colors[first % FIELDS], sizeof colors[0]);
    *view = scene->view;
    view->level_of_detail = SP_LOD_OFF; /* a pixel shows the ray through its centre */
    view->filter.mode = SP_FILTER_ADAPTIVE;
    view->transfer_function.order = SP_TF_AUTO;
    view->compositing.mode = SP_COMPOSITE_SHEET;
    for (int i = 1; i < count; i++)
        add_channel(view, (first + i) % FIELDS);
}

static bool draw_by(const struct test_renderer *renderer, const struct rig *rig, int volume,
                    const struct sp_view *view, struct test_image *image, struct sp_error *err) {
    const struct sp_render_options options = { .format = SP_RGBAF32,
                                               .find = find_volume,
                                               .user = (void *)rig };
    struct sp_frame *frame = sp_renderer_render(renderer->renderer, rig->volumes[volume], view,
                                                renderer->pool, &options, err);
    if (!frame)
        return false;
    assert_true(test_image_from_frame(image, frame));
    sp_frame_unref(&frame);
    return true;
}

static void draw(const struct test_renderer *renderer, const struct rig *rig, int volume,
                 const struct sp_view *view, struct test_image *image) {
    struct sp_error err;
    if (!draw_by(renderer, rig, volume, view, image, &err))
        fail_msg("%s: %s", err.place, err.text);
}

/* The ground truth: extinctions add up, and colours add up as light does: the mixture has the hue
 * of their sum by extinction and their mean brightness. */
struct marcher {
    const struct sp_view *view;
    int count;
    struct test_interpolant fields[FIELDS];
    struct sp_transfer_function functions[FIELDS];
};

static double largest(const double color[3]) {
    return fmax(fmax(color[0], color[1]), color[2]);
}

/* Adds a field's extinction, and its colour and brightness times extinction. False where nothing is
 * kept. */
static bool add_field(const struct marcher *m, int i, const double world[3], const double ahead[3],
                      double sums[5]) {
    double index[3], gradient[3] = { 0 }, color[3], opacity;
    if (!test_interpolant_to_index(&m->fields[i], world, index))
        return false;
    if (test_needs_gradient(m->view))
        test_interpolant_gradient(&m->fields[i], index, gradient);
    test_classify(&m->functions[i], test_interpolant_value(&m->fields[i], index), 0, color,
                  &opacity);
    const double extinction = -log(1 - opacity) / m->view->transfer_function.reference_length;
    test_shade(m->view, ahead, gradient, color);
    for (int c = 0; c < 3; c++)
        sums[c] += extinction * color[c];
    sums[3] += extinction;
    sums[4] += extinction * largest(color);
    return true;
}

static void march(void *user, const double eye[3], const double ahead[3], double from, double to,
                  double step, double *rgba) {
    const struct marcher *m = user;
    double light = 1;
    memset(rgba, 0, 4 * sizeof *rgba);
    for (double l = from + step / 2; l < to && light > 1e-6; l += step) {
        double world[3], sums[5] = { 0 };
        for (int r = 0; r < 3; r++)
            world[r] = eye[r] + l * ahead[r];
        for (int i = 0; i < m->count; i++)
            add_field(m, i, world, ahead, sums);
        if (!(sums[3] > 0))
            continue;
        const double alpha = 1 - exp(-sums[3] * step);
        for (int c = 0; c < 3; c++)
            rgba[c] += light * alpha * sums[c] / fmax(largest(sums), 1e-30) * sums[4] / sums[3];
        light *= 1 - alpha;
    }
    rgba[3] = 1 - light;
}

/* Renders the fields from number 0 on by brute force. */
static void render_truth(struct rig *rig, const struct sp_view *view, struct test_image *image) {
    struct marcher m = { .view = view, .count = (int)view->layer_count };
    for (int i = 0; i < m.count; i++) {
        rig->scenes[i].view.clip = view->clip;
        m.functions[i] = view->transfer_function;
        if (i > 0)
            sp_channel_function(view, &view->layers[i], NULL, &m.functions[i]);
        assert_true(test_interpolant_init(&m.fields[i], &rig->scenes[i]));
    }
    struct test_scene scene = rig->scenes[0];
    scene.view = *view;
    assert_true(test_each_ray(&scene, STEPS, march, &m, image));
    for (int i = 0; i < m.count; i++)
        test_interpolant_finish(&m.fields[i]);
}

static void plain(struct sp_view *view) {
    (void)view;
}

static void lit(struct sp_view *view) {
    view->shading.mode = SP_SHADING_PHONG;
}

static void slabs(struct sp_view *view) {
    view->compositing.mode = SP_COMPOSITE_SLAB;
}

static void clipped(struct sp_view *view) {
    view->clip.box[0][0] = 0.45;
    view->clip.plane_count = 1;
    view->clip.planes[0] = (struct sp_clip_plane){ { 0.3, 1, 0.2 }, -2 };
}

static void steep(struct sp_view *view) {
    view->camera.fov_y = 70;
    for (int a = 0; a < 3; a++)
        view->camera.position[a] *= 0.34;
}

static const struct {
    const char *name;
    void (*change)(struct sp_view *view);
    double floor; /* dB, half a decibel below the measured value */
} rows[] = {      /* additive colours are brighter than their mean: larger errors */
             { "plain", plain, 66.3 },
             { "lit", lit, 53.5 },
             { "slabs", slabs, 70.4 },
             { "clipped", clipped, 68.0 },
             { "steep", steep, 63.4 }
};

enum { ROWS = sizeof rows / sizeof *rows };

/* Returns the PSNR of each row against its truth. */
static void check_rows(const struct test_renderer *renderer, struct rig *rig, const char *isa,
                       const struct test_image *truths) {
    for (int i = 0; i < ROWS; i++) {
        struct test_image image;
        struct sp_view view;
        make_view(rig, 0, FIELDS, &view);
        rows[i].change(&view);
        draw(renderer, rig, 0, &view, &image);
        const double psnr = test_image_psnr(&image, &truths[i]);
        printf("%-8s %-8s %.1f dB\n", isa, rows[i].name, psnr);
        if (!(psnr >= rows[i].floor))
            test_image_dump(rows[i].name, &image, &truths[i], 10);
        assert_compare(psnr, >=, rows[i].floor);
        test_image_finish(&image);
    }
}

static void a_mixture_is_the_integral(void **state) {
    struct rig *rig = *state;
    struct test_image truths[ROWS];
    struct test_target target;
    for (int i = 0; i < ROWS; i++) {
        struct sp_view view;
        make_view(rig, 0, FIELDS, &view);
        rows[i].change(&view);
        render_truth(rig, &view, &truths[i]);
    }
    for (unsigned t = 0; test_target_at(t, &target) && strcmp(target.backend, "cpu") == 0; t++) {
        struct test_renderer renderer;
        if (!test_renderer_open(&renderer, &target, t % 2 + 1, NULL))
            continue;
        check_rows(&renderer, rig, target.isa, truths);
        test_renderer_close(&renderer);
    }
    for (int i = 0; i < ROWS; i++)
        test_image_finish(&truths[i]);
}

static void open_best(struct test_renderer *renderer) {
    const struct test_target best = { "cpu", "auto" };
    struct sp_error err;
    if (!test_renderer_open(renderer, &best, 2, &err))
        fail_msg("%s", err.text);
}

static double compare(const struct test_renderer *renderer, const struct rig *rig, int first,
                      const struct sp_view *one, int second, const struct sp_view *other) {
    struct test_image images[2];
    draw(renderer, rig, first, one, &images[0]);
    draw(renderer, rig, second, other, &images[1]);
    const double psnr = test_image_psnr(&images[0], &images[1]);
    for (int i = 0; i < 2; i++)
        test_image_finish(&images[i]);
    return psnr;
}

static void the_order_has_no_influence(void **state) {
    struct rig *rig = *state;
    struct test_renderer renderer;
    struct sp_view one, other;
    open_best(&renderer);
    make_view(rig, 0, FIELDS, &one);
    make_view(rig, 1, FIELDS, &other);
    assert_compare(compare(&renderer, rig, 0, &one, 1, &other), >=, 100);
    test_renderer_close(&renderer);
}

/* A volume beside itself is as if it had twice the extinction. A surface lies in both. */
static void the_same_volume_twice_is_twice_as_dense(void **state) {
    struct rig *rig = *state;
    struct test_renderer renderer;
    struct sp_view twice, dense;
    open_best(&renderer);
    make_view(rig, 0, 1, &twice);
    add_channel(&twice, 0);
    make_view(rig, 0, 1, &dense);
    dense.transfer_function.reference_length /= 2;
    for (int i = 0; i < 2; i++) {
        struct sp_view *view = i ? &dense : &twice;
        struct sp_layer *surface = &view->layers[view->layer_count++];
        *surface = sp_layer_default(SP_LAYER_SURFACE);
        surface->value = 120;
        surface->opacity = 0.5f;
    }
    assert_compare(compare(&renderer, rig, 0, &twice, 0, &dense), >=, 100);
    test_renderer_close(&renderer);
}

static void what_is_hidden_or_transparent_changes_nothing(void **state) {
    struct rig *rig = *state;
    struct test_renderer renderer;
    struct sp_view alone, view;
    open_best(&renderer);
    make_view(rig, 0, 1, &alone);
    make_view(rig, 0, 2, &view);
    view.layers[1].visible = false;
    assert_true(isinf(compare(&renderer, rig, 0, &alone, 0, &view)));
    view.layers[1].visible = true;
    for (int i = 0; i < 2; i++)
        view.layers[1].points[i].opacity = 0;
    assert_compare(compare(&renderer, rig, 0, &alone, 0, &view), >=, 120);
    /* The volume is hidden, and the channel is what the other volume is alone. */
    make_view(rig, 1, 1, &alone);
    make_view(rig, 0, 2, &view);
    view.layers[0].visible = false;
    assert_true(isinf(compare(&renderer, rig, 1, &alone, 0, &view)));
    test_renderer_close(&renderer);
}

/* Two pure colours in one place give their sum, as light does, and not a grey of half brightness.
 */
static void red_and_green_give_yellow(void **state) {
    struct rig *rig = *state;
    struct test_renderer renderer;
    struct test_image image;
    struct sp_view view;
    float brightest[3] = { 0 };
    open_best(&renderer);
    make_view(rig, 0, 1, &view);
    struct sp_layer *layer = add_channel(&view, 0);
    for (int p = 0; p < 2; p++) {
        memcpy(view.transfer_function.points[p].color, (float[3]){ 1, 0, 0 }, 3 * sizeof(float));
        memcpy(layer->points[p].color, (float[3]){ 0, 1, 0 }, 3 * sizeof(float));
        view.transfer_function.points[p].opacity = layer->points[p].opacity = p ? 0.9f : 0;
    }
    draw(&renderer, rig, 0, &view, &image);
    for (size_t k = 0; k < (size_t)64 * 64; k++)
        for (int c = 0; c < 3; c++)
            brightest[c] = fmaxf(brightest[c], (float)image.rgba[4 * k + c]);
    assert_compare(brightest[0], >=, 0.95);
    assert_compare(brightest[1], >=, 0.95);
    assert_compare(brightest[2], <=, 0.01);
    test_image_finish(&image);
    test_renderer_close(&renderer);
}

/* A projection shows the sum of the colours, at most 1. */
static void colors_of_projections_add_up(void **state) {
    static const enum sp_compositing modes[] = { SP_COMPOSITE_MAXIMUM, SP_COMPOSITE_MEAN };
    struct rig *rig = *state;
    struct test_renderer renderer;
    open_best(&renderer);
    for (size_t m = 0; m < sizeof modes / sizeof *modes; m++) {
        struct test_image sum, image;
        struct sp_view view;
        assert_true(test_image_init(&sum, 64, 64));
        for (int i = 0; i < FIELDS; i++) {
            make_view(rig, i, 1, &view);
            view.compositing.mode = modes[m];
            view.compositing.colors = SP_COLORS_TRANSFER_FUNCTION;
            draw(&renderer, rig, i, &view, &image);
            for (size_t k = 0; k < (size_t)4 * 64 * 64; k++)
                sum.rgba[k] = k % 4 == 3 ? 1 - (1 - sum.rgba[k]) * (1 - image.rgba[k])
                                         : fmin(sum.rgba[k] + image.rgba[k], 1);
            test_image_finish(&image);
        }
        make_view(rig, 0, FIELDS, &view);
        view.compositing.mode = modes[m];
        view.compositing.colors = SP_COLORS_TRANSFER_FUNCTION;
        draw(&renderer, rig, 0, &view, &image);
        assert_compare(test_image_psnr(&image, &sum), >=, 120);
        test_image_finish(&image);
        test_image_finish(&sum);
    }
    test_renderer_close(&renderer);
}

/* Cut away from the volume and from its channels. */
static void edits_cut_channels(void **state) {
    struct rig *rig = *state;
    struct test_renderer renderer;
    struct sp_view cut, clipped_view;
    open_best(&renderer);
    make_view(rig, 0, 2, &cut);
    make_view(rig, 0, 2, &clipped_view);
    cut.edit_count = 1;
    cut.edits[0] = (struct sp_edit){ .type = SP_EDIT_BOX, .box = { { 0, 0, 0 }, { 0.5, 1, 1 } } };
    clipped_view.clip.box[0][0] = 0.5;
    /* An edit has an edge that is one sample wide. */
    assert_compare(compare(&renderer, rig, 0, &cut, 0, &clipped_view), >=, 30);
    test_renderer_close(&renderer);
}

/* A function is made for a channel that has none. */
static void a_channel_has_a_default_function(void **state) {
    struct rig *rig = *state;
    const struct sp_volume_info *info = sp_volume_info(rig->volumes[1]);
    struct sp_transfer_function function;
    struct sp_view view;
    make_view(rig, 0, 2, &view);
    view.layers[1].point_count = 0;
    sp_channel_function(&view, &view.layers[1], info, &function);
    assert_int_equal(function.point_count, 2);
    assert_compare(function.points[0].value, >=, info->range[0]);
    assert_compare(function.points[1].value, <=, info->range[1]);
    assert_compare(function.points[0].value, <, function.points[1].value);
    assert_compare(function.points[0].opacity, ==, 0);
    assert_compare(function.points[1].opacity, ==, 0.5);
    assert_compare(function.reference_length, ==, view.transfer_function.reference_length);
    /* A channel without contrast shows nothing. */
    struct sp_volume_info flat = { .range = { 7, 7 }, .histogram = { [3] = 1 } };
    sp_channel_function(&view, &view.layers[1], &flat, &function);
    assert_int_equal(function.point_count, 1);
    assert_compare(function.points[0].opacity, ==, 0);
}

static void expect_error(const struct rig *rig, const struct sp_view *view, enum sp_code code,
                         const char *place, const char *text) {
    struct test_renderer renderer;
    struct test_image image;
    struct sp_error err = { 0 };
    open_best(&renderer);
    assert_false(draw_by(&renderer, rig, 0, view, &image, &err));
    assert_int_equal(err.code, code);
    assert_string_equal(err.place, place);
    if (!strstr(err.text, text))
        fail_msg("%s", err.text);
    test_renderer_close(&renderer);
}

static void channels_that_cannot_be_mixed_are_refused(void **state) {
    struct rig *rig = *state;
    struct sp_view view;
    make_view(rig, 0, 2, &view);
    snprintf(view.layers[1].id, sizeof view.layers[1].id, "elsewhere");
    expect_error(rig, &view, SP_ERR_INVALID, "/layers/1/id", "lie elsewhere");
    snprintf(view.layers[1].id, sizeof view.layers[1].id, "none");
    expect_error(rig, &view, SP_ERR_VOLUME_UNKNOWN, "/layers/1/id", "\"none\"");
    view.layers[1].id[0] = 0;
    expect_error(rig, &view, SP_ERR_INVALID, "/layers/1/id", "empty");
    make_view(rig, 0, 2, &view);
    add_channel(&view, 1);
    expect_error(rig, &view, SP_ERR_INVALID, "/layers/2/id", "the same volume");
    make_view(rig, 0, 2, &view);
    view.layers[1].points[1].value = view.layers[1].points[0].value;
    expect_error(rig, &view, SP_ERR_INVALID, "/layers/1/points/1/value", "does not rise");
    make_view(rig, 0, 2, &view);
    view.edit_count = 1;
    view.edits[0] = (struct sp_edit){ .type = SP_EDIT_PART, .range = { 0, 1 } };
    expect_error(rig, &view, SP_ERR_INVALID, "/edits/0/type", "channels");
}

static void modes_that_cannot_mix_are_refused(void **state) {
    struct rig *rig = *state;
    struct sp_view view;
    make_view(rig, 0, 2, &view);
    view.compositing.mode = SP_COMPOSITE_SPLAT;
    expect_error(rig, &view, SP_ERR_UNSUPPORTED, "/compositing/mode", "splat by splat");
    make_view(rig, 0, 2, &view);
    view.transfer_function.order = SP_TF_PRE;
    expect_error(rig, &view, SP_ERR_UNSUPPORTED, "/transfer_function/order", "after interpolation");
    make_view(rig, 0, 2, &view);
    view.compositing.mode = SP_COMPOSITE_SLAB;
    view.filter.mode = SP_FILTER_LOWPASS;
    expect_error(rig, &view, SP_ERR_UNSUPPORTED, "/filter", "default filter");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_mixture_is_the_integral),
        cmocka_unit_test(the_order_has_no_influence),
        cmocka_unit_test(the_same_volume_twice_is_twice_as_dense),
        cmocka_unit_test(what_is_hidden_or_transparent_changes_nothing),
        cmocka_unit_test(colors_of_projections_add_up),
        cmocka_unit_test(red_and_green_give_yellow),
        cmocka_unit_test(edits_cut_channels),
        cmocka_unit_test(a_channel_has_a_default_function),
        cmocka_unit_test(channels_that_cannot_be_mixed_are_refused),
        cmocka_unit_test(modes_that_cannot_mix_are_refused),
    };
    return cmocka_run_group_tests(tests, setup, teardown);
}
