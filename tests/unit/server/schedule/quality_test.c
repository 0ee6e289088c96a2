/* SPDX-License-Identifier: Apache-2.0
 *
 * The quality controller: the detail of a moving view, and the steps at rest. The tests pass the
 * times of frames.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "schedule/quality.h"
#include "support/compare.h"

/* The time of a frame: fixed work, which is an eighth with each level, work per megapixel, the
 * factor by which other load slows the machine, and the part of the time that a draft takes; 0 =
 * there are no drafts. */
struct machine {
    double fixed_ms, pixel_ms, load, draft;
};

static const uint32_t full[2] = { 1024, 1024 };
#define BUDGET SRV_QUALITY_ROUND_MS
static const struct srv_quality_budget budget = { .ms = BUDGET, .most_ms = BUDGET };

static double time_on(const struct machine *m, const struct srv_detail *d) {
    double mpx = (double)d->size[0] * d->size[1] * 1e-6;
    const double part = d->is_draft && m->draft > 0 ? m->draft : 1;
    return part * m->load * (m->fixed_ms / (1 << 3 * d->mip_level) + m->pixel_ms * mpx);
}

static void draw(struct srv_quality *quality, const struct machine *m,
                 const struct srv_detail *detail, bool moving) {
    if (detail->is_draft)
        srv_quality_drafts(quality, m->draft > 0);
    srv_quality_done(quality, detail, moving, BUDGET, time_on(m, detail));
}

/* Returns the rank of a detail, 0 = finest. */
static unsigned rank(const struct srv_detail *d) {
    return d->mip_level * 8 + (8 - d->size[0] * 8 / full[0]);
}

struct drag {
    struct srv_detail last;
    double last_ms, worst_ms;
    unsigned changes; /* frames whose detail differs from the previous frame */
    unsigned misses;  /* frames over the budget */
};

static struct drag drag(struct srv_quality *quality, const struct machine *m, int frames) {
    struct drag result = { .last_ms = 0 };
    for (int i = 0; i < frames; i++) {
        struct srv_detail detail;
        srv_quality_moving(quality, full, &budget, &detail);
        double ms = time_on(m, &detail);
        draw(quality, m, &detail, true);
        result.changes += i > 0 && rank(&detail) != rank(&result.last);
        result.misses += ms > BUDGET;
        result.worst_ms = ms > result.worst_ms ? ms : result.worst_ms;
        result.last = detail;
        result.last_ms = ms;
    }
    return result;
}

static double rest(struct srv_quality *quality, const struct machine *m) {
    struct srv_detail sharp = { .size = { full[0], full[1] } };
    draw(quality, m, &sharp, false);
    srv_quality_rest(quality, full);
    return time_on(m, &sharp);
}

static void the_budget_is_for_thirty_frames_per_second_or_fewer(void **state) {
    (void)state;
    assert_compare(srv_quality_budget(120, false, 1).ms, ==, SRV_QUALITY_BUDGET_MS);
    assert_compare(srv_quality_budget(30, false, 1).most_ms, ==, SRV_QUALITY_BUDGET_MS);
    assert_compare(srv_quality_budget(5, false, 1).ms, ==, 200);
    assert_compare(srv_quality_budget(60, true, 1).ms, ==, SRV_WARP_INTERVAL_MS);
    assert_compare(srv_quality_budget(5, true, 1).ms, ==, 200);
    assert_compare(srv_quality_budget(60, true, 0.5).most_ms, ==, SRV_WARP_INTERVAL_MS / 2);
    assert_compare(srv_quality_budget(60, false, 0.25).ms, ==, SRV_QUALITY_BUDGET_MS / 4);
    assert_compare(srv_quality_budget(60, false, 0.25).most_ms, ==, SRV_QUALITY_ROUND_MS / 4);
    assert_compare(srv_quality_budget(10, false, 0.25).most_ms, ==, 25);
}

/* A view that has a part of the time keeps its rate while frames of five eighths of the side allow
 * it; then its rate falls; then its frames get smaller. Whatever the first size was, and however
 * little is known of others. */
