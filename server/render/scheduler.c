/* SPDX-License-Identifier: Apache-2.0 */
#include "render/scheduler.h"

#include <assert.h>
#include <errno.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#include "clock.h"
#include "render/flights.h"
#include "render/video.h"
#include "sp/log.h"

enum {
    LANE_ENCODES = 2, /* no further job is begun while so many frames wait */
    ENCODE_QUEUE =
        2 * LANE_ENCODES + SP_IN_FLIGHT_MAX /* those that were begun by then come, too */,
    ENCODE_THREADS_MAX = 8,
    STILL_NICE = 10
};
#define POOL_IDLE_BYTES ((size_t)128 << 20)
#define KEPT_BYTES_MAX ((size_t)64 << 20)

struct still_item {
    struct still_item *next;
    struct srv_still still;
    double queued_ms; /* since when it waits */
};
struct forget_item {
    struct forget_item *next;
    struct sp_volume *volume;
};
struct work { /* a rendered frame on its way to an encoder: of a job or of a still */
    struct sp_frame *frame;
    struct srv_job *job;
    struct still_item *still;
    bool again; /* the frame is an earlier job's */
};

enum lane_name { STREAMS, STILLS, LANES };

struct lane {
    struct sp_renderer *renderer; /* its thread's */
    struct sp_renderer_info info; /* of the renderer; its thread writes it with the mutex held */
    pthread_t thread;
    bool running;
    pthread_cond_t wake; /* `generation`, stop */
    uint64_t generation; /* rises with everything that its thread may have waited for */
    struct forget_item *forget;
    unsigned encodes; /* frames in the encode queue */
};

struct srv_scheduler {
    struct srv_scheduler_options options;
    struct lane lanes[LANES];
    struct sp_frame_pool *pool;
    struct srv_hub *hub;
    pthread_mutex_t mutex;
    pthread_cond_t encode; /* the encode threads: work, stop */
    struct still_item *still_head, **still_tail;
    struct still_item *still_now; /* being rendered */
    atomic_bool still_cancel;
    unsigned still_waiting;    /* in the list */
    unsigned still_unanswered; /* in the list, being rendered or encoded */
    struct work encode_queue[ENCODE_QUEUE];
    unsigned encode_count;
    struct srv_flights flights; /* the stream lane's jobs */
    struct {                    /* the stream lane's */
        struct sp_frame *frame;
        uint64_t session, version;
    } kept;
    bool stop, encode_stop;
    pthread_t encode_threads[ENCODE_THREADS_MAX];
    unsigned encode_thread_count;
    struct sp_encoder *encoders[ENCODE_THREADS_MAX];
    struct srv_videos *videos;
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
    pthread_mutex_init(&s->mutex, NULL);
    pthread_condattr_t monotonic;
    pthread_condattr_init(&monotonic);
    pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC);
    atomic_init(&s->still_cancel, false);
    for (int l = 0; l < LANES; l++)
        pthread_cond_init(&s->lanes[l].wake, &monotonic);
    pthread_cond_init(&s->encode, NULL);
    pthread_condattr_destroy(&monotonic);
    bool ok = (s->pool = sp_frame_pool_create(POOL_IDLE_BYTES, err)) != NULL &&
              (s->videos = srv_videos_create(options->metrics, err)) != NULL;
    for (unsigned i = 0; ok && i < options->encode_threads; i++)
        ok = (s->encoders[i] = sp_encoder_create(err)) != NULL;
    if (!ok) {
        srv_scheduler_destroy(&s);
        return NULL;
    }
    s->lanes[STREAMS].renderer = *renderer;
    sp_renderer_info(*renderer, &s->lanes[STREAMS].info);
    *renderer = NULL;
    return s;
}

/* With the mutex held. */
static void wake_lane(struct lane *lane) {
    lane->generation++;
    pthread_cond_signal(&lane->wake);
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
    srv_metrics_add(s->options.metrics,
                    err->code == SP_ERR_CANCELLED ? SRV_COUNT_DROP_LEFT : SRV_COUNT_DROP_FAILED, 1);
    struct srv_still_result result = { .ok = false, .err = *err };
    still_answer(s, item, &result);
}

