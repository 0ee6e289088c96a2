/* SPDX-License-Identifier: Apache-2.0 */
#include "render/encode_pool.h"

#include <assert.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "common/background.h"
#include "sp/encode.h"
#include "sp/inflight.h"

enum {
    WAITING_MAX = 2, /* frames of one worker that wait before it begins no other */
    /* Each worker may have WAITING_MAX frames in the queue. Frames that it had begun by then, and
     * the session frames that are slow to encode, come on top. */
    QUEUE_MAX = SRV_WORKERS * WAITING_MAX + SP_IN_FLIGHT_MAX + SRV_SLOW_ENCODE_JOBS
};

/* An image that its own thread and helping threads encode in stripes. */
struct striped_image {
    unsigned count, taken, finished; /* stripes */
    sp_stripe_fn *encode_stripe;
    void *user; /* of encode_stripe */
};

struct encode_thread {
    struct srv_encode_pool *pool;
    struct sp_encoder *encoder;
    pthread_t thread;
    bool is_running; /* there is a thread to join; for the thread that starts and stops it */
    bool is_background;
    bool is_reserved;  /* helps with no snapshot */
    bool has_snapshot; /* its newest task is a snapshot; guarded by the mutex, as what follows */
    uint64_t session;  /* whose frame it encodes; 0 = none */
    struct striped_image image;
};

struct srv_encode_pool {
    struct srv_encode_pool_options options;
    struct encode_thread threads[2 * SRV_ENCODE_THREADS_MAX];
    unsigned thread_count;
    pthread_mutex_t mutex;                   /* guards what follows */
    pthread_cond_t changed;                  /* a task, stripes, maintenance or stop */
    pthread_cond_t finished;                 /* the last stripe of an image is encoded */
    struct srv_encode_task queue[QUEUE_MAX]; /* oldest first */
    unsigned queue_count;
    unsigned waiting[SRV_WORKERS]; /* tasks in the queue, without session frames slow to encode */
    bool stop, is_maintenance_due;
};

static bool is_slow(const struct srv_encode_task *task) {
    return task->job && task->job->is_slow_to_encode;
}

/* Encodes the next stripe of the image. Takes and returns with the mutex held, and releases it
 * meanwhile. False if all stripes are taken. */
static bool encode_next_stripe(struct srv_encode_pool *pool, struct striped_image *image,
                               struct sp_encoder *encoder) {
    if (image->taken == image->count)
        return false;
    unsigned i = image->taken++;
    pthread_mutex_unlock(&pool->mutex);
    image->encode_stripe(image->user, i, encoder);
    pthread_mutex_lock(&pool->mutex);
    if (++image->finished == image->count)
        pthread_cond_broadcast(&pool->finished);
    return true;
}

/* The encoder's sp_share_fn: encodes all stripes, with the help of threads that are idle. */
static void share_stripes(void *user, struct sp_encoder *encoder, unsigned count,
                          sp_stripe_fn *encode_stripe, void *stripe_user) {
    struct encode_thread *thread = user;
    struct srv_encode_pool *pool = thread->pool;
    struct striped_image *image = &thread->image;
    pthread_mutex_lock(&pool->mutex);
    *image = (struct striped_image){ .count = count,
                                     .encode_stripe = encode_stripe,
                                     .user = stripe_user };
    pthread_cond_broadcast(&pool->changed);
    while (encode_next_stripe(pool, image, encoder))
        ;
    while (image->finished < count)
        pthread_cond_wait(&pool->finished, &pool->mutex);
    pthread_mutex_unlock(&pool->mutex);
}

/* Encodes a stripe for another thread; false if none wants help. Locking as
 * encode_next_stripe(). */
static bool help(struct encode_thread *thread) {
    struct srv_encode_pool *pool = thread->pool;
    for (unsigned i = 0; i < pool->thread_count; i++) {
        struct encode_thread *other = &pool->threads[i];
        bool would_delay = thread->is_background && !other->is_background;
        if (would_delay || (thread->is_reserved && other->has_snapshot))
            continue;
        if (encode_next_stripe(pool, &other->image, thread->encoder))
            return true;
    }
    return false;
}

