/* SPDX-License-Identifier: Apache-2.0
 *
 * The interactive and the preemption worker, between a real hub and a renderer behind a gate
 * (support/gate.h): the linker replaces sp_renderer_begin() and sp_renderer_finish(). Each frame
 * waits in finish until the test lets it through or its cancel flag is set, so that "while it is
 * being rendered" is a state that the test controls. sp_renderer_info() is replaced as well.
 */
#include <pthread.h>
#include <sched.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "common/clock.h"
#include "schedule/quality.h"
#include "sp/inflight.h"
#include "support/compare.h"
#include "support/gate.h"
#include "support/render_fixture.h"

enum {
    FULL = 512, /* width and height of the default view, px */
    FPS = 30    /* granted to a participant by default, per second */
};

struct render { /* begun and not finished */
    const struct sp_renderer *renderer;
    struct sp_pause *pause;
    uint32_t size[2];
    const atomic_bool *cancel;
    struct sp_frame *frame;
};

static struct {                            /* guarded by the gate's mutex */
    unsigned ended;                        /* jobs whose end the hub knows */
    unsigned sharp;                        /* renders with all voxels at full size */
    unsigned depth;                        /* of the renderer */
    struct render begun[SP_IN_FLIGHT_MAX]; /* oldest first */
    unsigned begun_count;
    unsigned pauses, preempting;     /* pauses of a render; renders of the preemption worker */
    bool stops_preempting;           /* the preemption worker also waits at the gate */
    bool fails_preempting;           /* renders of the preemption worker fail */
    const char *preempting_backend;  /* that the preemption worker creates */
    const struct sp_renderer *first; /* the interactive worker's */
    uint32_t size[2];                /* of the newest render */
    unsigned mip_level;
    struct sp_renderer_info info; /* what sp_renderer_info() returns */
} seen;

unsigned __wrap_sp_renderer_depth(const struct sp_renderer *renderer);
unsigned __wrap_sp_renderer_depth(const struct sp_renderer *renderer) {
    (void)renderer;
    return seen.depth;
}

bool __wrap_sp_renderer_begin(struct sp_renderer *renderer, struct sp_volume *volume,
                              const struct sp_view *view, struct sp_frame_pool *pool,
                              const struct sp_render_options *options, struct sp_error *err);
bool __wrap_sp_renderer_begin(struct sp_renderer *renderer, struct sp_volume *volume,
                              const struct sp_view *view, struct sp_frame_pool *pool,
                              const struct sp_render_options *options, struct sp_error *err) {
    (void)volume;
    struct sp_frame *frame =
        sp_frame_create(pool, view->size[0], view->size[1], options->format, err);
    assert_non_null(frame);
    memset(frame->pixels, 0, frame->stride_bytes * frame->height);
    frame->stats = (struct sp_frame_stats){ .backend = "gate", .render_ms = 2 };
    pthread_mutex_lock(&gate.mutex);
    if (!seen.first)
        seen.first = renderer;
    if (renderer == seen.first)
        assert_compare(seen.begun_count, <, seen.depth);
    seen.preempting += renderer != seen.first;
    seen.begun[seen.begun_count++] = (struct render){
        renderer, options->pause, { view->size[0], view->size[1] }, options->cancel, frame
    };
    gate.entered++;
    seen.mip_level = options->mip_level;
    seen.sharp += options->mip_level == 0 && view->size[0] == FULL && !options->draft;
    memcpy(seen.size, view->size, sizeof seen.size);
    pthread_mutex_unlock(&gate.mutex);
    return true;
}

struct sp_frame *__wrap_sp_renderer_finish(struct sp_renderer *renderer, struct sp_error *err);
/* Returns the index of this renderer's oldest render. With the mutex held. */
static unsigned find_render(const struct sp_renderer *renderer) {
    unsigned i = 0;
    while (i < seen.begun_count && seen.begun[i].renderer != renderer)
        i++;
    assert_compare(i, <, seen.begun_count);
    return i;
}

static void pause_if_requested(void *user) {
    struct sp_pause *pause = user;
    if (!atomic_load(&pause->requested))
        return;
    pthread_mutex_lock(&gate.mutex);
    seen.pauses++;
    pthread_mutex_unlock(&gate.mutex);
    pause->wait(pause->user);
}

