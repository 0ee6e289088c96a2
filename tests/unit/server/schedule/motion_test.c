/* SPDX-License-Identifier: Apache-2.0
 *
 * The speed of the image: of turns, pans, zooms and rolls of the camera, in virtual time.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "schedule/motion.h"
#include "support/compare.h"

#define UPDATE_MS (1000.0 / 60)

enum move { TURN, PAN, ZOOM, ROLL };

/* Returns the camera after `s` seconds: a turn or roll by half a radian per second, a pan by a
 * third of the image, or a zoom by a factor of 1.5. */
static struct sp_camera camera_at(enum move move, enum sp_projection projection, double s) {
    struct sp_camera c = { .projection = projection,
                           .position = { 0, 0, 10 },
                           .up = { 0, 1, 0 },
                           .fov_y = 30,
                           .height = 5,
                           .near = 0.1 };
    switch (move) {
    case TURN:
        c.position[0] = 10 * sin(0.5 * s);
        c.position[2] = 10 * cos(0.5 * s);
        break;
    case PAN:
        c.position[0] = c.target[0] = 5.0 / 3 * s;
        break;
    case ZOOM:
        c.position[2] = 10 * pow(1.5, -s);
        c.height = 5 * pow(1.5, -s);
        break;
    case ROLL:
        c.up[0] = sin(0.5 * s);
        c.up[1] = cos(0.5 * s);
        break;
    }
    return c;
}

static struct srv_speed speed_of(enum move move, enum sp_projection projection, double rate) {
    struct srv_motion motion = { .at_ms = 0 };
    struct srv_speed speed;
    for (int i = 0; i < 60; i++) {
        const struct sp_camera c = camera_at(move, projection, rate * i / 60);
        srv_motion_update(&motion, &c, 1000 + i * UPDATE_MS);
    }
    assert_true(srv_motion_speed(&motion, 2000, &speed));
    return speed;
}

static void turns_pans_zooms_and_rolls_have_a_speed(void **state) {
    (void)state;
    static const double least[] = { 0.07, 0.3, 0.06, 0.08 }, most[] = { 0.15, 0.4, 0.15, 0.15 };
    for (int move = TURN; move <= ROLL; move++)
        for (int p = SP_PERSPECTIVE; p <= SP_ORTHOGRAPHIC; p++) {
            const struct srv_speed s = speed_of((enum move)move, (enum sp_projection)p, 1);
            const struct srv_speed twice = speed_of((enum move)move, (enum sp_projection)p, 2);
            assert_compare(s.motion, >=, least[move]);
            assert_compare(s.motion, <=, most[move]);
            if (move != ZOOM) /* which is nearer then, and so faster */
                assert_float_equal(twice.motion, 2 * s.motion, 0.1 * s.motion);
        }
}

static void only_a_turn_has_much_parallax(void **state) {
    (void)state;
    for (int p = SP_PERSPECTIVE; p <= SP_ORTHOGRAPHIC; p++) {
        const enum sp_projection projection = (enum sp_projection)p;
        struct srv_speed s = speed_of(TURN, projection, 1);
        assert_compare(s.parallax, >=, 0.7 * s.motion);
        for (int move = PAN; move <= ROLL; move++) {
            s = speed_of((enum move)move, projection, 1);
            assert_compare(s.parallax, <=, (projection == SP_PERSPECTIVE ? 0.3 : 0.01) * s.motion);
        }
    }
}

static void other_changes_of_the_view_have_no_speed(void **state) {
    (void)state;
    struct srv_motion motion = { .at_ms = 0 };
    struct srv_speed speed;
    struct sp_camera c = camera_at(TURN, SP_PERSPECTIVE, 0);
    for (int i = 0; i < 10; i++)
        srv_motion_update(&motion, &c, 1000 + i * UPDATE_MS);
    assert_false(srv_motion_speed(&motion, 1160, &speed));
    c = camera_at(TURN, SP_PERSPECTIVE, 0.1); /* after a pause, its time tells no speed */
    srv_motion_update(&motion, &c, 5000);
    assert_true(srv_motion_speed(&motion, 5000, &speed));
    assert_compare(speed.motion, ==, SRV_MOTION_NOMINAL.motion);
    assert_false(srv_motion_speed(&motion, 5300, &speed));
}

/* Updates that arrive together, as after a delay of the network, give no higher speed. */
static void updates_in_bunches_have_the_same_speed(void **state) {
    (void)state;
    struct srv_motion motion = { .at_ms = 0 };
    struct srv_speed speed;
    const struct srv_speed even = speed_of(TURN, SP_PERSPECTIVE, 1);
    for (int i = 0; i < 60; i++) {
        const struct sp_camera c = camera_at(TURN, SP_PERSPECTIVE, i / 60.0);
        srv_motion_update(&motion, &c, 1000 + i / 4 * 4 * UPDATE_MS);
    }
    assert_true(srv_motion_speed(&motion, 2000, &speed));
    assert_float_equal(speed.motion, even.motion, 0.1 * even.motion);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(turns_pans_zooms_and_rolls_have_a_speed),
        cmocka_unit_test(only_a_turn_has_much_parallax),
        cmocka_unit_test(other_changes_of_the_view_have_no_speed),
        cmocka_unit_test(updates_in_bunches_have_the_same_speed),
    };
    return cmocka_run_group_tests_name("schedule/motion", tests, NULL, NULL);
}
