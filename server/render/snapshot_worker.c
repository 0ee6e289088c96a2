/* SPDX-License-Identifier: Apache-2.0
 *
 * The still lane: single pictures. Next is that of the owner who has had least (owners.h), of his
 * the one that was asked for first; those in the background come last. A picture is asked for by
 * one or several: who wants one that is in flight joins it, and the first one pays.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/background.h"
#include "common/clock.h"
#include "render/render_pool_private.h"
#include "schedule/fair_queue.h"
#include "sp/log.h"

#define QUIET_MS 100.0 /* the stream lane has nothing to do: so long after its last frame */

/* Takes it out of the list: nobody joins it from now on. With the mutex held. */
static void take_out(struct srv_render_pool *s, struct srv_snapshot_entry *item) {
    struct srv_snapshot_entry **link = &s->stills;
    while (*link != item)
        link = &(*link)->next;
    *link = item->next;
    if (!s->stills)
        srv_fair_owners_reset(&s->owners);
    srv_worker_wake(&s->lanes[SRV_WORKER_SNAPSHOT]); /* its owner may have another one drawn */
}

void srv_snapshot_charge(struct srv_render_pool *s, const struct srv_snapshot_entry *item,
                         double ms) {
    pthread_mutex_lock(&s->mutex);
    if (!item->still.background)
        srv_fair_owners_charge(&s->owners, item->still.owner, ms);
    pthread_mutex_unlock(&s->mutex);
}

/* Calls those who ask for nothing but this result; the item is no longer in the list. */
static void answer(struct srv_render_pool *s, struct srv_snapshot_waiter *asks,
                   const struct srv_snapshot_result *result) {
    while (asks) {
        struct srv_snapshot_waiter *next = asks->next;
        asks->done(asks->user, result);
        free(asks);
        pthread_mutex_lock(&s->mutex);
        s->still_unanswered--;
        pthread_mutex_unlock(&s->mutex);
        asks = next;
    }
}

static void fail_asks(struct srv_render_pool *s, struct srv_snapshot_waiter *asks,
                      const struct sp_error *err) {
    struct srv_snapshot_result result = { .ok = false, .err = *err };
    bool is_cancelled = err->code == SP_ERR_CANCELLED;
    pthread_mutex_lock(&s->mutex);
    bool counts = !s->stop; /* what the end of the daemon takes away is not counted */
    pthread_mutex_unlock(&s->mutex);
    for (const struct srv_snapshot_waiter *ask = asks; ask && counts; ask = ask->next)
        srv_metrics_add(s->options.metrics,
                        is_cancelled ? SRV_COUNT_DROP_LEFT : SRV_COUNT_DROP_FAILED, 1);
    answer(s, asks, &result);
}

/* It is no longer in the list, and its volume no longer in use: before anybody is answered, who may
 * then unload it. Returns who asked. */
static struct srv_snapshot_waiter *free_item(struct srv_render_pool *s,
                                             struct srv_snapshot_entry *item) {
    struct srv_snapshot_waiter *asks = item->asks;
    srv_catalog_release(s->options.catalog, item->still.volume);
    free(item);
    return asks;
}

void srv_snapshot_answer(struct srv_render_pool *s, struct srv_snapshot_entry *item,
                         const struct srv_snapshot_result *result) {
    pthread_mutex_lock(&s->mutex);
    take_out(s, item);
    pthread_mutex_unlock(&s->mutex);
    answer(s, free_item(s, item), result);
}

void srv_snapshot_fail(struct srv_render_pool *s, struct srv_snapshot_entry *item,
                       const struct sp_error *err) {
    pthread_mutex_lock(&s->mutex);
    take_out(s, item);
    pthread_mutex_unlock(&s->mutex);
    fail_asks(s, free_item(s, item), err);
}

/* What is in the background gives way to streams and to other stills. With the mutex held. */
static bool gives_way(struct srv_snapshot_entry *item, double now_ms) {
    if (!item->still.background)
        return false;
    if (item->patient_ms == 0)
        item->patient_ms = now_ms;
    return srv_fair_protected_ms(now_ms - item->patient_ms,
                                 fmax(item->still.expected_ms, 2 * item->spent_ms)) == 0;
}

