/* SPDX-License-Identifier: Apache-2.0
 *
 * The detail of frames while the camera moves: the least expected error within the limits of time.
 * The tests pass the times of frames.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "schedule/error_model.h"
#include "schedule/quality.h"
#include "support/compare.h"

static const uint32_t full[2] = { 1024, 1024 };
#define TURN SRV_MOTION_NOMINAL
#define SLOW_TURN ((struct srv_speed){ 0.003, 0.003 })
#define VOXEL_PX 4

struct view {
    struct srv_quality quality;
    struct srv_quality_budget budget;
    double fixed_ms, pixel_ms; /* time of a draft: per frame, and per megapixel */
    struct srv_detail last;
    double last_ms;
};

static struct view begin(bool warps, double part, struct srv_speed speed, double fixed_ms,
                         double pixel_ms) {
    struct view v = { .budget = srv_quality_budget(60, warps, part),
                      .fixed_ms = fixed_ms,
                      .pixel_ms = pixel_ms };
    srv_quality_init(&v.quality);
    srv_quality_budget_moves(&v.budget, &speed, full[1], VOXEL_PX);
    return v;
}

static double time_of(const struct view *v, const struct srv_detail *d, double load) {
    const double mpx = (double)d->size[0] * d->size[1] * 1e-6;
    const double draft_ms = v->fixed_ms / (1 << 3 * d->mip_level) + v->pixel_ms * mpx;
    return load * draft_ms * (d->is_draft ? 1 : 2);
}

/* Draws a frame on a machine that `load` slows. */
static void draw(struct view *v, double load) {
    const double budget_ms = srv_quality_moving(&v->quality, full, &v->budget, &v->last);
    v->last_ms = time_of(v, &v->last, load);
    if (v->last.is_draft)
        srv_quality_drafts(&v->quality, true);
    srv_quality_done(&v->quality, &v->last, true, budget_ms, v->last_ms);
}

static void drag(struct view *v, int frames) {
    for (int i = 0; i < frames; i++)
        draw(v, 1);
}

/* A table of real scans at 512 x 512 px, turned by 34 degrees per second: dB. */
static void errors_agree_with_measurements(void **state) {
    (void)state;
    const struct srv_speed turn = SRV_MOTION_NOMINAL;
    assert_float_equal(-10 * log10(srv_error_of_width(2, 0, 0)), 36.6, 0.1);
    assert_float_equal(-10 * log10(srv_error_of_width(4, 0, 0)), 32.2, 0.5);
    static const struct {
        double ms, not_warped_db, warped_db;
    } ages[] = { { 59, 24.2, 33.8 }, { 118, 20.8, 30.9 }, { 235, 18.1, 28.4 } };
    for (size_t i = 0; i < sizeof ages / sizeof *ages; i++) {
        const double ms = ages[i].ms / 1.5;
        assert_float_equal(-10 * log10(srv_error_per_ms(&turn, false, 512) * ms),
                           ages[i].not_warped_db, 1);
        assert_float_equal(-10 * log10(srv_error_per_ms(&turn, true, 512) * ms), ages[i].warped_db,
                           1.5);
    }
}

static void fast_motion_gets_small_frames_and_slow_motion_large_ones(void **state) {
    (void)state;
    struct view fast = begin(false, 1, TURN, 10, 130);
    struct view slow = begin(false, 1, SLOW_TURN, 10, 130);
    drag(&fast, 100);
    drag(&slow, 100);
    assert_int_equal(fast.last.mip_level, 0);
    assert_int_equal(slow.last.mip_level, 0);
    assert_in_range(fast.last.size[0], 256, 384);
    assert_in_range(slow.last.size[0], 512, 1024);
    assert_compare(slow.last_ms, <=, SRV_QUALITY_ROUND_MS);
}

/* Whatever the model says, people see coarse pixels. */
static void warped_frames_are_large_where_the_time_allows_it(void **state) {
    (void)state;
    static const struct srv_speed speeds[] = { { 0.003, 0.003 }, { 0.13, 0.13 }, { 1, 1 } };
    for (size_t i = 0; i < sizeof speeds / sizeof *speeds; i++)
        for (double pixel_ms = 10; pixel_ms <= 110; pixel_ms += 10) {
            struct view v = begin(true, 1, speeds[i], 8, pixel_ms);
            drag(&v, 100);
            assert_compare(v.last.size[0], >=, 716);
            assert_compare(v.last_ms, <=, SRV_WARP_INTERVAL_MS);
        }
}

/* Nor is there a cliff where it no longer allows it. */
static void the_side_falls_smoothly_where_time_gets_short(void **state) {
    (void)state;
    uint32_t before = 0;
    for (double pixel_ms = 80; pixel_ms <= 900; pixel_ms *= 1.05) {
        struct view v = begin(true, 1, TURN, 8, pixel_ms);
        drag(&v, 100);
        assert_int_equal(v.last.mip_level, 0);
        if (before > 0)
            assert_compare(fabs((double)v.last.size[0] - before), <=, before / 6.0);
        before = v.last.size[0];
    }
    assert_compare(before, <=, 320);
}

