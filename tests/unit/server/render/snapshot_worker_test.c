/* SPDX-License-Identifier: Apache-2.0
 *
 * The snapshot worker behind a gate (support/gate.h): the linker replaces sp_renderer_render(),
 * which only this worker calls. Each snapshot waits there until the test lets it through or its
 * cancel flag is set. Session frames are rendered by the null backend.
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
#include "support/compare.h"
#include "support/gate.h"
#include "support/render_fixture.h"
#include "unit/server/counted.h"

enum {
    QUEUE = 4,
    SHARP = 90,
    STREAM_THREADS = 3, /* encode threads in the foreground */
    ENCODE_THREADS = 5, /* with those in the background */
    STRIPES = 8,
    SLOW_PX = 2500000 /* a PNG of this size is slow to encode (SRV_SLOW_ENCODE_MS) */
};

static struct { /* guarded by the gate's mutex */
    unsigned encoded;
    unsigned sharp;     /* of these, in the quality of final frames */
    unsigned width[16]; /* of the snapshots that entered the gate, in order */
    struct {            /* the callback of each encoder, in the order of the threads */
        struct sp_encoder *encoder;
        sp_share_fn *share;
        void *user;
    } sharers[ENCODE_THREADS];
    unsigned sharer_count;
    bool shares;                   /* each encoding calls make_stripe() for STRIPES stripes */
    unsigned at_stripes, together; /* threads in make_stripe(), and how many it waits for */
    unsigned made[STRIPES], by[ENCODE_THREADS];
    uint64_t blocked_png_px; /* PNGs of at least this size wait before encoding; 0 = none */
    unsigned pngs;           /* encodings of PNG that were begun */
} seen;

struct sp_frame *__real_sp_renderer_render(struct sp_renderer *renderer, struct sp_volume *volume,
                                           const struct sp_view *view, struct sp_frame_pool *pool,
                                           const struct sp_render_options *options,
                                           struct sp_error *err);
struct sp_frame *__wrap_sp_renderer_render(struct sp_renderer *renderer, struct sp_volume *volume,
                                           const struct sp_view *view, struct sp_frame_pool *pool,
                                           const struct sp_render_options *options,
                                           struct sp_error *err);
struct sp_frame *__wrap_sp_renderer_render(struct sp_renderer *renderer, struct sp_volume *volume,
                                           const struct sp_view *view, struct sp_frame_pool *pool,
                                           const struct sp_render_options *options,
                                           struct sp_error *err) {
    pthread_mutex_lock(&gate.mutex);
    seen.width[gate.entered++ % 16] = view->size[0];
    pthread_mutex_unlock(&gate.mutex);
    if (!gate_pass(options->cancel, NULL, NULL)) {
        sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
        return NULL;
    }
    struct sp_render_options go_on = *options;
    go_on.cancel = NULL;
    return __real_sp_renderer_render(renderer, volume, view, pool, &go_on, err);
}

void __wrap_sp_encoder_set_share(struct sp_encoder *encoder, sp_share_fn *share, void *user);
void __wrap_sp_encoder_set_share(struct sp_encoder *encoder, sp_share_fn *share, void *user) {
    seen.sharers[seen.sharer_count].encoder = encoder;
    seen.sharers[seen.sharer_count].share = share;
    seen.sharers[seen.sharer_count++].user = user;
}

static unsigned sharer_of(const struct sp_encoder *encoder) {
    unsigned i = 0;
    while (i < seen.sharer_count && seen.sharers[i].encoder != encoder)
        i++;
    assert_compare(i, <, seen.sharer_count);
    return i;
}

/* Waits until enough threads are at stripes. */
static void make_stripe(void *of, unsigned i, struct sp_encoder *with) {
    assert_ptr_equal(of, &seen);
    pthread_mutex_lock(&gate.mutex);
    seen.made[i]++;
    seen.by[sharer_of(with)]++;
    seen.at_stripes++;
    pthread_mutex_unlock(&gate.mutex);
    gate_await(&seen.at_stripes, seen.together);
}

