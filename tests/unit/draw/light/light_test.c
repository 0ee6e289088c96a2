/* SPDX-License-Identifier: Apache-2.0
 *
 * The field of light against rays that are marched through the volume.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "classify/transfer.h"
#include "data/volume/sample.h"
#include "draw/light/light.h"
#include "support/one_thread.h"
#include "support/sanitized.h"
#include "support/scene.h"

static const double reach = 0.1, light_radius = 0.07; /* of the view; as in light.c */

static const struct sp_light_kernels kernels = { sp_light_compute_cells, sp_light_pass,
                                                 sp_light_turn_in, sp_light_turn_out };

struct rig {
    struct test_scene scene;
    struct sp_volume *volume;
    struct sp_pool *pool;
    struct sp_light_cache cache;
    struct sp_light_job job;
    float direction[3];
};

/* A bowl, a ball above it and a thin plate beside it. */
static double things(const void *user, double x, double y, double z) {
    (void)user;
    double bowl = sqrt((x - 24) * (x - 24) + (y - 24) * (y - 24) + (z - 24) * (z - 24));
    double ball = sqrt((x - 24) * (x - 24) + (y - 24) * (y - 24) + (z - 26) * (z - 26));
    double value = y < 26 ? 220 * exp(-0.25 * (bowl - 18) * (bowl - 18)) : 0;
    value = fmax(value, 255 / (1 + exp(2 * (ball - 6))));
    return fmax(value, z < 34 ? 200 * exp(-0.25 * (x - 4) * (x - 4)) : 0);
}

static void open_rig(struct rig *rig, unsigned threads) {
    *rig = (struct rig){ .direction = { 0.36f, 0.8f, 0.48f } };
    const double spacing[3] = { 1, 1, 1.25 }, degrees[3] = { 20, 30, 10 };
    const double points[][5] = { { 60, 1, 1, 1, 0 }, { 120, 1, 1, 1, 0.4 }, { 200, 1, 1, 1, 0.7 } };
    test_view_init(&rig->scene.view);
    test_scene_points(&rig->scene, points, 3);
    assert_true(test_scene_voxels(&rig->scene, "things", (uint32_t[]){ 48, 47, 40 }, spacing,
                                  SP_UINT8, things, NULL));
    test_scene_direction(&rig->scene, degrees, 1, 0);
    rig->volume = test_scene_volume(&rig->scene, NULL);
    rig->pool = sp_pool_create(threads, NULL);
    assert_non_null(rig->volume);
    assert_non_null(rig->pool);
    struct sp_view *view = &rig->scene.view;
    view->shading = (struct sp_shading){ .mode = SP_SHADING_PHONG,
                                         .occlusion = 1,
                                         .shadow = 1,
                                         .reach = reach,
                                         .light_count = 1,
                                         .exponent = 24 };
    rig->job = (struct sp_light_job){ .volume = rig->volume,
                                      .view = view,
                                      .direction = rig->direction,
                                      .bytes_max = 1 << 24,
                                      .kernels = &kernels,
                                      .pool = rig->pool };
}

static void close_rig(struct rig *rig) {
    sp_light_evict(&rig->cache, NULL);
    sp_pool_destroy(&rig->pool);
    sp_volume_unref(&rig->volume);
    test_scene_finish(&rig->scene);
}

static struct sp_light_field get(struct rig *rig) {
    struct sp_light_field field;
    struct sp_error err = { 0 };
    if (!sp_light_get(&rig->cache, &rig->job, &field, &err))
        fail_msg("%s", err.text);
    return field;
}

static size_t cell_count(const struct sp_light_field *field) {
    return (size_t)field->dims[0] * (size_t)field->dims[1] * (size_t)field->dims[2];
}

/* The extinction at sample coordinates, from interpolated values [1/reference length]. */
static double extinction_at(const struct rig *rig, const double at[3]) {
    const uint32_t *dims = rig->scene.info.grid.dims;
    double value = 0;
    uint32_t low[3];
    double part[3];
    for (int a = 0; a < 3; a++) {
        if (at[a] < -0.5 || at[a] > dims[a] - 0.5)
            return 0;
        double x = fmin(fmax(at[a], 0), dims[a] - 1.0);
        low[a] = (uint32_t)fmin(x, dims[a] - 2.0);
        part[a] = x - low[a];
    }
    for (int k = 0; k < 8; k++) {
        double weight = 1;
        uint64_t i[3];
        for (int a = 0; a < 3; a++) {
            weight *= k >> a & 1 ? part[a] : 1 - part[a];
            i[a] = low[a] + (k >> a & 1);
        }
        value += weight *
                 sp_sample(rig->scene.voxels, SP_UINT8, (i[2] * dims[1] + i[1]) * dims[0] + i[0]);
    }
    struct sp_class class;
    sp_transfer_function_eval(&rig->scene.view.transfer_function, value, &class);
    const struct sp_view *view = &rig->scene.view;
    const struct sp_grid *grid = &rig->scene.info.grid;
    for (uint32_t p = 0; p < view->clip.plane_count; p++) {
        double dot = 0;
        for (int r = 0; r < 3; r++) {
            double world = grid->origin[r];
            for (int a = 0; a < 3; a++)
                world += grid->direction[r][a] * grid->spacing[a] * at[a];
            dot += view->clip.planes[p].normal[r] * world;
        }
        if (dot < view->clip.planes[p].offset)
            return 0;
    }
    return (double)class.depth;
}

