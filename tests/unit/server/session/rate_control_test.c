/* SPDX-License-Identifier: Apache-2.0
 *
 * The rate control: frames that the network carries.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "session/rate_control.h"
#include "support/compare.h"

enum { SIDE = 1024 };
static const uint32_t full[2] = { SIDE, SIDE };

/* A scene whose images have 40,000 bytes at full size and best quality, and whose video frames have
 * a tenth of that. The model of the bytes is wrong by `error` of the reduction. */
static size_t bytes_of(const struct srv_rate_step *step, bool is_video, double error) {
    double part = pow((double)step->side / 8, 1.5 * (1 - error)) *
                  pow((double)step->quality / SRV_RATE_QUALITY_MAX, 0.6 * (1 - error));
    return (size_t)(part * (is_video ? 4000 : 40000));
}

/* Sends `frames` frames over a link. Returns how long the last one took, ms. */
static double run(struct srv_rate_control *control, double bytes_per_ms, int frames,
                  bool takes_video, double error) {
    double send_ms = 0;
    for (int i = 0; i < frames; i++) {
        const struct srv_rate_demand demand = { .bytes_per_ms = bytes_per_ms,
                                                .interval_ms = 1000.0 / 60,
                                                .takes_video = takes_video,
                                                .quality = 90 };
        srv_rate_control_update(control, &demand);
        const struct srv_rate_step step = srv_rate_control_step(control);
        struct srv_rate_frame frame = { .is_video = control->is_video,
                                        .quality = step.quality,
                                        .full_size = { SIDE, SIDE },
                                        .bytes = bytes_of(&step, control->is_video, error) };
        srv_rate_control_size(control, full, frame.size);
        srv_rate_control_learn(control, &frame);
        send_ms = (double)frame.bytes / bytes_per_ms;
    }
    return send_ms;
}

static void a_fast_network_gets_full_quality(void **state) {
    (void)state;
    static const double rates[] = { 1300, 5000, 1e6, 0 }; /* 0: not known */
    for (size_t i = 0; i < sizeof rates / sizeof *rates; i++) {
        struct srv_rate_control control;
        uint32_t size[2];
        srv_rate_control_init(&control);
        run(&control, rates[i], 50, false, 0);
        assert_int_equal(control.step, 0);
        assert_int_equal(srv_rate_control_step(&control).quality, SRV_RATE_QUALITY_MAX);
        srv_rate_control_size(&control, full, size);
        assert_int_equal(size[0], SIDE);
        assert_int_equal(size[1], SIDE);
    }
}

/* Even if frames have other sizes than expected, 30 frames per second fit, and they are not smaller
 * than necessary. */
static void frames_fit_a_slow_network(void **state) {
    (void)state;
    static const double errors[] = { 0, -0.3, 0.3 };
    for (size_t e = 0; e < sizeof errors / sizeof *errors; e++)
        for (double rate = 1000; rate > 250; rate *= 0.9) {
            struct srv_rate_control control;
            srv_rate_control_init(&control);
            double send_ms = run(&control, rate, 100, false, errors[e]);
            assert_compare(send_ms, <=, 1000.0 / 30);
            assert_compare(send_ms, >=, 1000.0 / 30 / 2);
        }
}

static void the_step_does_not_flicker(void **state) {
    (void)state;
    struct srv_rate_control control;
    srv_rate_control_init(&control);
    unsigned changes = 0;
    run(&control, 800, 50, false, 0);
    for (int i = 0; i < 50; i++) { /* noise in what the link carries */
        const unsigned step = control.step;
        run(&control, i % 2 ? 800 : 900, 1, false, 0);
        assert_compare(control.step, >, 0);
        changes += control.step != step;
    }
    assert_compare(changes, <=, 1);
    run(&control, 1e5, 50, false, 0);
    assert_int_equal(control.step, 0);
}