static bool is_blocked(const struct sp_frame *frame) {
    pthread_mutex_lock(&gate.mutex);
    bool held =
        seen.blocked_png_px != 0 && (uint64_t)frame->width * frame->height >= seen.blocked_png_px;
    pthread_mutex_unlock(&gate.mutex);
    return held;
}

static void block_png(uint64_t px) {
    pthread_mutex_lock(&gate.mutex);
    seen.blocked_png_px = px;
    pthread_mutex_unlock(&gate.mutex);
}

bool __real_sp_encode(struct sp_encoder *encoder, const struct sp_frame *frame,
                      enum sp_image_format format, int quality, const uint8_t **bytes, size_t *size,
                      struct sp_error *err);
bool __wrap_sp_encode(struct sp_encoder *encoder, const struct sp_frame *frame,
                      enum sp_image_format format, int quality, const uint8_t **bytes, size_t *size,
                      struct sp_error *err);
bool __wrap_sp_encode(struct sp_encoder *encoder, const struct sp_frame *frame,
                      enum sp_image_format format, int quality, const uint8_t **bytes, size_t *size,
                      struct sp_error *err) {
    pthread_mutex_lock(&gate.mutex);
    seen.encoded++;
    seen.sharp += quality == SHARP;
    seen.pngs += format == SP_IMAGE_PNG;
    pthread_mutex_unlock(&gate.mutex);
    while (format == SP_IMAGE_PNG && is_blocked(frame))
        sched_yield();
    if (seen.shares) {
        unsigned own = sharer_of(encoder);
        seen.sharers[own].share(seen.sharers[own].user, encoder, STRIPES, make_stripe, &seen);
    }
    return __real_sp_encode(encoder, frame, format, quality, bytes, size, err);
}

static _Atomic int64_t ahead_s; /* of the real clock */

int __real_clock_gettime(clockid_t clock, struct timespec *t);
int __wrap_clock_gettime(clockid_t clock, struct timespec *t);
int __wrap_clock_gettime(clockid_t clock, struct timespec *t) {
    int result = __real_clock_gettime(clock, t);
    t->tv_sec += atomic_load(&ahead_s);
    return result;
}

struct fixture {
    struct render_fixture render;
    struct srv_participant *participant; /* NULL until one joins */
    char id[SRV_SESSION_ID_BYTES];
};

struct client { /* requests one snapshot; zero = JPEG */
    enum sp_image_format format;
    int quality; /* 0 = that of final frames */
    const char *owner;
    double expected_ms;
    bool wants_frame;
    unsigned answers, images, frames;
    size_t size;
    uint32_t sum; /* of the bytes */
    atomic_bool left;
};

static void on_done(void *user, const struct srv_snapshot_result *result) {
    struct client *client = user;
    pthread_mutex_lock(&gate.mutex);
    client->images += result->ok;
    client->frames += result->ok && result->frame && result->frame->pixels;
    client->size = result->ok ? result->size : 0;
    client->sum = 0;
    for (size_t i = 0; i < client->size; i++)
        client->sum = client->sum * 31 + result->bytes[i];
    client->answers++;
    pthread_mutex_unlock(&gate.mutex);
}

static bool is_gone(void *user) {
    return atomic_load(&((struct client *)user)->left);
}

static int set_up_threads(void **state, unsigned threads) {
    struct fixture *f = *state = calloc(1, sizeof *f);
    assert_non_null(f);
    gate_reset();
    memset(&seen, 0, sizeof seen);
    atomic_store(&ahead_s, 0);
    render_fixture_begin(&f->render, &(struct render_fixture_options){ .queue_max = QUEUE,
                                                                       .encode_threads = threads });
    render_fixture_session(&f->render, f->id);
    return 0;
}

static int set_up(void **state) {
    return set_up_threads(state, 1);
}

static int set_up_two(void **state) {
    return set_up_threads(state, 2);
}

static int set_up_sharing(void **state) {
    return set_up_threads(state, STREAM_THREADS);
}

static int tear_down(void **state) {
    struct fixture *f = *state;
    block_png(0);
    srv_hub_leave(f->render.hub, &f->participant, srv_clock_ms());
    render_fixture_end(&f->render);
    free(f);
    return 0;
}