static void a_part_of_the_time_costs_size_then_rate_then_size(void **state) {
    (void)state;
    static const struct {
        struct machine machine;
        double part;
        uint32_t side;
        double most_ms;
    } cases[] = {
        { { 5, 10, 1, 0 }, 1, 1024, SRV_QUALITY_BUDGET_MS },
        { { 5, 20, 1, 0 }, 0.5, 640, SRV_QUALITY_BUDGET_MS / 2 },
        { { 8, 24, 1, 0 }, 0.4, 640, SRV_QUALITY_ROUND_MS * 0.4 },
        { { 5, 80, 1, 0 }, 0.5, 384, SRV_QUALITY_BUDGET_MS },
        { { 20, 1, 1, 0 }, 0.5, 1024, SRV_QUALITY_BUDGET_MS }, /* smaller frames take as long */
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const struct srv_quality_budget own = srv_quality_budget(30, false, cases[i].part);
        struct srv_quality quality;
        struct srv_detail detail;
        srv_quality_init(&quality);
        for (int frame = 0; frame < 200; frame++) {
            const double ms =
                srv_quality_moving(&quality, full, frame < 100 ? &budget : &own, &detail);
            srv_quality_done(&quality, &detail, true, ms, time_on(&cases[i].machine, &detail));
        }
        assert_int_equal(detail.mip_level, 0);
        assert_compare(detail.size[0], >=, cases[i].side);
        assert_compare(time_on(&cases[i].machine, &detail), <=, cases[i].most_ms);
    }
}

static void frames_within_the_budget_keep_all_detail(void **state) {
    (void)state;
    static const struct machine machines[] = { { 2, 1, 1, 0 }, { 20, 10, 1, 0 }, { 5, 40, 1, 0 } };
    for (size_t i = 0; i < sizeof machines / sizeof *machines; i++) {
        struct srv_quality quality;
        srv_quality_init(&quality);
        drag(&quality, &machines[i], 2); /* the first frame is small: its time is not known */
        struct drag d = drag(&quality, &machines[i], 100);
        assert_int_equal(rank(&d.last), 0);
        assert_int_equal(d.changes, 0);
    }
}

/* On any machine the detail settles within a few frames, stays within the budget if any detail can,
 * and does not oscillate. */
static void detail_settles_on_any_machine(void **state) {
    (void)state;
    static const double fixed[] = { 0.5, 5, 30, 60, 90, 200, 400, 1500, 5000 };
    static const double pixel[] = { 0.5, 5, 20, 60, 100, 300, 800 };
    for (size_t f = 0; f < sizeof fixed / sizeof *fixed; f++)
        for (size_t p = 0; p < sizeof pixel / sizeof *pixel; p++) {
            struct machine m = { fixed[f], pixel[p], 1, 0 };
            struct srv_quality quality;
            srv_quality_init(&quality);
            drag(&quality, &m, 8);
            struct drag d = drag(&quality, &m, 400);
            struct srv_detail least = { .mip_level = SP_MIP_LEVEL_MAX,
                                        .size = { full[0] / 4, full[1] / 4 } };
            bool possible = time_on(&m, &least) <= BUDGET * 0.7;
            if (possible && (d.misses > 8 || d.last_ms > 2 * BUDGET))
                fail_msg("fixed %g pixel %g: %u frames over the budget", fixed[f], pixel[p],
                         d.misses);
            if (d.changes > 16)
                fail_msg("fixed %g pixel %g: %u changes", fixed[f], pixel[p], d.changes);
        }
}

/* The times of consecutive frames differ by a quarter. Detail may take a while to settle, but must
 * not oscillate. */
static void jitter_does_not_flicker(void **state) {
    (void)state;
    static const double fixed[] = { 5, 30, 60, 90, 200, 400, 1500 };
    static const double pixel[] = { 5, 20, 60, 100, 300 };
    uint32_t random = 1;
    for (size_t f = 0; f < sizeof fixed / sizeof *fixed; f++)
        for (size_t p = 0; p < sizeof pixel / sizeof *pixel; p++) {
            struct machine m = { fixed[f], pixel[p], 1, 0 };
            struct srv_quality quality;
            struct srv_detail last = { .mip_level = 9 };
            unsigned changes = 0;
            srv_quality_init(&quality);
            drag(&quality, &m, 20);
            for (int i = 0; i < 300; i++) {
                random = random * 1664525u + 1013904223u;
                m.load = 0.88 + (random >> 8) * (0.24 / (1 << 24));
                struct drag d = drag(&quality, &m, 1);
                changes += last.mip_level != 9 && rank(&d.last) != rank(&last);
                last = d.last;
            }
            if (changes > 20)
                fail_msg("fixed %g pixel %g: %u changes in 300 frames", fixed[f], pixel[p],
                         changes);
        }
}