/* 1 − A along a world direction from sample coordinates, from half a cell away on. */
static double march(const struct rig *rig, const double from[3], const double towards[3],
                    double fading) {
    const struct sp_grid *grid = &rig->scene.info.grid;
    double move[3], most = 0, step = 0.2, occluded = 0,
                    light = 1; /* the direction is orthonormal */
    for (int a = 0; a < 3; a++) {
        move[a] = 0;
        for (int r = 0; r < 3; r++)
            move[a] += grid->direction[r][a] * towards[r] / grid->spacing[a];
        most = fmax(most, fabs(move[a]));
    }
    double start = 0.5 / most;
    for (double s = start + step / 2; s < 90; s += step) {
        double at[3];
        for (int a = 0; a < 3; a++)
            at[a] = from[a] + s * move[a];
        double depth = extinction_at(rig, at) * step;
        occluded += light * -expm1(-depth) * exp(-s / fading);
        light *= exp(-depth);
    }
    return 1 - occluded;
}

/* The mean of A over the sphere, and the occlusion of the cosine hemispheres around both directions
 * of each axis of the world. */
static void compute_dark(const struct rig *rig, const double from[3], double dark[7]) {
    enum { COUNT = 150 };
    const struct sp_grid *grid = &rig->scene.info.grid;
    double diagonal = 0;
    memset(dark, 0, 7 * sizeof *dark);
    for (int a = 0; a < 3; a++)
        diagonal += pow(grid->dims[a] * grid->spacing[a], 2);
    for (int i = 0; i < COUNT; i++) { /* evenly along a spiral from pole to pole */
        double z = (2 * i + 1.0) / COUNT - 1, turn = i * 2.399963, r = sqrt(1 - z * z);
        const double d[3] = { r * cos(turn), r * sin(turn), z };
        double part = (1 - march(rig, from, d, reach * sqrt(diagonal))) / COUNT;
        dark[0] += part;
        for (int a = 0; a < 3; a++)
            dark[1 + 2 * a + (d[a] < 0)] += 4 * fabs(d[a]) * part;
    }
}

/* The same from the moments of a cell (light.h). */
static void read_dark(const struct sp_light_field *field, size_t cell, double dark[7]) {
    const uint32_t *words = field->moments[cell];
    double q[3];
    dark[0] = 1 - (field->cells[cell] & 255) / 255.0;
    for (int a = 0; a < 2; a++)
        q[a] = (words[a] >> (a ? 0 : 24) & 255) / (double)LIGHT_QUADRUPOLE -
               128 / (double)LIGHT_QUADRUPOLE;
    q[2] = -q[0] - q[1];
    for (int a = 0; a < 3; a++)
        for (int side = 0; side < 2; side++) {
            double d = ((words[0] >> 8 * a & 255) - 128.0) / (double)LIGHT_DIPOLE;
            dark[1 + 2 * a + side] = dark[0] + (side ? -2 : 2) * d + 15.0 / 8 * q[a];
        }
}

static double compute_lit(const struct rig *rig, const double from[3]) {
    enum { COUNT = 24 };
    const double d[3] = { (double)rig->direction[0], (double)rig->direction[1],
                          (double)rig->direction[2] };
    double u[3] = { d[1], -d[0], 0 }, v[3], length = hypot(d[0], d[1]), sum = 0;
    for (int a = 0; a < 3; a++)
        u[a] /= length;
    for (int a = 0; a < 3; a++)
        v[a] = d[(a + 1) % 3] * u[(a + 2) % 3] - d[(a + 2) % 3] * u[(a + 1) % 3];
    for (int i = 0; i < COUNT; i++) {
        double towards[3], turn = i * 2.399963, norm = 0, radius = sqrt((i + 0.5) / COUNT);
        for (int a = 0; a < 3; a++) {
            towards[a] = d[a] + light_radius * radius * (cos(turn) * u[a] + sin(turn) * v[a]);
            norm += towards[a] * towards[a];
        }
        for (int a = 0; a < 3; a++)
            towards[a] /= sqrt(norm);
        sum += march(rig, from, towards, INFINITY) / COUNT;
    }
    return sum;
}