static bool request(struct fixture *f, struct client *client, unsigned width, bool background) {
    struct srv_snapshot snapshot = { .format = client->format,
                                     .quality = client->quality ? client->quality : SHARP,
                                     .background = background,
                                     .expected_ms = client->expected_ms,
                                     .wants_frame = client->wants_frame,
                                     .done = on_done,
                                     .is_gone = is_gone,
                                     .user = client };
    struct sp_error err;
    snprintf(snapshot.owner, sizeof snapshot.owner, "%s",
             client->owner ? client->owner : "somebody");
    snapshot.volume = srv_catalog_acquire(f->render.catalog, "phantom", &err);
    assert_non_null(snapshot.volume);
    srv_catalog_default_view(f->render.catalog, snapshot.volume, &snapshot.view);
    snapshot.view.size[0] = width;
    return srv_render_pool_submit(f->render.render_pool, &snapshot, &err);
}

static void equal_snapshots_are_rendered_and_encoded_once(void **state) {
    struct fixture *f = *state;
    struct client first = { 0 }, other = { 0 }, same[4] = { { 0 } };
    assert_true(request(f, &first, 100, false));
    gate_await(&gate.entered, 1); /* it is being rendered */
    assert_true(request(f, &other, 200, false));
    for (int i = 0; i < 4; i++) /* more than the queue allows: they join entries */
        assert_true(request(f, &same[i], i < 2 ? 100 : 200, false));
    gate_let_through(2);
    gate_await(&first.answers, 1);
    gate_await(&other.answers, 1);
    for (int i = 0; i < 4; i++) {
        const struct client *like = i < 2 ? &first : &other;
        gate_await(&same[i].answers, 1);
        assert_int_equal(same[i].images, 1);
        assert_int_equal(same[i].size, like->size);
        assert_int_equal(same[i].sum, like->sum);
    }
    assert_int_equal(gate_count(&gate.entered), 2);
    assert_int_equal(gate_count(&seen.encoded), 2);
    assert_true(request(f, &first, 100, false)); /* it is no longer in the queue */
    gate_let_through(1);
    gate_await(&first.answers, 2);
    assert_int_equal(gate_count(&gate.entered), 3);
}

static void a_caller_that_encodes_receives_the_frame(void **state) {
    struct fixture *f = *state;
    struct client bytes = { 0 }, frame = { .wants_frame = true }, same = { .wants_frame = true };
    assert_true(request(f, &bytes, 100, false));
    gate_await(&gate.entered, 1);
    assert_true(request(f, &frame, 100, true)); /* the same image, but another kind of answer */
    assert_true(request(f, &same, 100, true));
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
    assert_int_equal(gate_count(&seen.encoded), 1);
}