void srv_snapshots_yield(struct srv_render_pool *s) {
    if (s->still_now && gives_way(s->still_now, srv_clock_ms()))
        atomic_store(&s->still_now->cancel, true);
}

void srv_snapshots_cancel(struct srv_render_pool *s) {
    if (s->still_now)
        atomic_store(&s->still_now->cancel, true);
}

/* Are so many of its owner's drawn and not answered yet that the others' have to come first? What
 * waits to be encoded stops the lane. */
static bool has_enough(const struct srv_render_pool *s, const struct srv_snapshot_entry *item) {
    unsigned drawn = 0, nice = s->encode_thread_count - s->options.encode_threads;
    for (const struct srv_snapshot_entry *i = s->stills; i; i = i->next)
        drawn +=
            !i->waits && !i->still.background && strcmp(i->still.owner, item->still.owner) == 0;
    return !item->still.background && drawn > nice;
}

static bool is_before(const struct srv_render_pool *s, const struct srv_snapshot_entry *a,
                      const struct srv_snapshot_entry *b) {
    if (a->still.background != b->still.background)
        return b->still.background;
    return !a->still.background && srv_fair_owners_start(&s->owners, a->still.owner) <
                                       srv_fair_owners_start(&s->owners, b->still.owner);
}

/* The next still becomes still_now; NULL if there is none, until *wait_ms at the latest. */
static struct srv_snapshot_entry *take_still(struct srv_render_pool *s, double *wait_ms) {
    struct srv_snapshot_entry *item = NULL;
    double now_ms = srv_clock_ms();
    pthread_mutex_lock(&s->mutex);
    bool quiet =
        s->lanes[SRV_WORKER_INTERACTIVE].flights.count == 0 && now_ms - s->stream_ms >= QUIET_MS;
    for (struct srv_snapshot_entry *i = s->stills; i; i = i->next) {
        bool may = i->waits && !has_enough(s, i) && (quiet || !gives_way(i, now_ms));
        if (i->waits && !may)
            *wait_ms = QUIET_MS;
        if (may && (!item || is_before(s, i, item)))
            item = i;
    }
    if (item) {
        if (!item->still.background)
            srv_fair_owners_begin(&s->owners, item->still.owner);
        item->waits = false;
        atomic_store(&item->cancel, s->stop);
        s->still_now = item;
    }
    pthread_mutex_unlock(&s->mutex);
    return item;
}

/* The frame to who encodes it himself. */
static void hand_over(struct srv_render_pool *s, struct srv_snapshot_entry *item,
                      struct sp_frame *frame, double drawn_ms) {
    struct srv_snapshot_result result = {
        .ok = true, .frame = frame, .stats = frame->stats, .drawn_ms = drawn_ms
    };
    srv_snapshot_answer(s, item, &result);
    sp_frame_unref(&frame);
}

/* *is_kept: it was there. */
static struct sp_frame *draw(struct srv_render_pool *s, struct srv_snapshot_entry *item,
                             bool *is_kept, struct sp_error *err) {
    struct srv_worker *lane = &s->lanes[SRV_WORKER_SNAPSHOT];
    bool wants_float = sp_image_format_info(item->still.format)->wants_float;
    struct sp_frame *frame =
        wants_float ? NULL : srv_frame_cache_find(s, item->still.volume, &item->still.view);
    *is_kept = frame != NULL;
    if (frame)
        return frame;
    if (!lane->renderer && !(lane->renderer = sp_renderer_create(&s->options.stills, err)))
        return NULL;
    const struct sp_render_options options = { .format = wants_float ? SP_RGBAF32 : SP_RGBA8,
                                               .cancel = &item->cancel };
    frame = sp_renderer_render(lane->renderer, srv_volume_voxels(item->still.volume),
                               &item->still.view, s->pool, &options, err);
    srv_worker_note_frame(s, SRV_WORKER_SNAPSHOT, item->still.volume);
    return frame;
}

static bool is_gone(const struct srv_snapshot_waiter *ask) {
    return ask->is_gone && ask->is_gone(ask->user);
}

