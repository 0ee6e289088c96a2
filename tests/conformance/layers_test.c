/* SPDX-License-Identifier: Apache-2.0
 *
 * Surfaces in a volume against a closed form: in a medium of constant extinction σ, the
 * iso-surfaces of a linear field are planes. Between two of them the ray collects c·(1 − e^−σL);
 * each adds its colour with its opacity.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "sp/renderer.h"
#include "support/compare.h"
#include "support/image.h"
#include "support/medium.h"
#include "support/render.h"

enum { SIDE = TEST_MEDIUM_SIDE };

/* Mean and largest difference. */
static const double exact[2] = { 5e-5, 2e-4 };
static const double within_a_sheet[2] = { 3e-4, 2e-3 };

/* The distance at which the ray meets a surface; INFINITY = it does not. Surfaces lie between
 * samples, so that they end half a gap before the volume. */
static double intersect_surface(const struct test_medium *s, double value, const double from[3],
                                const double along[3], const double t[2]) {
    double slope = test_dot(test_medium_field, along);
    double at = (value - test_medium_value(from)) / slope, p[3];
    if (!(at > t[0] && at < t[1]))
        return INFINITY;
    for (int r = 0; r < 3; r++)
        p[r] = from[r] + at * along[r] - s->grid.origin[r];
    for (int a = 0; a < 3; a++) {
        double axis[3], range[2];
        test_medium_axis(&s->grid, a, axis, range);
        double gap = s->grid.spacing[a], x = test_dot(axis, p);
        if (x < range[0] + 0.5 * gap || x > range[1] - 0.5 * gap)
            return INFINITY;
    }
    return at;
}

/* Returns the surfaces that the ray meets, as bits by layer, and a bit for the volume. */
static unsigned expect(const struct test_medium *s, double x, double y, double rgb[3]) {
    double from[3], along[3], t[2], at, through = 1;
    const unsigned volume = 1u << SP_LAYERS_MAX;
    unsigned met = 0;
    bool has_volume = false;
    test_medium_ray(&s->view.camera, x, y, from, along);
    rgb[0] = rgb[1] = rgb[2] = 0;
    for (uint32_t i = 0; i < s->view.layer_count; i++)
        has_volume = has_volume || s->view.layers[i].type == SP_LAYER_VOLUME;
    bool is_inside = test_medium_cut(s, from, along, true, t);
    at = is_inside ? t[0] : 0;
    met = is_inside ? volume : 0;
    while (is_inside && at < t[1]) {
        const struct sp_layer *nearest = NULL;
        double next = t[1];
        for (uint32_t i = 0; i < s->view.layer_count; i++) {
            const struct sp_layer *layer = &s->view.layers[i];
            if (layer->type != SP_LAYER_SURFACE || met >> i & 1)
                continue;
            double found = intersect_surface(s, layer->value, from, along, t);
            if (found < next) {
                next = found;
                nearest = layer;
            }
        }
        double pass = has_volume ? exp(-s->sigma * (next - at)) : 1;
        for (int c = 0; c < 3; c++)
            rgb[c] += through * (1 - pass) * (double)test_medium_color[c];
        through *= pass;
        at = next;
        if (!nearest)
            break;
        met |= 1u << (nearest - s->view.layers);
        for (int c = 0; c < 3; c++)
            rgb[c] += through * (double)(nearest->opacity * nearest->color[c]);
        through *= 1 - (double)nearest->opacity;
    }
    for (int c = 0; c < 3; c++)
        rgb[c] += through * (double)s->view.background[c];
    return met;
}

/* True if a border of the volume or of a surface is within 18 pixels, which is how far the
 * kernels of a surface reach. */
static bool is_edge(const struct test_medium *s, double x, double y) {
    double rgb[3], beside[3];
    const unsigned met = expect(s, x, y, rgb);
    for (int i = 0; i < 96; i++) {
        double distance = 3 + 3 * (i / 16), angle = i * M_PI / 8;
        if (expect(s, x + distance * cos(angle), y + distance * sin(angle), beside) != met)
            return true;
        for (int c = 0; c < 3; c++)
            if (distance == 3 && fabs(beside[c] - rgb[c]) > 0.04)
                return true;
    }
    return false;
}

static void check_target(const struct test_medium *s, const char *what, const double most[2],
                         const struct test_target *target) {
    struct test_renderer renderer;
    struct test_image image;
    struct sp_error err;
    if (!test_renderer_open(&renderer, target, 2, &err)) {
        printf("%-30s %-4s %-7s skipped: %s\n", what, target->backend, target->isa, err.text);
        return;
    }
    if (!test_render(&renderer, s->volume, &s->view, &image, &err)) {
        if (err.code != SP_ERR_UNSUPPORTED)
            fail_msg("%s on %s: %s", what, target->backend, err.text);
        printf("%-30s %-4s %-7s skipped: %s\n", what, target->backend, target->isa, err.text);
        test_renderer_close(&renderer);
        return;
    }
    double worst = 0, sum = 0;
    int count = 0, with_surface = 0;
    for (uint32_t y = 0; y < SIDE; y++)
        for (uint32_t x = 0; x < SIDE; x++) {
            double rgb[3];
            if (is_edge(s, x + 0.5, y + 0.5))
                continue;
            expect(s, x + 0.5, y + 0.5, rgb);
            const double *px = test_image_at(&image, x, y);
            for (int c = 0; c < 3; c++) {
                worst = fmax(worst, fabs(px[c] - rgb[c]));
                sum += fabs(px[c] - rgb[c]);
            }
            count++;
            with_surface += (expect(s, x + 0.5, y + 0.5, rgb) & 0xff) != 0;
        }
    printf("%-30s %-4s %-7s %5d of %5d px, mean %.6f, worst %.5f\n", what, target->backend,
           target->isa, with_surface, count, sum / (3 * count), worst);
    assert_compare(with_surface, >, 1000);
    assert_compare(sum / (3 * count), <, most[0]);
    assert_compare(worst, <, most[1]);
    test_image_finish(&image);
    test_renderer_close(&renderer);
}

