/* SPDX-License-Identifier: Apache-2.0
 *
 * One synthetic volume per rule of the first view.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "data/volume/anatomy.h"
#include "data/volume/sample.h"
#include "data/volume/volume.h"
#include "sp/view.h"
#include "splat/camera.h"
#include "support/compare.h"

typedef double value_at(double x, double y, double z);

static void release(void *voxels, size_t bytes) {
    (void)bytes;
    free(voxels);
}

/* A volume of float or uint8 samples on a unit grid; `anatomy` and `other`, the name of another
 * field of the file, may be "". */
static struct sp_volume *make_field(const uint32_t dims[3], enum sp_type type, const char *anatomy,
                                    const char *other, value_at *value) {
    struct sp_volume_info info = { .type = type, .source = "test" };
    size_t count = (size_t)dims[0] * dims[1] * dims[2];
    size_t capacity = (count * sp_type_size(type) + 63) & ~(size_t)63;
    void *voxels = aligned_alloc(64, capacity);
    assert_non_null(voxels);
    for (int a = 0; a < 3; a++) {
        info.grid.dims[a] = dims[a];
        info.grid.spacing[a] = info.grid.direction[a][a] = 1;
    }
    memcpy(info.anatomy, anatomy, strlen(anatomy) + 1);
    memcpy(info.others[0], other, strlen(other) + 1);
    for (size_t i = 0; i < count; i++) {
        const double v = value((double)(i % dims[0]), (double)(i / dims[0] % dims[1]),
                               (double)(i / dims[0] / dims[1]));
        sp_sample_set(voxels, type, i, v);
    }
    struct sp_volume *volume = sp_volume_adopt(&info, voxels, NULL, capacity, release, NULL);
    assert_non_null(volume);
    return volume;
}

static struct sp_volume *make(const uint32_t dims[3], enum sp_type type, const char *anatomy,
                              value_at *value) {
    return make_field(dims, type, anatomy, "", value);
}

static struct sp_volume *make_cube(uint32_t size, value_at *value) {
    return make((const uint32_t[3]){ size, size, size }, SP_UINT8, "", value);
}

static struct sp_view choose(const struct sp_volume *volume) {
    struct sp_view view;
    struct sp_error err;
    sp_view_choose(&view, volume, "v");
    if (!sp_view_validate(&view, &err))
        fail_msg("%s: %s", err.place, err.text);
    return view;
}

static double opacity_of(const struct sp_view *view, double value) {
    const struct sp_transfer_function *tf = &view->transfer_function;
    const struct sp_tf_point *p = tf->points, *end = p + tf->point_count;
    while (p < end && p->value <= value)
        p++;
    if (p == tf->points || p == end)
        return (double)(p == end ? p[-1].opacity : p->opacity);
    double t = (value - p[-1].value) / (p->value - p[-1].value);
    return (double)p[-1].opacity + t * (double)(p->opacity - p[-1].opacity);
}

static double optical_depth(const struct sp_view *view, double value, double length) {
    return -log(1 - opacity_of(view, value)) * length / view->transfer_function.reference_length;
}

static struct sp_vec3 away_of(const struct sp_view *view) {
    return sp_vec3_normalize(
        sp_vec3_sub(sp_vec3_from(view->camera.position), sp_vec3_from(view->camera.target)));
}

static double distance(double x, double y, double z, double cx, double cy, double cz) {
    return sqrt((x - cx) * (x - cx) + (y - cy) * (y - cy) + (z - cz) * (z - cz));
}

/* A whole number in [-range, range] that looks random. */
static double noise(double x, double y, double z, int range) {
    uint32_t h = (uint32_t)x * 73856093u ^ (uint32_t)y * 19349663u ^ (uint32_t)z * 83492791u;
    h = (h ^ h >> 13) * 1274126177u;
    return (double)((h ^ h >> 16) % (uint32_t)(2 * range + 1)) - range;
}

