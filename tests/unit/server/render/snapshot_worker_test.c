/* SPDX-License-Identifier: Apache-2.0
 *
 * The still lane behind a gate: the linker puts the gate in the place of sp_renderer_render(),
 * which that lane alone calls. What is drawn waits there until the test lets it through or its
 * cancel flag is set. Streams are drawn by the null backend.
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
#include "support/gate.h"
#include "support/render_fixture.h"
#include "unit/server/counted.h"

enum {
    QUEUE = 4,
    SHARP = 90,
    STREAM_THREADS = 3, /* that encode */
    ENCODE_THREADS = 5, /* with the nice ones */
    STRIPES = 8,
    DEAR_PX = 2500000 /* a PNG of so many is dear (SRV_SLOW_ENCODE_MS) */
};

static struct { /* guarded by the gate's mutex */
    unsigned encoded;
    unsigned sharp;     /* of the encoded, in the quality of sharp pictures */
    unsigned width[16]; /* of those that entered the gate, in order */
    struct {            /* as each encoder was told, in the order of the threads */
        struct sp_encoder *encoder;
        sp_share_fn *share;
        void *user;
    } sharers[ENCODE_THREADS];
    unsigned sharer_count;
    bool shares;                   /* what is encoded: stripes of the test's, which wait */
    unsigned at_stripes, together; /* threads, and how many have to be */
    unsigned made[STRIPES], by[ENCODE_THREADS];
    uint64_t held_png_px; /* PNGs of so many or more wait to be encoded; 0: none does */
    unsigned pngs;        /* that do, or did */
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
    assert_true(i < seen.sharer_count);
    return i;
}

/* Stays until as many threads are at stripes as have to be. */
static void make_stripe(void *of, unsigned i, struct sp_encoder *with) {
    assert_ptr_equal(of, &seen);
    pthread_mutex_lock(&gate.mutex);
    seen.made[i]++;
    seen.by[sharer_of(with)]++;
    seen.at_stripes++;
    pthread_mutex_unlock(&gate.mutex);
    gate_await(&seen.at_stripes, seen.together);
}

static bool is_held(const struct sp_frame *frame) {
    pthread_mutex_lock(&gate.mutex);
    bool held = seen.held_png_px != 0 && (uint64_t)frame->width * frame->height >= seen.held_png_px;
    pthread_mutex_unlock(&gate.mutex);
    return held;
}

static void hold_png(uint64_t px) {
    pthread_mutex_lock(&gate.mutex);
    seen.held_png_px = px;
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
    while (format == SP_IMAGE_PNG && is_held(frame))
        sched_yield();
    if (seen.shares) {
        unsigned own = sharer_of(encoder);
        seen.sharers[own].share(seen.sharers[own].user, encoder, STRIPES, make_stripe, &seen);
    }
    return __real_sp_encode(encoder, frame, format, quality, bytes, size, err);
}

static _Atomic int64_t ahead_s; /* of the world, the clock */

int __real_clock_gettime(clockid_t clock, struct timespec *t);
int __wrap_clock_gettime(clockid_t clock, struct timespec *t);
int __wrap_clock_gettime(clockid_t clock, struct timespec *t) {
    int result = __real_clock_gettime(clock, t);
    t->tv_sec += atomic_load(&ahead_s);
    return result;
}

struct fixture {
    struct render_fixture render;
    struct srv_participant *participant; /* NULL until somebody joins */
    char id[SRV_SESSION_ID_BYTES];
};

struct asker { /* of a still, as JPEG if nothing is said */
    enum sp_image_format format;
    int quality; /* 0 = that of a stream's sharp picture */
    const char *owner;
    double expected_ms;
    bool wants_frame;
    unsigned answers, pictures, frames;
    size_t size;
    uint32_t sum; /* of the bytes */
    atomic_bool left;
};

