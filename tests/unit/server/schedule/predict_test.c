/* SPDX-License-Identifier: Apache-2.0
 *
 * Where the camera will be, in virtual time.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "schedule/predict.h"
#include "support/compare.h"

#define UPDATE_MS (1000.0 / 60)
#define AHEAD_MS 150.0

enum move { TURN, PAN, ZOOM, ROLL, MOVES };

/* Returns the camera after `s` seconds. */
static struct sp_camera camera_at(enum move move, enum sp_projection projection, double s) {
    struct sp_camera c = { .projection = projection,
                           .position = { 1, 0, 10 },
                           .target = { 1, 0, 0 },
                           .up = { 0, 1, 0 },
                           .fov_y = 30,
                           .height = 5,
                           .near = 0.1 };
    switch (move) {
    case TURN:
        c.position[0] = 1 + 10 * sin(0.5 * s);
        c.position[2] = 10 * cos(0.5 * s);
        break;
    case PAN:
        c.position[0] = c.target[0] = 1 + 3 * s;
        break;
    case ZOOM: /* an orthographic camera keeps its distance */
        c.position[2] = projection == SP_PERSPECTIVE ? 10 * pow(1.5, -s) : 10;
        c.height = projection == SP_ORTHOGRAPHIC ? 5 * pow(1.5, -s) : 5;
        break;
    default:
        c.up[0] = sin(0.5 * s);
        c.up[1] = cos(0.5 * s);
    }
    return c;
}

static double distance(const struct sp_camera *a, const struct sp_camera *b) {
    double sum = (a->height - b->height) * (a->height - b->height);
    for (int i = 0; i < 3; i++)
        sum += pow(a->position[i] - b->position[i], 2) + pow(a->target[i] - b->target[i], 2) +
               pow(a->up[i] - b->up[i], 2);
    return sqrt(sum);
}

static void even_motion_goes_on(void **state) {
    (void)state;
    for (int move = TURN; move < MOVES; move++)
        for (int p = SP_PERSPECTIVE; p <= SP_ORTHOGRAPHIC; p++) {
            struct srv_past past = { .count = 0 };
            struct sp_camera c, predicted;
            double s = 0;
            for (int i = 0; i < 40; i++) {
                s = i * UPDATE_MS / 1000;
                c = camera_at((enum move)move, (enum sp_projection)p, s);
                srv_past_add(&past, &c, 5000 + i * UPDATE_MS);
            }
            assert_true(srv_predict(&past, 5000 + 40 * UPDATE_MS, AHEAD_MS, &predicted));
            const struct sp_camera truth =
                camera_at((enum move)move, (enum sp_projection)p, s + AHEAD_MS / 1000);
            assert_compare(distance(&predicted, &truth), <, 1e-6);
            assert_compare(distance(&c, &truth), >, 0.05);
        }
}

/* With a pause of some frames in between, so that the cameras before it tell no speed. */
static void a_camera_that_rests_stays(void **state) {
    (void)state;
    struct srv_past past = { .count = 0 };
    struct sp_camera predicted;
    assert_false(srv_predict(&past, 0, AHEAD_MS, &predicted));
    const struct sp_camera first = camera_at(TURN, SP_PERSPECTIVE, 0);
    srv_past_add(&past, &first, 1000);
    assert_false(srv_predict(&past, 1010, AHEAD_MS, &predicted));
    assert_float_equal(distance(&predicted, &first), 0, 0);
    for (int i = 1; i < 10; i++) {
        const struct sp_camera c = camera_at(TURN, SP_PERSPECTIVE, i * UPDATE_MS / 1000);
        srv_past_add(&past, &c, 1000 + i * UPDATE_MS);
    }
    assert_true(srv_predict(&past, 1000 + 10 * UPDATE_MS, AHEAD_MS, &predicted));
    assert_false(srv_predict(&past, 1000 + 20 * UPDATE_MS, AHEAD_MS, &predicted));
    assert_false(srv_predict(&past, 1000 + 10 * UPDATE_MS, 0, &predicted));
    for (int i = 0; i < 8; i++) /* a slider changes, and the camera does not */
        srv_past_add(&past, &first, 3000 + i * UPDATE_MS);
    assert_false(srv_predict(&past, 3000 + 8 * UPDATE_MS, AHEAD_MS, &predicted));
    srv_past_clear(&past);
    assert_false(srv_predict(&past, 3000 + 8 * UPDATE_MS, AHEAD_MS, &predicted));
}

