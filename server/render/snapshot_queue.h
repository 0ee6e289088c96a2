/* SPDX-License-Identifier: Apache-2.0
 *
 * The queue of snapshots: single images that HTTP clients request, and frames of a camera
 * path.
 *
 *   submit ─► waiting ─► rendering ─► encoding ─► answered
 *               ▲            │
 *               └────────────┘ a background snapshot was cancelled by more urgent work
 *
 * - The next snapshot belongs to the owner that has received the least time for rendering and
 *   encoding (common/fair_owners.h); it is the oldest snapshot of that owner.
 * - Equal snapshots share one entry, which is rendered and encoded once. Each request is a waiter
 *   of the entry; the owner of the first request is charged.
 * - Background snapshots come last. They begin when no other snapshot waits and no session frame
 *   was rendered for 100 ms. They yield to both kinds of work: they are cancelled and rendered
 *   again later. After waiting for twenty times their own time they no longer yield
 *   (common/fair_queue.h).
 * - An entry begins when the time step of its view is loaded, which submit asks for.
 * - An entry without waiters (their clients have left) is dropped, also while it is rendered.
 *
 * All functions are thread-safe. Callbacks of snapshots, except is_gone(), are called without the
 * lock.
 */
#ifndef SRV_RENDER_SNAPSHOT_QUEUE_H
#define SRV_RENDER_SNAPSHOT_QUEUE_H

#include <pthread.h>
#include <stdatomic.h>

#include "common/fair_owners.h"
#include "ops/metrics.h"
#include "render/catalog.h"
#include "render/worker.h"
#include "sp/budget.h"
#include "sp/encode.h"
#include "sp/frame.h"

struct srv_snapshot_result {
    bool ok;
    struct sp_error err;    /* if not ok */
    const uint8_t *bytes;   /* valid during the call */
    size_t size;            /* of bytes */
    struct sp_frame *frame; /* set instead of `bytes` if wants_frame; valid during the call */
    double drawn_ms;        /* time spent to render that frame; 0 = it was cached */
    struct sp_frame_stats stats;
    double encode_ms;
};

struct srv_snapshot { /* a request for one image */
    struct sp_view view;
    struct srv_volume *volume;        /* a use, taken over by submit */
    char owner[SRV_FAIR_OWNER_BYTES]; /* owner whose account is charged */
    bool is_limited;                  /* the owner has a share of the queue */
    enum sp_image_format format;
    int quality;
    enum sp_chroma chroma; /* of a JPEG */
    bool background;       /* the lowest class */
    double expected_ms;    /* expected time to render a background snapshot; 0 = not known */
    bool wants_frame;      /* the caller encodes; `format` says whether it needs bytes or floats */
    /* Called exactly once, from another thread. */
    void (*done)(void *user, const struct srv_snapshot_result *result);
    /* True if the client has left; then the request is dropped. Polled from other threads until
     * shortly before done(), with the queue's lock held: it must not call the render pool. NULL =
     * never. */
    bool (*is_gone)(void *user);
    void *user;
};

struct srv_snapshot_waiter;

struct srv_snapshot_entry { /* in the list until it is answered or dropped */
    struct srv_snapshot_entry *next;
    struct srv_snapshot snapshot; /* of the first request; constant, read without the lock */
    struct srv_volume *others[2 * SP_LAYERS_MAX]; /* uses of the time steps of other volumes */
    unsigned other_count;
    struct srv_snapshot_waiter *waiters;
    bool is_background;     /* all its requests are background requests */
    bool is_waiting;        /* false: it is being rendered or encoded */
    atomic_bool cancel;     /* of its rendering */
    double queued_ms;       /* when it was submitted */
    double yields_since_ms; /* when it had to yield first; 0 = never */
    double spent_ms;        /* the longest time spent on a rendering that was cancelled */
    /* Memory of frames (frame_memory.h). */
    uint64_t encoder_bytes; /* taken for its encoder from when it is taken until it is encoded */
    bool needs_all;         /* it did not fit beside other work: it must be rendered alone */
    bool is_refused; /* other work left too little memory for too long: the entry is not rendered */
    double waits_for_memory; /* waits for memory since this time, ms; 0 = it does not wait */
};

struct srv_snapshot_queue_options {
    struct srv_catalog *catalog;
    struct srv_metrics *metrics; /* NULL = none */
    struct srv_worker *worker;   /* is woken when there may be a snapshot to render */
    struct sp_budget *budget;    /* of the memory of snapshots; NULL = no limit */
    unsigned waiting_max;   /* most waiting snapshots per class; in the foreground an owner may use
                               only its share */
    unsigned unencoded_max; /* rendered and unanswered snapshots of one owner; above this number,
                               other owners come first */
};