static void on_done(void *user, const struct srv_snapshot_result *result) {
    struct asker *asker = user;
    pthread_mutex_lock(&gate.mutex);
    asker->pictures += result->ok;
    asker->frames += result->ok && result->frame && result->frame->pixels;
    asker->size = result->ok ? result->size : 0;
    asker->sum = 0;
    for (size_t i = 0; i < asker->size; i++)
        asker->sum = asker->sum * 31 + result->bytes[i];
    asker->answers++;
    pthread_mutex_unlock(&gate.mutex);
}

static bool has_left(void *user) {
    return atomic_load(&((struct asker *)user)->left);
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
    hold_png(0);
    srv_hub_leave(f->render.hub, &f->participant, srv_clock_ms());
    render_fixture_end(&f->render);
    free(f);
    return 0;
}

static bool ask(struct fixture *f, struct asker *asker, unsigned width, bool background) {
    struct srv_snapshot still = { .format = asker->format,
                                  .quality = asker->quality ? asker->quality : SHARP,
                                  .background = background,
                                  .expected_ms = asker->expected_ms,
                                  .wants_frame = asker->wants_frame,
                                  .done = on_done,
                                  .is_gone = has_left,
                                  .user = asker };
    struct sp_error err;
    snprintf(still.owner, sizeof still.owner, "%s", asker->owner ? asker->owner : "somebody");
    still.volume = srv_catalog_acquire(f->render.catalog, "phantom", &err);
    assert_non_null(still.volume);
    srv_catalog_default_view(f->render.catalog, still.volume, &still.view);
    still.view.size[0] = width;
    return srv_render_pool_submit(f->render.render_pool, &still, &err);
}

static void equal_stills_are_drawn_and_encoded_once(void **state) {
    struct fixture *f = *state;
    struct asker first = { 0 }, other = { 0 }, same[4] = { { 0 } };
    assert_true(ask(f, &first, 100, false));
    gate_await(&gate.entered, 1); /* it is being drawn */
    assert_true(ask(f, &other, 200, false));
    for (int i = 0; i < 4; i++) /* more than may wait: these do not */
        assert_true(ask(f, &same[i], i < 2 ? 100 : 200, false));
    gate_let_through(2);
    gate_await(&first.answers, 1);
    gate_await(&other.answers, 1);
    for (int i = 0; i < 4; i++) {
        const struct asker *like = i < 2 ? &first : &other;
        gate_await(&same[i].answers, 1);
        assert_int_equal(same[i].pictures, 1);
        assert_int_equal(same[i].size, like->size);
        assert_int_equal(same[i].sum, like->sum);
    }
    assert_int_equal(gate_count(&gate.entered), 2);
    assert_int_equal(gate_count(&seen.encoded), 2);
    assert_true(ask(f, &first, 100, false)); /* nothing of it is in flight any more */
    gate_let_through(1);
    gate_await(&first.answers, 2);
    assert_int_equal(gate_count(&gate.entered), 3);
}

static void who_encodes_himself_gets_the_frame(void **state) {
    struct fixture *f = *state;
    struct asker bytes = { 0 }, frame = { .wants_frame = true }, same = { .wants_frame = true };
    assert_true(ask(f, &bytes, 100, false));
    gate_await(&gate.entered, 1);
    assert_true(ask(f, &frame, 100, true)); /* the same picture, but not the same answer */
    assert_true(ask(f, &same, 100, true));
    gate_let_through(2);
    gate_await(&bytes.answers, 1);
    gate_await(&frame.answers, 1);
    gate_await(&same.answers, 1);
    assert_int_equal(bytes.frames, 0);
    assert_true(bytes.size > 0);
    assert_int_equal(frame.frames + same.frames, 2);
    assert_int_equal(frame.size + same.size, 0);
    assert_int_equal(gate_count(&seen.encoded), 1);
}

