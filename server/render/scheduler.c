/* SPDX-License-Identifier: Apache-2.0 */
#include "render/scheduler.h"

#include <assert.h>
#include <errno.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "sp/log.h"

enum { ENCODE_QUEUE = 2, ENCODE_THREADS_MAX = 8, STREAM_RUN = 4 };
#define POOL_IDLE_BYTES ((size_t)128 << 20)

struct still_item {
    struct still_item *next;
    struct srv_still still;
};
struct forget_item {
    struct forget_item *next;
    struct sp_volume *volume;
};
struct work { /* a rendered frame on its way to an encoder: of a job or of a still */
    struct sp_frame *frame;
    struct srv_job *job;
    struct still_item *still;
};

struct srv_scheduler {
    struct srv_scheduler_options options;
    struct sp_renderer *renderer; /* the render thread's */
    struct sp_frame_pool *pool;
    struct srv_hub *hub;
    pthread_mutex_t mutex;
    pthread_cond_t wake;   /* the render thread: `generation`, stills, room, stop */
    pthread_cond_t encode; /* the encode threads: work, stop */
    uint64_t generation;
    struct still_item *still_head, **still_tail;
    unsigned still_waiting;    /* in the list */
    unsigned still_unanswered; /* in the list, being rendered or encoded */
    struct forget_item *forget;
    struct work encode_queue[ENCODE_QUEUE];
    unsigned encode_count;
    uint64_t refining; /* session whose refinement is being rendered; 0 = none */
    atomic_bool cancel;
    bool stop, encode_stop;
    bool running;
    pthread_t render_thread, encode_threads[ENCODE_THREADS_MAX];
    unsigned encode_thread_count;
    struct sp_encoder *encoders[ENCODE_THREADS_MAX];
};

struct srv_scheduler *srv_scheduler_create(const struct srv_scheduler_options *options,
                                           struct sp_renderer **renderer, struct sp_error *err) {
    struct srv_scheduler *s = calloc(1, sizeof *s);
    if (!s) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "no memory for the scheduler");
        return NULL;
    }
    assert(options->encode_threads >= 1 && options->encode_threads <= ENCODE_THREADS_MAX);
    s->options = *options;
    s->still_tail = &s->still_head;
    atomic_init(&s->cancel, false);
    pthread_mutex_init(&s->mutex, NULL);
    pthread_condattr_t monotonic;
    pthread_condattr_init(&monotonic);
    pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC);
    pthread_cond_init(&s->wake, &monotonic);
    pthread_cond_init(&s->encode, NULL);
    pthread_condattr_destroy(&monotonic);
    bool ok = (s->pool = sp_frame_pool_create(POOL_IDLE_BYTES, err)) != NULL;
    for (unsigned i = 0; ok && i < options->encode_threads; i++)
        ok = (s->encoders[i] = sp_encoder_create(err)) != NULL;
    if (!ok) {
        srv_scheduler_destroy(&s);
        return NULL;
    }
    s->renderer = *renderer;
    *renderer = NULL;
    return s;
}

/* Answers. */

static void still_answer(struct srv_scheduler *s, struct still_item *item,
                         const struct srv_still_result *result) {
    item->still.done(item->still.user, result);
    srv_catalog_release(s->options.catalog, item->still.volume);
    free(item);
    pthread_mutex_lock(&s->mutex);
    s->still_unanswered--;
    pthread_mutex_unlock(&s->mutex);
}

static void still_fail(struct srv_scheduler *s, struct still_item *item,
                       const struct sp_error *err) {
    struct srv_still_result result = { .ok = false, .err = *err };
    still_answer(s, item, &result);
}

static void job_fail(struct srv_scheduler *s, struct srv_job *job, const struct sp_error *err) {
    if (err->code == SP_ERR_CANCELLED) {
        srv_hub_job_cancelled(s->hub, job);
    } else {
        sp_log(SP_LOG_ERROR, "rendering a session's view failed: %s%s%s", err->place,
               err->place[0] ? ": " : "", err->text);
        srv_hub_job_failed(s->hub, job, err);
    }
    free(job);
}

