/* SPDX-License-Identifier: Apache-2.0 */
#include "render/snapshot_queue.h"

#include <assert.h>
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/clock.h"
#include "common/fair_queue.h"
#include "common/fair_share.h"
#include "render/frame_memory.h"
#include "session/encode_params.h"

/* No session has rendered a frame for this long when a background snapshot begins. */
#define QUIET_MS 100.0

struct srv_snapshot_waiter {
    struct srv_snapshot_waiter *next;
    void (*done)(void *user, const struct srv_snapshot_result *result);
    bool (*is_gone)(void *user);
    void *user;
};

void srv_snapshot_queue_init(struct srv_snapshot_queue *queue,
                             const struct srv_snapshot_queue_options *options) {
    *queue = (struct srv_snapshot_queue){ .options = *options };
    pthread_mutex_init(&queue->mutex, NULL);
}

void srv_snapshot_queue_finish(struct srv_snapshot_queue *queue) {
    assert(!queue->entries);
    pthread_mutex_destroy(&queue->mutex);
}

unsigned srv_snapshot_queue_unanswered(struct srv_snapshot_queue *queue) {
    pthread_mutex_lock(&queue->mutex);
    unsigned unanswered = queue->unanswered;
    pthread_mutex_unlock(&queue->mutex);
    return unanswered;
}

/* Answers. */

/* Removes the entry from the list: no later request joins it. With the mutex held. */
static void remove_entry(struct srv_snapshot_queue *queue, struct srv_snapshot_entry *entry) {
    struct srv_snapshot_entry **link = &queue->entries;
    while (*link != entry)
        link = &(*link)->next;
    *link = entry->next;
    if (!queue->entries)
        srv_fair_owners_reset(&queue->owners);
    srv_worker_wake(queue->options.worker); /* its owner may have another one rendered now */
}

/* Answers the waiters of an entry that has left the list, and frees them. */
static void answer_waiters(struct srv_snapshot_queue *queue, struct srv_snapshot_waiter *waiters,
                           const struct srv_snapshot_result *result) {
    while (waiters) {
        struct srv_snapshot_waiter *next = waiters->next;
        waiters->done(waiters->user, result);
        free(waiters);
        pthread_mutex_lock(&queue->mutex);
        queue->unanswered--;
        pthread_mutex_unlock(&queue->mutex);
        waiters = next;
    }
}

static void fail_waiters(struct srv_snapshot_queue *queue, struct srv_snapshot_waiter *waiters,
                         const struct sp_error *err) {
    struct srv_snapshot_result result = { .ok = false, .err = *err };
    bool is_cancelled = err->code == SP_ERR_CANCELLED;
    pthread_mutex_lock(&queue->mutex);
    bool counts = !queue->stop; /* snapshots that the shutdown drops are not counted */
    pthread_mutex_unlock(&queue->mutex);
    for (const struct srv_snapshot_waiter *w = waiters; w && counts; w = w->next)
        srv_metrics_add(queue->options.metrics,
                        is_cancelled ? SRV_COUNT_DROP_LEFT : SRV_COUNT_DROP_FAILED, 1);
    answer_waiters(queue, waiters, &result);
}

static void release_others(struct srv_snapshot_queue *queue, struct srv_snapshot_entry *entry) {
    while (entry->other_count > 0)
        srv_catalog_release(queue->options.catalog, entry->others[--entry->other_count]);
}

/* Frees an entry that has left the list; returns its waiters. Releases the volumes before they are
 * answered, so that a client can unload it as soon as it has its answer. */
static struct srv_snapshot_waiter *free_entry(struct srv_snapshot_queue *queue,
                                              struct srv_snapshot_entry *entry) {
    struct srv_snapshot_waiter *waiters = entry->waiters;
    release_others(queue, entry);
    srv_catalog_release(queue->options.catalog, entry->snapshot.volume);
    free(entry);
    return waiters;
}

void srv_snapshot_queue_answer(struct srv_snapshot_queue *queue, struct srv_snapshot_entry *entry,
                               const struct srv_snapshot_result *result) {
    pthread_mutex_lock(&queue->mutex);
    remove_entry(queue, entry);
    pthread_mutex_unlock(&queue->mutex);
    answer_waiters(queue, free_entry(queue, entry), result);
}