static void a_still_is_drawn_while_anybody_wants_it(void **state) {
    struct fixture *f = *state;
    struct asker a = { 0 }, b = { 0 };
    assert_true(ask(f, &a, 100, false));
    gate_await(&gate.entered, 1);
    assert_true(ask(f, &b, 100, false));
    atomic_store(&a.left, true);
    for (int i = 0; i < 100; i++)
        srv_render_pool_tick(f->render.render_pool);
    assert_int_equal(gate_count(&gate.cancelled), 0);
    atomic_store(&b.left, true);
    srv_render_pool_tick(f->render.render_pool);
    gate_await(&gate.cancelled, 1);
    gate_await(&a.answers, 1);
    gate_await(&b.answers, 1);
    assert_int_equal(a.pictures + b.pictures, 0);
    assert_int_equal(counted_drops(f->render.metrics, "left"), 2);
}

static void of_those_that_wait_who_left_goes_alone(void **state) {
    struct fixture *f = *state;
    struct asker now = { 0 }, a = { 0 }, b = { 0 };
    assert_true(ask(f, &now, 100, false));
    gate_await(&gate.entered, 1);
    assert_true(ask(f, &a, 200, false));
    assert_true(ask(f, &b, 200, false));
    atomic_store(&a.left, true);
    srv_render_pool_tick(f->render.render_pool);
    assert_int_equal(gate_count(&a.answers), 1);
    assert_int_equal(gate_count(&b.answers), 0);
    gate_let_through(2);
    gate_await(&b.answers, 1);
    assert_int_equal(b.pictures, 1);
    assert_int_equal(counted_drops(f->render.metrics, "left"), 1);
}

static void the_end_answers_all_and_counts_none_as_left(void **state) {
    struct fixture *f = *state;
    struct asker now = { 0 }, waits = { 0 };
    assert_true(ask(f, &now, 100, false));
    gate_await(&gate.entered, 1);
    assert_true(ask(f, &waits, 200, false));
    srv_render_pool_stop(f->render.render_pool);
    assert_int_equal(now.answers + waits.answers, 2);
    assert_int_equal(now.pictures + waits.pictures, 0);
    assert_int_equal(counted_drops(f->render.metrics, "left"), 0);
    assert_int_equal(counted_drops(f->render.metrics, "failed"), 0);
}

/* However many of one wait, another's comes next; and they do not fill the queue. */
static void owners_have_equal_shares(void **state) {
    struct fixture *f = *state;
    struct asker ann[QUEUE + 1], bob = { .owner = "bob" }, late = { .owner = "bob" };
    for (unsigned i = 0; i <= QUEUE; i++)
        ann[i] = (struct asker){ .owner = "ann" };
    assert_true(ask(f, &ann[0], 100, false));
    gate_await(&gate.entered, 1);
    for (unsigned i = 1; i < QUEUE; i++)
        assert_true(ask(f, &ann[i], 100 + i, false));
    assert_false(ask(f, &ann[QUEUE], 199, false));
    assert_true(ask(f, &bob, 300, false));
    assert_false(ask(f, &late, 301, false)); /* the queue is full */
    gate_let_through(QUEUE + 1);
    for (unsigned i = 0; i < QUEUE; i++)
        gate_await(&ann[i].answers, 1);
    gate_await(&bob.answers, 1);
    assert_int_equal(seen.width[1], 300);
    for (unsigned i = 1; i < QUEUE; i++)
        assert_int_equal(seen.width[1 + i], 100 + i);
}

/* What it takes to encode counts: who has a thread at his pictures has no second one waiting for
 * another while somebody else's waits to be drawn, who had ten seconds more. */