/* The box of all voxels of at least this value in the image, as shares of its width and height. */
static void compute_image_box(const struct sp_view *view, const struct sp_volume *volume,
                              double least, double low[2], double high[2]) {
    const uint32_t *dims = sp_volume_info(volume)->grid.dims;
    const uint8_t *voxels = sp_volume_voxels(volume);
    struct sp_camera_transform camera;
    sp_camera_transform_init(&camera, &view->camera, view->size);
    low[0] = low[1] = INFINITY;
    high[0] = high[1] = -INFINITY;
    for (uint32_t k = 0; k < dims[2]; k++)
        for (uint32_t j = 0; j < dims[1]; j++)
            for (uint32_t i = 0; i < dims[0]; i++) {
                if ((double)*voxels++ < least)
                    continue;
                struct sp_vec3 at = { { i, j, k } };
                struct sp_vec3 u = sp_mat3_apply(&camera.w, sp_vec3_sub(at, camera.eye));
                for (int a = 0; a < 2; a++) {
                    double x = (camera.centre[a] + camera.scale * u.v[a] / u.v[2]) / view->size[a];
                    low[a] = fmin(low[a], x);
                    high[a] = fmax(high[a], x);
                }
            }
}

/* Asserts that the visible matter fills 60 to 90 % of the image's longer side, in its middle. */
static void check_framing(const struct sp_view *view, const struct sp_volume *volume,
                          double least) {
    double low[2], high[2], fill = 0;
    compute_image_box(view, volume, least, low, high);
    for (int a = 0; a < 2; a++) {
        fill = fmax(fill, high[a] - low[a]);
        assert_float_equal(0.5 * (low[a] + high[a]), 0.5, 0.05);
        assert_compare(low[a], >, 0.03);
        assert_compare(high[a], <, 0.97);
    }
    assert_compare(fill, >=, 0.6);
    assert_compare(fill, <=, 0.9);
}

/* A scanner's cylinder of air that is not zero, zero outside, and a ball. */
static double ball_in_air(double x, double y, double z) {
    if (hypot(x - 32, y - 32) > 31)
        return 0;
    if (distance(x, y, z, 38, 30, 30) < 9)
        return 160 + noise(x, y, z, 10);
    return 40 + noise(x, y, z, 8);
}

static void air_is_transparent_whatever_its_value(void **state) {
    (void)state;
    struct sp_volume *volume = make_cube(64, ball_in_air);
    struct sp_view view = choose(volume);
    for (int value = 0; value <= 48; value++)
        assert_float_equal(opacity_of(&view, value), 0, 1e-6);
    assert_compare(optical_depth(&view, 160, 18), >, 3);
    check_framing(&view, volume, 150);
    sp_volume_unref(&volume);
}

static double ball_on_plate(double x, double y, double z) {
    bool is_plate = x >= 2 && x < 4;
    return is_plate || distance(x, y, z, 22, 32, 32) < 18 ? 200 : 3 + noise(x, y, z, 2);
}

static double ball_under_plate(double x, double y, double z) {
    return ball_on_plate(y < 64 ? 63 - y : 0, x, z);
}

/* A holder as bright as the object cannot be told from it by its value. It becomes the floor. */
static void a_holder_lies_below(void **state) {
    (void)state;
    struct sp_volume *volume = make_cube(64, ball_on_plate);
    struct sp_view view = choose(volume);
    assert_float_equal(view.camera.up[0], 1, 1e-9);
    assert_compare(away_of(&view).v[0], >, 0.2); /* seen from above */
    check_framing(&view, volume, 150);
    sp_volume_unref(&volume);
    volume = make_cube(64, ball_under_plate);
    view = choose(volume);
    assert_float_equal(view.camera.up[1], -1, 1e-9);
    sp_volume_unref(&volume);
}

static double pot(double x, double y, double z) {
    double r = distance(x, y, z, 32, 32, 30);
    return r < 8    ? 180 + noise(x, y, z, 60)
           : r < 14 ? 80 + noise(x, y, z, 20)
                    : 3 + noise(x, y, z, 2);
}

static double pot_on_slab(double x, double y, double z) {
    return x < 5 && fabs(z - 32) < 20 ? 50 + noise(x, y, z, 5) : pot(x, y, z);
}

