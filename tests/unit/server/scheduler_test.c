/* SPDX-License-Identifier: Apache-2.0
 *
 * The stream lane between a real hub and a renderer behind a gate: the linker puts the gate in the
 * place of sp_renderer_begin() and sp_renderer_finish(). A render that is finished waits there
 * until the test lets it through or its cancel flag is set, so that "while it is being rendered" is
 * a state, not a moment. What a renderer says of itself comes from the gate as well.
 */
#include <math.h>
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

#include "clock.h"
#include "render/scheduler.h"

enum {
    FULL = 512, /* px a side of a view as it is by default */
    FPS = 30    /* frames a second that a participant gets by default */
};

struct render { /* that was begun and not finished */
    uint32_t size[2];
    const atomic_bool *cancel;
    struct sp_frame *frame;
};

struct gate {
    pthread_mutex_t mutex;
    unsigned entered, cancelled, passes;   /* passes: renders that may go through */
    unsigned ended;                        /* jobs, for the hub: it may make further ones */
    unsigned sharp;                        /* renders that entered with all voxels at full size */
    unsigned depth;                        /* of the renderer */
    struct render begun[SP_IN_FLIGHT_MAX]; /* oldest first */
    unsigned begun_count;
    uint32_t size[2]; /* of the newest render */
    unsigned coarse;
    struct sp_renderer_info info; /* as a renderer tells it after its next render */
};
static struct gate gate = { .mutex = PTHREAD_MUTEX_INITIALIZER };

static bool pass_gate(const atomic_bool *cancel) {
    for (;; sched_yield()) {
        pthread_mutex_lock(&gate.mutex);
        bool cancelled = atomic_load(cancel), go = !cancelled && gate.passes > 0;
        gate.passes -= go;
        gate.cancelled += cancelled;
        pthread_mutex_unlock(&gate.mutex);
        if (go || cancelled)
            return go;
    }
}

unsigned __wrap_sp_renderer_depth(const struct sp_renderer *renderer);
unsigned __wrap_sp_renderer_depth(const struct sp_renderer *renderer) {
    (void)renderer;
    return gate.depth;
}

bool __wrap_sp_renderer_begin(struct sp_renderer *renderer, struct sp_volume *volume,
                              const struct sp_view *view, struct sp_frame_pool *pool,
                              const struct sp_render_options *options, struct sp_error *err);
bool __wrap_sp_renderer_begin(struct sp_renderer *renderer, struct sp_volume *volume,
                              const struct sp_view *view, struct sp_frame_pool *pool,
                              const struct sp_render_options *options, struct sp_error *err) {
    (void)renderer, (void)volume;
    struct sp_frame *frame =
        sp_frame_create(pool, view->size[0], view->size[1], options->format, err);
    assert_non_null(frame);
    memset(frame->pixels, 0, frame->stride_bytes * frame->height);
    frame->stats = (struct sp_frame_stats){ .backend = "gate", .render_ms = 2 };
    pthread_mutex_lock(&gate.mutex);
    assert_true(gate.begun_count < gate.depth);
    gate.begun[gate.begun_count++] =
        (struct render){ { view->size[0], view->size[1] }, options->cancel, frame };
    gate.entered++;
    gate.coarse = options->coarse;
    gate.sharp += options->coarse == 0 && view->size[0] == FULL;
    memcpy(gate.size, view->size, sizeof gate.size);
    pthread_mutex_unlock(&gate.mutex);
    return true;
}

struct sp_frame *__wrap_sp_renderer_finish(struct sp_renderer *renderer, struct sp_error *err);
struct sp_frame *__wrap_sp_renderer_finish(struct sp_renderer *renderer, struct sp_error *err) {
    (void)renderer;
    assert_true(gate.begun_count > 0);
    struct render render = gate.begun[0];
    if (!pass_gate(render.cancel)) {
        sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
        sp_frame_unref(&render.frame);
    }
    pthread_mutex_lock(&gate.mutex);
    gate.begun_count--;
    memmove(gate.begun, gate.begun + 1, sizeof gate.begun - sizeof gate.begun[0]);
    pthread_mutex_unlock(&gate.mutex);
    return render.frame;
}

void __wrap_sp_renderer_info(const struct sp_renderer *renderer, struct sp_renderer_info *info);
void __wrap_sp_renderer_info(const struct sp_renderer *renderer, struct sp_renderer_info *info) {
    (void)renderer;
    pthread_mutex_lock(&gate.mutex);
    *info = gate.info;
    pthread_mutex_unlock(&gate.mutex);
}