static void encoding_is_paid_for_by_the_owner(void **state) {
    struct fixture *f = *state;
    struct asker ann[3], bob = { .owner = "bob" },
                         long_one = { .owner = "bob", .wants_frame = true };
    for (unsigned i = 0; i < 3; i++)
        ann[i] = (struct asker){ .owner = "ann", .format = SP_IMAGE_PNG };
    hold_png(1);
    assert_true(ask(f, &ann[0], 100, false));
    gate_let_through(1);
    gate_await(&seen.pngs, 1);
    assert_true(ask(f, &long_one, 200, false));
    gate_await(&gate.entered, 2);
    atomic_store(&ahead_s, 10);
    gate_let_through(1);
    gate_await(&long_one.answers, 1);
    assert_true(ask(f, &ann[1], 101, false));
    gate_await(&gate.entered, 3);
    assert_true(ask(f, &ann[2], 102, false));
    assert_true(ask(f, &bob, 300, false));
    gate_let_through(100);
    gate_await(&gate.entered, 4);
    assert_int_equal(seen.width[3], 300); /* two of the other's are not answered yet */
    hold_png(0);
    for (unsigned i = 0; i < 3; i++)
        gate_await(&ann[i].answers, 1);
    gate_await(&bob.answers, 1);
}

static void owners_pay_what_theirs_took(void **state) {
    (void)state;
    struct srv_fair_owners owners = { .count = 0 };
    char name[SRV_FAIR_OWNER_BYTES];
    srv_fair_owners_begin(&owners, "ann");
    srv_fair_owners_charge(&owners, "ann", 30);
    srv_fair_owners_charge(&owners, "ann", 10);
    assert_true(srv_fair_owners_start(&owners, "ann") == 40);
    assert_true(srv_fair_owners_start(&owners, "bob") == 0);
    srv_fair_owners_charge(&owners, "bob", 50);
    srv_fair_owners_begin(&owners, "ann");
    assert_true(srv_fair_owners_start(&owners, "new") == 40); /* nobody saves up a share */
    assert_true(srv_fair_owners_start(&owners, "bob") == 50);
    for (int i = 0; i < 2 * SRV_FAIR_OWNERS_MAX; i++) {
        snprintf(name, sizeof name, "host %d", i);
        srv_fair_owners_charge(&owners, name, 1);
    }
    assert_int_equal(owners.count, SRV_FAIR_OWNERS_MAX);
    assert_true(srv_fair_owners_start(&owners, "bob") == 50); /* those with least are dropped */
    srv_fair_owners_reset(&owners);
    assert_true(srv_fair_owners_start(&owners, "bob") == 0);
}

static void the_background_is_drawn_after_all_others(void **state) {
    struct fixture *f = *state;
    struct asker now = { 0 }, background[QUEUE + 1] = { { 0 } }, other = { 0 };
    assert_true(ask(f, &now, 100, false));
    gate_await(&gate.entered, 1);
    for (unsigned i = 0; i < QUEUE; i++)
        assert_true(ask(f, &background[i], 200 + i, true));
    assert_false(ask(f, &background[QUEUE], 299, true)); /* these do not fill the others' queue */
    assert_true(ask(f, &other, 300, false));
    gate_let_through(2 + QUEUE);
    for (unsigned i = 0; i < QUEUE; i++)
        gate_await(&background[i].answers, 1);
    assert_int_equal(seen.width[1], 300);
    for (unsigned i = 0; i < QUEUE; i++)
        assert_int_equal(seen.width[2 + i], 200 + i);
    assert_int_equal(counted_stages(f->render.metrics, "queue"), 2); /* that wait is no queue */
}

static void the_background_gives_way_and_is_taken_again(void **state) {
    struct fixture *f = *state;
    struct asker background = { 0 }, other = { 0 };
    assert_true(ask(f, &background, 200, true));
    gate_await(&gate.entered, 1);
    assert_true(ask(f, &other, 300, false));
    gate_await(&gate.cancelled, 1);
    gate_await(&gate.entered, 2);
    assert_int_equal(seen.width[1], 300);
    gate_let_through(2);
    gate_await(&background.answers, 1);
    assert_int_equal(background.pictures + other.pictures, 2);
    assert_int_equal(gate_count(&gate.entered), 3);
}