/* A pot with blocks of the slab's matter, as much as the slab has, but not along a face. */
static double pot_beside_blocks(double x, double y, double z) {
    bool is_block = fabs(x - 32) < 10 && (y < 12 || y >= 52) && fabs(z - 32) < 14;
    return is_block && y >= 3 && y < 61 ? 50 + noise(x, y, z, 5) : pot(x, y, z);
}

static void a_faint_slab_along_a_face_is_hidden(void **state) {
    (void)state;
    struct sp_volume *volume = make_cube(64, pot_on_slab);
    struct sp_view view = choose(volume);
    for (int value = 0; value <= 55; value++)
        assert_float_equal(opacity_of(&view, value), 0, 1e-6);
    assert_compare(optical_depth(&view, 90, 20), >, 0.5);
    check_framing(&view, volume, 75);
    sp_volume_unref(&volume);
    volume = make_cube(64, pot_beside_blocks);
    view = choose(volume);
    assert_compare(opacity_of(&view, 52), >, 0.0005);
    sp_volume_unref(&volume);
}

/* A ball with a core, and thin plates behind it that have the values of the ball's blurred edge. */
static double ball_and_plates(double x, double y, double z) {
    double r = distance(x, y, z, 32, 32, 32);
    if (x < 8)
        return (x == 3 || x == 6) && fabs(y - 32) < 5 ? 42 + noise(x, y, z, 8) : 2;
    return r < 14     ? 180 + noise(x, y, z, 70)
           : r < 22   ? 72 + noise(x, y, z, 4)
           : r < 22.3 ? 42 + noise(x, y, z, 14)
                      : 2;
}

static void thin_plates_are_hidden(void **state) {
    (void)state;
    struct sp_volume *volume = make_cube(64, ball_and_plates);
    struct sp_view view = choose(volume);
    for (int value = 0; value <= 50; value++)
        assert_float_equal(opacity_of(&view, value), 0, 1e-6);
    assert_compare(optical_depth(&view, 72, 20), >, 0.3);
    check_framing(&view, volume, 65);
    sp_volume_unref(&volume);
}

static double cut_at_first(double x, double y, double z) {
    return z < 44 && hypot(x - 32, y - 32) < 20 - 0.4 * z ? 150 : 2;
}

static double cut_at_last(double x, double y, double z) {
    return cut_at_first(x, y, 63 - z);
}

static void the_face_that_cuts_a_body_is_down(void **state) {
    (void)state;
    struct sp_volume *volume = make_cube(64, cut_at_first);
    assert_float_equal(choose(volume).camera.up[2], 1, 1e-9);
    sp_volume_unref(&volume);
    volume = make_cube(64, cut_at_last);
    assert_float_equal(choose(volume).camera.up[2], -1, 1e-9);
    sp_volume_unref(&volume);
}

static double disc(double x, double y, double z) {
    return z > 1 && z < 10 && hypot(x - 32, y - 32) < 28 ? 150 : 2;
}

static void flat_objects_are_seen_from_their_broad_side(void **state) {
    (void)state;
    const uint32_t dims[3] = { 64, 64, 12 };
    struct sp_volume *volume = make(dims, SP_UINT8, "", disc);
    struct sp_view view = choose(volume);
    assert_compare(away_of(&view).v[2], <,
                   -0.7); /* images: the first slice in front, row 0 above */
    assert_float_equal(view.camera.up[1], -1, 1e-9);
    check_framing(&view, volume, 100);
    sp_volume_unref(&volume);
    volume = make(dims, SP_FLOAT32, "", disc); /* maps: from above, north is up */
    view = choose(volume);
    assert_compare(away_of(&view).v[2], >, 0.7);
    assert_float_equal(view.camera.up[1], 1, 1e-9);
    sp_volume_unref(&volume);
}

/* A thin disc, and bodies that the first and the last face cut: alone, each would stand in its own
 * way. */
