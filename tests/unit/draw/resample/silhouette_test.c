/* SPDX-License-Identifier: Apache-2.0
 *
 * The silhouettes of random boxes that planes cut: a ray meets the box exactly if its pixel is
 * inside all sides.
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

#include "draw/resample/silhouette.h"

enum { SIZE = 64, CAMERAS = 400, POINTS = 300 };

/* In [-1, 1]. */
static double random_number(uint64_t *state) {
    *state = *state * 6364136223846793005u + 1442695040888963407u;
    return (double)(*state >> 33) / 1073741824.0 - 1;
}

static void normalise(double v[3]) {
    const double length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    for (int a = 0; a < 3; a++)
        v[a] /= length;
}

static double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const double a[3], const double b[3], double out[3]) {
    for (int i = 0; i < 3; i++)
        out[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

static void add_half(struct sp_resample *r, const double normal[3], double offset) {
    struct sp_resample_half *half = &r->halves[r->half_count++];
    *half = (struct sp_resample_half){ .offset = offset };
    memcpy(half->normal, normal, sizeof half->normal);
}

/* A box of ±1, its near plane, and up to three planes through places in it. */
static void init_halves(struct sp_resample *r, uint64_t *state) {
    double forward[3];
    for (int h = 0; h < 6; h++)
        add_half(r,
                 (double[]){ (h / 2 == 0) * (h & 1 ? -1 : 1), (h / 2 == 1) * (h & 1 ? -1 : 1),
                             (h / 2 == 2) * (h & 1 ? -1 : 1) },
                 -1);
    memcpy(forward, r->ray, sizeof forward);
    add_half(r, forward, dot(forward, r->eye) + 0.05);
    for (int k = (int)(2 + 2 * random_number(state)); k > 0; k--) {
        double normal[3], offset = 0;
        for (int a = 0; a < 3; a++)
            normal[a] = random_number(state);
        normalise(normal);
        for (int a = 0; a < 3; a++)
            offset += normal[a] * 0.5 * random_number(state);
        add_half(r, normal, offset);
    }
}

/* A camera that looks at the box from outside, or, every fourth one, from inside of it. */
static void init_camera(struct sp_resample *r, struct sp_camera_transform *camera, int number,
                        uint64_t *state) {
    const double distance = number % 4 == 3 ? 0.6 : 5;
    double up[3];
    for (int a = 0; a < 3; a++) {
        r->ray[a] = random_number(state);
        up[a] = random_number(state);
    }
    normalise(r->ray);
    cross(r->ray, up, r->right);
    normalise(r->right);
    cross(r->ray, r->right, r->down);
    camera->projection = number & 1 ? SP_PERSPECTIVE : SP_ORTHOGRAPHIC;
    camera->centre[0] = camera->centre[1] = SIZE / 2.0;
    camera->scale = number & 1 ? 70 : 17;
    for (int a = 0; a < 3; a++) {
        r->eye[a] = r->start[a] = 0.3 * random_number(state) - distance * r->ray[a];
        r->right[a] /= camera->scale;
        r->down[a] /= camera->scale;
    }
    r->camera = camera;
}

static bool meets(const struct sp_resample *r, double x, double y) {
    const bool is_perspective = r->camera->projection == SP_PERSPECTIVE;
    double start[3], along[3], begin = -INFINITY, end = INFINITY;
    for (int a = 0; a < 3; a++) {
        const double aside = (x - SIZE / 2.0) * r->right[a] + (y - SIZE / 2.0) * r->down[a];
        start[a] = r->eye[a] + (is_perspective ? 0 : aside);
        along[a] = r->ray[a] + (is_perspective ? aside : 0);
    }
    for (uint32_t h = 0; h < r->half_count; h++) {
        const double rise = dot(r->halves[h].normal, along);
        const double t = (r->halves[h].offset - dot(r->halves[h].normal, start)) / rise;
        begin = rise > 0 ? fmax(begin, t) : begin;
        end = rise < 0 ? fmin(end, t) : end;
    }
    return begin < end;
}

static void rays_meet_the_volume_inside_all_sides(void **state) {
    uint64_t seed = 7;
    int inside = 0, outside = 0, sides = 0;
    (void)state;
    for (int k = 0; k < CAMERAS; k++) {
        struct sp_camera_transform camera = { 0 };
        struct sp_frame frame = { .width = SIZE, .height = SIZE };
        struct sp_resample r = { .frame = &frame };
        struct sp_silhouette silhouette;
        int met = 0, missed = 0;
        init_camera(&r, &camera, k, &seed);
        init_halves(&r, &seed);
        sp_silhouette_init(&silhouette, &r);
        sides += silhouette.count;
        for (int i = 0; i < POINTS; i++) {
            const double x = (random_number(&seed) + 1) * SIZE / 2;
            const double y = (random_number(&seed) + 1) * SIZE / 2;
            const bool is_met = meets(&r, x, y);
            double least = INFINITY;
            for (int s = 0; s < silhouette.count; s++) {
                const double *line = silhouette.line[s];
                assert_float_equal(hypot(line[0], line[1]), 1, 1e-9);
                least = fmin(least, line[0] * x + line[1] * y + line[2]);
            }
            met += is_met;
            missed += !is_met;
            if (silhouette.count && fabs(least) > 1e-6)
                assert_int_equal(is_met, least > 0);
        }
        if (silhouette.count == 0) /* all pixels see the volume, or none */
            assert_int_equal(met * missed, 0);
        inside += met;
        outside += missed;
    }
    printf("%d sides; %d rays inside, %d outside\n", sides, inside, outside);
    assert_true(sides > 3 * CAMERAS);
    assert_true(inside > CAMERAS * POINTS / 10);
    assert_true(outside > CAMERAS * POINTS / 10);
}

/* A box that is seen along its edges has four sides, and its pixels' sides are where they belong.
 */
static void a_box_seen_along_its_edges_has_four_sides(void **state) {
    (void)state;
    struct sp_camera_transform camera = { .projection = SP_ORTHOGRAPHIC,
                                          .scale = 20,
                                          .centre = { SIZE / 2.0, SIZE / 2.0 } };
    struct sp_frame frame = { .width = SIZE, .height = SIZE };
    struct sp_resample r = { .frame = &frame,
                             .camera = &camera,
                             .ray = { 0, 0, 1 },
                             .right = { 1 / 20.0, 0, 0 },
                             .down = { 0, 1 / 20.0, 0 },
                             .eye = { 0, 0, -5 },
                             .start = { 0, 0, -5 } };
    struct sp_silhouette silhouette, joined;
    uint64_t seed = 1;
    init_halves(&r, &seed);
    r.half_count = 7;
    sp_silhouette_init(&silhouette, &r);
    assert_int_equal(silhouette.count, 4);
    for (int i = 0; i < 4; i++) {
        const double *line = silhouette.line[i];
        assert_float_equal(line[0] * SIZE / 2 + line[1] * SIZE / 2 + line[2], 20, 1e-9);
        assert_float_equal(fabs(line[0]) + fabs(line[1]), 1, 1e-9);
    }
    assert_true(sp_silhouette_is_equal(&silhouette, &silhouette));
    r.halves[1].is_joint = true;
    sp_silhouette_init(&joined, &r);
    assert_int_equal(joined.count, 3);
    assert_false(sp_silhouette_is_equal(&silhouette, &joined));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rays_meet_the_volume_inside_all_sides),
        cmocka_unit_test(a_box_seen_along_its_edges_has_four_sides),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