static void fail_all(struct srv_scheduler *s, struct still_item *list, const char *why) {
    struct sp_error err;
    sp_fail(&err, SP_ERR_CANCELLED, NULL, "%s", why);
    while (list) {
        struct still_item *next = list->next;
        still_fail(s, list, &err);
        list = next;
    }
}

static bool is_gone(const struct still_item *item) {
    return item->still.is_gone && item->still.is_gone(item->still.user);
}

/* elapsed_ms: of rendering that was cancelled. */
static void job_fail(struct srv_scheduler *s, struct srv_job *job, const struct sp_error *err,
                     double elapsed_ms) {
    if (err->code == SP_ERR_CANCELLED) {
        sp_log(SP_LOG_DEBUG, "%s given up after %.1f ms: %s",
               job->refinement ? "refinement" : "moving frame", elapsed_ms, err->text);
        srv_hub_job_cancelled(s->hub, job, elapsed_ms);
    } else {
        sp_log(SP_LOG_ERROR, "rendering a session's view failed: %s%s%s", err->place,
               err->place[0] ? ": " : "", err->text);
        srv_hub_job_failed(s->hub, job, err);
    }
    free(job);
}

/* The encode threads. */

static double stage_ms(const struct sp_frame_stats *stats, const char *name) {
    for (uint32_t i = 0; i < stats->stage_count; i++)
        if (strcmp(stats->stages[i].name, name) == 0)
            return stats->stages[i].ms;
    return 0;
}

static void count_render(struct srv_scheduler *s, const struct sp_frame_stats *stats) {
    srv_metrics_time(s->options.metrics, SRV_TIME_RENDER, stats->render_ms);
    srv_metrics_time(s->options.metrics, SRV_TIME_READBACK,
                     stage_ms(stats, "resolve") + stage_ms(stats, "read"));
}

static void encode_still(struct srv_scheduler *s, struct sp_encoder *encoder, struct work *work) {
    struct srv_still_result result = { .stats = work->frame->stats };
    const struct srv_still *still = &work->still->still;
    double start_ms = srv_clock_ms();
    result.ok = sp_encode(encoder, work->frame, still->format, still->quality, &result.bytes,
                          &result.size, &result.err);
    result.encode_ms = srv_clock_ms() - start_ms;
    count_render(s, &work->frame->stats);
    srv_metrics_time(s->options.metrics, SRV_TIME_ENCODE, result.encode_ms);
    srv_metrics_add(s->options.metrics, result.ok ? SRV_COUNT_PICTURES : SRV_COUNT_DROP_FAILED, 1);
    still_answer(s, work->still, &result);
}

static uint8_t codec_of(enum sp_image_format format) {
    return format == SP_IMAGE_PNG    ? PROTO_CODEC_PNG
           : format == SP_IMAGE_WEBP ? PROTO_CODEC_WEBP
                                     : PROTO_CODEC_JPEG;
}

static bool is_like(const struct srv_target *a, const struct srv_target *b) {
    return a->format == b->format && a->quality == b->quality;
}

/* Encodes once for all targets of the set `stills` with the format and quality of the first. Takes
 * them out of the set. */
static bool encode_group(struct srv_scheduler *s, struct sp_encoder *encoder, struct work *work,
                         uint64_t *stills, double *encode_ms, struct sp_error *err) {
    uint32_t first = (uint32_t)__builtin_ctzll(*stills);
    struct srv_job *job = work->job;
    const struct srv_target *like = &job->targets[first];
    const uint8_t *bytes;
    size_t size;
    double start_ms = srv_clock_ms();
    if (!sp_encode(encoder, work->frame, like->format, like->quality, &bytes, &size, err))
        return false;
    double took_ms = srv_clock_ms() - start_ms;
    *encode_ms += took_ms;
    srv_metrics_time(s->options.metrics, SRV_TIME_ENCODE, took_ms);
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
        if (*stills >> i & 1 && is_like(&job->targets[i], like)) {
            srv_hub_deliver(s->hub, job, i, &header, blob);
            *stills &= ~(UINT64_C(1) << i);
        }
    srv_blob_unref(&blob);
    return true;
}