struct sp_frame *__wrap_sp_renderer_finish(struct sp_renderer *renderer, struct sp_error *err) {
    pthread_mutex_lock(&gate.mutex);
    struct render render = seen.begun[find_render(renderer)];
    bool is_free = renderer != seen.first && !seen.stops_preempting;
    bool fails = renderer != seen.first && seen.fails_preempting;
    pthread_mutex_unlock(&gate.mutex);
    if (fails) {
        sp_fail(err, SP_ERR_BACKEND, "", "this renderer is broken");
        sp_frame_unref(&render.frame);
    } else if (!is_free && !gate_pass(render.cancel, pause_if_requested, render.pause)) {
        sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
        sp_frame_unref(&render.frame);
    }
    pthread_mutex_lock(&gate.mutex);
    unsigned i = find_render(renderer);
    seen.begun_count--;
    memmove(seen.begun + i, seen.begun + i + 1, (seen.begun_count - i) * sizeof seen.begun[0]);
    pthread_mutex_unlock(&gate.mutex);
    return render.frame;
}

void __wrap_sp_renderer_info(const struct sp_renderer *renderer, struct sp_renderer_info *info);
void __wrap_sp_renderer_info(const struct sp_renderer *renderer, struct sp_renderer_info *info) {
    (void)renderer;
    pthread_mutex_lock(&gate.mutex);
    *info = seen.info;
    pthread_mutex_unlock(&gate.mutex);
}

static void record_end(void) {
    pthread_mutex_lock(&gate.mutex);
    seen.ended++;
    pthread_mutex_unlock(&gate.mutex);
}

void __real_srv_schedule_done(struct srv_schedule *schedule, struct srv_render_job *job,
                              const struct srv_render_result *result);
void __wrap_srv_schedule_done(struct srv_schedule *schedule, struct srv_render_job *job,
                              const struct srv_render_result *result);
void __wrap_srv_schedule_done(struct srv_schedule *schedule, struct srv_render_job *job,
                              const struct srv_render_result *result) {
    struct srv_render_result quick = *result;
    quick.encode_ms = 1; /* a busy machine must not change the choice of detail */
    __real_srv_schedule_done(schedule, job, &quick);
    record_end();
}

void __real_srv_schedule_cancelled(struct srv_schedule *schedule, struct srv_render_job *job,
                                   double elapsed_ms);
void __wrap_srv_schedule_cancelled(struct srv_schedule *schedule, struct srv_render_job *job,
                                   double elapsed_ms);
void __wrap_srv_schedule_cancelled(struct srv_schedule *schedule, struct srv_render_job *job,
                                   double elapsed_ms) {
    __real_srv_schedule_cancelled(schedule, job, elapsed_ms);
    record_end();
}

struct fixture {
    struct render_fixture render;
    struct srv_participant *participant;
    char id[SRV_SESSION_ID_BYTES];
};

/* Makes a session whose views come to rest after rest_ms, and a renderer that takes `depth` frames.
 */
static void begin(struct fixture *f, double rest_ms, unsigned depth) {
    gate_reset();
    seen.ended = seen.sharp = seen.begun_count = seen.pauses = seen.preempting = 0;
    seen.stops_preempting = false;
    seen.first = NULL;
    seen.depth = depth;
    seen.info = (struct sp_renderer_info){ .backend = "gate", .isa = "", .device = "a wall" };
    render_fixture_begin(&f->render,
                         &(struct render_fixture_options){ .queue_max = 1, .rest_ms = rest_ms });
    render_fixture_load(&f->render, "demo:engine?size=8");
    render_fixture_session(&f->render, f->id);
    f->participant = render_fixture_join(&f->render, f->id, SRV_ROLE_CONTROL);
}

static int set_up(void **state) {
    *state = calloc(1, sizeof(struct fixture));
    return *state ? 0 : -1;
}

static int tear_down(void **state) {
    struct fixture *f = *state;
    srv_hub_leave(f->render.hub, &f->participant, srv_clock_ms());
    render_fixture_end(&f->render);
    free(f);
    return 0;
}

