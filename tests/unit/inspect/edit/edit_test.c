/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <string.h>

#include "data/volume/sample.h"
#include "data/volume/volume.h"
#include "sp/edit.h"
#include "support/compare.h"
#include "support/scene.h"

enum { N = 40, FULL = 200 };

/* Two balls that touch no other, joined by a bridge that is one sample wide, and a third one. */
static double balls(const void *user, double x, double y, double z) {
    (void)user;
    const double places[3][3] = { { 10, 10, 10 }, { 28, 10, 10 }, { 20, 30, 30 } };
    double value = fabs(y - 10) < 0.5 && fabs(z - 10) < 0.5 && x > 10 && x < 28 ? FULL : 0;
    for (int i = 0; i < 3; i++) {
        double dx = x - places[i][0], dy = y - places[i][1], dz = z - places[i][2];
        value = fmax(value, fmin(fmax(6.5 - sqrt(dx * dx + dy * dy + dz * dz), 0), 1) * FULL);
    }
    return value;
}

struct rig {
    struct test_scene scene;
    struct sp_volume *volume;
    struct sp_view view;
};

static struct rig make(enum sp_type type, const double spacing[3]) {
    static const double points[][5] = { { 20, 0, 0, 0, 0 }, { FULL, 1, 1, 1, 0.5 } };
    struct rig rig;
    memset(&rig, 0, sizeof rig);
    test_view_init(&rig.scene.view);
    assert_true(test_scene_voxels(&rig.scene, "balls", (const uint32_t[3]){ N, N, N }, spacing,
                                  type, balls, NULL));
    test_scene_points(&rig.scene, points, 2);
    rig.volume = test_scene_volume(&rig.scene, NULL);
    assert_non_null(rig.volume);
    rig.view = rig.scene.view;
    return rig;
}

static void finish(struct rig *rig) {
    sp_volume_unref(&rig->volume);
    test_scene_finish(&rig->scene);
}

static double value_at(const struct sp_volume *volume, int x, int y, int z) {
    return sp_sample(sp_volume_voxels(volume), sp_volume_info(volume)->type,
                     (uint64_t)x + N * ((uint64_t)y + (uint64_t)N * (uint64_t)z));
}

/* The world position of a sample. */
static void place(const struct rig *rig, int x, int y, int z, double out[3]) {
    const struct sp_grid *g = &rig->scene.info.grid;
    const int at[3] = { x, y, z };
    for (int r = 0; r < 3; r++)
        out[r] = g->origin[r] + g->spacing[r] * at[r];
}

static const double even[3] = { 1, 1, 1 };

static void without_edits_the_volume_is_itself(void **state) {
    (void)state;
    struct rig rig = make(SP_UINT8, even);
    struct sp_volume *edited = sp_edit_volume(rig.volume, &rig.view, NULL);
    assert_ptr_equal(edited, rig.volume);
    sp_volume_unref(&edited);
    finish(&rig);
}

/* The middles of the three balls, in the order of balls(). */
static const int middles[3][3] = { { 10, 10, 10 }, { 28, 10, 10 }, { 20, 30, 30 } };

static void check_middles(const struct sp_volume *volume, const bool stays[3]) {
    for (int i = 0; i < 3; i++) {
        const int *m = middles[i];
        assert_compare(value_at(volume, m[0], m[1], m[2]), ==, stays[i] ? FULL : 0);
    }
}

static void check_edit(struct rig *rig, const struct sp_edit *edit, const bool stays[3]) {
    rig->view.edits[0] = *edit;
    rig->view.edit_count = 1;
    struct sp_volume *edited = sp_edit_volume(rig->volume, &rig->view, NULL);
    assert_non_null(edited);
    check_middles(edited, stays);
    assert_memory_equal(sp_volume_info(edited)->range, sp_volume_info(rig->volume)->range,
                        2 * sizeof(double));
    sp_volume_unref(&edited);
}

