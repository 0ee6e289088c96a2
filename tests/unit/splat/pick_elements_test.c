/* SPDX-License-Identifier: Apache-2.0
 *
 * Picking of points, Gaussians and triangles: the opacity of a ray equals the opacity of the pixel,
 * and places have closed forms.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "sp/pick.h"
#include "support/compare.h"
#include "support/mesh.h"
#include "support/render.h"

enum { COUNT = 300 };
static const uint32_t size[2] = { 80, 60 };

static double uniform(double low, double high) {
    return low + (high - low) * (rand() / (double)RAND_MAX);
}

/* Elements of both kinds share their arrays. */
struct cloud {
    float positions[COUNT][3], factors[COUNT][6], numbers[COUNT], volumes[COUNT];
    float harmonics[COUNT][3];
};

static struct sp_volume *make_cloud(struct cloud *c, enum sp_kind kind, uint32_t count) {
    struct sp_elements elements = { .shape = { .kind = kind, .count = count },
                                    .positions = c->positions,
                                    .factors = c->factors };
    if (kind == SP_KIND_POINTS) {
        elements.values = c->numbers;
        elements.volumes = c->volumes;
    } else {
        elements.opacities = c->numbers;
        elements.harmonics = c->harmonics[0];
    }
    struct sp_volume *volume = sp_volume_create_elements(&elements, "cloud", NULL);
    assert_non_null(volume);
    return volume;
}

/* A cloud in the box [−2, 2]³. */
static struct sp_volume *random_cloud(enum sp_kind kind) {
    struct cloud *c = calloc(1, sizeof *c);
    assert_non_null(c);
    for (int i = 0; i < COUNT; i++) {
        for (int a = 0; a < 3; a++)
            c->positions[i][a] = (float)uniform(-2, 2);
        for (int k = 0; k < 6; k++)
            c->factors[i][k] = (float)uniform(-0.1, 0.1);
        c->factors[i][0] = c->factors[i][2] = c->factors[i][5] = 0.15f;
        c->numbers[i] = (float)uniform(0.05, 1);
        c->volumes[i] = (float)uniform(0.01, 0.1);
    }
    struct sp_volume *volume = make_cloud(c, kind, COUNT);
    free(c);
    return volume;
}

/* Looks along +z at the world's origin from a distance of 8. */
static struct sp_view view_of(struct sp_volume *volume, enum sp_layer_type type) {
    struct sp_view view;
    sp_view_init(&view, sp_volume_info(volume), "v");
    memcpy(view.size, size, sizeof size);
    view.camera = (struct sp_camera){
        .position = { 0, 0, -8 }, .up = { 0, 1, 0 }, .fov_y = 40, .height = 5, .near = 0.1
    };
    view.transfer_function =
        (struct sp_transfer_function){ .reference_length = 0.5,
                                       .point_count = 2,
                                       .points = { { 0, { 1, 1, 1 }, 0 },
                                                   { 1, { 1, 1, 1 }, 0.9f } } };
    memset(view.background, 0, sizeof view.background);
    view.layer_count = 1;
    view.layers[0] = sp_layer_default(type);
    return view;
}

static struct sp_pick pick_at(const struct sp_volume *volume, const struct sp_view *view, double x,
                              double y) {
    const struct sp_pick_input input = {
        .volume = volume, .view = view, .size = { size[0], size[1] }, .at = { x, y }
    };
    struct sp_pick pick;
    assert_true(sp_pick_at(&input, &pick, NULL));
    return pick;
}

/* Turned, moved and stretched. */
static void set_transform(struct sp_layer *layer) {
    const double transform[16] = {
        0.6, -0.8, 0, 0.3, 0.8, 0.6, 0, -0.2, 0, 0, 1.3, 0.5, 0, 0, 0, 1
    };
    memcpy(layer->transform, transform, sizeof transform);
}

/* The image of the layer against picks in the middle of its pixels: their mean and largest
 * difference of opacity. */
static void compare_image(struct sp_volume *volume, const struct sp_view *view, double mean,
                          double most) {
    struct test_renderer r;
    struct test_image image;
    const struct test_target target = { "cpu", "auto" };
    struct sp_error err;
    double sum = 0, largest = 0, lit = 0;
    assert_true(test_renderer_open(&r, &target, 1, &err));
    assert_true(test_render(&r, volume, view, &image, &err));
    for (uint32_t y = 0; y < size[1]; y++)
        for (uint32_t x = 0; x < size[0]; x++) {
            const struct sp_pick pick = pick_at(volume, view, x + 0.5, y + 0.5);
            const double alpha = test_image_at(&image, x, y)[3];
            sum += fabs(pick.opacity - alpha);
            largest = fmax(largest, fabs(pick.opacity - alpha));
            lit += alpha > 0.1;
        }
    assert_compare(lit, >, 200);
    assert_compare(sum / (size[0] * size[1]), <, mean);
    assert_compare(largest, <, most);
    test_image_finish(&image);
    test_renderer_close(&r);
}

