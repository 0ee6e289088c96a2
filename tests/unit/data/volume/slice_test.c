/* SPDX-License-Identifier: Apache-2.0
 *
 * Slices against fields that linear interpolation reproduces exactly, on every kind of grid.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "data/volume/grid.h"
#include "sp/slice.h"
#include "sp/view.h"
#include "support/compare.h"

enum { NX = 9, NY = 7, NZ = 5, COUNT = NX * NY * NZ };

static const double field[4] = { 0.7, -1.3, 2.1, 5 };

static double field_at(const double world[3]) {
    return field[0] * world[0] + field[1] * world[1] + field[2] * world[2] + field[3];
}

static void sample_position(const struct sp_grid *grid, const uint32_t i[3], double world[3]) {
    for (int r = 0; r < 3; r++) {
        world[r] = grid->origin[r];
        for (unsigned a = 0; a < 3; a++)
            world[r] += grid->direction[r][a] * sp_grid_distance(grid, a, i[a]);
    }
}

/* A volume of the linear field. */
static struct sp_volume *make_linear(const struct sp_grid *grid) {
    double values[COUNT];
    for (uint32_t i = 0; i < COUNT; i++) {
        double world[3];
        sample_position(grid, (uint32_t[3]){ i % NX, i / NX % NY, i / NX / NY }, world);
        values[i] = field_at(world);
    }
    struct sp_error err;
    struct sp_volume *volume = sp_volume_create(grid, SP_FLOAT64, values, "linear", &err);
    if (!volume)
        fail_msg("%s", err.text);
    return volume;
}

static struct sp_grid plain_grid(void) {
    return (struct sp_grid){ .dims = { NX, NY, NZ },
                             .spacing = { 1, 1, 1 },
                             .direction = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } } };
}

/* Anisotropic, turned about z, mirrored and off the origin. */
static struct sp_grid turned_grid(void) {
    struct sp_grid grid = { .dims = { NX, NY, NZ },
                            .spacing = { 0.4, 1.1, 3 },
                            .origin = { -20, 5, 100 },
                            .direction = { { 0.6, 0.8, 0 }, { 0.8, -0.6, 0 }, { 0, 0, -1 } } };
    return grid;
}

static const double steps_x[NX] = { 0, 0.5, 1, 1.5, 2, 3, 4.5, 7, 11 };
static const double steps_z[NZ] = { 0, 2, 3, 3.5, 8 };

static struct sp_grid rectilinear_grid(void) {
    struct sp_grid grid = turned_grid();
    grid.coordinates[0] = steps_x;
    grid.coordinates[2] = steps_z;
    grid.spacing[0] = 11.0 / (NX - 1);
    grid.spacing[2] = 8.0 / (NZ - 1);
    return grid;
}

static void pixel_position(const struct sp_slice *s, uint32_t column, uint32_t row,
                           double world[3]) {
    for (int r = 0; r < 3; r++)
        world[r] = s->origin[r] + column * s->step[0][r] + row * s->step[1][r];
}

/* True if the world position lies between the first and the last sample of every axis, with a
 * `margin` in world units: positive = further inside, negative = also outside. */
static bool is_between_samples(const struct sp_grid *grid, const double world[3], double margin) {
    /* The columns of all directions here are orthonormal, so the inverse is the transpose. */
    for (unsigned a = 0; a < 3; a++) {
        double distance = 0, last = sp_grid_distance(grid, a, grid->dims[a] - 1);
        for (int r = 0; r < 3; r++)
            distance += grid->direction[r][a] * (world[r] - grid->origin[r]);
        if (distance < margin || distance > last - margin)
            return false;
    }
    return true;
}

static void check_oblique(const struct sp_grid *grid) {
    struct sp_volume *volume = make_linear(grid);
    const struct sp_volume_info *info = sp_volume_info(volume);
    double centre[3], *values = malloc(90 * 70 * sizeof *values);
    struct sp_slice slice;
    sample_position(grid, (uint32_t[3]){ NX / 2, NY / 2, NZ / 2 }, centre);
    for (int turn = 0; turn < 12; turn++) {
        struct sp_slice_plane plane = { .normal = { cos(turn), sin(turn * 0.7), sin(turn) },
                                        .size = { 90, 70 },
                                        .spacing = 0.17 };
        memcpy(plane.origin, centre, sizeof centre);
        int inside = 0, outside = 0;
        assert_true(sp_slice_init_oblique(&slice, info, &plane, NULL));
        assert_int_equal(slice.type, SP_FLOAT64);
        sp_slice_sample(volume, &slice, values);
        for (uint32_t row = 0; row < 70; row++)
            for (uint32_t column = 0; column < 90; column++) {
                double world[3], value = values[row * 90 + column];
                pixel_position(&slice, column, row, world);
                if (is_between_samples(grid, world, 1e-6)) {
                    assert_compare(fabs(value - field_at(world)), <, 1e-9);
                    inside++;
                } else if (!is_between_samples(grid, world, -6)) {
                    assert_true(isnan(value));
                    outside++;
                }
            }
        assert_compare(inside, >, 100);
        (void)outside;
    }
    free(values);
    sp_volume_unref(&volume);
}