static void send_as(struct fixture *f, struct srv_participant *participant, const char *text) {
    char *answer;
    size_t size;
    assert_true(srv_hub_message(f->render.hub, participant, text, strlen(text), srv_clock_ms(),
                                &answer, &size));
    if (answer)
        assert_non_null(strstr(answer, "\"result\""));
    free(answer);
}

static void send(struct fixture *f, const char *text) {
    send_as(f, f->participant, text);
}

static void update_as(struct fixture *f, struct srv_participant *participant, unsigned seq) {
    char text[160];
    snprintf(text, sizeof text,
             "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"view.update\",\"params\":{\"seq\":%u,"
             "\"patch\":{\"background\":[0.%u,0,0,1]}}}",
             seq, seq);
    send_as(f, participant, text);
}

static void update(struct fixture *f, unsigned seq) {
    update_as(f, f->participant, seq);
}

/* Waits for the next frame and acknowledges it. */
static struct proto_frame_header next_frame_of(struct fixture *f,
                                               struct srv_participant *participant) {
    for (;; sched_yield()) {
        struct srv_message message;
        char text[120];
        enum srv_message_kind kind =
            srv_hub_next_message(f->render.hub, participant, true, srv_clock_ms(), &message);
        free(message.text);
        srv_blob_unref(&message.blob);
        if (kind != SRV_MESSAGE_FRAME)
            continue;
        snprintf(text, sizeof text,
                 "{\"jsonrpc\":\"2.0\",\"method\":\"stream.ack\",\"params\":{\"frame\":%u}}",
                 message.header.frame);
        send_as(f, participant, text);
        return message.header;
    }
}

static struct proto_frame_header next_frame(struct fixture *f) {
    return next_frame_of(f, f->participant);
}

/* Begins, and waits for the second frame. Before the first one, which also classifies the volume,
 * is over, no frame is cancelled. */
static void begin_second_frame(struct fixture *f) {
    begin(f, 1e6, 1);
    gate_let_through(1);
    next_frame(f);
    gate_await(&seen.ended, 1);
    update(f, 1);
    gate_await(&gate.entered, 2);
}

static void a_newer_view_cancels_the_refinement_of_an_older_one(void **state) {
    struct fixture *f = *state;
    begin(f, 1, 1);
    gate_let_through(1);
    assert_int_equal(next_frame(f).flags & PROTO_FRAME_FINAL, 0);
    gate_await(&gate.entered, 2); /* the final frame is being rendered */
    assert_int_equal(seen.size[0], FULL);
    assert_int_equal(gate_count(&gate.cancelled), 0);
    update(f, 7);
    gate_await(&gate.cancelled, 1);
    gate_let_through(100);
    assert_int_equal(next_frame(f).seq, 7); /* no further frame of the old view */
}

static void a_refinement_yields_to_motion_in_another_session(void **state) {
    struct fixture *f = *state;
    char id[SRV_SESSION_ID_BYTES];
    begin(f, 1, 1);
    gate_let_through(1);
    assert_int_equal(next_frame(f).flags & PROTO_FRAME_FINAL, 0);
    gate_await(&gate.entered, 2); /* the final frame is being rendered */
    assert_int_equal(seen.size[0], FULL);
    render_fixture_session(&f->render, id);
    struct srv_participant *other = render_fixture_join(&f->render, id, SRV_ROLE_CONTROL);
    gate_await(&gate.cancelled, 1);
    gate_await(&gate.entered, 3);
    gate_let_through(1);
    next_frame_of(f, other);
    gate_let_through(100);
    while (!(next_frame(f).flags & PROTO_FRAME_FINAL)) { /* it is rendered again */
    }
    srv_hub_leave(f->render.hub, &other, srv_clock_ms());
}

static void a_moving_frame_over_its_budget_is_cancelled_but_not_two_in_a_row(void **state) {
    struct fixture *f = *state;
    begin_second_frame(f);
    uint32_t pixels = seen.size[0] * seen.size[1];
    unsigned seq = 1, mip_level = seen.mip_level;
    while (gate_count(&gate.cancelled) == 0)
        update(f, ++seq);
    gate_await(&gate.entered, 3);
    if (seen.mip_level <= mip_level)
        assert_compare(seen.size[0] * seen.size[1], <, pixels);
    double long_ago_ms = srv_clock_ms() + 2.5 * SRV_QUALITY_BUDGET_MS;
    while (srv_clock_ms() < long_ago_ms)
        update(f, ++seq);
    assert_int_equal(gate_count(&gate.cancelled), 1);
    gate_let_through(1);
    assert_compare(next_frame(f).seq, >=, 2);
    gate_await(&gate.entered, 4); /* then the newest view */
}