static void count_end(void) {
    pthread_mutex_lock(&gate.mutex);
    gate.ended++;
    pthread_mutex_unlock(&gate.mutex);
}

void __real_srv_hub_job_done(struct srv_hub *hub, struct srv_job *job,
                             const struct srv_job_result *result);
void __wrap_srv_hub_job_done(struct srv_hub *hub, struct srv_job *job,
                             const struct srv_job_result *result);
void __wrap_srv_hub_job_done(struct srv_hub *hub, struct srv_job *job,
                             const struct srv_job_result *result) {
    __real_srv_hub_job_done(hub, job, result);
    count_end();
}

void __real_srv_hub_job_cancelled(struct srv_hub *hub, struct srv_job *job, double elapsed_ms);
void __wrap_srv_hub_job_cancelled(struct srv_hub *hub, struct srv_job *job, double elapsed_ms);
void __wrap_srv_hub_job_cancelled(struct srv_hub *hub, struct srv_job *job, double elapsed_ms) {
    __real_srv_hub_job_cancelled(hub, job, elapsed_ms);
    count_end();
}

static unsigned look_at(const unsigned *counter) {
    pthread_mutex_lock(&gate.mutex);
    unsigned value = *counter;
    pthread_mutex_unlock(&gate.mutex);
    return value;
}

static void wait_for(const unsigned *counter, unsigned value) {
    while (look_at(counter) < value)
        sched_yield();
}

static void let_through(unsigned renders) {
    pthread_mutex_lock(&gate.mutex);
    gate.passes += renders;
    pthread_mutex_unlock(&gate.mutex);
}

struct fixture {
    struct srv_catalog *catalog;
    struct srv_scheduler *scheduler;
    struct srv_hub *hub;
    struct srv_participant *participant;
    char id[SRV_SESSION_ID_BYTES];
};

static void on_progress(void *user, const char *id, const char *state, double progress,
                        const char *reason) {
    (void)user, (void)id, (void)state, (void)progress, (void)reason;
}

static void on_unloaded(void *user, struct sp_volume *volume) {
    (void)user;
    sp_volume_unref(&volume);
}

static void on_work(void *user) {
    srv_scheduler_wake(((struct fixture *)user)->scheduler);
}

static void on_ready(void *user) {
    (void)user;
}

static void on_interrupt(void *user, uint64_t session, enum srv_interrupt why) {
    srv_scheduler_interrupt(((struct fixture *)user)->scheduler, session, why);
}

static void load(struct fixture *f, const char *source) {
    struct srv_volume_request request = { .source = source };
    struct srv_volume_status status;
    char id[SP_NAME_BYTES];
    bool existed, conflict;
    assert_true(srv_catalog_add(f->catalog, &request, id, &existed, &conflict, NULL));
    for (;; sched_yield()) {
        assert_true(srv_catalog_find(f->catalog, id, &status));
        sp_volume_unref(&status.volume);
        if (status.state != SRV_VOLUME_LOADING)
            break;
    }
    assert_int_equal(status.state, SRV_VOLUME_READY);
}

/* A session, its views come to rest after rest_ms, and a renderer of `depth` frames. */
static void begin_deep(struct fixture *f, double rest_ms, unsigned depth) {
    struct srv_catalog_options catalog = { .memory_bytes = 1 << 20,
                                           .progress = on_progress,
                                           .unloaded = on_unloaded };
    gate.entered = gate.cancelled = gate.passes = gate.ended = gate.sharp = gate.begun_count = 0;
    gate.depth = depth;
    gate.info = (struct sp_renderer_info){ .backend = "gate", .isa = "", .device = "a wall" };
    f->catalog = srv_catalog_create(&catalog, NULL);
    assert_non_null(f->catalog);
    load(f, "demo:phantom?size=8");
    load(f, "demo:engine?size=8");
    struct sp_renderer_options null = { .backend = "null" };
    struct sp_renderer *renderer = sp_renderer_create(&null, NULL);
    struct srv_scheduler_options options = {
        .catalog = f->catalog, .queue_max = 1, .encode_threads = 1, .stills = null
    };
    f->scheduler = srv_scheduler_create(&options, &renderer, NULL);
    assert_non_null(f->scheduler);
    struct srv_hub_options hub = { .volumes = { f->catalog, srv_catalog_acquire, srv_catalog_ref,
                                                srv_catalog_release, srv_catalog_default_view,
                                                srv_catalog_pick },
                                   .sessions_max = 2,
                                   .participants_max = 2,
                                   .session_idle_ms = 1e6,
                                   .rest_ms = rest_ms,
                                   .stream_bytes = 1 << 20,
                                   .user = f,
                                   .work = on_work,
                                   .ready = on_ready,
                                   .interrupt = on_interrupt };
    f->hub = srv_hub_create(&hub, NULL);
    assert_true(srv_scheduler_start(f->scheduler, f->hub, NULL));
    proto_json *json = srv_hub_session_create(f->hub, NULL, srv_clock_ms(), f->id, NULL);
    assert_non_null(json);
    proto_json_free(&json);
    f->participant = srv_hub_join(f->hub, f->id, SRV_ROLE_CONTROL, f, srv_clock_ms(), NULL);
    assert_non_null(f->participant);
}