static void the_opacity_of_a_ray_is_that_of_the_pixel(void **state) {
    static const struct {
        enum sp_kind kind;
        enum sp_layer_type type;
    } kinds[] = { { SP_KIND_POINTS, SP_LAYER_POINTS }, { SP_KIND_GAUSSIANS, SP_LAYER_GAUSSIANS } };
    (void)state;
    srand(5);
    for (int k = 0; k < 2; k++)
        for (int variant = 0; variant < 4; variant++) {
            struct sp_volume *volume = random_cloud(kinds[k].kind);
            struct sp_view view = view_of(volume, kinds[k].type);
            if (variant & 1)
                view.camera.projection = SP_ORTHOGRAPHIC;
            if (variant & 2) {
                set_transform(&view.layers[0]);
                view.layers[0].size = 1.5;
                view.layers[0].opacity = 0.7f;
                view.layers[0].convention = SP_CONVENTION_NORMALISED;
            }
            compare_image(volume, &view, 1e-3, 0.01);
            sp_volume_unref(&volume);
        }
}

/* Compares picks between the middles of pixels with the same coverage. Silhouettes differ. */
static void a_mesh_is_hit_where_its_triangles_are(void **state) {
    struct sp_elements ball;
    (void)state;
    srand(6);
    assert_true(test_mesh_ball(&ball, 40, 1.5));
    struct sp_volume *volume = sp_volume_create_elements(&ball, "ball", NULL);
    assert_non_null(volume);
    struct sp_view view = view_of(volume, SP_LAYER_GEOMETRY);
    for (int n = 0; n < 40; n++) {
        const double x = uniform(30, 50), y = uniform(20, 40);
        struct sp_pick pick = pick_at(volume, &view, x, y);
        assert_true(pick.is_hit);
        assert_compare(pick.opacity, ==, 1);
        assert_true(isnan(pick.value));
        assert_int_equal(pick.elements, ball.shape.count);
        const double *p = pick.position;
        assert_compare(fabs(sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]) - 1.5), <, 0.01);
        assert_compare(p[2], <, 0);
    }
    view.layers[0].opacity = 0.4f; /* the front alone does not reach one half */
    struct sp_pick pick = pick_at(volume, &view, 40.2, 30.1);
    assert_compare(pick.position[2], >, 1);
    assert_compare(fabs(pick.opacity - (1 - 0.6 * 0.6)), <, 1e-6);
    view.layers[0].opacity = 1;
    view.clip.plane_count = 1; /* the front is cut away */
    view.clip.planes[0] = (struct sp_clip_plane){ { 0, 0, 1 }, 0 };
    assert_compare(pick_at(volume, &view, 40.2, 30.1).position[2], >, 1);
    assert_true(!pick_at(volume, &view, 1, 1).is_hit);
    sp_volume_unref(&volume);
    test_mesh_finish(&ball);
}

/* One Gaussian or point at z, round, of the standard deviation 0.3. */
static void put(struct cloud *c, uint32_t i, double z, double number) {
    c->positions[i][0] = c->positions[i][1] = 0;
    c->positions[i][2] = (float)z;
    memset(c->factors[i], 0, sizeof c->factors[i]);
    c->factors[i][0] = c->factors[i][2] = c->factors[i][5] = 0.3f;
    c->numbers[i] = (float)number;
    c->volumes[i] = 1;
}

static struct sp_volume *other;

static struct sp_volume *find_other(void *user, const char *id) {
    assert_ptr_equal(user, &other);
    return strcmp(id, "other") == 0 ? sp_volume_ref(other) : NULL;
}

