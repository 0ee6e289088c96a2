/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <pthread.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/clock.h"
#include "support/compare.h"
#include "support/gate.h"
#include "unit/server/render/snapshot_fixture.h"

struct snap_seen snap_seen;
_Atomic int64_t snap_ahead_s;

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
    snap_seen.width[gate.entered++ % 16] = view->size[0];
    pthread_mutex_unlock(&gate.mutex);
    if (!gate_pass(options->cancel, NULL, NULL)) {
        sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
        return NULL;
    }
    struct sp_render_options resumed = *options;
    resumed.cancel = NULL;
    return __real_sp_renderer_render(renderer, volume, view, pool, &resumed, err);
}

void __wrap_sp_encoder_set_share(struct sp_encoder *encoder, sp_share_fn *share, void *user);
void __wrap_sp_encoder_set_share(struct sp_encoder *encoder, sp_share_fn *share, void *user) {
    snap_seen.sharers[snap_seen.sharer_count].encoder = encoder;
    snap_seen.sharers[snap_seen.sharer_count].share = share;
    snap_seen.sharers[snap_seen.sharer_count++].user = user;
}

static unsigned sharer_of(const struct sp_encoder *encoder) {
    unsigned i = 0;
    while (i < snap_seen.sharer_count && snap_seen.sharers[i].encoder != encoder)
        i++;
    assert_compare(i, <, snap_seen.sharer_count);
    return i;
}

/* Waits until enough threads are at stripes. */
static void make_stripe(void *of, unsigned i, struct sp_encoder *with) {
    assert_ptr_equal(of, &snap_seen);
    pthread_mutex_lock(&gate.mutex);
    snap_seen.made[i]++;
    snap_seen.by[sharer_of(with)]++;
    snap_seen.at_stripes++;
    pthread_mutex_unlock(&gate.mutex);
    gate_await(&snap_seen.at_stripes, snap_seen.together);
}

static bool is_blocked(const struct sp_frame *frame) {
    pthread_mutex_lock(&gate.mutex);
    bool held = snap_seen.blocked_png_px != 0 &&
                (uint64_t)frame->width * frame->height >= snap_seen.blocked_png_px;
    pthread_mutex_unlock(&gate.mutex);
    return held;
}

void snap_block_png(uint64_t px) {
    pthread_mutex_lock(&gate.mutex);
    snap_seen.blocked_png_px = px;
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
    snap_seen.encoded++;
    snap_seen.sharp += quality == SNAP_SHARP;
    snap_seen.pngs += format == SP_IMAGE_PNG;
    pthread_mutex_unlock(&gate.mutex);
    while (format == SP_IMAGE_PNG && is_blocked(frame))
        sched_yield();
    if (snap_seen.shares) {
        unsigned own = sharer_of(encoder);
        snap_seen.sharers[own].share(snap_seen.sharers[own].user, encoder, SNAP_STRIPES,
                                     make_stripe, &snap_seen);
    }
    return __real_sp_encode(encoder, frame, format, quality, bytes, size, err);
}

int __real_clock_gettime(clockid_t clock, struct timespec *t);
int __wrap_clock_gettime(clockid_t clock, struct timespec *t);
int __wrap_clock_gettime(clockid_t clock, struct timespec *t) {
    int result = __real_clock_gettime(clock, t);
    t->tv_sec += atomic_load(&snap_ahead_s);
    return result;
}

static void on_done(void *user, const struct srv_snapshot_result *result) {
    struct snap_client *client = user;
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
    return atomic_load(&((struct snap_client *)user)->left);
}

int snap_set_up(void **state, unsigned threads) {
    struct snap_fixture *f = *state = calloc(1, sizeof *f);
    assert_non_null(f);
    gate_reset();
    memset(&snap_seen, 0, sizeof snap_seen);
    atomic_store(&snap_ahead_s, 0);
    render_fixture_begin(&f->render, &(struct render_fixture_options){ .queue_max = SNAP_QUEUE,
                                                                       .encode_threads = threads });
    render_fixture_session(&f->render, f->id);
    return 0;
}

int snap_tear_down(void **state) {
    struct snap_fixture *f = *state;
    snap_block_png(0);
    srv_hub_leave(f->render.hub, &f->participant, srv_clock_ms());
    render_fixture_end(&f->render);
    free(f);
    return 0;
}

bool snap_request(struct snap_fixture *f, struct snap_client *client, unsigned width,
                  bool background) {
    struct srv_snapshot snapshot = { .format = client->format,
                                     .quality = client->quality ? client->quality : SNAP_SHARP,
                                     .background = background,
                                     .is_limited = !client->is_admin,
                                     .expected_ms = client->expected_ms,
                                     .wants_frame = client->wants_frame,
                                     .done = on_done,
                                     .is_gone = is_gone,
                                     .user = client };
    struct sp_error err;
    snprintf(snapshot.owner, sizeof snapshot.owner, "%s", client->owner ? client->owner : "guest");
    snapshot.volume = srv_catalog_acquire(f->render.catalog, "phantom", &err);
    assert_non_null(snapshot.volume);
    srv_catalog_default_view(f->render.catalog, snapshot.volume, &snapshot.view);
    snapshot.view.size[0] = width;
    return srv_snapshot_queue_submit(srv_render_pool_snapshots(f->render.render_pool), &snapshot,
                                     &err);
}

void snap_send(struct snap_fixture *f, struct srv_participant *participant, const char *method,
               const char *params) {
    char text[160], *answer;
    size_t size;
    snprintf(text, sizeof text, "{\"jsonrpc\":\"2.0\",\"method\":\"%s\",\"params\":%s}", method,
             params);
    assert_true(srv_hub_message(f->render.hub, participant, text, strlen(text), srv_clock_ms(),
                                &answer, &size));
    free(answer);
}

struct proto_frame_header snap_next_frame(struct snap_fixture *f,
                                          struct srv_participant *participant) {
    struct srv_message message = { .text = NULL };
    char params[40];
    while (srv_hub_next_message(f->render.hub, participant, SRV_NEXT_ALL, srv_clock_ms(),
                                &message) != SRV_MESSAGE_FRAME) {
        free(message.text);
        sched_yield();
    }
    srv_blob_unref(&message.blob);
    snprintf(params, sizeof params, "{\"frame\":%u}", message.header.frame);
    snap_send(f, participant, "stream.ack", params);
    return message.header;
}

void snap_await_final_frame(struct snap_fixture *f, struct srv_participant *participant) {
    while (!(snap_next_frame(f, participant).flags & PROTO_FRAME_FINAL))
        ;
}

void snap_share_by(unsigned together) {
    pthread_mutex_lock(&gate.mutex);
    snap_seen.shares = true;
    snap_seen.together = together;
    snap_seen.at_stripes = 0;
    pthread_mutex_unlock(&gate.mutex);
}