static void the_size_changes_by_an_eighth_at_most(void **state) {
    (void)state;
    for (int warps = 0; warps <= 1; warps++) {
        struct view v = begin(warps, 1, TURN, 8, 60);
        uint32_t before = 0;
        drag(&v, 20);
        for (int i = 0; i < 600; i++) { /* the load rises and falls by a factor of 1.9 */
            draw(&v, exp(0.32 * sin(i * 0.03)) * (1 + 0.1 * sin(i * 1.7)));
            if (before > 0 && v.last.mip_level == 0)
                assert_compare(fabs((double)v.last.size[0] - before), <=, before / 8.0 + 1);
            assert_int_equal(v.last.mip_level, 0);
            before = v.last.size[0];
        }
    }
}

static void jitter_does_not_flicker(void **state) {
    (void)state;
    uint32_t random = 1;
    for (int warps = 0; warps <= 1; warps++)
        for (double pixel_ms = 10; pixel_ms <= 300; pixel_ms *= 1.4) {
            struct view v = begin(warps, 1, TURN, 8, pixel_ms);
            unsigned changes = 0;
            drag(&v, 50);
            for (int i = 0; i < 300; i++) {
                const uint32_t before = v.last.size[0];
                random = random * 1664525u + 1013904223u;
                draw(&v, 0.88 + (random >> 8) * (0.24 / (1 << 24)));
                changes += v.last.size[0] != before;
            }
            if (changes > 20)
                fail_msg("pixel %g, warps %d: %u changes", pixel_ms, warps, changes);
        }
}

static void the_size_falls_at_once_when_the_time_explodes(void **state) {
    (void)state;
    struct view v = begin(true, 1, TURN, 8, 60);
    drag(&v, 50);
    draw(&v, 6);
    draw(&v, 6); /* the second slow frame is believed */
    const uint32_t before = v.last.size[0];
    draw(&v, 6);
    assert_compare(v.last.size[0], <, before * 3 / 4);
    draw(&v, 6); /* by now the time of smaller frames is known */
    assert_compare(v.last_ms, <=, SRV_WARP_INTERVAL_MS);
}

/* A zoom makes frames four times as slow and voxels four times as large. Neither a coarser mip
 * level nor a side below a quarter follows. */
static void a_zoom_keeps_its_voxels(void **state) {
    (void)state;
    for (int warps = 0; warps <= 1; warps++) {
        const struct srv_speed zoom = { 0.2, 0.04 };
        struct view v = begin(warps, 1, zoom, 5, 60);
        drag(&v, 30);
        for (int i = 0; i < 120; i++) {
            const double zoomed = pow(4, i / 120.0);
            srv_quality_budget_moves(&v.budget, &zoom, full[1], VOXEL_PX * zoomed);
            draw(&v, zoomed);
            assert_int_equal(v.last.mip_level, 0);
            assert_compare(v.last.size[0], >=, full[0] / 4);
        }
    }
}

static void views_that_share_the_time_keep_their_rate(void **state) {
    (void)state;
    static const double parts[] = { 1, 0.5, 0.3, 0.1 };
    for (int warps = 0; warps <= 1; warps++)
        for (size_t i = 0; i < sizeof parts / sizeof *parts; i++) {
            struct view v = begin(warps, parts[i], SLOW_TURN, 0.5, 60);
            const double round_ms = warps ? SRV_WARP_INTERVAL_MS : SRV_QUALITY_ROUND_MS;
            drag(&v, 100);
            assert_compare(v.last_ms, <=, round_ms * parts[i]);
            if (parts[i] <= 0.5 && v.last.size[0] > 640 && !warps)
                assert_compare(v.last_ms, <=, SRV_QUALITY_BUDGET_MS * parts[i]);
        }
}

static void a_whole_frame_that_keeps_the_rate_is_taken(void **state) {
    (void)state;
    for (int warps = 0; warps <= 1; warps++) {
        struct view v = begin(warps, 1, TURN, 2, 8);
        drag(&v, 50);
        assert_int_equal(v.last.size[0], full[0]);
        assert_false(v.last.is_draft);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(errors_agree_with_measurements),
        cmocka_unit_test(fast_motion_gets_small_frames_and_slow_motion_large_ones),
        cmocka_unit_test(warped_frames_are_large_where_the_time_allows_it),
        cmocka_unit_test(the_side_falls_smoothly_where_time_gets_short),
        cmocka_unit_test(the_size_changes_by_an_eighth_at_most),
        cmocka_unit_test(jitter_does_not_flicker),
        cmocka_unit_test(the_size_falls_at_once_when_the_time_explodes),
        cmocka_unit_test(a_zoom_keeps_its_voxels),
        cmocka_unit_test(views_that_share_the_time_keep_their_rate),
        cmocka_unit_test(a_whole_frame_that_keeps_the_rate_is_taken),
    };
    return cmocka_run_group_tests_name("schedule/error model", tests, NULL, NULL);
}