static void a_snapshot_is_rendered_while_a_client_waits_for_it(void **state) {
    struct fixture *f = *state;
    struct client a = { 0 }, b = { 0 };
    assert_true(request(f, &a, 100, false));
    gate_await(&gate.entered, 1);
    assert_true(request(f, &b, 100, false));
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
    struct fixture *f = *state;
    struct client now = { 0 }, a = { 0 }, b = { 0 };
    assert_true(request(f, &now, 100, false));
    gate_await(&gate.entered, 1);
    assert_true(request(f, &a, 200, false));
    assert_true(request(f, &b, 200, false));
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
    struct fixture *f = *state;
    struct client now = { 0 }, waits = { 0 };
    assert_true(request(f, &now, 100, false));
    gate_await(&gate.entered, 1);
    assert_true(request(f, &waits, 200, false));
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
static void owners_take_turns(void **state) {
    struct fixture *f = *state;
    struct client ann[QUEUE + 1], bob = { .owner = "bob" }, late = { .owner = "bob" };
    for (unsigned i = 0; i <= QUEUE; i++)
        ann[i] = (struct client){ .owner = "ann" };
    assert_true(request(f, &ann[0], 100, false));
    gate_await(&gate.entered, 1);
    for (unsigned i = 1; i < QUEUE; i++)
        assert_true(request(f, &ann[i], 100 + i, false));
    assert_false(request(f, &ann[QUEUE], 199, false));
    assert_true(request(f, &bob, 300, false));
    assert_false(request(f, &late, 301, false)); /* the queue is full */
    gate_let_through(QUEUE + 1);
    for (unsigned i = 0; i < QUEUE; i++)
        gate_await(&ann[i].answers, 1);
    gate_await(&bob.answers, 1);
    assert_int_equal(seen.width[1], 300);
    for (unsigned i = 1; i < QUEUE; i++)
        assert_int_equal(seen.width[1 + i], 100 + i);
}

/* Encoding counts as well: while two snapshots of one owner are not answered yet, another owner
 * comes first, though it has received ten seconds more. */
static void owners_are_charged_for_encoding(void **state) {
    struct fixture *f = *state;
    struct client ann[3], bob = { .owner = "bob" },
                          long_one = { .owner = "bob", .wants_frame = true };
    for (unsigned i = 0; i < 3; i++)
        ann[i] = (struct client){ .owner = "ann", .format = SP_IMAGE_PNG };
    block_png(1);
    assert_true(request(f, &ann[0], 100, false));
    gate_let_through(1);
    gate_await(&seen.pngs, 1);
    assert_true(request(f, &long_one, 200, false));
    gate_await(&gate.entered, 2);
    atomic_store(&ahead_s, 10);
    gate_let_through(1);
    gate_await(&long_one.answers, 1);
    assert_true(request(f, &ann[1], 101, false));
    gate_await(&gate.entered, 3);
    assert_true(request(f, &ann[2], 102, false));
    assert_true(request(f, &bob, 300, false));
    gate_let_through(100);
    gate_await(&gate.entered, 4);
    assert_int_equal(seen.width[3], 300); /* two snapshots of ann are not answered yet */
    block_png(0);
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
    assert_compare(srv_fair_owners_start(&owners, "new"), ==,
                   40); /* an idle owner saves up no time */
    assert_compare(srv_fair_owners_start(&owners, "bob"), ==, 50);
    for (int i = 0; i < 2 * SRV_FAIR_OWNERS_MAX; i++) {
        snprintf(name, sizeof name, "host %d", i);
        srv_fair_owners_charge(&owners, name, 1);
    }
    assert_int_equal(owners.count, SRV_FAIR_OWNERS_MAX);
    assert_true(srv_fair_owners_start(&owners, "bob") ==
                50); /* the owners with the least lose their accounts */
    srv_fair_owners_reset(&owners);
    assert_compare(srv_fair_owners_start(&owners, "bob"), ==, 0);
}

static void background_snapshots_come_last(void **state) {
    struct fixture *f = *state;
    struct client now = { 0 }, background[QUEUE + 1] = { { 0 } }, other = { 0 };
    assert_true(request(f, &now, 100, false));
    gate_await(&gate.entered, 1);
    for (unsigned i = 0; i < QUEUE; i++)
        assert_true(request(f, &background[i], 200 + i, true));
    assert_false(request(f, &background[QUEUE], 299, true)); /* they have a limit of their own */
    assert_true(request(f, &other, 300, false));
    gate_let_through(2 + QUEUE);
    for (unsigned i = 0; i < QUEUE; i++)
        gate_await(&background[i].answers, 1);
    assert_int_equal(seen.width[1], 300);
    for (unsigned i = 0; i < QUEUE; i++)
        assert_int_equal(seen.width[2 + i], 200 + i);
    assert_int_equal(counted_stages(f->render.metrics, "queue"),
                     2); /* background waiting is no queueing time */
}

static void a_background_snapshot_yields_and_is_rendered_again(void **state) {
    struct fixture *f = *state;
    struct client background = { 0 }, other = { 0 };
    assert_true(request(f, &background, 200, true));
    gate_await(&gate.entered, 1);
    assert_true(request(f, &other, 300, false));
    gate_await(&gate.cancelled, 1);
    gate_await(&gate.entered, 2);
    assert_int_equal(seen.width[1], 300);
    gate_let_through(2);
    gate_await(&background.answers, 1);
    assert_int_equal(background.images + other.images, 2);
    assert_int_equal(gate_count(&gate.entered), 3);
}

static void a_background_snapshot_yields_to_sessions(void **state) {
    struct fixture *f = *state;
    struct client background = { 0 };
    assert_true(request(f, &background, 200, true));
    gate_await(&gate.entered, 1);
    f->participant = render_fixture_join(&f->render, f->id, SRV_ROLE_CONTROL);
    gate_await(&gate.cancelled, 1);
    gate_let_through(1000); /* it may yield again, to the final frame */
    gate_await(&background.answers, 1);
    assert_int_equal(background.images, 1);
}

/* A background snapshot yields once; later_s seconds later another one is requested. True if it
 * yields again. */
static bool yields_again(struct fixture *f, double expected_ms, int64_t later_s) {
    struct client background = { .expected_ms = expected_ms }, one = { 0 }, other = { 0 };
    assert_true(request(f, &background, 200, true));
    gate_await(&gate.entered, 1);
    assert_true(request(f, &one, 300, false));
    gate_let_through(1); /* the background snapshot is cancelled already */
    gate_await(&gate.entered, 3);
    atomic_store(&ahead_s, later_s);
    assert_true(request(f, &other, 400, false));
    gate_let_through(2);
    gate_await(&background.answers, 1);
    gate_await(&other.answers, 1);
    assert_int_equal(background.images + one.images + other.images, 3);
    return gate_count(&gate.cancelled) == 2;
}

static void a_background_snapshot_yields_for_twenty_times_its_time(void **state) {
    assert_true(yields_again(*state, 3600e3, 71900)); /* an hour, 19.97 times */
}

static void after_that_it_yields_no_more(void **state) {
    assert_false(yields_again(*state, 3600e3, 72100));
}

static void a_foreground_request_takes_a_snapshot_out_of_the_background(void **state) {
    struct fixture *f = *state;
    struct client background = { 0 }, somebody = { 0 }, other = { 0 };
    assert_true(request(f, &background, 200, true));
    gate_await(&gate.entered, 1);
    assert_true(request(f, &somebody, 200, false));
    assert_true(request(f, &other, 300, false));
    gate_let_through(2);
    gate_await(&other.answers, 1);
    assert_int_equal(background.images + somebody.images + other.images, 3);
    assert_int_equal(gate_count(&gate.cancelled), 0);
    assert_int_equal(gate_count(&gate.entered), 2);
}

static void send(struct fixture *f, struct srv_participant *participant, const char *method,
                 const char *params) {
    char text[160], *answer;
    size_t size;
    snprintf(text, sizeof text, "{\"jsonrpc\":\"2.0\",\"method\":\"%s\",\"params\":%s}", method,
             params);
    assert_true(srv_hub_message(f->render.hub, participant, text, strlen(text), srv_clock_ms(),
                                &answer, &size));
    free(answer);
}

/* Waits for the participant's next frame and acknowledges it. */
static struct proto_frame_header next_frame(struct fixture *f,
                                            struct srv_participant *participant) {
    struct srv_message message = { .text = NULL };
    char params[40];
    while (srv_hub_next_message(f->render.hub, participant, true, srv_clock_ms(), &message) !=
           SRV_MESSAGE_FRAME) {
        free(message.text);
        sched_yield();
    }
    srv_blob_unref(&message.blob);
    snprintf(params, sizeof params, "{\"frame\":%u}", message.header.frame);
    send(f, participant, "stream.ack", params);
    return message.header;
}

/* Takes the participant's frames up to the final one. */
static void await_final_frame(struct fixture *f, struct srv_participant *participant) {
    while (!(next_frame(f, participant).flags & PROTO_FRAME_FINAL))
        ;
}

/* A large PNG occupies an encode thread, and an encoder cannot be interrupted. The other
 * participants of the session, and other sessions, receive their frames all the same. */
static void slow_encodings_leave_a_thread_to_the_others(void **state) {
    struct fixture *f = *state;
    char id[SRV_SESSION_ID_BYTES], params[60];
    render_fixture_session(&f->render, id);
    f->participant = render_fixture_join(&f->render, f->id, SRV_ROLE_CONTROL);
    await_final_frame(f, f->participant);
    block_png(SLOW_PX);
    struct srv_participant *hog = render_fixture_join(&f->render, f->id, SRV_ROLE_VIEW);
    struct srv_participant *hogs = render_fixture_join(&f->render, id, SRV_ROLE_CONTROL);
    send(f, hog, "stream.configure", "{\"format\":\"png\",\"size\":[4096,4096]}");
    send(f, hogs, "stream.configure", "{\"format\":\"png\",\"size\":[4096,4096]}");
    for (uint32_t seq = 1; seq <= 20; seq++) {
        snprintf(params, sizeof params, "{\"seq\":%u,\"patch\":{\"background\":[0,0,%g,1]}}", seq,
                 seq / 32.0);
        send(f, hogs, "view.update", params);
        send(f, f->participant, "view.update", params);
        while (next_frame(f, f->participant).seq < seq)
            ;
    }
    gate_await(&seen.pngs, 1);
    block_png(0);
    await_final_frame(f, hog);
    await_final_frame(f, hogs);
    srv_hub_leave(f->render.hub, &hog, srv_clock_ms());
    srv_hub_leave(f->render.hub, &hogs, srv_clock_ms());
}

/* A single participant delays nobody, so its slow frames may use all threads. */
static void a_single_participant_may_use_all_threads(void **state) {
    struct fixture *f = *state;
    char params[60];
    f->participant = render_fixture_join(&f->render, f->id, SRV_ROLE_CONTROL);
    send(f, f->participant, "stream.configure", "{\"format\":\"png\",\"size\":[4096,4096]}");
    await_final_frame(f, f->participant);
    block_png(SLOW_PX);
    unsigned pngs = gate_count(&seen.pngs);
    for (uint32_t seq = 1; gate_count(&seen.pngs) < pngs + 2; seq++) {
        snprintf(params, sizeof params, "{\"seq\":%u,\"patch\":{\"background\":[0,0,%g,1]}}", seq,
                 seq % 32 / 32.0);
        send(f, f->participant, "view.update", params);
        sched_yield();
    }
    block_png(0);
}

static void the_final_frame_of_a_session_is_not_rendered_again(void **state) {
    struct fixture *f = *state;
    struct client client = { 0 };
    f->participant = render_fixture_join(&f->render, f->id, SRV_ROLE_CONTROL);
    await_final_frame(f, f->participant);
    long renders = counted_stages(f->render.metrics, "render");
    assert_compare(renders, >, 0);
    assert_true(request(f, &client, 512, false));
    gate_await(&client.answers, 1);
    assert_int_equal(client.images, 1);
    assert_int_equal(counted_stages(f->render.metrics, "render"), renders);
    assert_int_equal(gate_count(&gate.entered), 0);
}

static void nor_encoded_again_with_the_same_parameters(void **state) {
    struct fixture *f = *state;
    struct client same = { 0 }, other = { .quality = 17 };
    char id[SRV_SESSION_ID_BYTES];
    render_fixture_session(&f->render, id);
    f->participant = render_fixture_join(&f->render, f->id, SRV_ROLE_CONTROL);
    await_final_frame(f, f->participant);
    assert_int_equal(gate_count(&seen.sharp), 1);
    struct srv_participant *elsewhere = render_fixture_join(&f->render, id, SRV_ROLE_CONTROL);
    await_final_frame(f, elsewhere);
    srv_hub_leave(f->render.hub, &elsewhere, srv_clock_ms());
    assert_true(request(f, &same, 512, false));
    gate_await(&same.answers, 1);
    assert_int_equal(gate_count(&seen.sharp), 1);
    unsigned encoded = gate_count(&seen.encoded);
    assert_true(request(f, &other, 512, false));
    gate_await(&other.answers, 1);
    assert_int_equal(gate_count(&seen.encoded), encoded + 1);
    assert_int_equal(counted_stages(f->render.metrics, "encode"), encoded + 1);
    assert_in_range(other.size, 1, same.size - 1);
}

/* A PNG has no quality: one encoding serves all. */
static void parameters_that_a_format_ignores_make_no_difference(void **state) {
    struct fixture *f = *state;
    f->participant = render_fixture_join(&f->render, f->id, SRV_ROLE_CONTROL);
    struct srv_participant *other = render_fixture_join(&f->render, f->id, SRV_ROLE_VIEW);
    await_final_frame(f, f->participant);
    await_final_frame(f, other);
    send(f, other, "stream.configure",
         "{\"format\":\"png\",\"quality\":70,\"subsampling\":\"4:2:0\"}");
    await_final_frame(f, other);
    assert_int_equal(gate_count(&seen.pngs), 1);
    send(f, f->participant, "stream.configure", "{\"format\":\"png\",\"quality\":80}");
    await_final_frame(f, f->participant);
    assert_int_equal(gate_count(&seen.pngs), 1);
    srv_hub_leave(f->render.hub, &other, srv_clock_ms());
}

static void share_by(unsigned together) {
    pthread_mutex_lock(&gate.mutex);
    seen.shares = true;
    seen.together = together;
    seen.at_stripes = 0;
    pthread_mutex_unlock(&gate.mutex);
}

static void idle_threads_help_with_a_snapshot_except_the_reserved_one(void **state) {
    enum { PICTURES = 50 };
    struct fixture *f = *state;
    for (unsigned n = 1; n <= PICTURES; n++) {
        struct client client = { 0 };
        share_by(ENCODE_THREADS - 1); /* one is reserved for session frames */
        assert_true(request(f, &client, 100, false));
        gate_let_through(1);
        gate_await(&client.answers, 1);
        assert_int_equal(client.images, 1);
        for (int i = 0; i < STRIPES; i++)
            assert_int_equal(seen.made[i], n);
    }
    assert_int_equal(seen.by[0], 0);
    for (int t = 1; t < ENCODE_THREADS; t++)
        assert_compare(seen.by[t], >=, PICTURES);
}

static void idle_foreground_threads_help_with_a_session_frame(void **state) {
    struct fixture *f = *state;
    share_by(STREAM_THREADS);
    f->participant = render_fixture_join(&f->render, f->id, SRV_ROLE_CONTROL);
    await_final_frame(f, f->participant);
    for (int i = 0; i < STRIPES; i++)
        assert_int_equal(seen.made[i], gate_count(&seen.encoded));
    for (int t = 0; t < ENCODE_THREADS; t++)
        assert_int_equal(seen.by[t] > 0, t < STREAM_THREADS);
}

int main(void) {
    const struct CMUnitTest tests[] = {
#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
        TEST(equal_snapshots_are_rendered_and_encoded_once),
        TEST(a_caller_that_encodes_receives_the_frame),
        TEST(a_snapshot_is_rendered_while_a_client_waits_for_it),
        TEST(a_client_that_leaves_does_not_cancel_the_others),
        TEST(stopping_answers_all_and_counts_none_as_left),
        TEST(owners_take_turns),
        TEST(owners_are_charged_for_encoding),
        cmocka_unit_test(owners_are_charged_for_their_time),
        TEST(background_snapshots_come_last),
        TEST(a_background_snapshot_yields_and_is_rendered_again),
        TEST(a_background_snapshot_yields_to_sessions),
        TEST(a_background_snapshot_yields_for_twenty_times_its_time),
        TEST(after_that_it_yields_no_more),
        TEST(a_foreground_request_takes_a_snapshot_out_of_the_background),
        TEST(the_final_frame_of_a_session_is_not_rendered_again),
        TEST(nor_encoded_again_with_the_same_parameters),
        TEST(parameters_that_a_format_ignores_make_no_difference),
        cmocka_unit_test_setup_teardown(slow_encodings_leave_a_thread_to_the_others, set_up,
                                        tear_down),
        cmocka_unit_test_setup_teardown(a_single_participant_may_use_all_threads, set_up_two,
                                        tear_down),
        cmocka_unit_test_setup_teardown(idle_threads_help_with_a_snapshot_except_the_reserved_one,
                                        set_up_sharing, tear_down),
        cmocka_unit_test_setup_teardown(idle_foreground_threads_help_with_a_session_frame,
                                        set_up_sharing, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