static void oblique_slices_of_a_linear_field_are_exact(void **state) {
    (void)state;
    const struct sp_grid grids[] = { plain_grid(), turned_grid(), rectilinear_grid() };
    for (int i = 0; i < 3; i++)
        check_oblique(&grids[i]);
}

static void an_oblique_slice_lies_where_it_says(void **state) {
    (void)state;
    const struct sp_grid grid = plain_grid();
    struct sp_volume *volume = make_linear(&grid);
    struct sp_slice s;
    struct sp_slice_plane plane = {
        .origin = { 1, 2, 3 }, .normal = { 0, -4, 0 }, .size = { 3, 5 }, .spacing = 0.5
    };
    assert_true(sp_slice_init_oblique(&s, sp_volume_info(volume), &plane, NULL));
    /* From the front (low y) with z up, x points to the right. */
    const double origin[3] = { 0.5, 2, 4 }, right[3] = { 0.5, 0, 0 }, down[3] = { 0, 0, -0.5 };
    for (int r = 0; r < 3; r++) {
        assert_compare(fabs(s.origin[r] - origin[r]), <, 1e-12);
        assert_compare(fabs(s.step[0][r] - right[r]), <, 1e-12);
        assert_compare(fabs(s.step[1][r] - down[r]), <, 1e-12);
    }
    plane.up[0] = -1;
    assert_true(sp_slice_init_oblique(&s, sp_volume_info(volume), &plane, NULL));
    assert_compare(fabs(s.step[1][0] - 0.5), <, 1e-12); /* down is +x */
    assert_compare(fabs(s.step[0][2] - 0.5), <, 1e-12); /* right is +z */
    sp_volume_unref(&volume);
}

/* Samples of every type come through unchanged, also with NaN beside them. */
static void orthogonal_slices_are_samples(void **state) {
    (void)state;
    const struct sp_grid grid = turned_grid();
    double wide[COUNT];
    for (enum sp_type type = 0; type < SP_TYPE_COUNT; type++) {
        size_t bytes = sp_type_size(type);
        unsigned char values[COUNT * sizeof(double)] = { 0 }, out[NX * NY * sizeof(double)];
        for (size_t i = 0; i < COUNT * bytes; i++)
            values[i] = (unsigned char)(i * 37 % 101); /* finite in every type */
        struct sp_volume *volume = sp_volume_create(&grid, type, values, "samples", NULL);
        struct sp_slice s;
        for (uint32_t axis = 0; axis < 3; axis++)
            for (uint32_t index = 0; index < grid.dims[axis]; index++) {
                assert_true(
                    sp_slice_init_orthogonal(&s, sp_volume_info(volume), axis, index, NULL));
                assert_int_equal(s.type, type);
                assert_int_equal(s.size[0], grid.dims[axis == 0 ? 1 : 0]);
                assert_int_equal(s.size[1], grid.dims[axis == 2 ? 1 : 2]);
                sp_slice_sample(volume, &s, out);
                for (uint32_t row = 0; row < s.size[1]; row++)
                    for (uint32_t column = 0; column < s.size[0]; column++) {
                        uint32_t i[3] = { 0 };
                        i[axis] = index;
                        i[axis == 0 ? 1 : 0] = column;
                        i[axis == 2 ? 1 : 2] = row;
                        double world[3], there[3];
                        sample_position(&grid, i, world);
                        pixel_position(&s, column, row, there);
                        for (int r = 0; r < 3; r++)
                            assert_compare(fabs(world[r] - there[r]), <, 1e-9);
                        assert_memory_equal(out + (row * s.size[0] + column) * bytes,
                                            values + ((i[2] * NY + i[1]) * NX + i[0]) * bytes,
                                            bytes);
                    }
            }
        sp_volume_unref(&volume);
    }
    for (int i = 0; i < COUNT; i++)
        wide[i] = i % 2 ? NAN : i;
    struct sp_volume *volume = sp_volume_create(&grid, SP_FLOAT64, wide, "holes", NULL);
    struct sp_slice s;
    double out[NX * NY];
    assert_true(sp_slice_init_orthogonal(&s, sp_volume_info(volume), 2, 1, NULL));
    sp_slice_sample(volume, &s, out);
    for (int i = 0; i < NX * NY; i++)
        if ((i + NX * NY) % 2)
            assert_true(isnan(out[i]));
        else
            assert_compare(out[i], ==, i + NX * NY);
    sp_volume_unref(&volume);
}