static bool may_run(const struct encode_thread *thread, const struct srv_encode_task *task) {
    bool is_for_background = task->snapshot || (is_slow(task) && !task->job->is_alone);
    return thread->is_background == is_for_background;
}

/* True if a thread encodes another frame of the task's session. */
static bool has_thread(const struct srv_encode_pool *pool, const struct srv_encode_task *task) {
    for (unsigned t = 0; task->job && t < pool->thread_count; t++)
        if (pool->threads[t].session == task->job->session)
            return true;
    return false;
}

static bool has_video(const struct srv_encode_task *task) {
    for (uint32_t i = 0; task->job && i < task->job->target_count; i++)
        if (task->job->targets[i].video != SP_VIDEO_CODEC_COUNT)
            return true;
    return false;
}

/* Returns the index of the task to take next, or queue_count if there is none: the oldest one of a
 * session that has no thread, else the oldest one without video. A second video frame of a session
 * would only wait for the encoder of the first. */
static unsigned find_task(const struct encode_thread *thread) {
    const struct srv_encode_pool *pool = thread->pool;
    unsigned found = pool->queue_count;
    for (unsigned i = 0; i < pool->queue_count; i++) {
        const struct srv_encode_task *task = &pool->queue[i];
        if (!may_run(thread, task))
            continue;
        if (!has_thread(pool, task))
            return i;
        if (found == pool->queue_count && !has_video(task))
            found = i;
    }
    return found;
}

/* With the mutex held; false if there is nothing to take. */
static bool pop_task(struct encode_thread *thread, struct srv_encode_task *task) {
    struct srv_encode_pool *pool = thread->pool;
    unsigned found = find_task(thread);
    if (found == pool->queue_count)
        return false;
    *task = pool->queue[found];
    pool->queue_count--;
    memmove(pool->queue + found, pool->queue + found + 1,
            (pool->queue_count - found) * sizeof *task);
    pool->waiting[task->worker] -= !is_slow(task);
    thread->has_snapshot = task->snapshot;
    thread->session = task->job ? task->job->session : 0;
    pool->options.on_dequeued(pool->options.user, task->worker);
    return true;
}

/* Takes and returns with the mutex held. */
static void run_task(struct encode_thread *thread, const struct srv_encode_task *task) {
    struct srv_encode_pool *pool = thread->pool;
    struct sp_frame *frame = task->frame;
    pthread_mutex_unlock(&pool->mutex);
    pool->options.run(pool->options.user, thread->encoder, task);
    sp_frame_unref(&frame);
    pthread_mutex_lock(&pool->mutex);
    thread->session = 0;
    if (pool->queue_count > 0) /* other threads may now take frames of this session */
        pthread_cond_broadcast(&pool->changed);
}

/* Takes and returns with the mutex held. */
static void maintain(struct srv_encode_pool *pool) {
    pool->is_maintenance_due = false;
    pthread_mutex_unlock(&pool->mutex);
    pool->options.maintain(pool->options.user);
    pthread_mutex_lock(&pool->mutex);
}

/* Keeps no memory of large images meanwhile. With the mutex held. */
static void wait_for_work(struct encode_thread *thread) {
    sp_encoder_trim(thread->encoder);
    pthread_cond_wait(&thread->pool->changed, &thread->pool->mutex);
}

static void *encode_main(void *user) {
    struct encode_thread *thread = user;
    struct srv_encode_pool *pool = thread->pool;
    struct srv_encode_task task;
    if (thread->is_background)
        srv_background_thread_enter("an encode thread", SRV_NICE_BACKGROUND);
    pthread_mutex_lock(&pool->mutex);
    for (;;) {
        if (pop_task(thread, &task))
            run_task(thread, &task);
        else if (help(thread))
            continue;
        else if (pool->stop)
            break;
        else if (pool->is_maintenance_due)
            maintain(pool);
        else
            wait_for_work(thread);
    }
    pthread_mutex_unlock(&pool->mutex);
    return NULL;
}

