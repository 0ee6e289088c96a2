/* SPDX-License-Identifier: Apache-2.0
 *
 * What the files of the scheduler share: the lanes (scheduler.c), what their threads do
 * (stream_lane.c, express_lane.c, still_lane.c), and the encode threads (encode.c). Guarded by the
 * mutex, besides what says otherwise.
 */
#ifndef SRV_RENDER_RENDER_POOL_PRIVATE_H
#define SRV_RENDER_RENDER_POOL_PRIVATE_H

#include <pthread.h>

#include "render/frame_queue.h"
#include "render/render_pool.h"
#include "render/video.h"
#include "session/encode_params.h"
#include "sp/inflight.h"

enum {
    SRV_WORKER_ENCODES =
        2, /* no further job is begun while so many frames that are not dear wait */
    SRV_ENCODE_QUEUE = 3 * SRV_WORKER_ENCODES + SP_IN_FLIGHT_MAX /* that were begun by then */ +
                       SRV_SLOW_ENCODE_JOBS,
    SRV_ENCODE_THREADS_MAX = 8, /* of those that are not nice */
    SRV_FRAME_CACHE_ENCODINGS = 4
};

struct srv_snapshot_waiter { /* for a still */
    struct srv_snapshot_waiter *next;
    void (*done)(void *user, const struct srv_snapshot_result *result);
    bool (*is_gone)(void *user);
    void *user;
};
struct srv_snapshot_entry { /* in the list until it is answered or dropped */
    struct srv_snapshot_entry *next;
    struct srv_snapshot still; /* of the first who asked */
    struct srv_snapshot_waiter *asks;
    bool waits; /* false: being drawn or encoded */
    atomic_bool cancel;
    double queued_ms;  /* since when it is there */
    double patient_ms; /* since when it gives way; 0 = it never had to */
    double spent_ms;   /* drawing it before it gave way, the longest time */
};
struct srv_evict_item {
    struct srv_evict_item *next;
    struct sp_volume *volume;
};
struct srv_encode_task { /* a rendered frame on its way to an encoder: of a job or of a still */
    struct sp_frame *frame;
    struct srv_render_job *job;
    struct srv_snapshot_entry *still;
    bool is_express; /* the job is the express lane's */
    bool again;      /* the frame is an earlier job's: it was not drawn for this */
};

struct srv_striped_image {       /* a large JPEG, whose stripes are made by who has time */
    unsigned count, taken, made; /* stripes */
    sp_stripe_fn *stripe;
    void *of;
};
struct srv_encode_thread {
    struct srv_render_pool *render_pool;
    pthread_t thread;
    bool running;  /* there is a thread to join; of who starts and stops it */
    bool is_nice;  /* takes stills and dear frames of sessions, the others all else */
    bool is_first; /* of several: makes no stripes of stills */
    bool at_still;
    uint64_t session; /* of whose job it encodes a frame; 0 = none */
    struct sp_encoder *encoder;
    struct srv_striped_image picture; /* that it shares */
};

enum srv_worker_name {
    SRV_WORKER_INTERACTIVE,
    SRV_WORKER_SNAPSHOT,
    SRV_WORKER_PREEMPTION,
    SRV_WORKERS
};

struct srv_worker {
    struct sp_renderer *renderer; /* its thread's */
    struct sp_renderer_info info; /* of the renderer; its thread writes it with the mutex held */
    pthread_t thread;
    bool running;
    pthread_cond_t wake; /* `generation`, stop */
    uint64_t generation; /* rises with everything that its thread may have waited for */
    struct srv_evict_item *forget;
    unsigned encodes;               /* frames in the encode queue, without dear ones of sessions */
    struct srv_frame_queue flights; /* jobs; none in the still lane */
};

struct srv_render_pool {
    struct srv_render_pool_options options;
    struct srv_worker lanes[SRV_WORKERS];
    struct sp_frame_pool *pool;
    struct srv_hub *hub;
    pthread_mutex_t mutex;
    pthread_cond_t encode;                /* the encode threads: work, stripes, stop */
    pthread_cond_t made;                  /* the last stripe of a picture is */
    pthread_cond_t go_on;                 /* what stands still may go on, or is given up */
    bool has_no_express;                  /* its renderer fails: long frames do not stand still */
    struct srv_snapshot_entry *stills;    /* in flight, oldest first */
    struct srv_snapshot_entry *still_now; /* being drawn */
    struct srv_fair_owners owners;        /* of stills that are not in the background */
    unsigned still_unanswered;            /* who asked for one and has no answer */
    double stream_ms;                     /* when a lane of streams had something under way last */
    struct srv_encode_task encode_queue[SRV_ENCODE_QUEUE];
    unsigned encode_count;
    struct { /* the last sharp picture */
        struct sp_frame *frame;
        struct srv_fingerprint of; /* the volume */
        struct sp_view view;
        struct { /* its bytes, in the forms that streams had of it last */
            struct srv_encode_params form;
            struct srv_blob *blob; /* NULL = none */
        } encoded[SRV_FRAME_CACHE_ENCODINGS];
        unsigned next; /* of `encoded`, to be replaced */
    } kept;
    bool stop, encode_stop;
    bool videos_due; /* an encode thread with nothing else to do gives idle encoders back */
    struct srv_encode_thread encode_threads[2 * SRV_ENCODE_THREADS_MAX];
    unsigned encode_thread_count;
    struct srv_video_encoders *videos;
};