/* An encoder cannot be stopped: look before each. */
static bool still_wanted(struct srv_scheduler *s, const struct srv_job *job, struct sp_error *err) {
    return !job->refinement || srv_hub_is_newest(s->hub, job) ||
           sp_fail(err, SP_ERR_CANCELLED, NULL, "a newer view exists");
}

static void encode_job(struct srv_scheduler *s, struct sp_encoder *encoder, struct work *work) {
    static const char *const step_words[] = { "", " middle", " final" };
    struct srv_job *job = work->job;
    struct srv_job_result result = { .width = work->frame->width,
                                     .height = work->frame->height,
                                     .coarse = work->frame->stats.coarse,
                                     .render_ms = work->frame->stats.render_ms,
                                     /* Classification is kept until the volume or the transfer
                                        function changes. */
                                     .once_ms = stage_ms(&work->frame->stats, "classify"),
                                     .splats = work->frame->stats.splats,
                                     .visible_voxels = work->frame->stats.visible_voxels,
                                     .again = work->again };
    struct sp_error err = { .code = SP_OK };
    bool ok = still_wanted(s, job, &err);
    if (!work->again)
        count_render(s, &work->frame->stats);
    uint64_t stills =
        ok ? srv_videos_encode(s->videos, s->hub, job, work->frame, &result.encode_ms) : 0;
    while (ok && stills)
        ok = still_wanted(s, job, &err) &&
             encode_group(s, encoder, work, &stills, &result.encode_ms, &err);
    if (!ok) {
        job_fail(s, job, &err, 0);
        return;
    }
    sp_log(SP_LOG_DEBUG, "frame %ux%u%s for %u clients: rendered %.1f ms, encoded %.1f ms",
           result.width, result.height, step_words[job->step], job->target_count,
           result.again ? 0 : result.render_ms, result.encode_ms);
    srv_hub_job_done(s->hub, job, &result);
    free(job);
}

struct encode_start {
    struct srv_scheduler *scheduler;
    struct sp_encoder *encoder;
    bool stills; /* takes stills too */
};

/* Takes the oldest work that this thread may do. With the mutex held; false if there is none. */
static bool take_work(struct srv_scheduler *s, bool stills, struct work *work) {
    unsigned i = 0;
    while (i < s->encode_count && s->encode_queue[i].still && !stills)
        i++;
    if (i == s->encode_count)
        return false;
    *work = s->encode_queue[i];
    s->encode_count--;
    memmove(s->encode_queue + i, s->encode_queue + i + 1, (s->encode_count - i) * sizeof *work);
    struct lane *lane = &s->lanes[work->still ? STILLS : STREAMS];
    lane->encodes--; /* there is room */
    wake_lane(lane);
    return true;
}