static void pixels_are_reduced_before_voxels(void **state) {
    (void)state;
    struct srv_quality quality;
    struct machine m = { 10, 100, 1, 0 };
    srv_quality_init(&quality);
    struct drag d = drag(&quality, &m, 50);
    assert_int_equal(d.last.mip_level, 0);
    assert_in_range(d.last.size[0], 512, 1000);
    m = (struct machine){ 320, 4, 1, 0 }; /* on this machine, fewer pixels save no time */
    srv_quality_init(&quality);
    d = drag(&quality, &m, 50);
    assert_int_equal(d.last.mip_level, 1);
    assert_int_equal(d.last.size[0], 1024);
}

/* The first frame has the detail that another view's frames had in the end. If that was wrong, the
 * view's own first frame corrects it at once. */
/* Ten million points: each level takes a small part of the time of the level below. */
static void points_are_merged_before_frames_get_smaller(void **state) {
    static const double times[SP_MIP_LEVEL_MAX + 1] = { 1000, 100, 30 };
    struct srv_quality quality;
    struct srv_detail detail;
    (void)state;
    srv_quality_init(&quality);
    quality.prefers_levels = true;
    for (int motion = 0; motion < 3; motion++) {
        for (int i = 0; i < 20; i++) {
            srv_quality_moving(&quality, full, &budget, &detail);
            assert_int_equal(detail.mip_level, SP_MIP_LEVEL_MAX);
            assert_int_equal(detail.size[0], full[0]);
            srv_quality_done(&quality, &detail, true, BUDGET, times[detail.mip_level]);
        }
        if (motion > 0) { /* the sharp time is known */
            const struct srv_detail shown = detail;
            assert_true(srv_quality_intermediate(&quality, full, full, &shown, &detail));
            assert_int_equal(detail.mip_level, 1);
            assert_int_equal(detail.size[0], full[0]);
            srv_quality_done(&quality, &detail, false, BUDGET, times[1]);
        }
        detail = (struct srv_detail){ .size = { full[0], full[1] } };
        srv_quality_done(&quality, &detail, false, BUDGET, times[0]);
        srv_quality_rest(&quality, full);
    }
    /* Too slow even so: then frames get smaller. */
    for (int i = 0; i < 20; i++) {
        srv_quality_moving(&quality, full, &budget, &detail);
        srv_quality_done(&quality, &detail, true, BUDGET,
                         300.0 * detail.size[0] / full[0] * detail.size[1] / full[1]);
    }
    assert_int_equal(detail.mip_level, SP_MIP_LEVEL_MAX);
    assert_compare(detail.size[0], <, full[0] * 3 / 5);
}

static void times_of_another_view_are_the_first_guess(void **state) {
    (void)state;
    struct srv_detail detail;
    struct srv_quality other, quality;
    struct machine m = { 20, 5, 1, 0 };
    srv_quality_init(&other);
    drag(&other, &m, 20);
    srv_quality_init(&quality);
    srv_quality_moving(&quality, full, &budget, &detail);
    assert_int_equal(detail.size[0], 512);
    srv_quality_init_from(&quality, &other);
    srv_quality_moving(&quality, full, &budget, &detail);
    assert_int_equal(detail.size[0], 1024);
    assert_int_equal(detail.mip_level, 0);
    double guess_ms = srv_quality_expected_ms(&quality, &detail);
    assert_compare(guess_ms, >, 10);
    assert_compare(guess_ms, <, 60);
    srv_quality_done(&quality, &detail, true, BUDGET, 10 * guess_ms);
    assert_float_equal(srv_quality_expected_ms(&quality, &detail), 10 * guess_ms, 1e-6);
    srv_quality_moving(&quality, full, &budget, &detail);
    assert_compare(rank(&detail), >, 0);
}

/* Under a rising load, frames that miss the budget reduce the detail. When the load falls, detail
 * comes back during the drag, without a rest. */