void srv_snapshot_queue_fail(struct srv_snapshot_queue *queue, struct srv_snapshot_entry *entry,
                             const struct sp_error *err) {
    pthread_mutex_lock(&queue->mutex);
    remove_entry(queue, entry);
    pthread_mutex_unlock(&queue->mutex);
    fail_waiters(queue, free_entry(queue, entry), err);
}

/* The next one. */

bool srv_snapshot_has_steps(struct srv_catalog *catalog, const struct srv_snapshot_entry *entry,
                            struct sp_error *err) {
    bool ok = srv_catalog_step_is_ready(catalog, entry->snapshot.volume, err);
    for (unsigned i = 0; ok && i < entry->other_count; i++)
        ok = srv_catalog_step_is_ready(catalog, entry->others[i], err);
    return ok;
}

/* True if the time steps of the view are loaded, or never will be. */
static bool has_volume(const struct srv_snapshot_queue *queue,
                       const struct srv_snapshot_entry *entry) {
    struct sp_error err;
    return srv_snapshot_has_steps(queue->options.catalog, entry, &err) ||
           err.code != SP_ERR_NOT_READY;
}

/* True if this background snapshot yields to sessions and to other snapshots now. With the mutex
 * held. */
static bool yields(struct srv_snapshot_entry *entry, double now_ms) {
    if (!entry->is_background)
        return false;
    if (entry->yields_since_ms == 0)
        entry->yields_since_ms = now_ms;
    return srv_fair_protected_ms(now_ms - entry->yields_since_ms,
                                 fmax(entry->snapshot.expected_ms, 2 * entry->spent_ms)) == 0;
}

/* With the mutex held. */
static void cancel_if_it_yields(struct srv_snapshot_queue *queue) {
    if (queue->current && yields(queue->current, srv_clock_ms()))
        atomic_store(&queue->current->cancel, true);
}

void srv_snapshot_queue_begin_session_frame(struct srv_snapshot_queue *queue) {
    pthread_mutex_lock(&queue->mutex);
    queue->session_frames++;
    cancel_if_it_yields(queue);
    pthread_mutex_unlock(&queue->mutex);
}

void srv_snapshot_queue_end_session_frame(struct srv_snapshot_queue *queue, double now_ms) {
    pthread_mutex_lock(&queue->mutex);
    queue->session_frames--;
    queue->session_frame_ms = now_ms;
    pthread_mutex_unlock(&queue->mutex);
}

/* True if the owner has so many snapshots rendered and not answered that other owners come first.
 * Otherwise one owner's snapshots could fill the encode queue and stop the worker for all. */
static bool has_enough(const struct srv_snapshot_queue *queue,
                       const struct srv_snapshot_entry *entry) {
    unsigned unencoded = 0;
    for (const struct srv_snapshot_entry *e = queue->entries; e; e = e->next)
        unencoded += !e->is_waiting && !e->is_background &&
                     strcmp(e->snapshot.owner, entry->snapshot.owner) == 0;
    return !entry->is_background && unencoded > queue->options.unencoded_max;
}

static bool is_before(const struct srv_snapshot_queue *queue, const struct srv_snapshot_entry *a,
                      const struct srv_snapshot_entry *b) {
    if (a->is_background != b->is_background)
        return b->is_background;
    return !a->is_background && srv_fair_owners_start(&queue->owners, a->snapshot.owner) <
                                    srv_fair_owners_start(&queue->owners, b->snapshot.owner);
}

/* Memory that the entry needs before it is rendered: its pixels, and an encoder. */
static uint64_t bytes_of(const struct srv_snapshot *snapshot) {
    return srv_frame_memory_of(snapshot->format, snapshot->view.size);
}

static bool can_ever_fit(const struct srv_snapshot_queue *queue,
                         const struct srv_snapshot *snapshot, struct sp_error *err) {
    const uint64_t needed = bytes_of(snapshot), most = sp_budget_limit(queue->options.budget);
    return needed <= most ||
           sp_fail(err, SP_ERR_INVALID, "/size",
                   "an image of %u x %u px as %s needs %" PRIu64 " bytes, and the half of "
                   "--render-bytes for images over HTTP is %" PRIu64 "; ask for a smaller one",
                   snapshot->view.size[0], snapshot->view.size[1],
                   sp_image_format_info(snapshot->format)->name, needed, most);
}