static bool all_gone(const struct srv_snapshot_entry *item) {
    for (const struct srv_snapshot_waiter *ask = item->asks; ask; ask = ask->next)
        if (!is_gone(ask))
            return false;
    return true;
}

static void render_still(struct srv_render_pool *s, struct srv_snapshot_entry *item) {
    struct sp_error err = { .code = SP_OK };
    double start_ms = srv_clock_ms();
    if (item->spent_ms == 0 && !item->still.background) /* which is there to wait */
        srv_metrics_time(s->options.metrics, SRV_TIME_QUEUE, start_ms - item->queued_ms);
    bool is_kept = false;
    struct sp_frame *frame = draw(s, item, &is_kept, &err);
    double drawn_ms = is_kept ? 0 : srv_clock_ms() - start_ms;
    srv_snapshot_charge(s, item, drawn_ms);
    pthread_mutex_lock(&s->mutex);
    s->still_now = NULL;
    item->spent_ms = fmax(item->spent_ms, drawn_ms);
    bool again = !frame && err.code == SP_ERR_CANCELLED && !s->stop && !all_gone(item);
    item->waits = again; /* it gave way */
    pthread_mutex_unlock(&s->mutex);
    if (frame && item->still.wants_frame)
        hand_over(s, item, frame, drawn_ms);
    else if (frame)
        srv_encode_submit(
            s, (struct srv_encode_task){ .frame = frame, .still = item, .again = is_kept });
    else if (!again)
        srv_snapshot_fail(s, item, &err);
}

void *srv_snapshot_worker_main(void *user) {
    struct srv_render_pool *s = user;
    struct srv_worker *lane = &s->lanes[SRV_WORKER_SNAPSHOT];
    srv_background_thread_enter(
        "the still lane"); /* and so are the renderer's threads, which it will start */
    for (;;) {
        struct srv_worker_round turn = srv_worker_look(s, SRV_WORKER_SNAPSHOT);
        srv_worker_evict(lane, turn.forget);
        if (turn.stop)
            break;
        double wait_ms = 1000;
        struct srv_snapshot_entry *item = turn.room ? take_still(s, &wait_ms) : NULL;
        if (item)
            render_still(s, item);
        else
            srv_worker_wait(s, lane, turn.generation, wait_ms);
    }
    return NULL;
}

/* One in flight of the same bytes that may still be joined. With the mutex held. */
static struct srv_snapshot_entry *find_equal(struct srv_render_pool *s,
                                             const struct srv_snapshot *still) {
    const struct srv_encode_params form =
        srv_encode_params_from(still->format, still->quality, still->chroma);
    for (struct srv_snapshot_entry *i = s->stills; i; i = i->next) {
        const struct srv_snapshot *other = &i->still;
        const struct srv_encode_params theirs =
            srv_encode_params_from(other->format, other->quality, other->chroma);
        bool same = other->volume == still->volume && other->wants_frame == still->wants_frame &&
                    srv_encode_params_equal(&theirs, &form) &&
                    memcmp(&other->view, &still->view, sizeof still->view) == 0;
        if (same && (i->waits || !atomic_load(&i->cancel)))
            return i;
    }
    return NULL;
}

static void join(struct srv_snapshot_entry *item, struct srv_snapshot_waiter *ask,
                 bool background) {
    struct srv_snapshot_waiter **end = &item->asks;
    while (*end)
        end = &(*end)->next;
    *end = ask;
    item->still.background = item->still.background && background;
}

static bool has_room(const struct srv_render_pool *s, const struct srv_snapshot *still,
                     struct sp_error *err) {
    const unsigned most = s->options.queue_max, most_own = most - most / 4;
    unsigned waiting = 0, own = 0;
    for (const struct srv_snapshot_entry *i = s->stills; i; i = i->next) {
        bool counts = i->waits && i->still.background == still->background;
        waiting += counts;
        own += counts && strcmp(i->still.owner, still->owner) == 0;
    }
    if (waiting >= most)
        return sp_fail(err, SP_ERR_BUDGET, NULL,
                       "%u renders wait already and --render-queue allows %u; try again later",
                       waiting, most);
    return still->background || own < most_own ||
           sp_fail(err, SP_ERR_BUDGET, NULL,
                   "%u renders of yours wait already, and of the %u that --render-queue allows "
                   "one may have %u; try again later",
                   own, most, most_own);
}