static void detail_comes_back_when_the_load_falls(void **state) {
    (void)state;
    static const struct machine machines[] = { { 20, 5, 1, 0 },
                                               { 5, 25, 1, 0 },
                                               { 25, 0.5, 1, 0 } };
    for (size_t i = 0; i < sizeof machines / sizeof *machines; i++)
        for (double load = 1.5; load <= 24; load *= 2) {
            struct srv_quality quality;
            struct machine m = machines[i];
            srv_quality_init(&quality);
            struct drag d = drag(&quality, &m, 20);
            assert_int_equal(rank(&d.last), 0);
            m.load = load;
            drag(&quality, &m, 40);
            d = drag(&quality, &m, 60);
            if (d.last.mip_level != SP_MIP_LEVEL_MAX)
                assert_compare(d.misses, <=, 3);
            m.load = 1;
            d = drag(&quality, &m, 100);
            if (rank(&d.last) != 0)
                fail_msg("machine %zu after a load of %g: still at rank %u", i, load,
                         rank(&d.last));
        }
}

static void keeping_and_raising_detail_have_different_thresholds(void **state) {
    (void)state;
    struct srv_quality quality;
    struct machine m = { 20, 20, 1, 0 };
    srv_quality_init(&quality);
    drag(&quality, &m, 10);
    m.load = 1.5; /* 61 ms: within the budget */
    struct drag d = drag(&quality, &m, 50);
    assert_int_equal(rank(&d.last), 0);
    assert_int_equal(d.changes, 0);
    m.load = 2;
    for (int i = 0; i < 20 && (i < 10 || rank(&d.last) == 0); i++)
        d = drag(&quality, &m, 1);
    assert_compare(rank(&d.last), >, 0);
    m.load = 1.5; /* the same load after less detail: all detail would fit, but barely */
    d = drag(&quality, &m, 50);
    assert_compare(rank(&d.last), >, 0);
    assert_compare(d.last_ms, <=, 0.75 * BUDGET);
    m.load = 1;
    d = drag(&quality, &m, 20);
    assert_int_equal(rank(&d.last), 0);
}

static void only_the_second_slow_frame_in_a_row_reduces_detail(void **state) {
    (void)state;
    struct srv_quality quality;
    struct machine m = { 10, 5, 1, 0 }, slow = { 10, 5, 40, 0 };
    srv_quality_init(&quality);
    drag(&quality, &m, 20);
    drag(&quality, &slow, 1);
    struct drag d = drag(&quality, &m, 10);
    assert_int_equal(d.changes, 0);
    assert_int_equal(rank(&d.last), 0);
    drag(&quality, &slow, 2);
    struct srv_detail detail;
    srv_quality_moving(&quality, full, &budget, &detail);
    assert_compare(rank(&detail), >, 0);
}

/* A level that takes 90 ms is tried again in vain, each time after a longer wait. */
static void levels_that_were_too_slow_are_tried_less_and_less_often(void **state) {
    (void)state;
    struct srv_quality quality;
    struct machine m = { 90, 0.5, 1, 0 };
    srv_quality_init(&quality);
    drag(&quality, &m, 4);
    unsigned tries[3];
    for (int i = 0; i < 3; i++)
        tries[i] = drag(&quality, &m, 200).misses;
    assert_in_range(tries[0], 1, 4);
    assert_compare(tries[2], <=, 1);
    struct machine hopeless = { 400, 0.5, 1, 0 }; /* more than twice too slow */
    srv_quality_init(&quality);
    drag(&quality, &hopeless, 4);
    assert_int_equal(drag(&quality, &hopeless, 400).misses, 0);
}

static void slow_levels_are_tried_again_after_a_rest(void **state) {
    (void)state;
    struct srv_quality quality;
    struct machine m = { 320, 1, 1, 0 }, jammed = { 320, 1, 100, 0 };
    srv_quality_init(&quality);
    assert_int_equal(drag(&quality, &m, 20).last.mip_level, 1);
    assert_int_equal(drag(&quality, &jammed, 3).last.mip_level, 2);
    rest(&quality, &m);
    assert_int_equal(drag(&quality, &m, 1).last.mip_level, 1);
    /* Levels that are known to be fast stay known: the next drag begins as the last one ended. */
    struct drag before = drag(&quality, &m, 20);
    rest(&quality, &m);
    assert_int_equal(rank(&before.last), rank(&(struct srv_detail){ 1, { 1024, 1024 }, true }));
    assert_int_equal(drag(&quality, &m, 20).changes, 0);
}