/* Acquires the memory of the entry's encoder if it and the pixels fit beside what others have. The
 * next entry waits for its memory before any other is begun, so that small ones do not delay it for
 * ever. With the mutex held. */
static bool acquire_memory(struct srv_snapshot_queue *queue, struct srv_snapshot_entry *entry,
                           double now_ms) {
    struct sp_budget *budget = queue->options.budget;
    const uint64_t others = sp_budget_total(budget);
    const uint64_t encoder =
        entry->snapshot.wants_frame
            ? 0
            : sp_encode_bytes(entry->snapshot.format, entry->snapshot.view.size);
    const bool fits = entry->needs_all
                          ? others == 0
                          : others + bytes_of(&entry->snapshot) <= sp_budget_limit(budget);
    if (fits && sp_budget_acquire(budget, SP_BUDGET_ENCODERS, encoder)) {
        entry->encoder_bytes = encoder;
        entry->waits_for_memory = 0;
        return true;
    }
    if (entry->waits_for_memory == 0)
        entry->waits_for_memory = now_ms;
    entry->is_refused = now_ms - entry->waits_for_memory >= SRV_MEMORY_WAIT_MS;
    return entry->is_refused;
}

void srv_snapshot_queue_release(struct srv_snapshot_queue *queue,
                                struct srv_snapshot_entry *entry) {
    sp_budget_release(queue->options.budget, SP_BUDGET_ENCODERS, entry->encoder_bytes);
    entry->encoder_bytes = 0;
}

struct srv_snapshot_entry *srv_snapshot_queue_pop(struct srv_snapshot_queue *queue, double *wait_ms,
                                                  bool *needs_memory) {
    const double look_again_ms = 100;
    struct srv_snapshot_entry *next = NULL;
    double now_ms = srv_clock_ms();
    pthread_mutex_lock(&queue->mutex);
    bool is_quiet = queue->session_frames == 0 && now_ms - queue->session_frame_ms >= QUIET_MS;
    for (struct srv_snapshot_entry *e = queue->entries; e; e = e->next) {
        bool may_begin = e->is_waiting && !has_enough(queue, e) && (is_quiet || !yields(e, now_ms));
        if (e->is_waiting && !may_begin)
            *wait_ms = QUIET_MS;
        if (may_begin && has_volume(queue, e) && (!next || is_before(queue, e, next)))
            next = e;
    }
    *needs_memory = next && !acquire_memory(queue, next, now_ms);
    if (*needs_memory) {
        *wait_ms = look_again_ms;
        next = NULL;
    }
    if (next) {
        if (!next->is_background)
            srv_fair_owners_begin(&queue->owners, next->snapshot.owner);
        /* Background snapshots are meant to wait; their time is no queueing time. */
        if (!next->is_background && next->spent_ms == 0)
            srv_metrics_time(queue->options.metrics, SRV_TIME_QUEUE, now_ms - next->queued_ms);
        next->is_waiting = false;
        atomic_store(&next->cancel, queue->stop);
        queue->current = next;
    }
    pthread_mutex_unlock(&queue->mutex);
    return next;
}

static bool is_gone(const struct srv_snapshot_waiter *waiter) {
    return waiter->is_gone && waiter->is_gone(waiter->user);
}

static bool are_all_gone(const struct srv_snapshot_entry *entry) {
    for (const struct srv_snapshot_waiter *w = entry->waiters; w; w = w->next)
        if (!is_gone(w))
            return false;
    return true;
}

/* With the mutex held. */
static void charge(struct srv_snapshot_queue *queue, const struct srv_snapshot_entry *entry,
                   double ms) {
    if (!entry->is_background)
        srv_fair_owners_charge(&queue->owners, entry->snapshot.owner, ms);
}

void srv_snapshot_queue_charge(struct srv_snapshot_queue *queue,
                               const struct srv_snapshot_entry *entry, double ms) {
    pthread_mutex_lock(&queue->mutex);
    charge(queue, entry, ms);
    pthread_mutex_unlock(&queue->mutex);
}

