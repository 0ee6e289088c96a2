/* SPDX-License-Identifier: Apache-2.0
 *
 * The snapshot queue and its worker: equal requests, clients that leave, owners, and the
 * background.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>

#include "support/compare.h"
#include "support/gate.h"
#include "unit/server/counted.h"
#include "unit/server/render/snapshot_fixture.h"

static int set_up(void **state) {
    return snap_set_up(state, 1);
}

static void equal_snapshots_are_rendered_and_encoded_once(void **state) {
    struct snap_fixture *f = *state;
    struct snap_client first = { 0 }, other = { 0 }, same[4] = { { 0 } };
    assert_true(snap_request(f, &first, 100, false));
    gate_await(&gate.entered, 1); /* it is being rendered */
    assert_true(snap_request(f, &other, 200, false));
    for (int i = 0; i < 4; i++) /* more than the queue allows: they join entries */
        assert_true(snap_request(f, &same[i], i < 2 ? 100 : 200, false));
    gate_let_through(2);
    gate_await(&first.answers, 1);
    gate_await(&other.answers, 1);
    for (int i = 0; i < 4; i++) {
        const struct snap_client *like = i < 2 ? &first : &other;
        gate_await(&same[i].answers, 1);
        assert_int_equal(same[i].images, 1);
        assert_int_equal(same[i].size, like->size);
        assert_int_equal(same[i].sum, like->sum);
    }
    assert_int_equal(gate_count(&gate.entered), 2);
    assert_int_equal(gate_count(&snap_seen.encoded), 2);
    assert_true(snap_request(f, &first, 100, false)); /* the first one is no longer in the queue */
    gate_let_through(1);
    gate_await(&first.answers, 2);
    assert_int_equal(gate_count(&gate.entered), 3);
}

static void a_caller_that_encodes_receives_the_frame(void **state) {
    struct snap_fixture *f = *state;
    struct snap_client bytes = { 0 }, frame = { .wants_frame = true },
                       same = { .wants_frame = true };
    assert_true(snap_request(f, &bytes, 100, false));
    gate_await(&gate.entered, 1);
    assert_true(
        snap_request(f, &frame, 100, true)); /* the same image, but another kind of answer */
    assert_true(snap_request(f, &same, 100, true));
    gate_let_through(2);
    gate_await(&bytes.answers, 1);
    gate_await(&frame.answers, 1);
    gate_await(&same.answers, 1);
    assert_int_equal(bytes.frames, 0);
    assert_compare(bytes.size, >, 0);
    assert_int_equal(frame.frames, 1);
    assert_int_equal(same.frames, 1);
    assert_int_equal(frame.size, 0);
    assert_int_equal(same.size, 0);
    assert_int_equal(gate_count(&snap_seen.encoded), 1);
}

static void a_snapshot_is_rendered_while_a_client_waits_for_it(void **state) {
    struct snap_fixture *f = *state;
    struct snap_client a = { 0 }, b = { 0 };
    assert_true(snap_request(f, &a, 100, false));
    gate_await(&gate.entered, 1);
    assert_true(snap_request(f, &b, 100, false));
    atomic_store(&a.left, true);
    for (int i = 0; i < 100; i++)
        srv_render_pool_tick(f->render.render_pool);
    assert_int_equal(gate_count(&gate.cancelled), 0);
    atomic_store(&b.left, true);
    srv_render_pool_tick(f->render.render_pool);
    gate_await(&gate.cancelled, 1);
    gate_await(&a.answers, 1);
    gate_await(&b.answers, 1);
    assert_int_equal(a.images, 0);
    assert_int_equal(b.images, 0);
    assert_int_equal(counted_drops(f->render.metrics, "left"), 2);
}