static void a_cancelled_frame_took_at_least_its_elapsed_time(void **state) {
    (void)state;
    struct srv_quality quality;
    struct machine m = { 40, 4, 1, 0 };
    struct srv_detail detail, next;
    srv_quality_init(&quality);
    drag(&quality, &m, 20);
    srv_quality_moving(&quality, full, &budget, &detail);
    assert_int_equal(rank(&detail), 0);
    srv_quality_cancelled(&quality, &detail, 10); /* shorter than expected, so it changes nothing */
    srv_quality_moving(&quality, full, &budget, &next);
    assert_int_equal(rank(&next), 0);
    srv_quality_cancelled(&quality, &detail, 140);
    srv_quality_moving(&quality, full, &budget, &next);
    assert_compare(rank(&next), >, 0);
}

static void an_intermediate_frame_precedes_a_slow_sharp_one(void **state) {
    (void)state;
    struct srv_quality quality;
    struct srv_detail middle;
    struct machine quick = { 100, 50, 1, 0 }, voxels = { 1600, 20, 1, 0 },
                   pixels = { 10, 2000, 1, 0 };
    srv_quality_init(&quality);
    assert_false(srv_quality_intermediate(&quality, full, full,
                                          &(struct srv_detail){ 0, { 512, 512 }, true }, &middle));
    struct drag d = drag(&quality, &quick, 50);
    assert_false(srv_quality_intermediate(&quality, full, full, &d.last,
                                          &middle)); /* the sharp frame is ready soon */
    srv_quality_init(&quality);
    d = drag(&quality, &voxels, 50);
    rest(&quality, &voxels);
    assert_int_equal(d.last.mip_level, 2);
    assert_true(srv_quality_intermediate(&quality, full, full, &d.last, &middle));
    assert_int_equal(middle.mip_level, 1);
    assert_int_equal(middle.size[0], 1024);
    /* The client has this frame already. */
    assert_false(srv_quality_intermediate(&quality, full, full, &middle, &middle));
    srv_quality_init(&quality);
    d = drag(&quality, &pixels, 50);
    double sharp_ms = rest(&quality, &pixels);
    assert_true(srv_quality_intermediate(&quality, full, full, &d.last, &middle));
    if (middle.mip_level >= d.last.mip_level)
        assert_compare(middle.size[0], >, d.last.size[0]);
    assert_compare(time_on(&pixels, &middle), <=, sharp_ms / 3);
    /* No larger than the network allows. */
    const uint32_t most[2] = { middle.size[0] - 8, middle.size[0] - 8 };
    assert_true(srv_quality_intermediate(&quality, full, most, &d.last, &middle));
    assert_int_equal(middle.size[0], most[0]);
}

static bool is_whole(const struct srv_detail *d) {
    return !d->is_draft && rank(d) == 0;
}

static void only_moving_frames_of_all_detail_are_whole(void **state) {
    (void)state;
    static const struct machine machines[] = {
        { 5, 10, 1, 0.5 },   { 10, 30, 1, 0.5 }, { 40, 30, 1, 0.5 },
        { 10, 100, 1, 0.6 }, { 400, 4, 1, 0.5 }, { 5, 10, 1, 0 },
    };
    for (size_t i = 0; i < sizeof machines / sizeof *machines; i++) {
        const struct machine *m = &machines[i];
        const struct srv_detail sharp = { .size = { full[0], full[1] } };
        struct srv_quality quality;
        struct srv_detail detail;
        srv_quality_init(&quality);
        for (int motion = 0; motion < 3; motion++) {
            for (int frame = 0; frame < 50; frame++) {
                srv_quality_moving(&quality, full, &budget, &detail);
                assert_true(is_whole(&detail) || detail.is_draft);
                draw(&quality, m, &detail, true);
            }
            if (srv_quality_intermediate(&quality, full, full, &detail, &detail))
                assert_true(detail.is_draft);
            rest(&quality, m);
            srv_quality_moving(&quality, full, &budget, &detail);
            assert_int_equal(is_whole(&detail), time_on(m, &sharp) <= 0.75 * BUDGET);
        }
    }
}