static void elements_are_hit_at_the_depths_of_their_centres(void **state) {
    struct cloud c = { .numbers = { 0 } };
    struct sp_pick pick;
    (void)state;
    put(&c, 0, 1, 0.9);
    put(&c, 1, -2, 0.3);
    put(&c, 2, 3, 0.99);
    struct sp_volume *volume = make_cloud(&c, SP_KIND_GAUSSIANS, 3);
    struct sp_view view = view_of(volume, SP_LAYER_GAUSSIANS);
    pick = pick_at(volume, &view, 40, 30); /* the faint one is not enough */
    assert_true(pick.is_hit);
    assert_compare(fabs(pick.position[2] - 1), <, 1e-6);
    assert_compare(fabs(pick.opacity - (1 - 0.7 * 0.1 * 0.01)), <, 1e-5);
    view.camera.near = 9.5; /* only the last one */
    assert_compare(fabs(pick_at(volume, &view, 40, 30).position[2] - 3), <, 1e-6);
    view.camera.near = 0.1;
    view.layers[0].visible = false;
    pick = pick_at(volume, &view, 40, 30);
    assert_compare(pick.opacity, ==, 0);
    assert_int_equal(pick.elements, 0);
    sp_volume_unref(&volume);

    c.numbers[0] = NAN; /* not drawn */
    c.positions[2][1] = INFINITY;
    volume = make_cloud(&c, SP_KIND_GAUSSIANS, 3);
    view.layers[0].visible = true;
    pick = pick_at(volume, &view, 40, 30);
    assert_true(!pick.is_hit);
    assert_compare(fabs(pick.opacity - 0.3), <, 1e-5);
    sp_volume_unref(&volume);
}

/* Points of another volume inside of fog: a pick hits the matter in front. */
static void elements_of_another_volume_lie_in_the_volume(void **state) {
    enum { SIDE = 8 };
    static uint8_t voxels[SIDE * SIDE * SIDE];
    struct cloud c = { .numbers = { 0 } };
    struct sp_grid grid = { .dims = { SIDE, SIDE, SIDE }, .spacing = { 0.5, 0.5, 0.5 } };
    (void)state;
    for (int i = 0; i < 3; i++) {
        grid.direction[i][i] = 1;
        grid.origin[i] = -1.75; /* the box is [−2, 2]³ */
    }
    memset(voxels, 1, sizeof voxels);
    struct sp_volume *volume = sp_volume_create(&grid, SP_UINT8, voxels, "fog", NULL);
    put(&c, 0, 0, 0.5);
    other = make_cloud(&c, SP_KIND_POINTS, 1);
    struct sp_view view = view_of(volume, SP_LAYER_VOLUME);
    view.transfer_function.points[1].opacity = 0.1f; /* of the fog over 0.5: half at 3.29 */
    view.transfer_function.points[0].opacity = 0.9f;
    view.layers[1] = sp_layer_default(SP_LAYER_POINTS);
    view.layer_count = 2;
    snprintf(view.layers[1].id, sizeof view.layers[1].id, "other");
    struct sp_pick_input input = {
        .volume = volume, .view = &view, .size = { size[0], size[1] }, .at = { 40, 30 }
    };
    struct sp_pick pick;
    const double fog = -log(0.9) / 0.5;
    assert_true(sp_pick_at(&input, &pick, NULL)); /* without find() there is the fog alone */
    assert_compare(fabs(pick.position[2] - (-2 + log(2) / fog)), <, 1e-6);
    assert_compare(pick.value, ==, 1);
    input.find = find_other;
    input.user = &other;
    assert_true(sp_pick_at(&input, &pick, NULL));
    assert_compare(fabs(pick.position[2]), <, 1e-6);
    assert_compare(pick.value, ==, 0.5);
    view.layers[1].transform[11] = 1.9; /* now behind what is seen of the fog */
    assert_true(sp_pick_at(&input, &pick, NULL));
    assert_compare(fabs(pick.position[2] - (-2 + log(2) / fog)), <, 1e-6);
    view.layers[1].transform[11] = -4; /* and before it, outside of the volume */
    assert_true(sp_pick_at(&input, &pick, NULL));
    assert_compare(fabs(pick.position[2] + 4), <, 1e-6);
    view.layers[0].visible = false;
    view.layers[1].transform[11] = 5;
    assert_true(sp_pick_at(&input, &pick, NULL));
    assert_compare(fabs(pick.position[2] - 5), <, 1e-6);
    snprintf(view.layers[1].id, sizeof view.layers[1].id, "closed");
    assert_true(sp_pick_at(&input, &pick, NULL));
    assert_compare(pick.opacity, ==, 0);
    sp_volume_unref(&other);
    sp_volume_unref(&volume);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_opacity_of_a_ray_is_that_of_the_pixel),
        cmocka_unit_test(a_mesh_is_hit_where_its_triangles_are),
        cmocka_unit_test(elements_are_hit_at_the_depths_of_their_centres),
        cmocka_unit_test(elements_of_another_volume_lie_in_the_volume)
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