static void the_fields_of_a_file_stand_alike(void **state) {
    (void)state;
    value_at *const fields[] = { disc, cut_at_first, cut_at_last };
    for (size_t i = 0; i < sizeof fields / sizeof fields[0]; i++) {
        struct sp_volume *volume =
            make_field((const uint32_t[3]){ 64, 64, 64 }, SP_UINT8, "", "other", fields[i]);
        struct sp_view view = choose(volume);
        assert_float_equal(view.camera.up[2], 1, 1e-9);
        assert_compare(away_of(&view).v[1], <, -0.7);
        sp_volume_unref(&volume);
    }
}

static double ball(double x, double y, double z) {
    return distance(x, y, z, 24, 24, 24) < 18 ? 150 : 2;
}

static void patients_stand_upright_and_face_the_camera(void **state) {
    (void)state;
    static const char *const spaces[] = { "RAS", "LPS", "LAS", "RPI", "ASL", "SRP", "IPR", "PSL" };
    for (size_t i = 0; i < sizeof spaces / sizeof spaces[0]; i++) {
        struct sp_volume *volume =
            make((const uint32_t[3]){ 48, 48, 48 }, SP_UINT8, spaces[i], ball);
        struct sp_view view = choose(volume);
        double up[3], front[3], left[3];
        assert_true(sp_anatomy_find(spaces[i], 'S', up));
        assert_true(sp_anatomy_find(spaces[i], 'A', front));
        assert_true(sp_anatomy_find(spaces[i], 'L', left));
        for (int a = 0; a < 3; a++)
            assert_float_equal(view.camera.up[a], up[a], 1e-9);
        struct sp_vec3 away = away_of(&view);
        assert_compare(sp_vec3_dot(away, sp_vec3_from(front)), >, 0.7);
        assert_compare(sp_vec3_dot(away, sp_vec3_from(left)), >, 0.2);
        assert_compare(sp_vec3_dot(away, sp_vec3_from(up)), >, 0.1);
        sp_volume_unref(&volume);
    }
}

/* A few axial slices are seen from below, as radiologists do: anterior above, left on the right. */
static void few_axial_slices_are_seen_from_below(void **state) {
    (void)state;
    struct sp_volume *volume = make((const uint32_t[3]){ 64, 64, 12 }, SP_UINT8, "LPS", disc);
    struct sp_view view = choose(volume);
    struct sp_vec3 away = away_of(&view), up = sp_vec3_from(view.camera.up);
    assert_compare(away.v[2], <, -0.7);
    assert_float_equal(up.v[1], -1, 1e-9);
    assert_compare(sp_vec3_cross(up, away).v[0], >, 0.7);
    sp_volume_unref(&volume);
}

static double small_ball(double x, double y, double z) {
    return distance(x, y, z, 70, 20, 55) < 7 ? 150 : 2 + noise(x, y, z, 2);
}

static double rod(double x, double y, double z) {
    return x > 8 && x < 90 && hypot(y - 70, z - 30) < 4 ? 150 : 2;
}

static double speck(double x, double y, double z) {
    return x > 200 && x < 204 && y > 100 && y < 104 && z > 30 && z < 34 ? 255 : 0;
}

static void small_objects_fill_the_image(void **state) {
    (void)state;
    static value_at *const values[] = { small_ball, rod };
    for (size_t i = 0; i < sizeof values / sizeof values[0]; i++) {
        struct sp_volume *volume = make_cube(96, values[i]);
        struct sp_view view = choose(volume);
        check_framing(&view, volume, 100);
        sp_volume_unref(&volume);
    }
    /* Three voxels of 300: smaller than the distance of the samples. */
    struct sp_volume *volume = make((const uint32_t[3]){ 300, 300, 60 }, SP_UINT8, "", speck);
    struct sp_view view = choose(volume);
    const double middle[3] = { 202, 102, 32 };
    for (int a = 0; a < 3; a++)
        assert_float_equal(view.camera.target[a], middle[a], 1);
    assert_compare(distance(view.camera.position[0], view.camera.position[1],
                            view.camera.position[2], 202, 102, 32),
                   <, 40);
    sp_volume_unref(&volume);
}

/* A blob without surfaces. */
static double blob(double x, double y, double z) {
    return exp(-0.5 * pow(distance(x, y, z, 24, 24, 24) / 6, 2));
}