struct errors {
    double square[3], most[3], weight; /* of the mean of A, the transmittance, and the occlusion of
                                          cosine hemispheres */
};

/* Compares every few cells; opaque cells count little, as in images. */
static struct errors compare(const struct rig *rig, const struct sp_light_field *field) {
    struct errors errors = { 0 };
    const unsigned every = TEST_SANITIZED ? 997 : 37;
    for (size_t i = 0; i < cell_count(field); i += every) {
        const size_t cell[3] = { i % (size_t)field->dims[0],
                                 i / (size_t)field->dims[0] % (size_t)field->dims[1],
                                 i / (size_t)field->dims[0] / (size_t)field->dims[1] };
        double from[3], clear = (field->cells[i] >> 16) / 255.0;
        for (int a = 0; a < 3; a++)
            from[a] = ((double)cell[a] - (double)field->first) / (double)field->per_sample;
        double dark[7], truth[7], error[8];
        compute_dark(rig, from, truth);
        read_dark(field, i, dark);
        for (int k = 0; k < 7; k++)
            error[k] = dark[k] - truth[k];
        error[7] = (field->cells[i] >> 8 & 255) / 255.0 - compute_lit(rig, from);
        for (int k = 0; k < 8; k++) {
            int c = k == 0 ? 0 : k == 7 ? 1 : 2;
            errors.square[c] += clear * error[k] * error[k] / (c == 2 ? 6 : 1);
            errors.most[c] = clear > 0.5 ? fmax(errors.most[c], fabs(error[k])) : errors.most[c];
        }
        errors.weight += clear;
    }
    return errors;
}

static void check_errors(const char *name, const struct errors *errors, const double limits[3]) {
    static const char *const names[] = { "mean of A", "transmittance", "cosine hemispheres" };
    for (int c = 0; c < 3; c++) {
        double rms = sqrt(errors->square[c] / errors->weight);
        print_message("%s: %s: RMS error %.4f, at most %.3f\n", name, names[c], rms,
                      errors->most[c]);
        if (!(rms <= (TEST_SANITIZED ? 2 : 1) * limits[c])) /* fewer cells are compared there */
            fail_msg("%s: RMS error %.4f is more than %.4f", name, rms, limits[c]);
    }
}

static void follows_rays(void **state) {
    const double limits[3] = { 0.0115, 0.055, 0.0135 };
    (void)state;
    struct rig rig;
    open_rig(&rig, 2);
    struct sp_light_field field = get(&rig);
    struct errors errors = compare(&rig, &field);
    check_errors("whole", &errors, limits);
    struct sp_clip *clip = &rig.scene.view.clip;
    clip->plane_count = 1;
    clip->planes[0] = (struct sp_clip_plane){ { 0.6, 0.8, 0 }, -4 };
    field = get(&rig);
    errors = compare(&rig, &field);
    check_errors("clipped", &errors, limits);
    close_rig(&rig);
}

static void does_not_depend_on_threads(void **state) {
    (void)state;
    struct rig one, many;
    open_rig(&one, 1);
    struct sp_light_field expected = get(&one);
    for (unsigned threads = 2; threads <= 5; threads += 3) {
        open_rig(&many, threads);
        struct sp_light_field field = get(&many);
        assert_memory_equal(field.cells, expected.cells, cell_count(&field) * sizeof *field.cells);
        assert_memory_equal(field.moments, expected.moments,
                            cell_count(&field) * sizeof *field.moments);
        close_rig(&many);
    }
    close_rig(&one);
}