/* The encode threads. */

static void encode_still(struct srv_scheduler *s, struct sp_encoder *encoder, struct work *work) {
    struct srv_still_result result = { .stats = work->frame->stats };
    const struct srv_still *still = &work->still->still;
    double start_ms = srv_clock_ms();
    result.ok = sp_encode(encoder, work->frame, still->format, still->quality, &result.bytes,
                          &result.size, &result.err);
    result.encode_ms = srv_clock_ms() - start_ms;
    still_answer(s, work->still, &result);
}

static uint8_t codec_of(enum sp_image_format format) {
    return format == SP_IMAGE_PNG    ? PROTO_CODEC_PNG
           : format == SP_IMAGE_WEBP ? PROTO_CODEC_WEBP
                                     : PROTO_CODEC_JPEG;
}

/* Encodes once for all targets with the format and quality of target `first`. */
static bool encode_group(struct srv_scheduler *s, struct sp_encoder *encoder, struct work *work,
                         uint32_t first, double *encode_ms, struct sp_error *err) {
    struct srv_job *job = work->job;
    const struct srv_target *like = &job->targets[first];
    const uint8_t *bytes;
    size_t size;
    double start_ms = srv_clock_ms();
    if (!sp_encode(encoder, work->frame, like->format, like->quality, &bytes, &size, err))
        return false;
    double took_ms = srv_clock_ms() - start_ms;
    *encode_ms += took_ms;
    struct srv_blob *blob = srv_blob_create(bytes, size);
    if (!blob)
        return sp_fail(err, SP_ERR_MEMORY, NULL, "no memory for an encoded frame of %zu bytes",
                       size);
    struct proto_frame_header header = {
        .codec = codec_of(like->format),
        .flags = like->format == SP_IMAGE_PNG ? PROTO_FRAME_LOSSLESS : 0,
        .width = (uint16_t)work->frame->width,
        .height = (uint16_t)work->frame->height,
        .render_us = (uint32_t)(work->frame->stats.render_ms * 1000),
        .encode_us = (uint32_t)(took_ms * 1000),
    };
    for (uint32_t i = first; i < job->target_count; i++)
        if (job->targets[i].format == like->format && job->targets[i].quality == like->quality)
            srv_hub_deliver(s->hub, job, i, &header, blob);
    srv_blob_unref(&blob);
    return true;
}

/* Classification is kept until the volume or the transfer function changes. */
static double once_ms(const struct sp_frame_stats *stats) {
    for (uint32_t i = 0; i < stats->stage_count; i++)
        if (strcmp(stats->stages[i].name, "classify") == 0)
            return stats->stages[i].ms;
    return 0;
}

static void encode_job(struct srv_scheduler *s, struct sp_encoder *encoder, struct work *work) {
    struct srv_job *job = work->job;
    struct srv_job_result result = { .width = work->frame->width,
                                     .height = work->frame->height,
                                     .coarse = work->frame->stats.coarse,
                                     .render_ms = work->frame->stats.render_ms,
                                     .once_ms = once_ms(&work->frame->stats),
                                     .splats = work->frame->stats.splats,
                                     .visible_voxels = work->frame->stats.visible_voxels };
    struct sp_error err = { .code = SP_OK };
    bool ok = true;
    for (uint32_t i = 0; ok && i < job->target_count; i++) {
        bool done = false;
        for (uint32_t j = 0; j < i && !done; j++)
            done = job->targets[j].format == job->targets[i].format &&
                   job->targets[j].quality == job->targets[i].quality;
        if (!done)
            ok = encode_group(s, encoder, work, i, &result.encode_ms, &err);
    }
    if (!ok) {
        job_fail(s, job, &err);
        return;
    }
    sp_log(SP_LOG_DEBUG, "frame %ux%u%s for %u clients: rendered %.1f ms, encoded %.1f ms",
           result.width, result.height, job->final ? " final" : "", job->target_count,
           result.render_ms, result.encode_ms);
    srv_hub_job_done(s->hub, job, &result);
    free(job);
}