bool srv_snapshot_queue_end_rendering(struct srv_snapshot_queue *queue,
                                      struct srv_snapshot_entry *entry, bool is_cancelled,
                                      double render_ms) {
    pthread_mutex_lock(&queue->mutex);
    charge(queue, entry, render_ms);
    queue->current = NULL;
    entry->spent_ms = fmax(entry->spent_ms, render_ms);
    entry->is_waiting = is_cancelled && !queue->stop && !are_all_gone(entry);
    bool is_waiting = entry->is_waiting;
    pthread_mutex_unlock(&queue->mutex);
    return is_waiting;
}

/* Requests. */

/* Finds an entry that renders and encodes the same image and that a request may still join. With
 * the mutex held. */
static struct srv_snapshot_entry *find_equal(struct srv_snapshot_queue *queue,
                                             const struct srv_snapshot *snapshot) {
    const struct srv_encode_params params =
        srv_encode_params_from(snapshot->format, snapshot->quality, snapshot->chroma);
    for (struct srv_snapshot_entry *e = queue->entries; e; e = e->next) {
        const struct srv_snapshot *other = &e->snapshot;
        const struct srv_encode_params theirs =
            srv_encode_params_from(other->format, other->quality, other->chroma);
        bool is_equal = other->volume == snapshot->volume &&
                        other->wants_frame == snapshot->wants_frame &&
                        srv_encode_params_equal(&theirs, &params) &&
                        sp_view_equal(&other->view, &snapshot->view);
        if (is_equal && (e->is_waiting || !atomic_load(&e->cancel)))
            return e;
    }
    return NULL;
}

static void join_entry(struct srv_snapshot_entry *entry, struct srv_snapshot_waiter *waiter,
                       bool background) {
    struct srv_snapshot_waiter **end = &entry->waiters;
    while (*end)
        end = &(*end)->next;
    *end = waiter;
    entry->is_background = entry->is_background && background;
}

/* True if one more of its class may wait; in the foreground each owner has a share. With the mutex
 * held. */
static bool has_capacity(const struct srv_snapshot_queue *queue,
                         const struct srv_snapshot *snapshot, struct sp_error *err) {
    struct srv_pool pool = { .most = queue->options.waiting_max };
    for (const struct srv_snapshot_entry *e = queue->entries; e; e = e->next) {
        bool counts = e->is_waiting && e->is_background == snapshot->background;
        pool.used += counts;
        pool.own += counts && strcmp(e->snapshot.owner, snapshot->owner) == 0;
    }
    if (srv_fair_left(&pool, snapshot->is_limited && !snapshot->background) > 0)
        return true;
    if (pool.used >= pool.most)
        return sp_fail(err, SP_ERR_BUDGET, NULL,
                       "%u renders are waiting and --render-queue allows %u; try again later",
                       (unsigned)pool.used, (unsigned)pool.most);
    return sp_fail(
        err, SP_ERR_BUDGET, NULL,
        "%u of your renders and %u of all are waiting, and --render-queue allows %u; the "
        "rest is kept for others; try again later",
        (unsigned)pool.own, (unsigned)pool.used, (unsigned)pool.most);
}

/* With the mutex held. */
static void append(struct srv_snapshot_queue *queue, struct srv_snapshot_entry *entry) {
    struct srv_snapshot_entry **end = &queue->entries;
    while (*end)
        end = &(*end)->next;
    *end = entry;
    if (!entry->is_background)
        cancel_if_it_yields(queue);
}

/* Acquires the view's time step in place of the volume that was opened; NULL when out of memory. */
static void *acquire_step(struct srv_catalog *catalog, const struct srv_snapshot *snapshot) {
    struct srv_volume *step = srv_catalog_step(catalog, snapshot->volume, snapshot->view.time.step);
    srv_catalog_release(catalog, snapshot->volume);
    return step;
}