static void rectilinear_axes_become_even(void **state) {
    (void)state;
    const struct sp_grid grid = rectilinear_grid();
    struct sp_volume *volume = make_linear(&grid);
    struct sp_slice s;
    double values[64 * 64];
    assert_true(sp_slice_init_orthogonal(&s, sp_volume_info(volume), 1, 2, NULL));
    assert_int_equal(s.size[0], 23); /* 11 in steps of 0.5 */
    assert_int_equal(s.size[1], 17); /* 8 in steps of 0.5 */
    sp_slice_sample(volume, &s, values);
    for (uint32_t row = 0; row < s.size[1]; row++)
        for (uint32_t column = 0; column < s.size[0]; column++) {
            double world[3];
            pixel_position(&s, column, row, world);
            assert_compare(fabs(values[row * s.size[0] + column] - field_at(world)), <, 1e-9);
        }
    /* Along a rectilinear axis the slice lies at the sample. */
    assert_true(sp_slice_init_orthogonal(&s, sp_volume_info(volume), 2, 3, NULL));
    double world[3];
    sample_position(&grid, (uint32_t[3]){ 0, 0, 3 }, world);
    for (int r = 0; r < 3; r++)
        assert_compare(fabs(s.origin[r] - world[r]), <, 1e-9);
    sp_volume_unref(&volume);
}

static void a_long_axis_is_reduced(void **state) {
    (void)state;
    enum { LONG = 5000 };
    struct sp_grid grid = plain_grid();
    grid.dims[0] = LONG;
    grid.dims[1] = 2;
    grid.dims[2] = 1;
    uint16_t values[2 * LONG];
    for (int i = 0; i < 2 * LONG; i++)
        values[i] = (uint16_t)(i % LONG);
    struct sp_volume *volume = sp_volume_create(&grid, SP_UINT16, values, "long", NULL);
    struct sp_slice s;
    float out[2 * SP_SLICE_SIDE_MAX];
    assert_true(sp_slice_init_orthogonal(&s, sp_volume_info(volume), 2, 0, NULL));
    assert_int_equal(s.size[0], SP_SLICE_SIDE_MAX);
    assert_int_equal(s.size[1], 2);
    assert_int_equal(s.type, SP_FLOAT32);
    sp_slice_sample(volume, &s, out);
    assert_compare(out[0], ==, 0);
    assert_compare(out[SP_SLICE_SIDE_MAX - 1], ==, LONG - 1);
    double step = (LONG - 1.0) / (SP_SLICE_SIDE_MAX - 1);
    assert_compare(fabs((double)out[SP_SLICE_SIDE_MAX + 1] - step), <, 1e-3);
    sp_volume_unref(&volume);
}

/* A cell reaches half a gap beyond its sample, with the sample's value. */
static void borders_hold_their_value(void **state) {
    (void)state;
    const struct sp_grid grid = plain_grid();
    struct sp_volume *volume = make_linear(&grid);
    struct sp_slice s;
    double values[5];
    const struct sp_slice_plane plane = {
        .origin = { -0.5, 3, 2 }, .normal = { 0, 0, 1 }, .size = { 5, 1 }, .spacing = 0.25
    };
    assert_true(sp_slice_init_oblique(&s, sp_volume_info(volume), &plane, NULL));
    sp_slice_sample(volume, &s, values);
    assert_true(isnan(values[0])); /* x = −1, −0.75, −0.5, −0.25, 0 */
    assert_true(isnan(values[1]));
    for (int i = 2; i < 5; i++)
        assert_compare(fabs(values[i] - field_at((double[3]){ 0, 3, 2 })), <, 1e-9);
    sp_volume_unref(&volume);
}