static void append(struct srv_render_pool *s, struct srv_snapshot_entry *item) {
    struct srv_snapshot_entry **end = &s->stills;
    while (*end)
        end = &(*end)->next;
    *end = item;
    if (!item->still.background)
        srv_snapshots_yield(s);
}

bool srv_render_pool_submit(struct srv_render_pool *s, const struct srv_snapshot *still,
                            struct sp_error *err) {
    struct srv_snapshot_waiter *ask = malloc(sizeof *ask);
    struct srv_snapshot_entry *item = malloc(sizeof *item);
    bool ok = (ask && item) || sp_fail(err, SP_ERR_MEMORY, NULL, "no memory for a render request");
    pthread_mutex_lock(&s->mutex);
    if (ok && s->stop)
        ok = sp_fail(err, SP_ERR_CANCELLED, NULL, "the daemon is shutting down");
    struct srv_snapshot_entry *equal = ok ? find_equal(s, still) : NULL;
    ok = ok && (equal || has_room(s, still, err));
    if (ok) {
        *ask = (struct srv_snapshot_waiter){ NULL, still->done, still->is_gone, still->user };
        s->still_unanswered++;
    }
    if (ok && equal) {
        join(equal, ask, still->background);
    } else if (ok) {
        *item = (struct srv_snapshot_entry){
            .still = *still, .asks = ask, .waits = true, .queued_ms = srv_clock_ms()
        };
        append(s, item);
    }
    if (ok)
        srv_worker_wake(&s->lanes[SRV_WORKER_SNAPSHOT]);
    pthread_mutex_unlock(&s->mutex);
    if (!ok)
        free(ask);
    if (!ok || equal) {
        srv_catalog_release(s->options.catalog, still->volume);
        free(item);
    }
    return ok;
}

/* Moves those who left from *asks to *gone. */
static void part(struct srv_snapshot_waiter **asks, struct srv_snapshot_waiter **gone) {
    while (*asks) {
        struct srv_snapshot_waiter *ask = *asks;
        if (is_gone(ask)) {
            *asks = ask->next;
            ask->next = *gone;
            *gone = ask;
        } else {
            asks = &ask->next;
        }
    }
}

/* Frees items that wait and that nobody asks for any more. */
static void free_unasked(struct srv_render_pool *s, struct srv_snapshot_entry *list) {
    while (list) {
        struct srv_snapshot_entry *next = list->next;
        free_item(s, list);
        list = next;
    }
}

void srv_snapshots_tick(struct srv_render_pool *s) {
    struct srv_snapshot_waiter *gone = NULL;
    struct srv_snapshot_entry *unasked = NULL;
    struct sp_error err;
    pthread_mutex_lock(&s->mutex);
    for (struct srv_snapshot_entry **at = &s->stills; *at;) {
        struct srv_snapshot_entry *item = *at;
        if (item->waits)
            part(&item->asks, &gone);
        if (item->asks) {
            at = &item->next;
            continue;
        }
        *at = item->next;
        item->next = unasked;
        unasked = item;
    }
    if (s->still_now && all_gone(s->still_now))
        atomic_store(&s->still_now->cancel, true);
    pthread_mutex_unlock(&s->mutex);
    sp_fail(&err, SP_ERR_CANCELLED, NULL, "who asked for this picture has left");
    fail_asks(s, gone, &err);
    free_unasked(s, unasked);
}

void srv_snapshots_drop(struct srv_render_pool *s) {
    struct sp_error err;
    sp_fail(&err, SP_ERR_CANCELLED, NULL, "the daemon is shutting down");
    for (;;) {
        pthread_mutex_lock(&s->mutex);
        struct srv_snapshot_entry *item = s->stills;
        while (item && !item->waits)
            item = item->next;
        pthread_mutex_unlock(&s->mutex);
        if (!item)
            return;
        srv_snapshot_fail(s, item, &err);
    }
}