static void the_background_gives_way_to_streams(void **state) {
    struct fixture *f = *state;
    struct asker background = { 0 };
    assert_true(ask(f, &background, 200, true));
    gate_await(&gate.entered, 1);
    f->participant = render_fixture_join(&f->render, f->id, SRV_ROLE_CONTROL);
    gate_await(&gate.cancelled, 1);
    gate_let_through(1000); /* it may give way again: to the picture that follows at rest */
    gate_await(&background.answers, 1);
    assert_int_equal(background.pictures, 1);
}

/* It gave way once, and so many seconds later somebody else comes: does it give way again? */
static bool gives_way_again(struct fixture *f, double expected_ms, int64_t later_s) {
    struct asker background = { .expected_ms = expected_ms }, one = { 0 }, other = { 0 };
    assert_true(ask(f, &background, 200, true));
    gate_await(&gate.entered, 1);
    assert_true(ask(f, &one, 300, false));
    gate_let_through(1); /* which the background does not take: it was cancelled before */
    gate_await(&gate.entered, 3);
    atomic_store(&ahead_s, later_s);
    assert_true(ask(f, &other, 400, false));
    gate_let_through(2);
    gate_await(&background.answers, 1);
    gate_await(&other.answers, 1);
    assert_int_equal(background.pictures + one.pictures + other.pictures, 3);
    return gate_count(&gate.cancelled) == 2;
}

static void the_background_gives_way_for_twenty_times_its_time(void **state) {
    assert_true(gives_way_again(*state, 3600e3, 71900)); /* an hour, 19.97 times */
}

static void and_then_no_more(void **state) {
    assert_false(gives_way_again(*state, 3600e3, 72100));
}

static void somebody_who_waits_for_it_takes_it_out_of_the_background(void **state) {
    struct fixture *f = *state;
    struct asker background = { 0 }, somebody = { 0 }, other = { 0 };
    assert_true(ask(f, &background, 200, true));
    gate_await(&gate.entered, 1);
    assert_true(ask(f, &somebody, 200, false));
    assert_true(ask(f, &other, 300, false));
    gate_let_through(2);
    gate_await(&other.answers, 1);
    assert_int_equal(background.pictures + somebody.pictures + other.pictures, 3);
    assert_int_equal(gate_count(&gate.cancelled), 0);
    assert_int_equal(gate_count(&gate.entered), 2);
}

static void tell(struct fixture *f, struct srv_participant *participant, const char *method,
                 const char *params) {
    char text[160], *answer;
    size_t size;
    snprintf(text, sizeof text, "{\"jsonrpc\":\"2.0\",\"method\":\"%s\",\"params\":%s}", method,
             params);
    assert_true(srv_hub_message(f->render.hub, participant, text, strlen(text), srv_clock_ms(),
                                &answer, &size));
    free(answer);
}

/* The participant's next frame, acknowledged. */
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
    tell(f, participant, "stream.ack", params);
    return message.header;
}

/* Takes the participant's frames up to the sharp one. */
static void see_the_sharp_one(struct fixture *f, struct srv_participant *participant) {
    while (!(next_frame(f, participant).flags & PROTO_FRAME_FINAL))
        ;
}

/* Large pictures as PNG hold an encode thread each, and nothing ends that. The others in the
 * session, and other sessions, get theirs all the same. */