static void a_client_that_leaves_does_not_cancel_the_others(void **state) {
    struct snap_fixture *f = *state;
    struct snap_client now = { 0 }, a = { 0 }, b = { 0 };
    assert_true(snap_request(f, &now, 100, false));
    gate_await(&gate.entered, 1);
    assert_true(snap_request(f, &a, 200, false));
    assert_true(snap_request(f, &b, 200, false));
    atomic_store(&a.left, true);
    srv_render_pool_tick(f->render.render_pool);
    assert_int_equal(gate_count(&a.answers), 1);
    assert_int_equal(gate_count(&b.answers), 0);
    gate_let_through(2);
    gate_await(&b.answers, 1);
    assert_int_equal(b.images, 1);
    assert_int_equal(counted_drops(f->render.metrics, "left"), 1);
}

static void stopping_answers_all_and_counts_none_as_left(void **state) {
    struct snap_fixture *f = *state;
    struct snap_client now = { 0 }, waits = { 0 };
    assert_true(snap_request(f, &now, 100, false));
    gate_await(&gate.entered, 1);
    assert_true(snap_request(f, &waits, 200, false));
    srv_render_pool_stop(f->render.render_pool);
    assert_int_equal(now.answers, 1);
    assert_int_equal(waits.answers, 1);
    assert_int_equal(now.images, 0);
    assert_int_equal(waits.images, 0);
    assert_int_equal(counted_drops(f->render.metrics, "left"), 0);
    assert_int_equal(counted_drops(f->render.metrics, "failed"), 0);
}

/* However many snapshots of one owner wait, another owner's comes next, and finds space in the
 * queue. */
static void owners_alternate(void **state) {
    struct snap_fixture *f = *state;
    struct snap_client ann[SNAP_QUEUE + 1], bob = { .owner = "bob" }, late = { .owner = "bob" };
    for (unsigned i = 0; i <= SNAP_QUEUE; i++)
        ann[i] = (struct snap_client){ .owner = "ann" };
    assert_true(snap_request(f, &ann[0], 100, false));
    gate_await(&gate.entered, 1);
    for (unsigned i = 1; i < SNAP_QUEUE; i++)
        assert_true(snap_request(f, &ann[i], 100 + i, false));
    assert_false(snap_request(f, &ann[SNAP_QUEUE], 199, false));
    assert_true(snap_request(f, &bob, 300, false));
    assert_false(snap_request(f, &late, 301, false)); /* the queue is full */
    gate_let_through(SNAP_QUEUE + 1);
    for (unsigned i = 0; i < SNAP_QUEUE; i++)
        gate_await(&ann[i].answers, 1);
    gate_await(&bob.answers, 1);
    assert_int_equal(snap_seen.width[1], 300);
    for (unsigned i = 1; i < SNAP_QUEUE; i++)
        assert_int_equal(snap_seen.width[1 + i], 100 + i);
}

/* Two owners cannot fill the queue either: the last place is for an owner that has none, or for an
 * admin. */
static void owners_leave_a_place_in_the_queue(void **state) {
    struct snap_fixture *f = *state;
    struct snap_client first = { .owner = "ann" }, admin = { .owner = "root", .is_admin = true };
    struct snap_client ann[2] = { { .owner = "ann" }, { .owner = "ann" } },
                       bob[2] = { { .owner = "bob" }, { .owner = "bob" } };
    assert_true(snap_request(f, &first, 100, false));
    gate_await(&gate.entered, 1);
    for (unsigned i = 0; i < 2; i++)
        assert_true(snap_request(f, &ann[i], 200 + i, false));
    assert_true(snap_request(f, &bob[0], 300, false));
    assert_false(snap_request(f, &bob[1], 301, false));
    assert_true(snap_request(f, &admin, 400, false));
    gate_let_through(SNAP_QUEUE + 1);
    for (unsigned i = 0; i < 2; i++)
        gate_await(&ann[i].answers, 1);
    gate_await(&first.answers, 1);
    gate_await(&bob[0].answers, 1);
    gate_await(&admin.answers, 1);
}

/* Encoding counts as well: while two snapshots of one owner are not answered yet, another owner
 * comes first, though it has received ten seconds more. */