bool srv_snapshot_queue_submit(struct srv_snapshot_queue *queue, const struct srv_snapshot *request,
                               struct sp_error *err) {
    struct srv_snapshot_waiter *waiter = malloc(sizeof *waiter);
    struct srv_snapshot_entry *entry = calloc(1, sizeof *entry), *equal = NULL;
    struct srv_snapshot own = *request, *snapshot = &own;
    own.volume = acquire_step(queue->options.catalog, request);
    bool ok = (waiter && entry && own.volume &&
               srv_catalog_other_steps(queue->options.catalog, own.volume, &own.view, entry->others,
                                       &entry->other_count)) ||
              sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for a render");
    pthread_mutex_lock(&queue->mutex);
    if (ok && queue->stop)
        ok = sp_fail(err, SP_ERR_CANCELLED, NULL, "the daemon is shutting down");
    if (ok)
        equal = find_equal(queue, snapshot);
    ok =
        ok && (equal || (can_ever_fit(queue, snapshot, err) && has_capacity(queue, snapshot, err)));
    if (ok) {
        *waiter =
            (struct srv_snapshot_waiter){ NULL, snapshot->done, snapshot->is_gone, snapshot->user };
        queue->unanswered++;
    }
    if (ok && equal) {
        join_entry(equal, waiter, snapshot->background);
    } else if (ok) {
        entry->snapshot = *snapshot;
        entry->waiters = waiter;
        entry->is_background = snapshot->background;
        entry->is_waiting = true;
        entry->queued_ms = srv_clock_ms();
        append(queue, entry);
    }
    if (ok)
        srv_worker_wake(queue->options.worker);
    pthread_mutex_unlock(&queue->mutex);
    if (!ok)
        free(waiter);
    if ((!ok || equal) && own.volume)
        srv_catalog_release(queue->options.catalog, own.volume);
    if (entry && (!ok || equal)) {
        release_others(queue, entry);
        free(entry);
    }
    return ok;
}

/* Clients that leave, and the end. */

/* Moves the waiters that have left from *waiters to *gone. */
static void move_gone(struct srv_snapshot_waiter **waiters, struct srv_snapshot_waiter **gone) {
    while (*waiters) {
        struct srv_snapshot_waiter *waiter = *waiters;
        if (is_gone(waiter)) {
            *waiters = waiter->next;
            waiter->next = *gone;
            *gone = waiter;
        } else {
            waiters = &waiter->next;
        }
    }
}

void srv_snapshot_queue_tick(struct srv_snapshot_queue *queue) {
    struct srv_snapshot_waiter *gone = NULL;
    struct srv_snapshot_entry *unwanted = NULL;
    struct sp_error err;
    pthread_mutex_lock(&queue->mutex);
    for (struct srv_snapshot_entry **link = &queue->entries; *link;) {
        struct srv_snapshot_entry *entry = *link;
        if (entry->is_waiting)
            move_gone(&entry->waiters, &gone);
        if (entry->waiters) {
            link = &entry->next;
            continue;
        }
        *link = entry->next;
        entry->next = unwanted;
        unwanted = entry;
    }
    if (queue->current && are_all_gone(queue->current))
        atomic_store(&queue->current->cancel, true);
    pthread_mutex_unlock(&queue->mutex);
    sp_fail(&err, SP_ERR_CANCELLED, NULL, "the client that requested this image has left");
    fail_waiters(queue, gone, &err);
    while (unwanted) {
        struct srv_snapshot_entry *next = unwanted->next;
        free_entry(queue, unwanted);
        unwanted = next;
    }
}

void srv_snapshot_queue_stop(struct srv_snapshot_queue *queue) {
    pthread_mutex_lock(&queue->mutex);
    queue->stop = true;
    if (queue->current)
        atomic_store(&queue->current->cancel, true);
    pthread_mutex_unlock(&queue->mutex);
}

void srv_snapshot_queue_drop_waiting(struct srv_snapshot_queue *queue) {
    struct sp_error err;
    sp_fail(&err, SP_ERR_CANCELLED, NULL, "the daemon is shutting down");
    for (;;) {
        pthread_mutex_lock(&queue->mutex);
        struct srv_snapshot_entry *entry = queue->entries;
        while (entry && !entry->is_waiting)
            entry = entry->next;
        pthread_mutex_unlock(&queue->mutex);
        if (!entry)
            return;
        srv_snapshot_queue_fail(queue, entry, &err);
    }
}