static void a_part_is_removed_or_kept(void **state) {
    (void)state;
    static const enum sp_type types[] = { SP_UINT8, SP_INT16, SP_FLOAT32, SP_FLOAT64 };
    for (size_t t = 0; t < sizeof types / sizeof types[0]; t++) {
        struct rig rig = make(types[t], (const double[3]){ 1, 1.5, 0.5 });
        struct sp_edit edit = { .type = SP_EDIT_PART, .range = { 100, 255 } };
        place(&rig, 10, 10, 10, edit.point);
        check_edit(&rig, &edit, (const bool[3]){ false, false, true });
        edit.keep = SP_KEEP_INSIDE;
        check_edit(&rig, &edit, (const bool[3]){ true, true, false });
        place(&rig, 20, 30, 31, edit.point);
        check_edit(&rig, &edit, (const bool[3]){ false, false, true });
        place(&rig, 0, 39, 0, edit.point); /* far from all of them */
        check_edit(&rig, &edit, (const bool[3]){ true, true, true });
        edit.point[0] = 1e18;
        check_edit(&rig, &edit, (const bool[3]){ true, true, true });
        finish(&rig);
    }
}

/* The fading border of a removed part is removed with it; the other parts stay. */
static void nothing_of_a_removed_part_is_left(void **state) {
    (void)state;
    struct rig rig = make(SP_UINT8, even);
    rig.view.edits[0] = (struct sp_edit){ .type = SP_EDIT_PART, .range = { 100, 255 } };
    place(&rig, 10, 10, 10, rig.view.edits[0].point);
    rig.view.edit_count = 1;
    struct sp_volume *edited = sp_edit_volume(rig.volume, &rig.view, NULL);
    assert_non_null(edited);
    for (int z = 0; z < N; z++)
        for (int y = 0; y < N; y++)
            for (int x = 0; x < N; x++)
                assert_compare(value_at(edited, x, y, z), ==,
                               y + z < 40 ? 0 : value_at(rig.volume, x, y, z));
    sp_volume_unref(&edited);
    finish(&rig);
}

static void cutting_the_bridge_parts_the_balls(void **state) {
    (void)state;
    struct rig rig = make(SP_UINT8, even);
    struct sp_edit *edits = rig.view.edits;
    edits[0] = (struct sp_edit){ .type = SP_EDIT_SPHERE, .radius = 1.5 };
    place(&rig, 19, 10, 10, edits[0].center);
    edits[1] = (struct sp_edit){ .type = SP_EDIT_PART, .range = { 100, 255 } };
    place(&rig, 10, 10, 10, edits[1].point);
    rig.view.edit_count = 1;
    struct sp_volume *cut = sp_edit_volume(rig.volume, &rig.view, NULL);
    check_middles(cut, (const bool[3]){ true, true, true });
    assert_compare(value_at(cut, 19, 10, 10), ==, 0);
    rig.view.edit_count = 2; /* goes on from the volume with one edit */
    struct sp_volume *parted = sp_edit_volume(rig.volume, &rig.view, NULL);
    check_middles(parted, (const bool[3]){ false, true, true });
    assert_true(sp_volume_is_of(parted, rig.volume));
    rig.view.edit_count = 1; /* undo */
    struct sp_volume *undone = sp_edit_volume(rig.volume, &rig.view, NULL);
    check_middles(undone, (const bool[3]){ true, true, true });
    sp_volume_unref(&cut);
    sp_volume_unref(&parted);
    sp_volume_unref(&undone);
    finish(&rig);
}

static void the_last_result_is_remembered(void **state) {
    (void)state;
    struct rig rig = make(SP_UINT8, even);
    rig.view.edits[0] =
        (struct sp_edit){ .type = SP_EDIT_BOX, .box = { { 0, 0, 0 }, { 0.5, 1, 1 } } };
    rig.view.edit_count = 1;
    struct sp_volume *none = sp_edit_volume_made(rig.volume, &rig.view);
    assert_ptr_equal(none, rig.volume);
    struct sp_volume *first = sp_edit_volume(rig.volume, &rig.view, NULL);
    struct sp_volume *second = sp_edit_volume(rig.volume, &rig.view, NULL);
    struct sp_volume *made = sp_edit_volume_made(rig.volume, &rig.view);
    assert_ptr_equal(first, second);
    assert_ptr_equal(first, made);
    rig.view.transfer_function.points[0].opacity = 0.2f; /* another value is transparent */
    rig.view.transfer_function.points[1].opacity = 0;
    struct sp_volume *third = sp_edit_volume(rig.volume, &rig.view, NULL);
    assert_ptr_not_equal(first, third);
    assert_compare(value_at(third, 0, 0, 0), ==, FULL);
    sp_volume_unref(&none);
    sp_volume_unref(&first);
    sp_volume_unref(&second);
    sp_volume_unref(&third);
    sp_volume_unref(&made);
    finish(&rig);
}