struct encode_start {
    struct srv_scheduler *scheduler;
    struct sp_encoder *encoder;
};

static void *encode_main(void *user) {
    struct encode_start start = *(struct encode_start *)user;
    free(user);
    struct srv_scheduler *s = start.scheduler;
    pthread_mutex_lock(&s->mutex);
    for (;;) {
        if (s->encode_count == 0) {
            if (s->encode_stop)
                break;
            pthread_cond_wait(&s->encode, &s->mutex);
            continue;
        }
        struct work work = s->encode_queue[0];
        memmove(s->encode_queue, s->encode_queue + 1, --s->encode_count * sizeof work);
        s->generation++; /* there is room */
        pthread_cond_signal(&s->wake);
        pthread_mutex_unlock(&s->mutex);
        if (work.job)
            encode_job(s, start.encoder, &work);
        else
            encode_still(s, start.encoder, &work);
        sp_frame_unref(&work.frame);
        pthread_mutex_lock(&s->mutex);
    }
    pthread_mutex_unlock(&s->mutex);
    return NULL;
}

/* The render thread. */

static void pass_on(struct srv_scheduler *s, struct work work) {
    pthread_mutex_lock(&s->mutex);
    assert(s->encode_count < ENCODE_QUEUE);
    s->encode_queue[s->encode_count++] = work;
    pthread_cond_signal(&s->encode);
    pthread_mutex_unlock(&s->mutex);
}

static struct sp_frame *render(struct srv_scheduler *s, struct srv_volume *volume,
                               const struct sp_view *view, enum sp_pixel_format format,
                               unsigned coarse, struct sp_error *err) {
    struct sp_render_options options = { .format = format, .coarse = coarse, .cancel = &s->cancel };
    struct sp_frame *frame =
        sp_renderer_render(s->renderer, srv_volume_voxels(volume), view, s->pool, &options, err);
    srv_catalog_set_derived(s->options.catalog, volume,
                            sp_renderer_memory(s->renderer, srv_volume_voxels(volume)));
    return frame;
}

/* False: stopping. From now on srv_scheduler_interrupt() reaches this render. */
static bool begin_render(struct srv_scheduler *s, const struct srv_job *job) {
    pthread_mutex_lock(&s->mutex);
    bool go_on = !s->stop;
    if (go_on)
        atomic_store(&s->cancel, false);
    s->refining = job && job->refinement ? job->session : 0;
    pthread_mutex_unlock(&s->mutex);
    return go_on;
}

static void render_job(struct srv_scheduler *s, struct srv_job *job) {
    struct sp_error err = { .code = SP_OK };
    struct sp_frame *frame = NULL;
    /* The view may have changed before the interruption could reach us. */
    if (!begin_render(s, job) || (job->refinement && !srv_hub_is_newest(s->hub, job)))
        sp_fail(&err, SP_ERR_CANCELLED, NULL, "a newer view exists");
    else
        frame = render(s, job->volume, &job->view, SP_RGBA8, job->coarse, &err);
    if (frame)
        pass_on(s, (struct work){ .frame = frame, .job = job });
    else
        job_fail(s, job, &err);
}

static void render_still(struct srv_scheduler *s, struct still_item *item) {
    struct sp_error err = { .code = SP_OK };
    struct sp_frame *frame = NULL;
    enum sp_pixel_format format =
        sp_image_format_info(item->still.format)->wants_float ? SP_RGBAF32 : SP_RGBA8;
    if (!begin_render(s, NULL))
        sp_fail(&err, SP_ERR_CANCELLED, NULL, "the daemon is shutting down");
    else
        frame = render(s, item->still.volume, &item->still.view, format, 0, &err);
    if (frame)
        pass_on(s, (struct work){ .frame = frame, .still = item });
    else
        still_fail(s, item, &err);
}

static struct still_item *pop_still(struct srv_scheduler *s) {
    pthread_mutex_lock(&s->mutex);
    struct still_item *item = s->still_head;
    if (item) {
        s->still_head = item->next;
        if (!s->still_head)
            s->still_tail = &s->still_head;
        s->still_waiting--;
    }
    pthread_mutex_unlock(&s->mutex);
    return item;
}