static void is_cached_and_updated(void **state) {
    (void)state;
    struct rig rig;
    open_rig(&rig, 1);
    struct sp_light_field field = get(&rig);
    size_t bytes = cell_count(&field) * sizeof *field.cells;
    uint32_t *first = malloc(bytes);
    assert_non_null(first);
    memcpy(first, field.cells, bytes);
    rig.direction[0] = -0.36f;
    field = get(&rig);
    assert_int_not_equal(memcmp(first, field.cells, bytes), 0);
    rig.direction[0] = 0.36f;
    field = get(&rig);
    assert_memory_equal(first, field.cells, bytes);
    /* A shadow alone, then with occlusion, is as if both had been there from the start. */
    sp_light_evict(&rig.cache, NULL);
    assert_int_equal(sp_light_bytes(&rig.cache, NULL), 0);
    rig.scene.view.shading.occlusion = 0;
    field = get(&rig);
    for (size_t i = 0; i < cell_count(&field); i++)
        assert_int_equal(field.cells[i] & 255, 255);
    rig.scene.view.shading.occlusion = 0.5;
    field = get(&rig);
    assert_memory_equal(first, field.cells, bytes);
    assert_true(field.occlusion == 0.5f);
    /* Another reach makes other moments, and the first reach the first ones. */
    rig.scene.view.shading.reach = 2 * reach;
    field = get(&rig);
    assert_true(field.is_made);
    assert_int_not_equal(memcmp(first, field.cells, bytes), 0);
    rig.scene.view.shading.reach = reach;
    field = get(&rig);
    assert_memory_equal(first, field.cells, bytes);
    for (int i = 0; i < 2 * LIGHT_SLOTS; i++) { /* more transfer functions than slots */
        rig.scene.view.transfer_function.points[0].opacity = 0.01f * (float)(i + 1);
        get(&rig);
    }
    sp_light_evict(&rig.cache, rig.volume);
    assert_int_equal(sp_light_bytes(&rig.cache, rig.volume), 0);
    free(first);
    close_rig(&rig);
}

static void nothing_occludes_nothing(void **state) {
    (void)state;
    struct rig rig;
    open_rig(&rig, 1);
    for (int i = 0; i < 3; i++)
        rig.scene.view.transfer_function.points[i].opacity = 0;
    struct sp_light_field field = get(&rig);
    for (size_t i = 0; i < cell_count(&field); i++)
        assert_int_equal(field.cells[i], 0xffffff);
    rig.scene.view.transfer_function.points[2].opacity = 0.9f;
    rig.scene.view.clip.plane_count = 1;
    rig.scene.view.clip.planes[0] = (struct sp_clip_plane){ { 0, 1e200, 0 }, 1e203 };
    field = get(&rig);
    for (size_t i = 0; i < cell_count(&field); i++)
        assert_int_equal(field.cells[i], 0xffffff);
    close_rig(&rig);
}

static void bears_extreme_functions(void **state) {
    (void)state;
    struct rig rig;
    open_rig(&rig, 1);
    struct sp_transfer_function *tf = &rig.scene.view.transfer_function;
    const double lengths[3] = { 1e-300, 1, 1e300 };
    const double values[3][2] = { { -1e308, 1e308 }, { 0, 5e-324 }, { 100, 100 } };
    for (int l = 0; l < 3; l++)
        for (int v = 0; v < 3; v++) {
            tf->reference_length = lengths[l];
            tf->point_count = v == 2 ? 1 : 2;
            tf->points[0].value = values[v][0];
            tf->points[1].value = values[v][1];
            tf->points[0].opacity = 0.5f;
            tf->gradient_count = 1;
            tf->gradient[0] = (struct sp_gradient_point){ 1e308, 1 };
            struct sp_light_field field = get(&rig);
            const int *d = field.dims;
            uint32_t cell = field.cells[(d[2] / 2 * d[1] + d[1] / 2) * d[0] + d[0] / 2];
            assert_int_equal((cell & 255) == 255, l == 2);
            assert_int_equal(cell >> 8 & 255, l == 2 ? 255 : 0);
            for (size_t i = 0; i < cell_count(&field); i++)
                assert_in_range(field.cells[i] >> 16, 1, 255);
        }
    close_rig(&rig);
}

static void refuses_and_recovers(void **state) {
    (void)state;
    struct rig rig;
    struct sp_light_field field;
    struct sp_error err = { 0 };
    atomic_bool cancel = true;
    open_rig(&rig, 2);
    rig.job.bytes_max = 1000;
    assert_false(sp_light_get(&rig.cache, &rig.job, &field, &err));
    assert_int_equal(err.code, SP_ERR_BUDGET);
    rig.job.bytes_max = 1 << 24;
    rig.job.interrupt.cancel = &cancel;
    assert_false(sp_light_get(&rig.cache, &rig.job, &field, &err));
    assert_int_equal(err.code, SP_ERR_CANCELLED);
    rig.job.interrupt.cancel = NULL;
    get(&rig);
    close_rig(&rig);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        one_thread_test(follows_rays),
        cmocka_unit_test(does_not_depend_on_threads),
        one_thread_test(is_cached_and_updated),
        one_thread_test(nothing_occludes_nothing),
        one_thread_test(bears_extreme_functions),
        cmocka_unit_test(refuses_and_recovers),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