static void the_tick_cancels_a_frame_without_a_further_interrupt(void **state) {
    struct fixture *f = *state;
    begin_second_frame(f);
    update(f, 2); /* the last update, while the frame is within its budget */
    while (gate_count(&gate.cancelled) == 0) {
        srv_render_pool_tick(f->render.render_pool);
        sched_yield();
    }
    gate_let_through(1);
    assert_int_equal(next_frame(f).seq, 2);
}

static void a_final_moving_frame_is_encoded_again_but_not_rendered_again(void **state) {
    struct fixture *f = *state;
    begin(f, 200, 1);
    gate_let_through(1000);
    while (!(next_frame(f).flags & PROTO_FRAME_FINAL)) { /* the first frames are small */
    }
    for (unsigned seq = 1; seq <= 3; seq++) {
        struct proto_frame_header header;
        unsigned before = gate_count(&seen.sharp);
        update(f, seq);
        do {
            header = next_frame(f);
            assert_int_equal(header.seq, seq);
        } while (!(header.flags & PROTO_FRAME_FINAL));
        assert_int_equal(header.width, FULL);
        assert_int_equal(gate_count(&seen.sharp), before + 1);
    }
    send(f, "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"stream.configure\",\"params\":"
            "{\"lossless\":true}}");
    unsigned before = gate_count(&seen.sharp);
    while (!(next_frame(f).flags & PROTO_FRAME_LOSSLESS)) {
    }
    assert_int_equal(gate_count(&seen.sharp), before); /* the final frame of this view is cached */
}

static void unwanted_frames_are_cancelled(void **state) {
    struct fixture *f = *state;
    begin(f, 1e6, 1);
    gate_await(&gate.entered, 1);
    send(f, "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"view.update\",\"params\":{\"seq\":1,"
            "\"patch\":{\"volume\":\"engine\"}}}"); /* frames of the old volume are useless */
    gate_await(&gate.cancelled, 1);
    gate_await(&gate.entered, 2);
    srv_hub_leave(f->render.hub, &f->participant, srv_clock_ms());
    gate_await(&gate.cancelled, 2);
}

/* Waits for the next stream.stats; the caller frees it. */
static char *next_stats(struct fixture *f) {
    for (;; sched_yield()) {
        struct srv_message message;
        srv_hub_next_message(f->render.hub, f->participant, false, srv_clock_ms(), &message);
        if (message.text && strstr(message.text, "\"stream.stats\""))
            return message.text;
        free(message.text);
    }
}

static void a_change_of_the_backend_is_reported_at_once(void **state) {
    struct fixture *f = *state;
    struct sp_renderer_info info[SRV_RENDERERS];
    begin(f, 1e6, 1);
    srv_render_pool_info(f->render.render_pool, info);
    assert_string_equal(info[0].backend, "gate");
    assert_string_equal(info[0].failover_reason, "");
    assert_null(info[1].backend); /* no snapshot was rendered yet */
    gate_await(&gate.entered, 1);
    pthread_mutex_lock(&gate.mutex);
    seen.info = (struct sp_renderer_info){
        .backend = "fence", .isa = "", .device = "a hedge", .failover_reason = "the gate is stuck"
    };
    pthread_mutex_unlock(&gate.mutex);
    gate_let_through(1);
    char *stats = next_stats(f);
    assert_non_null(strstr(stats, "\"backend\":\"fence\""));
    assert_non_null(strstr(stats, "\"device\":\"a hedge\""));
    free(stats);
    srv_render_pool_info(f->render.render_pool, info);
    assert_string_equal(info[0].backend, "fence");
    assert_string_equal(info[0].failover_reason, "the gate is stuck");
}

/* Waits for the time between two frames of a participant, so that every participant wants a frame
 * of the next view at once. Otherwise the worker may find only one of two requests. */
static void settle_rate(void) {
    for (double next_ms = srv_clock_ms() + 1000.0 / FPS; srv_clock_ms() < next_ms;)
        sched_yield();
}