static void forget(struct srv_scheduler *s, struct forget_item *list) {
    while (list) {
        struct forget_item *next = list->next;
        sp_renderer_forget(s->renderer, list->volume);
        sp_volume_unref(&list->volume);
        free(list);
        list = next;
    }
}

struct turn { /* what the render thread found at the start of a round */
    uint64_t generation;
    bool stop, still, room;
    struct forget_item *forget;
};

static struct turn look(struct srv_scheduler *s) {
    pthread_mutex_lock(&s->mutex);
    struct turn turn = { .generation = s->generation,
                         .stop = s->stop,
                         .still = s->still_head != NULL,
                         .room = s->encode_count < ENCODE_QUEUE,
                         .forget = s->forget };
    s->forget = NULL;
    pthread_mutex_unlock(&s->mutex);
    return turn;
}

static void wait_for_work(struct srv_scheduler *s, uint64_t generation, double wait_ms) {
    struct timespec until;
    clock_gettime(CLOCK_MONOTONIC, &until);
    long long ns = until.tv_nsec + (long long)(wait_ms * 1e6) + 1;
    until.tv_sec += ns / 1000000000;
    until.tv_nsec = ns % 1000000000;
    pthread_mutex_lock(&s->mutex);
    while (s->generation == generation && !s->stop)
        if (pthread_cond_timedwait(&s->wake, &s->mutex, &until) == ETIMEDOUT)
            break;
    pthread_mutex_unlock(&s->mutex);
}

static void *render_main(void *user) {
    struct srv_scheduler *s = user;
    struct srv_job *job = NULL;
    unsigned run = 0; /* frames of streams since the last still */
    for (;;) {
        struct turn turn = look(s);
        forget(s, turn.forget);
        if (turn.stop)
            break;
        double wait_ms = 1000;
        if (!job && !(job = malloc(sizeof *job)))
            sp_log(SP_LOG_ERROR, "no memory for a render job");
        bool streams = job && turn.room && !(turn.still && run >= STREAM_RUN);
        if (streams &&
            srv_hub_next_job(s->hub, !turn.still || run > 0, srv_clock_ms(), job, &wait_ms)) {
            render_job(s, job);
            job = NULL;
            run++;
        } else if (turn.room && turn.still) {
            render_still(s, pop_still(s));
            run = 0;
        } else {
            wait_for_work(s, turn.generation, turn.room ? wait_ms : 1000);
        }
    }
    free(job);
    return NULL;
}

/* Start, stop, and what other threads call. */

bool srv_scheduler_start(struct srv_scheduler *s, struct srv_hub *hub, struct sp_error *err) {
    s->hub = hub;
    for (unsigned i = 0; i < s->options.encode_threads; i++) {
        struct encode_start *start = malloc(sizeof *start);
        if (!start)
            return sp_fail(err, SP_ERR_MEMORY, NULL, "no memory to start an encode thread");
        *start = (struct encode_start){ .scheduler = s, .encoder = s->encoders[i] };
        int failed = pthread_create(&s->encode_threads[i], NULL, encode_main, start);
        if (failed) {
            free(start);
            return sp_fail(err, SP_ERR_IO, NULL, "cannot start an encode thread: %s",
                           strerror(failed));
        }
        s->encode_thread_count++;
    }
    int failed = pthread_create(&s->render_thread, NULL, render_main, s);
    if (failed)
        return sp_fail(err, SP_ERR_IO, NULL, "cannot start the render thread: %s",
                       strerror(failed));
    s->running = true;
    return true;
}