/* Twice as slow a machine with drafts of half the time draws frames of the same sizes. */
static void drafts_have_times_of_their_own(void **state) {
    (void)state;
    const struct machine drafts = { 20, 160, 1, 0.5 }, whole = { 10, 80, 1, 0 };
    struct srv_quality quality, other;
    struct srv_detail sharp = { .size = { full[0], full[1] } };
    srv_quality_init(&quality);
    srv_quality_init(&other);
    for (int motion = 0; motion < 3; motion++) {
        const struct drag d = drag(&quality, &drafts, 100), e = drag(&other, &whole, 100);
        assert_true(d.last.is_draft);
        assert_int_equal(rank(&d.last), rank(&e.last));
        if (motion > 0)
            assert_int_equal(d.changes, 0);
        rest(&quality, &drafts);
        rest(&other, &whole);
        assert_float_equal(srv_quality_expected_ms(&quality, &sharp), 180, 10);
        assert_float_equal(srv_quality_expected_ms(&quality, &d.last), time_on(&drafts, &d.last),
                           2);
    }
}

/* The time of the first draft is the whole frame's, so that it is not too slow. */
static void an_unknown_draft_takes_as_long_as_a_whole_frame(void **state) {
    (void)state;
    const struct srv_detail sharp = { .size = { full[0], full[1] } };
    const struct srv_detail draft = { .size = { full[0], full[1] }, .is_draft = true };
    struct srv_quality quality;
    srv_quality_init(&quality);
    srv_quality_done(&quality, &sharp, false, BUDGET, 100);
    assert_float_equal(srv_quality_expected_ms(&quality, &draft), 100, 1e-6);
    srv_quality_init(&quality);
    srv_quality_drafts(&quality, true);
    srv_quality_done(&quality, &draft, true, BUDGET, 50);
    assert_float_equal(srv_quality_expected_ms(&quality, &sharp), 100, 1e-6);
    /* It was no draft: all frames are whole. */
    srv_quality_drafts(&quality, false);
    srv_quality_done(&quality, &draft, true, BUDGET, 90);
    assert_float_equal(srv_quality_expected_ms(&quality, &sharp), 90, 1e-6);
    srv_quality_done(&quality, &sharp, false, BUDGET, 90);
    assert_float_equal(srv_quality_expected_ms(&quality, &draft), 90, 1e-6);
    /* Other layers, for example: drafts are drawn again, and the first one's time is believed. */
    srv_quality_drafts(&quality, true);
    srv_quality_done(&quality, &draft, true, BUDGET, 30);
    assert_float_equal(srv_quality_expected_ms(&quality, &draft), 30, 1e-6);
    assert_float_equal(srv_quality_expected_ms(&quality, &sharp), 90, 1e-6);
}

static void tiny_frames_have_a_size(void **state) {
    (void)state;
    struct srv_quality quality;
    static const uint32_t tiny[2] = { 1, 3 };
    struct srv_detail detail;
    srv_quality_init(&quality);
    for (int i = 0; i < 20; i++) {
        srv_quality_moving(&quality, tiny, &budget, &detail);
        assert_int_equal(detail.size[0], 1);
        assert_in_range(detail.size[1], 1, 3);
        srv_quality_done(&quality, &detail, true, BUDGET, 1e6);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_budget_is_for_thirty_frames_per_second_or_fewer),
        cmocka_unit_test(a_part_of_the_time_costs_size_then_rate_then_size),
        cmocka_unit_test(frames_within_the_budget_keep_all_detail),
        cmocka_unit_test(detail_settles_on_any_machine),
        cmocka_unit_test(jitter_does_not_flicker),
        cmocka_unit_test(pixels_are_reduced_before_voxels),
        cmocka_unit_test(points_are_merged_before_frames_get_smaller),
        cmocka_unit_test(times_of_another_view_are_the_first_guess),
        cmocka_unit_test(detail_comes_back_when_the_load_falls),
        cmocka_unit_test(keeping_and_raising_detail_have_different_thresholds),
        cmocka_unit_test(only_the_second_slow_frame_in_a_row_reduces_detail),
        cmocka_unit_test(levels_that_were_too_slow_are_tried_less_and_less_often),
        cmocka_unit_test(slow_levels_are_tried_again_after_a_rest),
        cmocka_unit_test(a_cancelled_frame_took_at_least_its_elapsed_time),
        cmocka_unit_test(an_intermediate_frame_precedes_a_slow_sharp_one),
        cmocka_unit_test(only_moving_frames_of_all_detail_are_whole),
        cmocka_unit_test(drafts_have_times_of_their_own),
        cmocka_unit_test(an_unknown_draft_takes_as_long_as_a_whole_frame),
        cmocka_unit_test(tiny_frames_have_a_size),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