struct srv_snapshot_queue {
    struct srv_snapshot_queue_options options;
    pthread_mutex_t mutex;              /* guards what follows; taken before the worker's */
    struct srv_snapshot_entry *entries; /* oldest first */
    struct srv_snapshot_entry *current; /* being rendered */
    struct srv_fair_owners owners;      /* of foreground snapshots */
    unsigned unanswered;                /* requests without an answer */
    unsigned session_frames;            /* being rendered for sessions now */
    double session_frame_ms;            /* when the last of them ended */
    bool stop;
};

void srv_snapshot_queue_init(struct srv_snapshot_queue *queue,
                             const struct srv_snapshot_queue_options *options);
/* After every entry was answered. */
void srv_snapshot_queue_finish(struct srv_snapshot_queue *queue);

/* Any thread; done() may be called at once. Takes over the use of the volume. On failure releases
 * it and does not call done(): SP_ERR_BUDGET (the queue is full), SP_ERR_INVALID (the image can
 * never fit the memory of frames), SP_ERR_CANCELLED (the daemon stops), SP_ERR_MEMORY. */
bool srv_snapshot_queue_submit(struct srv_snapshot_queue *queue,
                               const struct srv_snapshot *snapshot, struct sp_error *err);
/* Drops the requests of clients that have left. */
void srv_snapshot_queue_tick(struct srv_snapshot_queue *queue);
/* Returns the number of requests without an answer. */
unsigned srv_snapshot_queue_unanswered(struct srv_snapshot_queue *queue);
/* The daemon stops: refuses new requests and cancels the rendering. */
void srv_snapshot_queue_stop(struct srv_snapshot_queue *queue);
/* Answers all that wait with SP_ERR_CANCELLED. After the snapshot worker has ended. */
void srv_snapshot_queue_drop_waiting(struct srv_snapshot_queue *queue);

/* Call them when a worker begins, and when it has ended, a frame of a session. Background snapshots
 * yield meanwhile. */
void srv_snapshot_queue_begin_session_frame(struct srv_snapshot_queue *queue);
void srv_snapshot_queue_end_session_frame(struct srv_snapshot_queue *queue, double now_ms);

/* The snapshot worker. */

/* True if the time steps of the view are loaded; else *err is set, as by
 * srv_catalog_step_is_ready(). */
bool srv_snapshot_has_steps(struct srv_catalog *catalog, const struct srv_snapshot_entry *entry,
                            struct sp_error *err);
/* Takes the entry to render next, and acquires the memory of its encoder. NULL if there is none:
 * the caller asks again after *wait_ms at the latest; *wait_ms is unchanged if only an event can
 * bring a snapshot. *needs_memory = true: the next entry waits until other work releases memory,
 * and the worker should release its own. An entry that has waited for SRV_MEMORY_WAIT_MS is
 * returned with is_refused. */
struct srv_snapshot_entry *srv_snapshot_queue_pop(struct srv_snapshot_queue *queue, double *wait_ms,
                                                  bool *needs_memory);
/* Releases the memory that was acquired for the entry's encoder. */
void srv_snapshot_queue_release(struct srv_snapshot_queue *queue, struct srv_snapshot_entry *entry);
/* Call it when the rendering of an entry ended after render_ms. Charges the owner. is_cancelled:
 * the rendering yielded or lacked memory, and the entry is to be rendered again. Returns true if
 * the entry waits for that. Otherwise the caller answers the entry, now or after encoding. */
bool srv_snapshot_queue_end_rendering(struct srv_snapshot_queue *queue,
                                      struct srv_snapshot_entry *entry, bool is_cancelled,
                                      double render_ms);

/* The snapshot worker and the encode threads. */

void srv_snapshot_queue_charge(struct srv_snapshot_queue *queue,
                               const struct srv_snapshot_entry *entry, double ms);
/* Both functions answer every waiter and free the entry. */
void srv_snapshot_queue_answer(struct srv_snapshot_queue *queue, struct srv_snapshot_entry *entry,
                               const struct srv_snapshot_result *result);
void srv_snapshot_queue_fail(struct srv_snapshot_queue *queue, struct srv_snapshot_entry *entry,
                             const struct sp_error *err);

#endif