/* With the mutex held. */
void srv_worker_wake(struct srv_worker *lane);

struct srv_worker_round { /* what a lane's thread found at the start of a round */
    uint64_t generation;
    bool stop, room;
    struct srv_evict_item *forget;
};
struct srv_worker_round srv_worker_look(struct srv_render_pool *s, enum srv_worker_name name);
/* Until there may be something new since `generation`, at most wait_ms. */
void srv_worker_wait(struct srv_render_pool *s, struct srv_worker *lane, uint64_t generation,
                     double wait_ms);
/* Its renderer's thread; takes over the list. */
void srv_worker_evict(struct srv_worker *lane, struct srv_evict_item *list);
/* After a frame of the volume was drawn, or not. */
void srv_worker_note_frame(struct srv_render_pool *s, enum srv_worker_name name,
                           struct srv_volume *volume);

/* Jobs, in a lane that has them; its thread. Hands one to the renderer: begun, or the hub was told
 * that it failed. */
void srv_job_begin(struct srv_render_pool *s, enum srv_worker_name name,
                   struct srv_render_job *job);
/* Waits for the oldest job that was begun. */
void srv_job_finish(struct srv_render_pool *s, enum srv_worker_name name);

/* Nothing is drawn in the express lane any more. */
void srv_preemption_disable(struct srv_render_pool *s, const struct sp_error *why);

/* The threads; `user` is the scheduler. */
void *srv_interactive_worker_main(void *user);
void *srv_preemption_worker_main(void *user);
void *srv_snapshot_worker_main(void *user);

/* Takes over the work. */
void srv_encode_submit(struct srv_render_pool *s, struct srv_encode_task work);
/* What the threads need; the threads. */
bool srv_encode_create(struct srv_render_pool *s, struct sp_error *err);
bool srv_encode_start(struct srv_render_pool *s, struct sp_error *err);
/* When nothing more is passed on: encodes what waits, and ends the threads. */
void srv_encode_stop(struct srv_render_pool *s);
void srv_encode_destroy(struct srv_render_pool *s);

/* A job that came to nothing; takes it over. elapsed_ms: of rendering that was cancelled. */
void srv_job_fail(struct srv_render_pool *s, struct srv_render_job *job, const struct sp_error *err,
                  double elapsed_ms);

/* The kept picture, if it is that of the view; the caller's reference. Without the mutex. */
struct sp_frame *srv_frame_cache_find(struct srv_render_pool *s, const struct srv_volume *volume,
                                      const struct sp_view *view);

/* Keeps it in the place of what was kept; NULL = nothing is any more. Without the mutex. */
void srv_frame_cache_set(struct srv_render_pool *s, struct sp_frame *frame,
                         const struct srv_volume *volume, const struct sp_view *view);
/* Bytes of the frame, if it is the kept one and was encoded in that form; the caller's reference.
 */
struct srv_blob *srv_frame_cache_bytes(struct srv_render_pool *s, const struct sp_frame *frame,
                                       const struct srv_encode_params *form);
/* Keeps them, if the frame is the kept one. */
void srv_frame_cache_set_bytes(struct srv_render_pool *s, const struct sp_frame *frame,
                               const struct srv_encode_params *form, struct srv_blob *blob);

/* Stills, without the mutex. Its owner pays for it. */
void srv_snapshot_charge(struct srv_render_pool *s, const struct srv_snapshot_entry *item,
                         double ms);
/* These take over the item. */
void srv_snapshot_answer(struct srv_render_pool *s, struct srv_snapshot_entry *item,
                         const struct srv_snapshot_result *result);
void srv_snapshot_fail(struct srv_render_pool *s, struct srv_snapshot_entry *item,
                       const struct sp_error *err);
/* The stream lane begins something; with the mutex held. */
void srv_snapshots_yield(struct srv_render_pool *s);
/* Cancels what is being drawn: the daemon stops; with the mutex held. */
void srv_snapshots_cancel(struct srv_render_pool *s);
/* Drops those whose askers left. */
void srv_snapshots_tick(struct srv_render_pool *s);
/* Answers those that wait: the daemon is shutting down. */
void srv_snapshots_drop(struct srv_render_pool *s);

#endif