static void owners_are_charged_for_encoding(void **state) {
    struct snap_fixture *f = *state;
    struct snap_client ann[3], bob = { .owner = "bob" },
                               long_one = { .owner = "bob", .wants_frame = true };
    for (unsigned i = 0; i < 3; i++)
        ann[i] = (struct snap_client){ .owner = "ann", .format = SP_IMAGE_PNG };
    snap_block_png(1);
    assert_true(snap_request(f, &ann[0], 100, false));
    gate_let_through(1);
    gate_await(&snap_seen.pngs, 1);
    assert_true(snap_request(f, &long_one, 200, false));
    gate_await(&gate.entered, 2);
    atomic_store(&snap_ahead_s, 10);
    gate_let_through(1);
    gate_await(&long_one.answers, 1);
    assert_true(snap_request(f, &ann[1], 101, false));
    gate_await(&gate.entered, 3);
    assert_true(snap_request(f, &ann[2], 102, false));
    assert_true(snap_request(f, &bob, 300, false));
    gate_let_through(100);
    gate_await(&gate.entered, 4);
    assert_int_equal(snap_seen.width[3], 300); /* two snapshots of ann are not answered yet */
    snap_block_png(0);
    for (unsigned i = 0; i < 3; i++)
        gate_await(&ann[i].answers, 1);
    gate_await(&bob.answers, 1);
}

static void owners_are_charged_for_their_time(void **state) {
    (void)state;
    struct srv_fair_owners owners = { .count = 0 };
    char name[SRV_FAIR_OWNER_BYTES];
    srv_fair_owners_begin(&owners, "ann");
    srv_fair_owners_charge(&owners, "ann", 30);
    srv_fair_owners_charge(&owners, "ann", 10);
    assert_compare(srv_fair_owners_start(&owners, "ann"), ==, 40);
    assert_compare(srv_fair_owners_start(&owners, "bob"), ==, 0);
    srv_fair_owners_charge(&owners, "bob", 50);
    srv_fair_owners_begin(&owners, "ann");
    /* An idle owner saves up no time. */
    assert_compare(srv_fair_owners_start(&owners, "new"), ==, 40);
    assert_compare(srv_fair_owners_start(&owners, "bob"), ==, 50);
    for (int i = 0; i < 2 * SRV_FAIR_OWNERS_MAX; i++) {
        snprintf(name, sizeof name, "host %d", i);
        srv_fair_owners_charge(&owners, name, 1);
    }
    assert_int_equal(owners.count, SRV_FAIR_OWNERS_MAX);
    /* The owners with the least lose their accounts. */
    assert_compare(srv_fair_owners_start(&owners, "bob"), ==, 50);
    srv_fair_owners_reset(&owners);
    assert_compare(srv_fair_owners_start(&owners, "bob"), ==, 0);
}

static void background_snapshots_come_last(void **state) {
    struct snap_fixture *f = *state;
    struct snap_client now = { 0 }, background[SNAP_QUEUE + 1] = { { 0 } }, other = { 0 };
    assert_true(snap_request(f, &now, 100, false));
    gate_await(&gate.entered, 1);
    for (unsigned i = 0; i < SNAP_QUEUE; i++)
        assert_true(snap_request(f, &background[i], 200 + i, true));
    assert_false(snap_request(f, &background[SNAP_QUEUE], 299,
                              true)); /* background snapshots have a limit of their own */
    assert_true(snap_request(f, &other, 300, false));
    gate_let_through(2 + SNAP_QUEUE);
    for (unsigned i = 0; i < SNAP_QUEUE; i++)
        gate_await(&background[i].answers, 1);
    assert_int_equal(snap_seen.width[1], 300);
    for (unsigned i = 0; i < SNAP_QUEUE; i++)
        assert_int_equal(snap_seen.width[2 + i], 200 + i);
    /* Waiting in the background does not count as queueing time. */
    assert_int_equal(counted_stages(f->render.metrics, "queue"), 2);
}

