/* SPDX-License-Identifier: Apache-2.0
 *
 * The size of the pieces of a frame, for given times and sizes of its bands.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <string.h>

#include "backend/gl/workload.h"
#include "classify/visible.h"
#include "support/compare.h"

enum { LONG_MS = 30, FAIR_MS = 10, SHORT_MS = 4, HALVINGS = 6 };

/* A GPU with enough memory. */
static const struct gl_limits whole = { .records = 4000000,
                                        .bins = 1 << 25,
                                        .tiles = 1 << 17,
                                        .pairs = 1 << 25,
                                        .loops = 1 << 19,
                                        .stall_factor = 8,
                                        .record_bytes = (uint64_t)1 << 30,
                                        .dispatch_ms = 25 };
static const struct gl_costs plain = { .columns = 100, .pair_rounds = 1, .record_bytes = 32 };

static struct gl_workload make_workload(void) {
    struct gl_workload workload = { .limits = whole };
    gl_workload_init(&workload);
    return workload;
}

/* Reports a band that was drawn, with the time of its longest dispatch. */
static void report_band(struct gl_workload *workload, double ms) {
    const struct gl_pieces was = gl_workload_plan(workload, &plain);
    gl_workload_adapt(workload, &was, ms);
}

static void a_long_dispatch_halves_pieces(void **state) {
    (void)state;
    struct gl_workload workload = make_workload();
    workload.pairs = whole.pairs;
    report_band(&workload, LONG_MS);
    const struct gl_limits now = gl_workload_limits(&workload);
    assert_int_equal(now.records, whole.records / 2);
    assert_int_equal(now.bins, whole.bins / 2);
    assert_int_equal(now.tiles, whole.tiles / 2);
    assert_int_equal(now.loops, whole.loops / 2);
    assert_int_equal(now.pairs, whole.pairs / 2);
    assert_int_equal(workload.pairs, now.pairs);
    assert_int_equal(gl_workload_plan(&workload, &plain).pass_pairs, whole.loops / 2);
    for (int i = 0; i < 20; i++)
        report_band(&workload, LONG_MS);
    assert_int_equal(workload.halvings, HALVINGS);
    assert_compare(gl_workload_plan(&workload, &plain).records, >=, SP_BRICK_VOXELS);
}

/* A band that was submitted before the change says nothing about the new pieces. */
static void bands_in_flight_are_answered_once(void **state) {
    (void)state;
    struct gl_workload workload = make_workload();
    const struct gl_pieces was = gl_workload_plan(&workload, &plain);
    gl_workload_adapt(&workload, &was, LONG_MS);
    gl_workload_adapt(&workload, &was, LONG_MS);
    assert_int_equal(workload.halvings, 1);
    report_band(&workload, LONG_MS);
    assert_int_equal(workload.halvings, 2);
}

static void pieces_grow_only_after_short_dispatches(void **state) {
    (void)state;
    struct gl_workload workload = make_workload();
    report_band(&workload, LONG_MS);
    report_band(&workload, LONG_MS);
    for (int i = 0; i < 4 * GL_SHORT_BANDS; i++)
        report_band(&workload, FAIR_MS);
    for (int i = 0; i < GL_SHORT_BANDS - 1; i++)
        report_band(&workload, SHORT_MS);
    report_band(&workload, FAIR_MS);
    for (int i = 0; i < GL_SHORT_BANDS - 1; i++)
        report_band(&workload, SHORT_MS);
    assert_int_equal(workload.halvings, 2);
    report_band(&workload, SHORT_MS);
    assert_int_equal(workload.halvings, 1);
    for (int i = 0; i < 4 * GL_SHORT_BANDS; i++)
        report_band(&workload, SHORT_MS);
    assert_int_equal(workload.halvings, 0);
}

/* The time of a dispatch is proportional to the size of its piece. */
static void pieces_settle(void **state) {
    (void)state;
    for (double whole_ms = 1; whole_ms < 1500; whole_ms *= 1.1) {
        struct gl_workload workload = make_workload();
        int slow = 0;
        for (int i = 0; i < 20 * GL_SHORT_BANDS; i++) {
            double ms = ldexp(whole_ms, -(int)workload.halvings);
            slow += ms > whole.dispatch_ms;
            report_band(&workload, ms);
        }
        assert_compare(slow, <=, HALVINGS);
        assert_compare(ldexp(whole_ms, -(int)workload.halvings), <=, whole.dispatch_ms);
    }
}

static void software_gl_has_no_time_limit(void **state) {
    (void)state;
    struct gl_workload workload = make_workload();
    workload.limits.dispatch_ms = INFINITY;
    report_band(&workload, 1e6);
    assert_int_equal(workload.halvings, 0);
    assert_true(gl_workload_halve(&workload)); /* because memory is short */
    for (int i = 0; i < GL_SHORT_BANDS; i++)
        report_band(&workload, 1e6);
    assert_int_equal(workload.halvings, 0);
}