static void smooth_fields_are_translucent(void **state) {
    (void)state;
    struct sp_volume *volume = make((const uint32_t[3]){ 48, 48, 48 }, SP_FLOAT32, "", blob);
    struct sp_view view = choose(volume), plain;
    sp_view_init(&plain, sp_volume_info(volume), "v");
    assert_compare(view.shading.ambient, >, plain.shading.ambient);
    assert_compare(optical_depth(&view, 0.3, 4), <, 1.5); /* the inside shows through */
    assert_compare(optical_depth(&view, 0.9, 6), >, 1.5);
    sp_volume_unref(&volume);
}

/* A dense shell, soft matter inside, and in it a core that is a little denser. */
static double shell(double x, double y, double z) {
    double r = distance(x, y, z, 32, 32, 32);
    return r > 28 ? 0 : r > 25 ? 250 : distance(x, y, z, 38, 32, 32) < 7 ? 80 : 50;
}

static void a_shell_does_not_hide_what_is_inside(void **state) {
    (void)state;
    struct sp_volume *volume = make_cube(64, shell);
    struct sp_view view = choose(volume);
    assert_compare(optical_depth(&view, 250, 6), <, 0.5);
    assert_compare(optical_depth(&view, 50, 40), <, 1);
    assert_compare(optical_depth(&view, 80, 14), >, 1.5);
    sp_volume_unref(&volume);
}

static double wild(double x, double y, double z) {
    return x == 3 && y == 4 && z < 2 ? 1e30 : ball(x, y, z);
}

static double masked(double x, double y, double z) {
    return distance(x, y, z, 24, 24, 24) < 18 ? 100 + x : NAN;
}

static void wild_and_missing_values_do_not_count(void **state) {
    (void)state;
    const uint32_t dims[3] = { 48, 48, 48 };
    struct sp_volume *volume = make(dims, SP_FLOAT32, "", wild);
    struct sp_view view = choose(volume);
    assert_float_equal(opacity_of(&view, 2), 0, 1e-6);
    assert_compare(optical_depth(&view, 150, 36), >, 3);
    sp_volume_unref(&volume);
    volume = make(dims, SP_FLOAT32, "", masked);
    view = choose(volume);
    assert_compare(optical_depth(&view, 110, 10), >, 0.1);
    assert_compare(optical_depth(&view, 135, 10), >, 1);
    sp_volume_unref(&volume);
}

static double constant(double x, double y, double z) {
    (void)x, (void)y, (void)z;
    return 7;
}

static double nothing(double x, double y, double z) {
    (void)x, (void)y, (void)z;
    return NAN;
}

/* Lines of 0, as outside of a scanner's circle, and of 1. */
static double stripes(double x, double y, double z) {
    (void)y, (void)z;
    return (int)x % 4 == 0 ? 0 : (int)x % 4 == 1 ? 1 : NAN;
}

/* No range is narrower than one value: the bins stay inside of their array. */
static void one_value_beside_padding_is_a_range(void **state) {
    (void)state;
    struct sp_volume *volume = make((const uint32_t[3]){ 8, 8, 8 }, SP_FLOAT32, "", stripes);
    const struct sp_view view = choose(volume);
    assert_true(view.transfer_function.point_count >= 1);
    for (uint32_t i = 0; i < view.transfer_function.point_count; i++)
        assert_true(isfinite(view.transfer_function.points[i].value));
    sp_volume_unref(&volume);
}

static double tiny(double x, double y, double z) {
    return ball(x, y, z) * 1e-308;
}

static double tiniest(double x, double y, double z) {
    return ball(x, y, z) > 2 ? 5e-324 : 0;
}

/* Ranges whose inverse is no number. */
static void tiny_ranges_have_a_view(void **state) {
    (void)state;
    static value_at *const values[] = { tiny, tiniest };
    for (size_t i = 0; i < sizeof values / sizeof values[0]; i++) {
        struct sp_volume *volume =
            make((const uint32_t[3]){ 48, 48, 48 }, SP_FLOAT64, "", values[i]);
        const struct sp_view view = choose(volume);
        for (uint32_t p = 0; p < view.transfer_function.point_count; p++)
            assert_true(isfinite(view.transfer_function.points[p].value));
        sp_volume_unref(&volume);
    }
}