static void a_window_makes_grey(void **state) {
    (void)state;
    struct sp_grid grid = plain_grid();
    grid.dims[0] = 5;
    grid.dims[1] = grid.dims[2] = 1;
    const float values[5] = { -1, 10, 20, 30, NAN };
    struct sp_volume *volume = sp_volume_create(&grid, SP_FLOAT32, values, "five", NULL);
    struct sp_slice s;
    assert_true(sp_slice_init_orthogonal(&s, sp_volume_info(volume), 2, 0, NULL));
    struct sp_frame_pool *pool = sp_frame_pool_create(0, NULL);
    struct sp_frame *frame = sp_frame_create(pool, 5, 1, SP_RGBA8, NULL);
    sp_slice_draw(volume, &s, (double[2]){ 15, 20 }, NULL, frame);
    const uint8_t expected[20] = { 0,   0,   0,   255, 64,  64,  64, 255, 191, 191,
                                   191, 255, 255, 255, 255, 255, 0,  0,   0,   0 };
    assert_memory_equal(frame->pixels, expected, sizeof expected);
    assert_false(frame->is_opaque);
    const struct sp_transfer_function colors = {
        .point_count = 3,
        .points = { { 0, { 1, 0, 0 }, 0 }, { 20, { 0, 1, 0 }, 0.5f }, { 25, { 0, 0, 1 }, 0 } }
    };
    sp_slice_draw(volume, &s, (double[2]){ 0, 0 }, &colors, frame);
    const uint8_t colored[20] = { 255, 0,   0, 255, 128, 128, 0, 255, 0, 255,
                                  0,   255, 0, 0,   255, 255, 0, 0,   0, 0 };
    assert_memory_equal(frame->pixels, colored, sizeof colored);
    sp_frame_unref(&frame);
    sp_frame_pool_destroy(&pool);
    sp_volume_unref(&volume);
}

static void the_default_window_leaves_out_half_a_percent(void **state) {
    (void)state;
    struct sp_volume_info info = { .range = { 0, 256 } };
    double window[2];
    info.histogram[0] = 4;
    info.histogram[100] = 496;
    info.histogram[149] = 496;
    info.histogram[255] = 4;
    sp_slice_default_window(&info, window);
    assert_compare(window[0], ==, 125);
    assert_compare(window[1], ==, 50);
    const struct sp_volume_info one_value = { .range = { 7, 7 }, .histogram = { 12 } };
    sp_slice_default_window(&one_value, window);
    assert_compare(window[0], ==, 7);
    assert_compare(window[1], >, 0);
}

static void check_refused(const struct sp_volume_info *info, const struct sp_slice_plane *plane,
                          const char *place) {
    struct sp_slice s;
    struct sp_error err = { .code = SP_OK };
    assert_false(sp_slice_init_oblique(&s, info, plane, &err));
    assert_int_equal(err.code, SP_ERR_INVALID);
    assert_string_equal(err.place, place);
}

static void wrong_planes_are_refused(void **state) {
    (void)state;
    const struct sp_grid grid = plain_grid();
    struct sp_volume *volume = make_linear(&grid);
    const struct sp_volume_info *info = sp_volume_info(volume);
    const struct sp_slice_plane good = { .normal = { 0, 0, 1 }, .size = { 1, 1 } };
    struct sp_slice_plane p = good;
    struct sp_slice s;
    struct sp_error err;
    assert_true(sp_slice_init_oblique(&s, info, &good, NULL));
    p.normal[2] = 0;
    check_refused(info, &p, "normal");
    p = good;
    p.origin[1] = NAN;
    check_refused(info, &p, "origin");
    p = good;
    p.up[2] = -3;
    check_refused(info, &p, "up");
    p = good;
    p.size[1] = SP_SLICE_SIDE_MAX + 1;
    check_refused(info, &p, "size");
    p = good;
    p.spacing = -1;
    check_refused(info, &p, "spacing");
    assert_false(sp_slice_init_orthogonal(&s, info, 3, 0, &err));
    assert_string_equal(err.place, "axis");
    assert_false(sp_slice_init_orthogonal(&s, info, 2, NZ, &err));
    assert_string_equal(err.place, "index");
    assert_string_equal(err.text, "index 5 is outside [0, 4] along axis 2");
    sp_volume_unref(&volume);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(oblique_slices_of_a_linear_field_are_exact),
        cmocka_unit_test(an_oblique_slice_lies_where_it_says),
        cmocka_unit_test(orthogonal_slices_are_samples),
        cmocka_unit_test(rectilinear_axes_become_even),
        cmocka_unit_test(a_long_axis_is_reduced),
        cmocka_unit_test(borders_hold_their_value),
        cmocka_unit_test(a_window_makes_grey),
        cmocka_unit_test(the_default_window_leaves_out_half_a_percent),
        cmocka_unit_test(wrong_planes_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