static void dear_pictures_leave_a_thread_to_the_others(void **state) {
    struct fixture *f = *state;
    char id[SRV_SESSION_ID_BYTES], params[60];
    render_fixture_session(&f->render, id);
    f->participant = render_fixture_join(&f->render, f->id, SRV_ROLE_CONTROL);
    see_the_sharp_one(f, f->participant);
    hold_png(DEAR_PX);
    struct srv_participant *hog = render_fixture_join(&f->render, f->id, SRV_ROLE_VIEW);
    struct srv_participant *hogs = render_fixture_join(&f->render, id, SRV_ROLE_CONTROL);
    tell(f, hog, "stream.configure", "{\"format\":\"png\",\"size\":[4096,4096]}");
    tell(f, hogs, "stream.configure", "{\"format\":\"png\",\"size\":[4096,4096]}");
    for (uint32_t seq = 1; seq <= 20; seq++) {
        snprintf(params, sizeof params, "{\"seq\":%u,\"patch\":{\"background\":[0,0,%g,1]}}", seq,
                 seq / 32.0);
        tell(f, hogs, "view.update", params);
        tell(f, f->participant, "view.update", params);
        while (next_frame(f, f->participant).seq < seq)
            ;
    }
    gate_await(&seen.pngs, 1);
    hold_png(0);
    see_the_sharp_one(f, hog);
    see_the_sharp_one(f, hogs);
    srv_hub_leave(f->render.hub, &hog, srv_clock_ms());
    srv_hub_leave(f->render.hub, &hogs, srv_clock_ms());
}

/* Who is alone keeps nobody from anything: all threads are his. */
static void who_is_alone_has_all_threads(void **state) {
    struct fixture *f = *state;
    char params[60];
    f->participant = render_fixture_join(&f->render, f->id, SRV_ROLE_CONTROL);
    tell(f, f->participant, "stream.configure", "{\"format\":\"png\",\"size\":[4096,4096]}");
    see_the_sharp_one(f, f->participant);
    hold_png(DEAR_PX);
    unsigned pngs = gate_count(&seen.pngs);
    for (uint32_t seq = 1; gate_count(&seen.pngs) < pngs + 2; seq++) {
        snprintf(params, sizeof params, "{\"seq\":%u,\"patch\":{\"background\":[0,0,%g,1]}}", seq,
                 seq % 32 / 32.0);
        tell(f, f->participant, "view.update", params);
        sched_yield();
    }
    hold_png(0);
}

static void a_sessions_sharp_picture_is_not_drawn_again(void **state) {
    struct fixture *f = *state;
    struct asker asker = { 0 };
    f->participant = render_fixture_join(&f->render, f->id, SRV_ROLE_CONTROL);
    see_the_sharp_one(f, f->participant);
    long renders = counted_stages(f->render.metrics, "render");
    assert_true(renders > 0);
    assert_true(ask(f, &asker, 512, false));
    gate_await(&asker.answers, 1);
    assert_int_equal(asker.pictures, 1);
    assert_int_equal(counted_stages(f->render.metrics, "render"), renders);
    assert_int_equal(gate_count(&gate.entered), 0);
}

static void nor_encoded_again_in_the_same_form(void **state) {
    struct fixture *f = *state;
    struct asker same = { 0 }, other = { .quality = 17 };
    char id[SRV_SESSION_ID_BYTES];
    render_fixture_session(&f->render, id);
    f->participant = render_fixture_join(&f->render, f->id, SRV_ROLE_CONTROL);
    see_the_sharp_one(f, f->participant);
    assert_int_equal(gate_count(&seen.sharp), 1);
    struct srv_participant *elsewhere = render_fixture_join(&f->render, id, SRV_ROLE_CONTROL);
    see_the_sharp_one(f, elsewhere);
    srv_hub_leave(f->render.hub, &elsewhere, srv_clock_ms());
    assert_true(ask(f, &same, 512, false));
    gate_await(&same.answers, 1);
    assert_int_equal(gate_count(&seen.sharp), 1);
    unsigned encoded = gate_count(&seen.encoded);
    assert_true(ask(f, &other, 512, false));
    gate_await(&other.answers, 1);
    assert_int_equal(gate_count(&seen.encoded), encoded + 1);
    assert_int_equal(counted_stages(f->render.metrics, "encode"), encoded + 1);
    assert_true(same.size > other.size && other.size > 0);
}