static void a_background_snapshot_yields_and_is_rendered_again(void **state) {
    struct snap_fixture *f = *state;
    struct snap_client background = { 0 }, other = { 0 };
    assert_true(snap_request(f, &background, 200, true));
    gate_await(&gate.entered, 1);
    assert_true(snap_request(f, &other, 300, false));
    gate_await(&gate.cancelled, 1);
    gate_await(&gate.entered, 2);
    assert_int_equal(snap_seen.width[1], 300);
    gate_let_through(2);
    gate_await(&background.answers, 1);
    assert_int_equal(background.images + other.images, 2);
    assert_int_equal(gate_count(&gate.entered), 3);
}

static void a_background_snapshot_yields_to_sessions(void **state) {
    struct snap_fixture *f = *state;
    struct snap_client background = { 0 };
    assert_true(snap_request(f, &background, 200, true));
    gate_await(&gate.entered, 1);
    f->participant = render_fixture_join(&f->render, f->id, SRV_ROLE_CONTROL);
    gate_await(&gate.cancelled, 1);
    gate_let_through(1000); /* it may yield again, to the final frame */
    gate_await(&background.answers, 1);
    assert_int_equal(background.images, 1);
}

/* A background snapshot yields once; later_s seconds later another one is requested. True if it
 * yields again. */
static bool yields_again(struct snap_fixture *f, double expected_ms, int64_t later_s) {
    struct snap_client background = { .expected_ms = expected_ms }, one = { 0 }, other = { 0 };
    assert_true(snap_request(f, &background, 200, true));
    gate_await(&gate.entered, 1);
    assert_true(snap_request(f, &one, 300, false));
    gate_let_through(1); /* the background snapshot is cancelled already */
    gate_await(&gate.entered, 3);
    atomic_store(&snap_ahead_s, later_s);
    assert_true(snap_request(f, &other, 400, false));
    gate_let_through(2);
    gate_await(&background.answers, 1);
    gate_await(&other.answers, 1);
    assert_int_equal(background.images + one.images + other.images, 3);
    return gate_count(&gate.cancelled) == 2;
}

static void a_background_snapshot_yields_for_twenty_times_its_time(void **state) {
    assert_true(yields_again(*state, 3600e3, 71900)); /* an hour, 19.97 times */
}

static void after_that_time_it_no_longer_yields(void **state) {
    assert_false(yields_again(*state, 3600e3, 72100));
}

static void a_foreground_request_takes_a_snapshot_out_of_the_background(void **state) {
    struct snap_fixture *f = *state;
    struct snap_client background = { 0 }, foreground = { 0 }, other = { 0 };
    assert_true(snap_request(f, &background, 200, true));
    gate_await(&gate.entered, 1);
    assert_true(snap_request(f, &foreground, 200, false));
    assert_true(snap_request(f, &other, 300, false));
    gate_let_through(2);
    gate_await(&other.answers, 1);
    assert_int_equal(background.images + foreground.images + other.images, 3);
    assert_int_equal(gate_count(&gate.cancelled), 0);
    assert_int_equal(gate_count(&gate.entered), 2);
}

int main(void) {
    const struct CMUnitTest tests[] = {
#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, snap_tear_down)
        TEST(equal_snapshots_are_rendered_and_encoded_once),
        TEST(a_caller_that_encodes_receives_the_frame),
        TEST(a_snapshot_is_rendered_while_a_client_waits_for_it),
        TEST(a_client_that_leaves_does_not_cancel_the_others),
        TEST(stopping_answers_all_and_counts_none_as_left),
        TEST(owners_alternate),
        TEST(owners_leave_a_place_in_the_queue),
        TEST(owners_are_charged_for_encoding),
        cmocka_unit_test(owners_are_charged_for_their_time),
        TEST(background_snapshots_come_last),
        TEST(a_background_snapshot_yields_and_is_rendered_again),
        TEST(a_background_snapshot_yields_to_sessions),
        TEST(a_background_snapshot_yields_for_twenty_times_its_time),
        TEST(after_that_time_it_no_longer_yields),
        TEST(a_foreground_request_takes_a_snapshot_out_of_the_background),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