static void close_gate(void) {
    pthread_mutex_lock(&gate.mutex);
    gate.passes = gate.cancelled = 0;
    pthread_mutex_unlock(&gate.mutex);
}

static void settle(void) {
    gate_await(&seen.ended, gate_count(&gate.entered));
    settle_rate();
}

/* A renderer that takes two frames at a time, and a participant that wants frames of another size:
 * each change of the view makes two jobs at once. */
static struct srv_participant *begin_with_two(struct fixture *f) {
    begin(f, 1e6, 2);
    struct srv_participant *other = render_fixture_join(&f->render, f->id, SRV_ROLE_VIEW);
    send_as(f, other,
            "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"stream.configure\",\"params\":"
            "{\"size\":[100,100]}}");
    gate_let_through(1000);
    next_frame(f);
    while (next_frame_of(f, other).width > 100) { /* encoded before stream.configure */
    }
    settle();
    close_gate();
    return other;
}

static void frames_begin_while_others_are_rendered(void **state) {
    struct fixture *f = *state;
    struct srv_participant *other = begin_with_two(f);
    for (unsigned seq = 2; seq <= 4; seq++) {
        unsigned entered = gate_count(&gate.entered);
        update(f, seq);
        gate_await(&gate.entered, entered + 2); /* without letting one through */
        gate_let_through(2);
        assert_int_equal(next_frame(f).seq, seq);
        next_frame_of(f, other);
        settle();
    }
    assert_int_equal(gate_count(&gate.cancelled), 0);
    srv_hub_leave(f->render.hub, &other, srv_clock_ms());
}

static void of_two_frames_in_flight_one_is_always_finished(void **state) {
    struct fixture *f = *state;
    struct srv_participant *other = begin_with_two(f);
    unsigned entered = gate_count(&gate.entered), seq = 2;
    update(f, seq);
    gate_await(&gate.entered, entered + 2);
    while (gate_count(&gate.cancelled) == 0)
        update(f, ++seq); /* both are outdated, the first is over its budget */
    double long_ago_ms = srv_clock_ms() + 2.5 * SRV_QUALITY_BUDGET_MS;
    while (srv_clock_ms() < long_ago_ms) {
        update(f, ++seq);
        srv_render_pool_tick(f->render.render_pool);
    }
    assert_int_equal(gate_count(&gate.cancelled), 1);
    srv_hub_leave(f->render.hub, &other, srv_clock_ms());
}

static void the_pool_can_stop_with_frames_in_flight(void **state) {
    struct fixture *f = *state;
    struct srv_participant *other = begin_with_two(f);
    unsigned entered = gate_count(&gate.entered);
    update(f, 2);
    gate_await(&gate.entered, entered + 2);
    render_fixture_stop(&f->render);
    assert_int_equal(gate_count(&gate.cancelled), 2);
    srv_hub_leave(f->render.hub, &other, srv_clock_ms());
}

/* Makes a second session, whose frames are known to be short, while a frame of the first session
 * waits at the gate. Returns the participant of the second session. */
static struct srv_participant *begin_with_a_long_frame(struct fixture *f, bool holds) {
    char id[SRV_SESSION_ID_BYTES];
    begin(f, 1e6, 1);
    pthread_mutex_lock(&gate.mutex);
    /* The preemption worker creates a renderer of its own. */
    seen.info.backend = seen.preempting_backend ? seen.preempting_backend : "null";
    seen.info.can_pause = holds;
    pthread_mutex_unlock(&gate.mutex);
    gate_let_through(1000);
    next_frame(f);
    render_fixture_session(&f->render, id);
    struct srv_participant *other = render_fixture_join(&f->render, id, SRV_ROLE_CONTROL);
    send_as(f, other,
            "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"stream.configure\",\"params\":"
            "{\"size\":[16,16]}}");              /* quick to encode */
    while (next_frame_of(f, other).width > 16) { /* encoded before stream.configure */
    }
    update_as(f, other, 2);
    next_frame_of(f, other);
    settle();
    close_gate();
    unsigned entered = gate_count(&gate.entered);
    update(f, 3);
    gate_await(&gate.entered, entered + 1);
    update_as(f, other, 4);
    return other;
}