void srv_encode_pool_submit(struct srv_encode_pool *pool, const struct srv_encode_task *task) {
    pthread_mutex_lock(&pool->mutex);
    pool->waiting[task->worker] += !is_slow(task);
    assert(pool->queue_count < QUEUE_MAX);
    pool->queue[pool->queue_count++] = *task;
    pthread_cond_broadcast(&pool->changed); /* to all: not every thread may take it */
    pthread_mutex_unlock(&pool->mutex);
}

bool srv_encode_pool_has_capacity(struct srv_encode_pool *pool, enum srv_worker_kind worker) {
    pthread_mutex_lock(&pool->mutex);
    bool has_capacity = pool->waiting[worker] < WAITING_MAX;
    pthread_mutex_unlock(&pool->mutex);
    return has_capacity;
}

unsigned srv_encode_pool_background_threads(const struct srv_encode_pool *pool) {
    return pool->thread_count - pool->options.threads;
}

void srv_encode_pool_request_maintenance(struct srv_encode_pool *pool) {
    pthread_mutex_lock(&pool->mutex);
    pool->is_maintenance_due = true;
    pthread_cond_broadcast(&pool->changed);
    pthread_mutex_unlock(&pool->mutex);
}

struct srv_encode_pool *srv_encode_pool_create(const struct srv_encode_pool_options *options,
                                               struct sp_error *err) {
    const unsigned foreground = options->threads;
    assert(foreground >= 1 && foreground <= SRV_ENCODE_THREADS_MAX);
    struct srv_encode_pool *pool = calloc(1, sizeof *pool);
    if (!pool) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for the encode threads");
        return NULL;
    }
    pool->options = *options;
    pthread_mutex_init(&pool->mutex, NULL);
    pthread_cond_init(&pool->changed, NULL);
    pthread_cond_init(&pool->finished, NULL);
    pool->thread_count = foreground > 1 ? 2 * foreground - 1 : 2;
    for (unsigned i = 0; i < pool->thread_count; i++) {
        struct encode_thread *thread = &pool->threads[i];
        thread->pool = pool;
        thread->is_background = i >= foreground;
        thread->is_reserved = i == 0 && foreground > 1;
        thread->encoder = sp_encoder_create(err);
        if (!thread->encoder) {
            srv_encode_pool_destroy(&pool);
            return NULL;
        }
        if (foreground > 1)
            sp_encoder_set_share(thread->encoder, share_stripes, thread);
    }
    return pool;
}

bool srv_encode_pool_start(struct srv_encode_pool *pool, struct sp_error *err) {
    for (unsigned i = 0; i < pool->thread_count; i++) {
        struct encode_thread *thread = &pool->threads[i];
        int failed = pthread_create(&thread->thread, NULL, encode_main, thread);
        if (failed)
            return sp_fail(err, SP_ERR_IO, NULL, "cannot start an encode thread: %s",
                           strerror(failed));
        thread->is_running = true;
    }
    return true;
}

void srv_encode_pool_stop(struct srv_encode_pool *pool) {
    pthread_mutex_lock(&pool->mutex);
    pool->stop = true;
    pthread_cond_broadcast(&pool->changed);
    pthread_mutex_unlock(&pool->mutex);
    for (unsigned i = 0; i < pool->thread_count; i++) {
        struct encode_thread *thread = &pool->threads[i];
        if (thread->is_running)
            pthread_join(thread->thread, NULL);
        thread->is_running = false;
    }
}

void srv_encode_pool_destroy(struct srv_encode_pool **pool_pointer) {
    struct srv_encode_pool *pool = *pool_pointer;
    *pool_pointer = NULL;
    if (!pool)
        return;
    for (unsigned i = 0; i < pool->thread_count; i++)
        sp_encoder_destroy(&pool->threads[i].encoder);
    pthread_cond_destroy(&pool->finished);
    pthread_cond_destroy(&pool->changed);
    pthread_mutex_destroy(&pool->mutex);
    free(pool);
}