/* The share of a constant volume that cuts leave, against the volume of their shapes. */
static double one(const void *user, double x, double y, double z) {
    (void)user, (void)x, (void)y, (void)z;
    return 1;
}

static void cuts_remove_their_volume(void **state) {
    (void)state;
    const double spacing[3] = { 1, 1.3, 0.8 };
    static const double points[][5] = { { 0, 0, 0, 0, 0 }, { 1, 1, 1, 1, 0.5 } };
    const struct {
        struct sp_edit edit;
        double stays; /* samples */
    } cases[] = {
        { { .type = SP_EDIT_SPHERE, .radius = 12, .keep = SP_KEEP_INSIDE },
          4 * M_PI / 3 * 12 * 12 * 12 / (1 * 1.3 * 0.8) },
        { { .type = SP_EDIT_SPHERE, .radius = 12 },
          N * N * N - 4 * M_PI / 3 * 12 * 12 * 12 / (1 * 1.3 * 0.8) },
        { { .type = SP_EDIT_BOX, .box = { { 0.2, 0, 0.125 }, { 1, 1, 0.8 } }, .keep = 1 },
          0.8 * 0.675 * N * N * N },
        { { .type = SP_EDIT_PLANE, .normal = { 1, 2, -3 } }, 0.5 * N * N * N },
        { { .type = SP_EDIT_PLANE, .normal = { 1e200, 0, 0 }, .offset = 4e200 }, 0.4 * N * N * N },
    };
    struct rig rig = { .view.edit_count = 1 };
    test_view_init(&rig.scene.view);
    assert_true(test_scene_voxels(&rig.scene, "one", (const uint32_t[3]){ N, N, N }, spacing,
                                  SP_FLOAT32, one, NULL));
    ((float *)rig.scene.voxels)[0] = 0; /* so that there is a transparent value */
    test_scene_points(&rig.scene, points, 2);
    rig.volume = test_scene_volume(&rig.scene, NULL);
    rig.view = rig.scene.view;
    rig.view.edit_count = 1;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        double sum = 0;
        rig.view.edits[0] = cases[i].edit;
        struct sp_volume *edited = sp_edit_volume(rig.volume, &rig.view, NULL);
        for (int k = 0; k < N * N * N; k++)
            sum += (double)((const float *)sp_volume_voxels(edited))[k];
        assert_float_equal(sum, cases[i].stays, 0.003 * N * N * N);
        sp_volume_unref(&edited);
    }
    finish(&rig);
}

static void samples_that_are_not_finite_stay(void **state) {
    (void)state;
    struct rig rig = make(SP_FLOAT32, even);
    float *voxels = rig.scene.voxels;
    voxels[0] = NAN;
    sp_volume_unref(&rig.volume);
    rig.volume = test_scene_volume(&rig.scene, NULL);
    rig.view.edits[0] =
        (struct sp_edit){ .type = SP_EDIT_PLANE, .normal = { 1, 0, 0 }, .offset = 1e6 };
    rig.view.edit_count = 1;
    struct sp_volume *edited = sp_edit_volume(rig.volume, &rig.view, NULL);
    assert_true(isnan(value_at(edited, 0, 0, 0)));
    assert_compare(value_at(edited, 10, 10, 10), ==, 0);
    sp_volume_unref(&edited);
    finish(&rig);
}

/* The rig's view shows all values, so removed samples become NaN. The type then holds NaN and all
 * other samples exactly. */
static void check_holes(struct rig *rig, enum sp_type type) {
    uint64_t holes = 0;
    struct sp_volume *edited = sp_edit_volume(rig->volume, &rig->view, NULL);
    assert_non_null(edited);
    assert_int_equal(sp_volume_info(edited)->type, type);
    assert_int_equal(sp_volume_info(edited)->voxel_bytes, N * N * N * sp_type_size(type));
    assert_memory_equal(sp_volume_info(edited)->range, sp_volume_info(rig->volume)->range,
                        2 * sizeof(double));
    for (int z = 0; z < N; z++)
        for (int y = 0; y < N; y++)
            for (int x = 0; x < N; x++) {
                bool is_hole = x >= N / 2 || y >= N / 4;
                holes += is_hole;
                assert_int_equal(isnan(value_at(edited, x, y, z)) != 0, is_hole);
                if (!is_hole)
                    assert_compare(value_at(edited, x, y, z), ==, value_at(rig->volume, x, y, z));
            }
    assert_int_equal(sp_volume_info(edited)->nonfinite, holes);
    sp_volume_unref(&edited);
}