static void video_replaces_images_where_it_wins(void **state) {
    (void)state;
    struct srv_rate_control control;
    srv_rate_control_init(&control);
    run(&control, 5000, 20, true, 0); /* 8 ms per image */
    assert_false(control.is_video);
    run(&control, 1500, 20, true, 0); /* 27 ms */
    assert_true(control.is_video);
    assert_int_equal(control.step, 0);
    run(&control, 2500, 20, true, 0);
    assert_true(control.is_video); /* not back at once */
    run(&control, 5000, 20, true, 0);
    assert_false(control.is_video);
    run(&control, 50, 50, true, 0); /* even video is too large */
    assert_true(control.is_video);
    assert_compare(control.step, >, 0);
    run(&control, 50, 1, false, 0); /* the client takes it no longer */
    assert_false(control.is_video);
}

static void lossless_images_become_smaller(void **state) {
    (void)state;
    struct srv_rate_control control;
    srv_rate_control_init(&control);
    double send_ms = 0;
    for (int i = 0; i < 100; i++) {
        const struct srv_rate_demand demand = { .bytes_per_ms = 3000,
                                                .interval_ms = 1000.0 / 60,
                                                .quality = 90 };
        srv_rate_control_update(&control, &demand);
        const double side = srv_rate_control_step(&control).side / 8.0;
        struct srv_rate_frame frame = { .is_lossless = true,
                                        .quality = 90,
                                        .full_size = { SIDE, SIDE },
                                        .bytes = (size_t)(250000 * pow(side, 1.5)) };
        srv_rate_control_size(&control, full, frame.size);
        srv_rate_control_learn(&control, &frame);
        send_ms = (double)frame.bytes / demand.bytes_per_ms;
    }
    assert_compare(send_ms, <=, 1000.0 / 30);
    assert_compare(send_ms, >=, 1000.0 / 30 / 2);
}

/* A lower quality that the client asked for counts before anything else is reduced. */
static void the_granted_quality_counts(void **state) {
    (void)state;
    struct srv_rate_control control;
    srv_rate_control_init(&control);
    struct srv_rate_demand demand = { .bytes_per_ms = 1000, .interval_ms = 16, .quality = 90 };
    const struct srv_rate_frame frame = {
        .quality = 60, .size = { SIDE, SIDE }, .full_size = { SIDE, SIDE }, .bytes = 40000
    };
    srv_rate_control_learn(&control, &frame); /* 40 ms at quality 60 */
    demand.quality = 20;                      /* about 28 ms */
    srv_rate_control_update(&control, &demand);
    assert_int_equal(control.step, 0);
    assert_int_equal(srv_rate_control_step(&control).quality, 20);
    demand.quality = 90;
    srv_rate_control_update(&control, &demand);
    assert_compare(control.step, >, 0);
}

static void other_frames_begin_as_images(void **state) {
    (void)state;
    struct srv_rate_control control;
    srv_rate_control_init(&control);
    run(&control, 600, 20, true, 0);
    assert_true(control.is_video);
    srv_rate_control_forget(&control);
    assert_false(control.is_video);
    run(&control, 1e5, 20, true, 0); /* and stay so if the network became fast */
    assert_false(control.is_video);
    assert_int_equal(control.step, 0);
}

static void refused_video_is_counted_as_images(void **state) {
    (void)state;
    struct srv_rate_control control;
    srv_rate_control_init(&control);
    run(&control, 600, 20, true, 0);
    assert_true(control.is_video);
    assert_int_equal(control.step, 0);
    const struct srv_rate_demand refused = { .bytes_per_ms = 600,
                                             .interval_ms = 16,
                                             .takes_video = true,
                                             .quality = 90,
                                             .is_video_refused = true };
    srv_rate_control_update(&control, &refused);
    assert_true(control.is_video); /* it is asked for again and again */
    assert_compare(control.step, >, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_fast_network_gets_full_quality),
        cmocka_unit_test(frames_fit_a_slow_network),
        cmocka_unit_test(the_step_does_not_flicker),
        cmocka_unit_test(video_replaces_images_where_it_wins),
        cmocka_unit_test(lossless_images_become_smaller),
        cmocka_unit_test(the_granted_quality_counts),
        cmocka_unit_test(other_frames_begin_as_images),
        cmocka_unit_test(refused_video_is_counted_as_images),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