static void memory_loads_raise_the_cost_of_a_pair(void **state) {
    (void)state;
    struct gl_workload workload = make_workload();
    struct gl_costs clipped = plain;
    clipped.pair_loads = 14;
    assert_int_equal(gl_workload_plan(&workload, &plain).pass_pairs, whole.loops);
    assert_int_equal(gl_workload_plan(&workload, &clipped).pass_pairs, whole.loops / (1 + 14 * 8));
    assert_int_equal(gl_workload_plan(&workload, &plain).splat_rounds, whole.loops / 8);
    assert_int_equal(gl_workload_plan(&workload, &plain).bin_pairs, whole.loops / (8 * 24));
    workload.limits.loops = 10; /* a minimum is always allowed */
    assert_int_equal(gl_workload_plan(&workload, &clipped).pass_pairs, 1);
    assert_int_equal(gl_workload_plan(&workload, &plain).splat_rounds, 300);
}

static void as_many_records_as_fit_are_used(void **state) {
    (void)state;
    struct gl_workload workload = make_workload();
    for (uint32_t words = 2; words <= 24; words++) {
        struct gl_costs costs = plain;
        costs.record_bytes = 16 * words;
        workload.limits.record_bytes = 20 << 20;
        uint64_t own = costs.record_bytes + GL_SPAN_BYTES;
        uint64_t records = gl_workload_plan(&workload, &costs).records;
        assert_compare(records * own, <=, 20 << 20);
        assert_compare((records + 1) * own, >, 20 << 20);
        costs.block_bytes = 4 << 20;
        assert_int_equal(gl_workload_plan(&workload, &costs).records,
                         (4 << 20) / costs.record_bytes);
        workload.limits.record_bytes = 1; /* at least one brick */
        assert_int_equal(gl_workload_plan(&workload, &costs).records, SP_BRICK_VOXELS);
    }
}

static void slow_pieces_are_no_reason_to_refuse(void **state) {
    (void)state;
    struct gl_workload workload = make_workload();
    struct sp_error err;
    while (gl_workload_halve(&workload))
        continue;
    struct gl_pieces was = gl_workload_plan(&workload, &plain);
    was.layers = was.rows = 1;
    was.records = SP_BRICK_VOXELS;
    struct gl_bins_head head = { .needed = 1 << 22 };
    assert_true(gl_workload_retry(&workload, &was, &head, &err));
    assert_compare(workload.pairs, >=, head.needed);
    assert_compare(workload.pairs, <=, whole.pairs);
    head.needed = (1 << 25) + 1;
    assert_false(gl_workload_retry(&workload, &was, &head, &err));
    assert_int_equal(err.code, SP_ERR_BUDGET);
    assert_non_null(strstr(err.text, "cover 33554433 tiles"));
}

static void wide_splats_use_fewer_rows_then_layers(void **state) {
    (void)state;
    struct gl_workload workload = make_workload();
    struct gl_pieces was = gl_workload_plan(&workload, &plain);
    was.rows = 100;
    was.layers = 10;
    const struct gl_bins_head head = { .widest = 4 * was.splat_rounds };
    assert_false(gl_workload_fits(&was, &head));
    assert_true(gl_workload_retry(&workload, &was, &head, NULL));
    assert_in_range(workload.rows, 1, 25);
    was.rows = 1;
    assert_true(gl_workload_retry(&workload, &was, &head, NULL));
    assert_in_range(workload.layers, 1, 2);
    uint32_t rows = workload.rows;
    const struct gl_bins_head fair = { .widest = was.splat_rounds / 2 }, few = { .widest = 0 };
    gl_workload_grow(&workload, &was, &fair);
    assert_int_equal(workload.rows, rows);
    gl_workload_grow(&workload, &was, &few);
    assert_int_equal(workload.rows, 2 * rows);
}

/* Many pairs of the volume on a tile do not multiply the passes of other layers, nor the reverse.
 */
static void other_layers_have_their_own_passes(void **state) {
    (void)state;
    struct gl_workload workload = make_workload();
    struct gl_costs costs = plain;
    struct sp_error err;
    costs.element_rounds = 16;
    struct gl_pieces was = gl_workload_plan(&workload, &costs);
    assert_int_equal(was.element_pairs, whole.loops / 16);
    struct gl_bins_head head = { .longest = was.pass_pairs,
                                 .longest_elements = 4 * was.element_pairs };
    assert_false(gl_workload_fits(&was, &head));
    assert_true(gl_workload_retry(&workload, &was, &head, &err));
    was = gl_workload_plan(&workload, &costs);
    assert_int_equal(was.passes, 1);
    assert_int_equal(was.element_passes, 5); /* a quarter more */
    assert_true(gl_workload_fits(&was, &head));
    head.longest_elements = 1;
    head.longest = 2 * was.pass_pairs;
    assert_true(gl_workload_retry(&workload, &was, &head, &err));
    gl_workload_grow(&workload, &was, &head);
    assert_int_equal(workload.passes, 2);
    assert_int_equal(workload.element_passes, 3); /* half of them */
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_long_dispatch_halves_pieces),
        cmocka_unit_test(bands_in_flight_are_answered_once),
        cmocka_unit_test(pieces_grow_only_after_short_dispatches),
        cmocka_unit_test(pieces_settle),
        cmocka_unit_test(software_gl_has_no_time_limit),
        cmocka_unit_test(memory_loads_raise_the_cost_of_a_pair),
        cmocka_unit_test(as_many_records_as_fit_are_used),
        cmocka_unit_test(slow_pieces_are_no_reason_to_refuse),
        cmocka_unit_test(wide_splats_use_fewer_rows_then_layers),
        cmocka_unit_test(other_layers_have_their_own_passes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