static void begin(struct fixture *f, double rest_ms) {
    begin_deep(f, rest_ms, 1);
}

static int set_up(void **state) {
    *state = calloc(1, sizeof(struct fixture));
    return *state ? 0 : -1;
}

static int tear_down(void **state) {
    struct fixture *f = *state;
    srv_hub_leave(f->hub, &f->participant, srv_clock_ms());
    srv_scheduler_stop(f->scheduler);
    srv_hub_destroy(&f->hub);
    srv_scheduler_destroy(&f->scheduler);
    srv_catalog_destroy(&f->catalog);
    free(f);
    return 0;
}

static void tell_by(struct fixture *f, struct srv_participant *participant, const char *text) {
    char *answer;
    size_t size;
    assert_true(
        srv_hub_message(f->hub, participant, text, strlen(text), srv_clock_ms(), &answer, &size));
    assert_true(!answer || strstr(answer, "\"result\""));
    free(answer);
}

static void tell(struct fixture *f, const char *text) {
    tell_by(f, f->participant, text);
}

static void update(struct fixture *f, unsigned seq) {
    char text[160];
    snprintf(text, sizeof text,
             "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"view.update\",\"params\":{\"seq\":%u,"
             "\"patch\":{\"background\":[0.%u,0,0,1]}}}",
             seq, seq);
    tell(f, text);
}

/* The next frame that arrives, acknowledged. */
static struct proto_frame_header next_frame_of(struct fixture *f,
                                               struct srv_participant *participant) {
    for (;; sched_yield()) {
        struct srv_message message;
        char text[120];
        enum srv_message_kind kind =
            srv_hub_next_message(f->hub, participant, true, srv_clock_ms(), &message);
        free(message.text);
        srv_blob_unref(&message.blob);
        if (kind != SRV_MESSAGE_FRAME)
            continue;
        snprintf(text, sizeof text,
                 "{\"jsonrpc\":\"2.0\",\"method\":\"stream.ack\",\"params\":{\"frame\":%u}}",
                 message.header.frame);
        tell_by(f, participant, text);
        return message.header;
    }
}

static struct proto_frame_header next_frame(struct fixture *f) {
    return next_frame_of(f, f->participant);
}

static void a_newer_view_gives_up_the_refinement_of_an_older_one(void **state) {
    struct fixture *f = *state;
    begin(f, 1);
    let_through(1);
    assert_int_equal(next_frame(f).flags & PROTO_FRAME_FINAL, 0);
    wait_for(&gate.entered, 2); /* the sharp picture is on its way */
    assert_int_equal(gate.size[0], FULL);
    assert_int_equal(look_at(&gate.cancelled), 0);
    update(f, 7);
    wait_for(&gate.cancelled, 1);
    let_through(100);
    assert_int_equal(next_frame(f).seq, 7); /* of the old view nothing more is seen */
}

static void a_refinement_gives_way_to_what_moves_in_another_session(void **state) {
    struct fixture *f = *state;
    char id[SRV_SESSION_ID_BYTES];
    begin(f, 1);
    let_through(1);
    assert_int_equal(next_frame(f).flags & PROTO_FRAME_FINAL, 0);
    wait_for(&gate.entered, 2); /* the sharp picture is on its way */
    assert_int_equal(gate.size[0], FULL);
    proto_json *json = srv_hub_session_create(f->hub, NULL, srv_clock_ms(), id, NULL);
    assert_non_null(json);
    proto_json_free(&json);
    struct srv_participant *other =
        srv_hub_join(f->hub, id, SRV_ROLE_CONTROL, f, srv_clock_ms(), NULL);
    assert_non_null(other);
    wait_for(&gate.cancelled, 1);
    wait_for(&gate.entered, 3);
    assert_true(gate.size[0] < FULL);
    let_through(100);
    next_frame_of(f, other);
    while (!(next_frame(f).flags & PROTO_FRAME_FINAL)) { /* it is taken again */
    }
    srv_hub_leave(f->hub, &other, srv_clock_ms());
}