/* Two cuts, the second one on top of the first. */
static void add_cuts(struct rig *rig) {
    rig->view.edits[0] =
        (struct sp_edit){ .type = SP_EDIT_BOX, .box = { { 0.5, 0, 0 }, { 1, 1, 1 } } };
    rig->view.edits[1] =
        (struct sp_edit){ .type = SP_EDIT_BOX, .box = { { 0, 0.25, 0 }, { 1, 1, 1 } } };
    rig->view.edit_count = 1;
    struct sp_volume *first = sp_edit_volume(rig->volume, &rig->view, NULL);
    assert_non_null(first);
    sp_volume_unref(&first);
    rig->view.edit_count = 2;
}

static void without_a_transparent_value_samples_become_nan(void **state) {
    (void)state;
    static const enum sp_type types[][2] = { { SP_UINT8, SP_FLOAT32 },  { SP_INT8, SP_FLOAT32 },
                                             { SP_UINT16, SP_FLOAT32 }, { SP_INT16, SP_FLOAT32 },
                                             { SP_INT32, SP_FLOAT64 },  { SP_FLOAT32, SP_FLOAT32 },
                                             { SP_FLOAT64, SP_FLOAT64 } };
    static const double shown[][5] = { { 0, 1, 1, 1, 0.1 }, { FULL, 1, 1, 1, 0.5 } };
    for (size_t t = 0; t < sizeof types / sizeof types[0]; t++) {
        struct rig rig = make(types[t][0], even);
        test_scene_points(&rig.scene, shown, 2);
        rig.view = rig.scene.view;
        add_cuts(&rig);
        check_holes(&rig, types[t][1]);
        finish(&rig);
    }
}

/* So do they where the view shows values whatever their opacity is. */
static void views_of_all_values_have_holes(void **state) {
    (void)state;
    struct rig rig = make(SP_UINT8, even);
    const struct sp_view plain = rig.view;
    rig.view.compositing.mode = SP_COMPOSITE_MINIMUM;
    add_cuts(&rig);
    check_holes(&rig, SP_FLOAT32);

    rig.view = plain;
    rig.view.slices.mode = SP_SLICES_ORTHOGONAL;
    rig.view.slices.in_3d = rig.view.slices.planes[0] = true;
    add_cuts(&rig);
    check_holes(&rig, SP_FLOAT32);

    rig.view = plain;
    rig.view.layers[rig.view.layer_count++] = sp_layer_default(SP_LAYER_SURFACE);
    rig.view.layers[rig.view.layer_count - 1].value = 0; /* below it nothing is transparent */
    add_cuts(&rig);
    check_holes(&rig, SP_FLOAT32);

    for (int i = 0; i < 2; i++) { /* the surface closes the cut, also without the volume */
        rig.view.layers[rig.view.layer_count - 1].value = 100;
        struct sp_volume *edited = sp_edit_volume(rig.volume, &rig.view, NULL);
        assert_int_equal(sp_volume_info(edited)->type, SP_UINT8);
        assert_compare(value_at(edited, N - 1, 0, 0), ==, 0);
        sp_volume_unref(&edited);
        rig.view.transfer_function.points[0].opacity = 1;
        rig.view.layers[0] = rig.view.layers[--rig.view.layer_count];
    }
    finish(&rig);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(without_edits_the_volume_is_itself),
        cmocka_unit_test(a_part_is_removed_or_kept),
        cmocka_unit_test(nothing_of_a_removed_part_is_left),
        cmocka_unit_test(cutting_the_bridge_parts_the_balls),
        cmocka_unit_test(the_last_result_is_remembered),
        cmocka_unit_test(cuts_remove_their_volume),
        cmocka_unit_test(samples_that_are_not_finite_stay),
        cmocka_unit_test(without_a_transparent_value_samples_become_nan),
        cmocka_unit_test(views_of_all_values_have_holes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