static void another_projection_is_no_motion(void **state) {
    (void)state;
    for (int what = 0; what < 2; what++) {
        struct srv_past past = { .count = 0 };
        struct sp_camera c = camera_at(TURN, SP_PERSPECTIVE, 0), predicted;
        srv_past_add(&past, &c, 1000);
        if (what == 0)
            c.projection = SP_ORTHOGRAPHIC;
        else
            c.fov_y = 40;
        srv_past_add(&past, &c, 1040);
        assert_false(srv_predict(&past, 1050, AHEAD_MS, &predicted));
    }
}

/* A jump of the camera within a few milliseconds would send it anywhere. */
static void a_prediction_does_not_go_far(void **state) {
    (void)state;
    for (int move = TURN; move < MOVES; move++) {
        struct srv_past past = { .count = 0 };
        struct sp_camera c = camera_at((enum move)move, SP_PERSPECTIVE, 0), predicted;
        srv_past_add(&past, &c, 1000);
        c = camera_at((enum move)move, SP_PERSPECTIVE, 2);
        srv_past_add(&past, &c, 1030);
        assert_true(srv_predict(&past, 1040, 1000, &predicted));
        assert_compare(distance(&predicted, &c), >, 0.1);
        assert_compare(distance(&predicted, &c), <, 0.45 * 10);
    }
}

/* Cameras of an eye at its own target, or that looks along its up vector, have no direction. */
static void a_camera_without_direction_stays(void **state) {
    (void)state;
    struct srv_past past = { .count = 0 };
    struct sp_camera c = camera_at(TURN, SP_PERSPECTIVE, 0), predicted;
    srv_past_add(&past, &c, 1000);
    c.up[0] = c.up[1] = 0;
    c.up[2] = 1;
    srv_past_add(&past, &c, 1040);
    assert_false(srv_predict(&past, 1050, AHEAD_MS, &predicted));
}

/* A hand that swings to and fro, as smoothly as hands do (Flash and Hogan 1985): the prediction is
 * nearer to where the camera will be than the newest camera is, although updates arrive in bunches
 * and the hand turns back. */
static void a_swinging_hand_is_predicted_better_than_not(void **state) {
    (void)state;
    struct srv_past past = { .count = 0 };
    double with = 0, without = 0, stop_with = 0, stop_without = 0;
    for (int i = 0; i < 600; i++) {
        double angle[2]; /* now, and when the frame is displayed */
        for (int k = 0; k < 2; k++) {
            const double s = (i * UPDATE_MS + k * AHEAD_MS) / 1000, u = fmod(s, 1);
            const double part = u * u * u * (10 - 15 * u + 6 * u * u);
            angle[k] = (int)s % 2 ? 1 - part : part;
        }
        const struct sp_camera now = camera_at(TURN, SP_PERSPECTIVE, angle[0]);
        const struct sp_camera then = camera_at(TURN, SP_PERSPECTIVE, angle[1]);
        const double arrived_ms = 1000 + i / 3 * 3 * UPDATE_MS;
        struct sp_camera predicted = now;
        srv_past_add(&past, &now, arrived_ms);
        srv_predict(&past, arrived_ms + 1, AHEAD_MS, &predicted);
        with += pow(distance(&predicted, &then), 2);
        without += pow(distance(&now, &then), 2);
        if (fmod(i * UPDATE_MS / 1000, 1) > 0.8) { /* the hand comes to its end */
            stop_with += pow(distance(&predicted, &then), 2);
            stop_without += pow(distance(&now, &then), 2);
        }
    }
    assert_compare(with, <, 0.5 * without);
    assert_compare(stop_with, <, stop_without);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(even_motion_goes_on),
        cmocka_unit_test(a_camera_that_rests_stays),
        cmocka_unit_test(another_projection_is_no_motion),
        cmocka_unit_test(a_prediction_does_not_go_far),
        cmocka_unit_test(a_camera_without_direction_stays),
        cmocka_unit_test(a_swinging_hand_is_predicted_better_than_not),
    };
    return cmocka_run_group_tests_name("schedule/predict", tests, NULL, NULL);
}