static void volumes_without_contrast_keep_the_plain_default(void **state) {
    (void)state;
    static value_at *const values[] = { constant, nothing };
    for (size_t i = 0; i < sizeof values / sizeof values[0]; i++) {
        struct sp_volume *volume = make((const uint32_t[3]){ 9, 8, 7 }, SP_FLOAT32, "", values[i]);
        struct sp_view view = choose(volume), plain;
        sp_view_init(&plain, sp_volume_info(volume), "v");
        assert_memory_equal(view.camera.position, plain.camera.position,
                            sizeof plain.camera.position);
        assert_int_equal(view.transfer_function.point_count, plain.transfer_function.point_count);
        sp_volume_unref(&volume);
    }
    /* A voxel, a line, a slice and a block of one value are equally dense through their thinnest
     * side: neither nearly black nor a brick. */
    static const uint32_t shapes[][3] = { { 1, 1, 1 }, { 1, 1, 40 }, { 30, 1, 20 }, { 9, 8, 7 } };
    for (size_t i = 0; i < sizeof shapes / sizeof shapes[0]; i++) {
        struct sp_volume *volume = make(shapes[i], SP_FLOAT32, "", constant);
        const struct sp_view view = choose(volume);
        const struct sp_volume_info *info = sp_volume_info(volume);
        double thickness = INFINITY;
        for (int a = 0; a < 3; a++)
            thickness = fmin(thickness, shapes[i][a] * info->grid.spacing[a]);
        assert_float_equal(optical_depth(&view, 7, thickness), 1.5, 1e-3);
        sp_volume_unref(&volume);
    }
    /* Any shape has a valid first view. */
    for (uint32_t n = 1; n < 27; n++) {
        const uint32_t dims[3] = { 1 + n % 3, 1 + n / 3 % 3, 1 + n / 9 };
        struct sp_volume *volume = make(dims, SP_FLOAT32, "", blob);
        choose(volume);
        sp_volume_unref(&volume);
    }
}

static void the_result_is_always_the_same(void **state) {
    (void)state;
    struct sp_volume *a = make_cube(64, ball_in_air), *b = make_cube(64, ball_in_air);
    struct sp_view first = choose(a), second = choose(b);
    assert_memory_equal(&first.camera, &second.camera, sizeof first.camera);
    assert_int_equal(first.transfer_function.point_count, second.transfer_function.point_count);
    for (uint32_t i = 0; i < first.transfer_function.point_count; i++)
        assert_memory_equal(&first.transfer_function.points[i], &second.transfer_function.points[i],
                            sizeof(struct sp_tf_point));
    sp_volume_unref(&a);
    sp_volume_unref(&b);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(air_is_transparent_whatever_its_value),
        cmocka_unit_test(a_holder_lies_below),
        cmocka_unit_test(a_faint_slab_along_a_face_is_hidden),
        cmocka_unit_test(thin_plates_are_hidden),
        cmocka_unit_test(the_face_that_cuts_a_body_is_down),
        cmocka_unit_test(flat_objects_are_seen_from_their_broad_side),
        cmocka_unit_test(the_fields_of_a_file_stand_alike),
        cmocka_unit_test(patients_stand_upright_and_face_the_camera),
        cmocka_unit_test(few_axial_slices_are_seen_from_below),
        cmocka_unit_test(small_objects_fill_the_image),
        cmocka_unit_test(smooth_fields_are_translucent),
        cmocka_unit_test(a_shell_does_not_hide_what_is_inside),
        cmocka_unit_test(wild_and_missing_values_do_not_count),
        cmocka_unit_test(one_value_beside_padding_is_a_range),
        cmocka_unit_test(tiny_ranges_have_a_view),
        cmocka_unit_test(volumes_without_contrast_keep_the_plain_default),
        cmocka_unit_test(the_result_is_always_the_same),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