void srv_scheduler_stop(struct srv_scheduler *s) {
    pthread_mutex_lock(&s->mutex);
    s->stop = true;
    atomic_store(&s->cancel, true);
    pthread_cond_broadcast(&s->wake);
    pthread_mutex_unlock(&s->mutex);
    if (s->running)
        pthread_join(s->render_thread, NULL);
    s->running = false;
    struct sp_error err;
    sp_fail(&err, SP_ERR_CANCELLED, NULL, "the daemon is shutting down");
    for (struct still_item *item; (item = pop_still(s));)
        still_fail(s, item, &err);
    pthread_mutex_lock(&s->mutex);
    s->encode_stop = true;
    pthread_cond_broadcast(&s->encode);
    pthread_mutex_unlock(&s->mutex);
    while (s->encode_thread_count > 0)
        pthread_join(s->encode_threads[--s->encode_thread_count], NULL);
}

void srv_scheduler_destroy(struct srv_scheduler **scheduler) {
    struct srv_scheduler *s = *scheduler;
    *scheduler = NULL;
    if (!s)
        return;
    srv_scheduler_stop(s);
    forget(s, s->forget);
    for (unsigned i = 0; i < s->options.encode_threads; i++)
        sp_encoder_destroy(&s->encoders[i]);
    sp_renderer_destroy(&s->renderer);
    sp_frame_pool_destroy(&s->pool);
    pthread_cond_destroy(&s->encode);
    pthread_cond_destroy(&s->wake);
    pthread_mutex_destroy(&s->mutex);
    free(s);
}

bool srv_scheduler_submit(struct srv_scheduler *s, const struct srv_still *still,
                          struct sp_error *err) {
    struct still_item *item = malloc(sizeof *item);
    bool ok = item || sp_fail(err, SP_ERR_MEMORY, NULL, "no memory for a render request");
    pthread_mutex_lock(&s->mutex);
    if (ok && s->stop)
        ok = sp_fail(err, SP_ERR_CANCELLED, NULL, "the daemon is shutting down");
    if (ok && s->still_waiting >= s->options.queue_max)
        ok = sp_fail(err, SP_ERR_BUDGET, NULL,
                     "%u renders wait already and --render-queue allows %u; try again later",
                     s->still_waiting, s->options.queue_max);
    if (ok) {
        *item = (struct still_item){ .still = *still };
        *s->still_tail = item;
        s->still_tail = &item->next;
        s->still_waiting++;
        s->still_unanswered++;
        s->generation++;
        pthread_cond_signal(&s->wake);
    }
    pthread_mutex_unlock(&s->mutex);
    if (!ok) {
        srv_catalog_release(s->options.catalog, still->volume);
        free(item);
    }
    return ok;
}

unsigned srv_scheduler_waiting(struct srv_scheduler *s) {
    pthread_mutex_lock(&s->mutex);
    unsigned waiting = s->still_unanswered;
    pthread_mutex_unlock(&s->mutex);
    return waiting;
}

void srv_scheduler_wake(void *user) {
    struct srv_scheduler *s = user;
    pthread_mutex_lock(&s->mutex);
    s->generation++;
    pthread_cond_signal(&s->wake);
    pthread_mutex_unlock(&s->mutex);
}

void srv_scheduler_interrupt(void *user, uint64_t session) {
    struct srv_scheduler *s = user;
    pthread_mutex_lock(&s->mutex);
    if (s->refining == session)
        atomic_store(&s->cancel, true);
    pthread_mutex_unlock(&s->mutex);
}

void srv_scheduler_forget(void *user, struct sp_volume *volume) {
    struct srv_scheduler *s = user;
    struct forget_item *item = malloc(sizeof *item);
    if (!item) { /* what was derived stays until the end; the voxels go */
        sp_log(SP_LOG_ERROR, "no memory to tell the renderer that a volume is gone");
        sp_volume_unref(&volume);
        return;
    }
    item->volume = volume;
    pthread_mutex_lock(&s->mutex);
    item->next = s->forget;
    s->forget = item;
    s->generation++;
    pthread_cond_signal(&s->wake);
    pthread_mutex_unlock(&s->mutex);
}

bool srv_scheduler_supports(void *user, const struct sp_view *view, struct sp_error *err) {
    struct srv_scheduler *s = user;
    return sp_renderer_supports(s->renderer, view, err);
}