static void a_long_frame_is_paused_for_a_short_one(void **state) {
    struct fixture *f = *state;
    struct srv_participant *other = begin_with_a_long_frame(f, true);
    assert_int_equal(next_frame_of(f, other).seq, 4); /* without letting one through */
    assert_int_equal(gate_count(&seen.preempting), 1);
    assert_int_equal(gate_count(&gate.cancelled), 0);
    gate_let_through(1); /* the long frame is resumed */
    assert_int_equal(next_frame(f).seq, 3);
    srv_hub_leave(f->render.hub, &other, srv_clock_ms());
}

static void a_paused_frame_can_be_cancelled(void **state) {
    struct fixture *f = *state;
    struct srv_participant *other = begin_with_a_long_frame(f, true);
    assert_int_equal(next_frame_of(f, other).seq, 4);
    pthread_mutex_lock(&gate.mutex);
    seen.stops_preempting = true;
    seen.pauses = 0;
    pthread_mutex_unlock(&gate.mutex);
    update_as(f, other, 5);
    gate_await(&seen.pauses, 1); /* and stays paused */
    render_fixture_stop(&f->render);
    assert_int_equal(gate_count(&gate.cancelled), 2);
    srv_hub_leave(f->render.hub, &other, srv_clock_ms());
}

static void a_frame_that_cannot_be_paused_delays_the_others(void **state) {
    struct fixture *f = *state;
    struct srv_participant *other = begin_with_a_long_frame(f, false);
    settle_rate();
    assert_int_equal(gate_count(&seen.preempting), 0);
    gate_let_through(2);
    assert_int_equal(next_frame_of(f, other).seq, 4);
    assert_int_equal(gate_count(&seen.preempting), 0);
    srv_hub_leave(f->render.hub, &other, srv_clock_ms());
}

/* Lets the long frame and the short one through, which the interactive worker renders instead. */
static void expect_no_preemption(struct fixture *f, struct srv_participant *other) {
    gate_let_through(2);
    assert_int_equal(next_frame_of(f, other).seq, 4);
    next_frame(f);
    settle();
    close_gate();
    const unsigned entered = gate_count(&gate.entered), past = gate_count(&seen.preempting);
    update(f, 5); /* a long frame again */
    gate_await(&gate.entered, entered + 1);
    update_as(f, other, 6);
    settle_rate();
    assert_int_equal(gate_count(&seen.preempting), past);
    gate_let_through(2);
    assert_int_equal(next_frame_of(f, other).seq, 6);
    srv_hub_leave(f->render.hub, &other, srv_clock_ms());
}

static void a_preemption_worker_whose_render_fails_is_not_used_again(void **state) {
    seen.fails_preempting = true;
    struct srv_participant *other = begin_with_a_long_frame(*state, true);
    gate_await(&seen.preempting, 1);
    expect_no_preemption(*state, other);
    seen.fails_preempting = false;
}

static void a_preemption_worker_without_a_renderer_is_not_used(void **state) {
    seen.preempting_backend = "missing";
    expect_no_preemption(*state, begin_with_a_long_frame(*state, true));
    seen.preempting_backend = NULL;
}

int main(void) {
    const struct CMUnitTest tests[] = {
#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
        TEST(a_newer_view_cancels_the_refinement_of_an_older_one),
        TEST(a_refinement_yields_to_motion_in_another_session),
        TEST(a_moving_frame_over_its_budget_is_cancelled_but_not_two_in_a_row),
        TEST(the_tick_cancels_a_frame_without_a_further_interrupt),
        TEST(a_final_moving_frame_is_encoded_again_but_not_rendered_again),
        TEST(unwanted_frames_are_cancelled),
        TEST(a_change_of_the_backend_is_reported_at_once),
        TEST(frames_begin_while_others_are_rendered),
        TEST(of_two_frames_in_flight_one_is_always_finished),
        TEST(the_pool_can_stop_with_frames_in_flight),
        TEST(a_long_frame_is_paused_for_a_short_one),
        TEST(a_paused_frame_can_be_cancelled),
        TEST(a_frame_that_cannot_be_paused_delays_the_others),
        TEST(a_preemption_worker_whose_render_fails_is_not_used_again),
        TEST(a_preemption_worker_without_a_renderer_is_not_used),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