static void a_moving_frame_far_over_its_budget_is_given_up_but_not_two_in_a_row(void **state) {
    struct fixture *f = *state;
    begin(f, 1e6);
    let_through(1); /* the first one does what is done once */
    next_frame(f);
    update(f, 1);
    wait_for(&gate.entered, 2);
    uint32_t pixels = gate.size[0] * gate.size[1];
    unsigned seq = 1, coarse = gate.coarse;
    while (look_at(&gate.cancelled) == 0)
        update(f, ++seq);
    wait_for(&gate.entered, 3);
    assert_true(gate.coarse > coarse || gate.size[0] * gate.size[1] < pixels);
    double long_ago_ms = srv_clock_ms() + 2.5 * SRV_PACE_ENOUGH_MS;
    while (srv_clock_ms() < long_ago_ms)
        update(f, ++seq);
    assert_int_equal(look_at(&gate.cancelled), 1);
    let_through(1);
    assert_true(next_frame(f).seq >= 2);
    wait_for(&gate.entered, 4); /* and on with the newest */
}

static void the_tick_gives_up_what_nobody_interrupts_any_more(void **state) {
    struct fixture *f = *state;
    begin(f, 1e6);
    let_through(1);
    next_frame(f);
    update(f, 1);
    wait_for(&gate.entered, 2);
    update(f, 2); /* the last one: it comes while the frame is within its budget */
    while (look_at(&gate.cancelled) == 0) {
        srv_scheduler_tick(f->scheduler);
        sched_yield();
    }
    let_through(1);
    assert_int_equal(next_frame(f).seq, 2);
}

static void a_sharp_moving_picture_is_encoded_again_not_rendered(void **state) {
    struct fixture *f = *state;
    begin(f, 200);
    let_through(1000);
    while (!(next_frame(f).flags & PROTO_FRAME_FINAL)) { /* the first ones are small */
    }
    for (unsigned seq = 1; seq <= 3; seq++) {
        struct proto_frame_header header;
        unsigned before = look_at(&gate.sharp);
        update(f, seq);
        do {
            header = next_frame(f);
            assert_int_equal(header.seq, seq);
        } while (!(header.flags & PROTO_FRAME_FINAL));
        assert_int_equal(header.width, FULL);
        assert_int_equal(look_at(&gate.sharp), before + 1);
    }
    tell(f, "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"stream.configure\",\"params\":"
            "{\"lossless\":true}}");
    unsigned before = look_at(&gate.sharp);
    while (!(next_frame(f).flags & PROTO_FRAME_LOSSLESS)) {
    }
    assert_int_equal(look_at(&gate.sharp), before); /* that view's sharp picture is there */
}

static void what_nobody_wants_is_given_up(void **state) {
    struct fixture *f = *state;
    begin(f, 1e6);
    wait_for(&gate.entered, 1);
    tell(f, "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"view.update\",\"params\":{\"seq\":1,"
            "\"patch\":{\"volume\":\"engine\"}}}"); /* of another volume nothing can be used */
    wait_for(&gate.cancelled, 1);
    wait_for(&gate.entered, 2);
    srv_hub_leave(f->hub, &f->participant, srv_clock_ms());
    wait_for(&gate.cancelled, 2);
}

/* The next stream.stats that arrives; the caller frees it. */
static char *next_stats(struct fixture *f) {
    for (;; sched_yield()) {
        struct srv_message message;
        srv_hub_next_message(f->hub, f->participant, false, srv_clock_ms(), &message);
        if (message.text && strstr(message.text, "\"stream.stats\""))
            return message.text;
        free(message.text);
    }
}

static void a_backend_that_is_given_up_is_told_at_once(void **state) {
    struct fixture *f = *state;
    struct sp_renderer_info streams, stills;
    begin(f, 1e6);
    srv_scheduler_info(f->scheduler, &streams, &stills);
    assert_string_equal(streams.backend, "gate");
    assert_string_equal(streams.given_up, "");
    assert_null(stills.backend); /* there was no still yet */
    wait_for(&gate.entered, 1);
    pthread_mutex_lock(&gate.mutex);
    gate.info = (struct sp_renderer_info){
        .backend = "fence", .isa = "", .device = "a hedge", .given_up = "the gate is stuck"
    };
    pthread_mutex_unlock(&gate.mutex);
    let_through(1);
    char *stats = next_stats(f);
    assert_non_null(strstr(stats, "\"backend\":\"fence\""));
    assert_non_null(strstr(stats, "\"device\":\"a hedge\""));
    free(stats);
    srv_scheduler_info(f->scheduler, &streams, &stills);
    assert_string_equal(streams.backend, "fence");
    assert_string_equal(streams.given_up, "the gate is stuck");
}