static void check(struct test_medium *s, const char *what, const double most[2]) {
    struct test_target target;
    for (unsigned i = 0; test_target_at(i, &target); i++)
        check_target(s, what, most, &target);
}

static void add_surface(struct test_medium *s, double value, float opacity) {
    struct sp_layer *layer = &s->view.layers[s->view.layer_count++];
    *layer = sp_layer_default(SP_LAYER_SURFACE);
    layer->value = value;
    layer->opacity = opacity;
    layer->color[0] = s->view.layer_count & 1 ? 0.2f : 0.9f;
}

/* Looks at the planes from an oblique angle, close enough that they fill the image. */
static void init(struct test_medium *s, enum sp_projection projection) {
    struct sp_camera *camera = &s->view.camera;
    test_medium_init(s, projection);
    assert_non_null(s->volume);
    for (int i = 0; i < 3; i++)
        camera->position[i] = camera->target[i] - 1000 * test_medium_field[i] + (i == 0 ? 20 : 0);
    camera->fov_y = 18;
    camera->height *= 0.45;
}

/* Returns the value in the middle of the volume plus `part`. */
static double value_at(const struct test_medium *s, double part) {
    return test_medium_value(s->view.camera.target) + part;
}

static void surfaces_lie_inside_interpolated_sheets(void **state) {
    (void)state;
    for (int projection = SP_PERSPECTIVE; projection <= SP_ORTHOGRAPHIC; projection++) {
        struct test_medium s;
        init(&s, (enum sp_projection)projection);
        add_surface(&s, value_at(&s, 0), 1);
        check(&s, projection ? "opaque, orthographic" : "opaque, perspective", exact);
        s.view.layers[1].opacity = 0.5f;
        add_surface(&s, value_at(&s, 0.2), 0.3f);
        add_surface(&s, value_at(&s, -0.2), 0.8f);
        check(&s, projection ? "three, orthographic" : "three, perspective", exact);
        sp_volume_unref(&s.volume);
    }
}

/* A fragment divides splats, sheets and slabs. Splats as wholes before or behind a surface would
 * show the lattice of the voxels on it as stripes of up to 0.009. */
static void surfaces_lie_inside_splats_sheets_and_slabs(void **state) {
    (void)state;
    static const char *const names[] = { "inside splats", "inside sheets", "inside slabs" };
    for (int mode = SP_COMPOSITE_SPLAT; mode <= SP_COMPOSITE_SLAB; mode++)
        for (int projection = SP_PERSPECTIVE; projection <= SP_ORTHOGRAPHIC; projection++) {
            struct test_medium s;
            init(&s, (enum sp_projection)projection);
            s.view.transfer_function.order = SP_TF_PRE;
            s.view.compositing.mode = (enum sp_compositing)mode;
            add_surface(&s, value_at(&s, 0), 1);
            add_surface(&s, value_at(&s, 0.2), 0.3f);
            check(&s, names[mode], within_a_sheet);
            sp_volume_unref(&s.volume);
        }
}

static void surfaces_are_drawn_without_the_volume(void **state) {
    (void)state;
    struct test_medium s;
    init(&s, SP_PERSPECTIVE);
    add_surface(&s, value_at(&s, 0), 0.6f);
    add_surface(&s, value_at(&s, 0.2), 0.3f);
    s.view.layers[0].visible = false;
    /* expect() knows no hidden layers. */
    memmove(&s.view.layers[0], &s.view.layers[1], 2 * sizeof s.view.layers[0]);
    s.view.layer_count = 2;
    check(&s, "without the volume", exact);
    sp_volume_unref(&s.volume);
}

static void clipping_cuts_surfaces(void **state) {
    (void)state;
    struct test_medium s;
    init(&s, SP_PERSPECTIVE);
    add_surface(&s, value_at(&s, 0), 1);
    s.view.clip.box[0][1] = 0.2;
    s.view.clip.box[1][0] = 0.7;
    check(&s, "clipped", exact);
    sp_volume_unref(&s.volume);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(surfaces_lie_inside_interpolated_sheets),
        cmocka_unit_test(surfaces_lie_inside_splats_sheets_and_slabs),
        cmocka_unit_test(surfaces_are_drawn_without_the_volume),
        cmocka_unit_test(clipping_cuts_surfaces),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