/* A PNG has no quality: of all who want one it is the same. */
static void what_a_format_does_not_have_makes_no_difference(void **state) {
    struct fixture *f = *state;
    f->participant = render_fixture_join(&f->render, f->id, SRV_ROLE_CONTROL);
    struct srv_participant *other = render_fixture_join(&f->render, f->id, SRV_ROLE_VIEW);
    see_the_sharp_one(f, f->participant);
    see_the_sharp_one(f, other);
    tell(f, other, "stream.configure",
         "{\"format\":\"png\",\"quality\":70,\"subsampling\":\"4:2:0\"}");
    see_the_sharp_one(f, other);
    assert_int_equal(gate_count(&seen.pngs), 1);
    tell(f, f->participant, "stream.configure", "{\"format\":\"png\",\"quality\":80}");
    see_the_sharp_one(f, f->participant);
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

static void idle_threads_make_stripes_of_a_still_but_not_the_streams(void **state) {
    enum { PICTURES = 50 };
    struct fixture *f = *state;
    for (unsigned n = 1; n <= PICTURES; n++) {
        struct asker asker = { 0 };
        share_by(ENCODE_THREADS - 1); /* one is for streams alone */
        assert_true(ask(f, &asker, 100, false));
        gate_let_through(1);
        gate_await(&asker.answers, 1);
        assert_int_equal(asker.pictures, 1);
        for (int i = 0; i < STRIPES; i++)
            assert_int_equal(seen.made[i], n);
    }
    assert_int_equal(seen.by[0], 0);
    for (int t = 1; t < ENCODE_THREADS; t++)
        assert_true(seen.by[t] >= PICTURES);
}

static void idle_threads_that_are_not_nice_make_stripes_of_a_streams_picture(void **state) {
    struct fixture *f = *state;
    share_by(STREAM_THREADS);
    f->participant = render_fixture_join(&f->render, f->id, SRV_ROLE_CONTROL);
    see_the_sharp_one(f, f->participant);
    for (int i = 0; i < STRIPES; i++)
        assert_int_equal(seen.made[i], gate_count(&seen.encoded));
    for (int t = 0; t < ENCODE_THREADS; t++)
        assert_true((seen.by[t] > 0) == (t < STREAM_THREADS));
}

int main(void) {
    const struct CMUnitTest tests[] = {
#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
        TEST(equal_stills_are_drawn_and_encoded_once),
        TEST(who_encodes_himself_gets_the_frame),
        TEST(a_still_is_drawn_while_anybody_wants_it),
        TEST(of_those_that_wait_who_left_goes_alone),
        TEST(the_end_answers_all_and_counts_none_as_left),
        TEST(owners_have_equal_shares),
        TEST(encoding_is_paid_for_by_the_owner),
        cmocka_unit_test(owners_pay_what_theirs_took),
        TEST(the_background_is_drawn_after_all_others),
        TEST(the_background_gives_way_and_is_taken_again),
        TEST(the_background_gives_way_to_streams),
        TEST(the_background_gives_way_for_twenty_times_its_time),
        TEST(and_then_no_more),
        TEST(somebody_who_waits_for_it_takes_it_out_of_the_background),
        TEST(a_sessions_sharp_picture_is_not_drawn_again),
        TEST(nor_encoded_again_in_the_same_form),
        TEST(what_a_format_does_not_have_makes_no_difference),
        cmocka_unit_test_setup_teardown(dear_pictures_leave_a_thread_to_the_others, set_up,
                                        tear_down),
        cmocka_unit_test_setup_teardown(who_is_alone_has_all_threads, set_up_two, tear_down),
        cmocka_unit_test_setup_teardown(idle_threads_make_stripes_of_a_still_but_not_the_streams,
                                        set_up_sharing, tear_down),
        cmocka_unit_test_setup_teardown(
            idle_threads_that_are_not_nice_make_stripes_of_a_streams_picture, set_up_sharing,
            tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