static void *encode_main(void *user) {
    struct encode_start start = *(struct encode_start *)user;
    free(user);
    struct srv_scheduler *s = start.scheduler;
    pthread_mutex_lock(&s->mutex);
    for (;;) {
        struct work work;
        if (!take_work(s, start.stills, &work)) {
            if (s->encode_stop)
                break;
            pthread_cond_wait(&s->encode, &s->mutex);
            continue;
        }
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

/* The render threads. */

static void pass_on(struct srv_scheduler *s, struct work work) {
    pthread_mutex_lock(&s->mutex);
    s->lanes[work.still ? STILLS : STREAMS].encodes++;
    assert(s->encode_count < ENCODE_QUEUE);
    s->encode_queue[s->encode_count++] = work;
    pthread_cond_broadcast(&s->encode);
    pthread_mutex_unlock(&s->mutex);
}

/* After anything that may have changed the renderer's backend. */
static void note_backend(struct srv_scheduler *s, enum lane_name name) {
    struct lane *lane = &s->lanes[name];
    struct sp_renderer_info info;
    sp_renderer_info(lane->renderer, &info);
    bool is_another = !lane->info.backend || strcmp(info.backend, lane->info.backend) != 0;
    if (!is_another && strcmp(info.overburdened, lane->info.overburdened) == 0)
        return;
    pthread_mutex_lock(&s->mutex);
    lane->info = info;
    pthread_mutex_unlock(&s->mutex);
    if (is_another && name == STREAMS)
        srv_hub_set_backend(s->hub, info.backend, info.device);
}

/* After a frame of the volume was drawn, or not. */
static void note_frame(struct srv_scheduler *s, enum lane_name name, struct srv_volume *volume) {
    struct lane *lane = &s->lanes[name];
    srv_catalog_set_derived(s->options.catalog, volume, name,
                            sp_renderer_memory(lane->renderer, srv_volume_voxels(volume)));
    note_backend(s, name);
}

/* The kept picture, if it is the one that the job wants; the caller's reference. */
static struct sp_frame *reuse(struct srv_scheduler *s, const struct srv_job *job) {
    struct sp_frame *frame = s->kept.frame;
    bool same = frame && job->sharp && s->kept.session == job->session &&
                s->kept.version == job->version && frame->width == job->view.size[0] &&
                frame->height == job->view.size[1];
    return same ? sp_frame_ref(frame) : NULL;
}

static void keep(struct srv_scheduler *s, const struct srv_job *job, struct sp_frame *frame) {
    if (!job->sharp || frame->stride_bytes * frame->height > KEPT_BYTES_MAX)
        return;
    sp_frame_unref(&s->kept.frame);
    s->kept.frame = sp_frame_ref(frame);
    s->kept.session = job->session;
    s->kept.version = job->version;
}

/* Hands the job to the renderer. From now on srv_scheduler_interrupt() reaches it. */
static void begin_job(struct srv_scheduler *s, struct srv_job *job) {
    struct sp_error err = { .code = SP_OK };
    double start_ms = srv_clock_ms();
    pthread_mutex_lock(&s->mutex);
    struct srv_flight *flight = srv_flights_begin(&s->flights, job, start_ms);
    if (s->stop)
        srv_flights_cancel(&s->flights);
    pthread_mutex_unlock(&s->mutex);
    /* The view may have changed before the interruption could reach us. */
    if (!srv_hub_is_newest(s->hub, job))
        srv_scheduler_interrupt(s, job->session, SRV_NEWER_VIEW);
    if (job->refinement)
        sp_log(SP_LOG_DEBUG, "refinement %ux%u begins", job->view.size[0], job->view.size[1]);
    const struct sp_render_options options = { .format = SP_RGBA8,
                                               .coarse = job->coarse,
                                               .cancel = &flight->cancel };
    bool ok = sp_renderer_begin(s->lanes[STREAMS].renderer, srv_volume_voxels(job->volume),
                                &job->view, s->pool, &options, &err);
    flight->spent_ms = srv_clock_ms() - start_ms;
    if (ok)
        return;
    pthread_mutex_lock(&s->mutex);
    srv_flights_undo(&s->flights);
    pthread_mutex_unlock(&s->mutex);
    job_fail(s, job, &err, 0);
}

/* Waits for the oldest job that was begun. */
static void finish_job(struct srv_scheduler *s) {
    struct sp_error err = { .code = SP_OK };
    struct srv_flight *flight = srv_flights_oldest(&s->flights);
    struct srv_job *job = flight->job;
    double start_ms = srv_clock_ms();
    struct sp_frame *frame = sp_renderer_finish(s->lanes[STREAMS].renderer, &err);
    double now_ms = srv_clock_ms(), spent_ms = flight->spent_ms + now_ms - start_ms;
    pthread_mutex_lock(&s->mutex);
    srv_flights_end(&s->flights, now_ms);
    pthread_mutex_unlock(&s->mutex);
    note_frame(s, STREAMS, job->volume);
    if (frame) {
        keep(s, job, frame);
        pass_on(s, (struct work){ .frame = frame, .job = job });
    } else {
        job_fail(s, job, &err, spent_ms);
    }
}

static void finish_jobs(struct srv_scheduler *s) {
    while (s->flights.count > 0)
        finish_job(s);
}

/* Begins the job, unless its picture is there or on its way. */
static void take_job(struct srv_scheduler *s, struct srv_job *job) {
    if (srv_flights_has_sharp(&s->flights, job))
        finish_jobs(s);
    struct sp_frame *frame = reuse(s, job);
    if (frame)
        pass_on(s, (struct work){ .frame = frame, .job = job, .again = true });
    else
        begin_job(s, job);
}

/* The next still becomes still_now; NULL if there is none. With the mutex held. */
static struct still_item *take_still(struct srv_scheduler *s) {
    struct still_item *item = s->still_head;
    if (!item)
        return NULL;
    s->still_head = item->next;
    if (!s->still_head)
        s->still_tail = &s->still_head;
    s->still_waiting--;
    s->still_now = item;
    atomic_store(&s->still_cancel, s->stop);
    return item;
}

static void render_still(struct srv_scheduler *s, struct still_item *item) {
    struct lane *lane = &s->lanes[STILLS];
    struct sp_error err = { .code = SP_OK };
    struct sp_frame *frame = NULL;
    srv_metrics_time(s->options.metrics, SRV_TIME_QUEUE, srv_clock_ms() - item->queued_ms);
    enum sp_pixel_format format =
        sp_image_format_info(item->still.format)->wants_float ? SP_RGBAF32 : SP_RGBA8;
    if (!lane->renderer)
        lane->renderer = sp_renderer_create(&s->options.stills, &err);
    const struct sp_render_options options = { .format = format, .cancel = &s->still_cancel };
    if (lane->renderer) {
        frame = sp_renderer_render(lane->renderer, srv_volume_voxels(item->still.volume),
                                   &item->still.view, s->pool, &options, &err);
        note_frame(s, STILLS, item->still.volume);
    }
    pthread_mutex_lock(&s->mutex);
    s->still_now = NULL;
    pthread_mutex_unlock(&s->mutex);
    if (frame)
        pass_on(s, (struct work){ .frame = frame, .still = item });
    else
        still_fail(s, item, &err);
}

static void forget(struct lane *lane, struct forget_item *list) {
    while (list) {
        struct forget_item *next = list->next;
        if (lane->renderer)
            sp_renderer_forget(lane->renderer, list->volume);
        sp_volume_unref(&list->volume);
        free(list);
        list = next;
    }
}

struct turn { /* what a lane's thread found at the start of a round */
    uint64_t generation;
    bool stop, room;
    struct forget_item *forget;
    struct still_item *still; /* still lane, if there is room */
};

static struct turn look(struct srv_scheduler *s, enum lane_name name) {
    struct lane *lane = &s->lanes[name];
    pthread_mutex_lock(&s->mutex);
    struct turn turn = { .generation = lane->generation,
                         .stop = s->stop,
                         .room = lane->encodes < LANE_ENCODES,
                         .forget = lane->forget };
    lane->forget = NULL;
    if (name == STILLS && turn.room && !turn.stop)
        turn.still = take_still(s);
    pthread_mutex_unlock(&s->mutex);
    return turn;
}

static void wait_for_work(struct srv_scheduler *s, struct lane *lane, uint64_t generation,
                          double wait_ms) {
    struct timespec until;
    clock_gettime(CLOCK_MONOTONIC, &until);
    long long ns = until.tv_nsec + (long long)(wait_ms * 1e6) + 1;
    until.tv_sec += ns / 1000000000;
    until.tv_nsec = ns % 1000000000;
    pthread_mutex_lock(&s->mutex);
    while (lane->generation == generation && !s->stop)
        if (pthread_cond_timedwait(&lane->wake, &s->mutex, &until) == ETIMEDOUT)
            break;
    pthread_mutex_unlock(&s->mutex);
}

/* Keeps as many jobs begun as the renderer takes: the next one is prepared while the GPU draws the
 * one before. */
static void *stream_main(void *user) {
    struct srv_scheduler *s = user;
    struct lane *lane = &s->lanes[STREAMS];
    struct srv_job *job = NULL;
    for (;;) {
        struct turn turn = look(s, STREAMS);
        if (turn.forget)
            sp_frame_unref(&s->kept.frame);
        forget(lane, turn.forget);
        if (turn.stop)
            break;
        double wait_ms = 1000;
        if (!job && !(job = malloc(sizeof *job)))
            sp_log(SP_LOG_ERROR, "no memory for a render job");
        bool takes = job && turn.room && s->flights.count < sp_renderer_depth(lane->renderer);
        if (takes && srv_hub_next_job(s->hub, srv_clock_ms(), job, &wait_ms)) {
            take_job(s, job);
            job = NULL;
        } else if (s->flights.count > 0) {
            finish_job(s);
        } else {
            wait_for_work(s, lane, turn.generation, turn.room ? wait_ms : 1000);
        }
    }
    finish_jobs(s);
    free(job);
    return NULL;
}

static void *still_main(void *user) {
    struct srv_scheduler *s = user;
    struct lane *lane = &s->lanes[STILLS];
    /* Of this thread alone, and of the renderer's threads, which it will start. */
    if (setpriority(PRIO_PROCESS, (id_t)gettid(), STILL_NICE) != 0)
        sp_log(SP_LOG_WARN, "the still lane cannot be nice: %s", strerror(errno));
    for (;;) {
        struct turn turn = look(s, STILLS);
        forget(lane, turn.forget);
        if (turn.stop)
            break;
        if (turn.still)
            render_still(s, turn.still);
        else
            wait_for_work(s, lane, turn.generation, 1000);
    }
    return NULL;
}

/* Start, stop, and what other threads call. */

bool srv_scheduler_start(struct srv_scheduler *s, struct srv_hub *hub, struct sp_error *err) {
    s->hub = hub;
    srv_hub_set_backend(hub, s->lanes[STREAMS].info.backend, s->lanes[STREAMS].info.device);
    for (unsigned i = 0; i < s->options.encode_threads; i++) {
        struct encode_start *start = malloc(sizeof *start);
        if (!start)
            return sp_fail(err, SP_ERR_MEMORY, NULL, "no memory to start an encode thread");
        *start = (struct encode_start){ .scheduler = s,
                                        .encoder = s->encoders[i],
                                        .stills = i > 0 || s->options.encode_threads == 1 };
        int failed = pthread_create(&s->encode_threads[i], NULL, encode_main, start);
        if (failed) {
            free(start);
            return sp_fail(err, SP_ERR_IO, NULL, "cannot start an encode thread: %s",
                           strerror(failed));
        }
        s->encode_thread_count++;
    }
    static void *(*const mains[LANES])(void *) = { stream_main, still_main };
    for (int l = 0; l < LANES; l++) {
        int failed = pthread_create(&s->lanes[l].thread, NULL, mains[l], s);
        if (failed)
            return sp_fail(err, SP_ERR_IO, NULL, "cannot start a render thread: %s",
                           strerror(failed));
        s->lanes[l].running = true;
    }
    return true;
}

void srv_scheduler_stop(struct srv_scheduler *s) {
    pthread_mutex_lock(&s->mutex);
    s->stop = true;
    srv_flights_cancel(&s->flights);
    atomic_store(&s->still_cancel, true);
    for (int l = 0; l < LANES; l++)
        wake_lane(&s->lanes[l]);
    pthread_mutex_unlock(&s->mutex);
    for (int l = 0; l < LANES; l++) {
        if (s->lanes[l].running)
            pthread_join(s->lanes[l].thread, NULL);
        s->lanes[l].running = false;
    }
    pthread_mutex_lock(&s->mutex);
    struct still_item *left = s->still_head;
    s->still_head = NULL;
    s->still_tail = &s->still_head;
    s->still_waiting = 0;
    pthread_mutex_unlock(&s->mutex);
    fail_all(s, left, "the daemon is shutting down");
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
    sp_frame_unref(&s->kept.frame);
    for (int l = 0; l < LANES; l++) {
        forget(&s->lanes[l], s->lanes[l].forget);
        sp_renderer_destroy(&s->lanes[l].renderer);
        pthread_cond_destroy(&s->lanes[l].wake);
    }
    for (unsigned i = 0; i < s->options.encode_threads; i++)
        sp_encoder_destroy(&s->encoders[i]);
    srv_videos_destroy(&s->videos);
    sp_frame_pool_destroy(&s->pool);
    pthread_cond_destroy(&s->encode);
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
        *item = (struct still_item){ .still = *still, .queued_ms = srv_clock_ms() };
        *s->still_tail = item;
        s->still_tail = &item->next;
        s->still_waiting++;
        s->still_unanswered++;
        wake_lane(&s->lanes[STILLS]);
    }
    pthread_mutex_unlock(&s->mutex);
    if (!ok) {
        srv_catalog_release(s->options.catalog, still->volume);
        free(item);
    }
    return ok;
}

void srv_scheduler_tick(struct srv_scheduler *s) {
    struct still_item *gone = NULL;
    pthread_mutex_lock(&s->mutex);
    for (struct still_item **at = &s->still_head; *at;) {
        struct still_item *item = *at;
        if (!is_gone(item)) {
            at = &item->next;
            continue;
        }
        *at = item->next;
        s->still_waiting--;
        item->next = gone;
        gone = item;
    }
    s->still_tail = &s->still_head;
    while (*s->still_tail)
        s->still_tail = &(*s->still_tail)->next;
    if (s->still_now && is_gone(s->still_now))
        atomic_store(&s->still_cancel, true);
    srv_flights_tick(&s->flights, srv_clock_ms());
    pthread_mutex_unlock(&s->mutex);
    fail_all(s, gone, "who asked for this picture has left");
    srv_videos_tick(s->videos, srv_clock_ms());
}

void srv_scheduler_info(struct srv_scheduler *s, struct sp_renderer_info *streams,
                        struct sp_renderer_info *stills) {
    pthread_mutex_lock(&s->mutex);
    *streams = s->lanes[STREAMS].info;
    *stills = s->lanes[STILLS].info;
    pthread_mutex_unlock(&s->mutex);
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
    wake_lane(&s->lanes[STREAMS]);
    pthread_mutex_unlock(&s->mutex);
}

void srv_scheduler_interrupt(void *user, uint64_t session, enum srv_interrupt why) {
    struct srv_scheduler *s = user;
    pthread_mutex_lock(&s->mutex);
    srv_flights_interrupt(&s->flights, session, why, srv_clock_ms());
    pthread_mutex_unlock(&s->mutex);
}

void srv_scheduler_forget(void *user, struct sp_volume *volume) {
    struct srv_scheduler *s = user;
    for (int l = 0; l < LANES; l++) {
        struct forget_item *item = malloc(sizeof *item);
        if (!item) { /* what was derived stays until the end */
            sp_log(SP_LOG_ERROR, "no memory to tell a renderer that a volume is gone");
            continue;
        }
        item->volume = sp_volume_ref(volume);
        pthread_mutex_lock(&s->mutex);
        item->next = s->lanes[l].forget;
        s->lanes[l].forget = item;
        wake_lane(&s->lanes[l]);
        pthread_mutex_unlock(&s->mutex);
    }
    sp_volume_unref(&volume);
}

bool srv_scheduler_supports(void *user, const struct sp_view *view, struct sp_error *err) {
    struct srv_scheduler *s = user;
    return sp_renderer_supports(s->lanes[STREAMS].renderer, view, err);
}