/* Nothing is under way, and as much time has passed as there is between two frames of a
 * participant: whoever wants a picture of the next view wants it as soon as it is there. Without
 * that the lane may find one of two who want one, and waits for that picture as it should. */
static void settle(void) {
    wait_for(&gate.ended, look_at(&gate.entered));
    double next_ms = srv_clock_ms() + 1000.0 / FPS;
    while (srv_clock_ms() < next_ms)
        sched_yield();
}

/* A renderer of two frames at a time, and a participant who wants pictures of another size: each
 * change of the view makes two jobs at once. */
static struct srv_participant *begin_with_two(struct fixture *f) {
    begin_deep(f, 1e6, 2);
    struct srv_participant *other =
        srv_hub_join(f->hub, f->id, SRV_ROLE_VIEW, f, srv_clock_ms(), NULL);
    assert_non_null(other);
    tell_by(f, other,
            "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"stream.configure\",\"params\":"
            "{\"size\":[100,100]}}");
    let_through(1000);
    next_frame(f);
    while (next_frame_of(f, other).width > 100) { /* before it was told */
    }
    settle();
    pthread_mutex_lock(&gate.mutex);
    gate.passes = gate.cancelled = 0;
    pthread_mutex_unlock(&gate.mutex);
    return other;
}

static void frames_are_begun_while_others_are_drawn(void **state) {
    struct fixture *f = *state;
    struct srv_participant *other = begin_with_two(f);
    for (unsigned seq = 2; seq <= 4; seq++) {
        unsigned entered = look_at(&gate.entered);
        update(f, seq);
        wait_for(&gate.entered, entered + 2); /* nothing was let through */
        let_through(2);
        assert_int_equal(next_frame(f).seq, seq);
        next_frame_of(f, other);
        settle();
    }
    assert_int_equal(look_at(&gate.cancelled), 0);
    srv_hub_leave(f->hub, &other, srv_clock_ms());
}

static void of_two_frames_in_flight_one_is_always_finished(void **state) {
    struct fixture *f = *state;
    struct srv_participant *other = begin_with_two(f);
    unsigned entered = look_at(&gate.entered), seq = 2;
    update(f, seq);
    wait_for(&gate.entered, entered + 2);
    while (look_at(&gate.cancelled) == 0)
        update(f, ++seq); /* both are outdated, and the first is over its budget */
    double long_ago_ms = srv_clock_ms() + 2.5 * SRV_PACE_ENOUGH_MS;
    while (srv_clock_ms() < long_ago_ms) {
        update(f, ++seq);
        srv_scheduler_tick(f->scheduler);
    }
    assert_int_equal(look_at(&gate.cancelled), 1);
    srv_hub_leave(f->hub, &other, srv_clock_ms());
}

static void a_daemon_may_stop_with_frames_in_flight(void **state) {
    struct fixture *f = *state;
    struct srv_participant *other = begin_with_two(f);
    unsigned entered = look_at(&gate.entered);
    update(f, 2);
    wait_for(&gate.entered, entered + 2);
    srv_scheduler_stop(f->scheduler);
    assert_int_equal(look_at(&gate.cancelled), 2);
    srv_hub_leave(f->hub, &other, srv_clock_ms());
}

int main(void) {
    const struct CMUnitTest tests[] = {
#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
        TEST(a_newer_view_gives_up_the_refinement_of_an_older_one),
        TEST(a_refinement_gives_way_to_what_moves_in_another_session),
        TEST(a_moving_frame_far_over_its_budget_is_given_up_but_not_two_in_a_row),
        TEST(the_tick_gives_up_what_nobody_interrupts_any_more),
        TEST(a_sharp_moving_picture_is_encoded_again_not_rendered),
        TEST(what_nobody_wants_is_given_up),
        TEST(a_backend_that_is_given_up_is_told_at_once),
        TEST(frames_are_begun_while_others_are_drawn),
        TEST(of_two_frames_in_flight_one_is_always_finished),
        TEST(a_daemon_may_stop_with_frames_in_flight),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
