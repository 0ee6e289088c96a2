/* SPDX-License-Identifier: Apache-2.0
 *
 * The encode threads: frames become pictures, for the outboxes of participants or the answers of
 * stills. A thread with nothing else to do lends a hand with the stripes of another's large JPEG,
 * which so is there sooner; when all have work of their own each does its own.
 *
 * Nothing stops an encoder. So that nobody's frame waits for long behind another's, what takes long
 * has threads of its own, which are nice: stills, and the dear frames of sessions
 * (SRV_SLOW_ENCODE_MS), if those are not for the only participant that there is. And a session has
 * one thread while another one's frame waits.
 */
#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "common/background.h"
#include "common/clock.h"
#include "render/render_pool_private.h"
#include "sp/log.h"

/* elapsed_ms: of rendering that was cancelled. */
void srv_job_fail(struct srv_render_pool *s, struct srv_render_job *job, const struct sp_error *err,
                  double elapsed_ms) {
    if (err->code == SP_ERR_CANCELLED) {
        sp_log(SP_LOG_DEBUG, "%s given up after %.1f ms: %s",
               job->is_refinement ? "refinement" : "moving frame", elapsed_ms, err->text);
        srv_schedule_cancelled(s->hub, job, elapsed_ms);
    } else {
        sp_log(SP_LOG_ERROR, "rendering a session's view failed: %s%s%s", err->place,
               err->place[0] ? ": " : "", err->text);
        srv_schedule_failed(s->hub, job, err);
    }
    free(job);
}

static double stage_ms(const struct sp_frame_stats *stats, const char *name) {
    for (uint32_t i = 0; i < stats->stage_count; i++)
        if (strcmp(stats->stages[i].name, name) == 0)
            return stats->stages[i].ms;
    return 0;
}

static void count_render(struct srv_render_pool *s, const struct sp_frame_stats *stats) {
    srv_metrics_time(s->options.metrics, SRV_TIME_RENDER, stats->render_ms);
    srv_metrics_time(s->options.metrics, SRV_TIME_READBACK,
                     stage_ms(stats, "resolve") + stage_ms(stats, "read"));
}

static void encode_still(struct srv_render_pool *s, struct sp_encoder *encoder,
                         struct srv_encode_task *work) {
    struct srv_snapshot_result result = { .stats = work->frame->stats };
    const struct srv_snapshot *still = &work->still->still;
    const struct srv_encode_params form =
        srv_encode_params_from(still->format, still->quality, still->chroma);
    double start_ms = srv_clock_ms();
    struct srv_blob *known = srv_frame_cache_bytes(s, work->frame, &form);
    if (known) {
        result.ok = true;
        result.bytes = known->bytes;
        result.size = known->size;
    } else {
        sp_encoder_set_chroma(encoder, form.chroma);
        result.ok = sp_encode(encoder, work->frame, form.format, form.quality, &result.bytes,
                              &result.size, &result.err);
    }
    result.encode_ms = srv_clock_ms() - start_ms;
    srv_snapshot_charge(s, work->still, result.encode_ms);
    if (!work->again)
        count_render(s, &work->frame->stats);
    if (!known)
        srv_metrics_time(s->options.metrics, SRV_TIME_ENCODE, result.encode_ms);
    srv_metrics_add(s->options.metrics, result.ok ? SRV_COUNT_SNAPSHOTS : SRV_COUNT_DROP_FAILED, 1);
    srv_snapshot_answer(s, work->still, &result);
    srv_blob_unref(&known);
}

static uint8_t codec_of(enum sp_image_format format) {
    return format == SP_IMAGE_PNG    ? PROTO_CODEC_PNG
           : format == SP_IMAGE_WEBP ? PROTO_CODEC_WEBP
                                     : PROTO_CODEC_JPEG;
}

static bool has_form(const struct srv_render_target *target, const struct srv_encode_params *form) {
    const struct srv_encode_params own =
        srv_encode_params_from(target->format, target->quality, target->chroma);
    return srv_encode_params_equal(&own, form);
}

static struct srv_blob *make_blob(struct sp_encoder *encoder, const struct sp_frame *frame,
                                  const struct srv_encode_params *form, struct sp_error *err) {
    const uint8_t *bytes;
    size_t size;
    sp_encoder_set_chroma(encoder, form->chroma);
    if (!sp_encode(encoder, frame, form->format, form->quality, &bytes, &size, err))
        return NULL;
    struct srv_blob *blob = srv_blob_create(bytes, size);
    if (!blob)
        sp_fail(err, SP_ERR_MEMORY, NULL, "no memory for an encoded frame of %zu bytes", size);
    return blob;
}

/* Encodes once for all targets of the set `stills` with the format and quality of the first, if
 * that has not been done for another session. Takes them out of the set. */
static bool encode_group(struct srv_render_pool *s, struct sp_encoder *encoder,
                         struct srv_encode_task *work, uint64_t *stills, double *encode_ms,
                         struct sp_error *err) {
    uint32_t first = (uint32_t)__builtin_ctzll(*stills);
    struct srv_render_job *job = work->job;
    const struct srv_render_target *like = &job->targets[first];
    const struct srv_encode_params form =
        srv_encode_params_from(like->format, like->quality, like->chroma);
    double start_ms = srv_clock_ms();
    struct srv_blob *blob = srv_frame_cache_bytes(s, work->frame, &form);
    const bool is_known = blob != NULL;
    if (!is_known) {
        blob = make_blob(encoder, work->frame, &form, err);
        if (!blob)
            return false;
        srv_frame_cache_set_bytes(s, work->frame, &form, blob);
    }
    double took_ms = srv_clock_ms() - start_ms;
    *encode_ms += took_ms;
    if (!is_known)
        srv_metrics_time(s->options.metrics, SRV_TIME_ENCODE, took_ms);
    struct proto_frame_header header = {
        .codec = codec_of(like->format),
        .flags = like->format == SP_IMAGE_PNG ? PROTO_FRAME_LOSSLESS : 0,
        .width = (uint16_t)work->frame->width,
        .height = (uint16_t)work->frame->height,
        .render_us = (uint32_t)(work->frame->stats.render_ms * 1000),
        .encode_us = (uint32_t)(took_ms * 1000),
    };
    for (uint32_t i = first; i < job->target_count; i++)
        if (*stills >> i & 1 && has_form(&job->targets[i], &form)) {
            srv_schedule_deliver(s->hub, job, i, &header, blob);
            *stills &= ~(UINT64_C(1) << i);
        }
    srv_blob_unref(&blob);
    return true;
}

/* An encoder cannot be stopped: look before each. */
static bool still_wanted(struct srv_render_pool *s, const struct srv_render_job *job,
                         struct sp_error *err) {
    return !job->is_refinement || srv_schedule_is_newest(s->hub, job) ||
           sp_fail(err, SP_ERR_CANCELLED, NULL, "a newer view exists");
}

static void encode_job(struct srv_render_pool *s, struct sp_encoder *encoder,
                       struct srv_encode_task *work) {
    static const char *const step_words[] = { "", " middle", " final" };
    struct srv_render_job *job = work->job;
    struct srv_render_result result = { .width = work->frame->width,
                                        .height = work->frame->height,
                                        .mip_level = work->frame->stats.mip_level,
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
        ok ? srv_video_encoders_encode(s->videos, s->hub, job, work->frame, &result.encode_ms) : 0;
    while (ok && stills)
        ok = still_wanted(s, job, &err) &&
             encode_group(s, encoder, work, &stills, &result.encode_ms, &err);
    if (!ok) {
        srv_job_fail(s, job, &err, 0);
        return;
    }
    sp_log(SP_LOG_DEBUG, "frame %ux%u%s for %u clients: rendered %.1f ms, encoded %.1f ms",
           result.width, result.height, step_words[job->step], job->target_count,
           result.again ? 0 : result.render_ms, result.encode_ms);
    srv_schedule_done(s->hub, job, &result);
    free(job);
}

/* Takes the next stripe, encodes it, and looks whether all are there. With the mutex held, and held
 * again after; false if all are taken. */
static bool make_stripe(struct srv_render_pool *s, struct srv_striped_image *picture,
                        struct sp_encoder *with) {
    if (picture->taken == picture->count)
        return false;
    unsigned i = picture->taken++;
    pthread_mutex_unlock(&s->mutex);
    picture->stripe(picture->of, i, with);
    pthread_mutex_lock(&s->mutex);
    if (++picture->made == picture->count)
        pthread_cond_broadcast(&s->made);
    return true;
}

static void share_stripes(void *user, struct sp_encoder *own, unsigned count, sp_stripe_fn *stripe,
                          void *of) {
    struct srv_encode_thread *thread = user;
    struct srv_render_pool *s = thread->render_pool;
    struct srv_striped_image *picture = &thread->picture;
    pthread_mutex_lock(&s->mutex);
    *picture = (struct srv_striped_image){ .count = count, .stripe = stripe, .of = of };
    pthread_cond_broadcast(&s->encode);
    while (make_stripe(s, picture, own))
        ;
    while (picture->made < count)
        pthread_cond_wait(&s->made, &s->mutex);
    pthread_mutex_unlock(&s->mutex);
}

/* A stripe of another's picture, if there is one. As make_stripe(). */
static bool lend_hand(struct srv_encode_thread *thread) {
    struct srv_render_pool *s = thread->render_pool;
    for (unsigned i = 0; i < s->encode_thread_count; i++) {
        struct srv_encode_thread *other = &s->encode_threads[i];
        /* A stripe for which others wait would wait for a nice thread. */
        if (thread->is_nice > other->is_nice || (thread->is_first && other->at_still))
            continue;
        if (make_stripe(s, &other->picture, thread->encoder))
            return true;
    }
    return false;
}

static struct srv_worker *lane_of(struct srv_render_pool *s, const struct srv_encode_task *work) {
    return &s->lanes[work->still        ? SRV_WORKER_SNAPSHOT
                     : work->is_express ? SRV_WORKER_PREEMPTION
                                        : SRV_WORKER_INTERACTIVE];
}

static bool is_slow_to_encode(const struct srv_encode_task *work) {
    return work->job && work->job->is_slow_to_encode;
}

static bool may_take(const struct srv_encode_thread *thread, const struct srv_encode_task *work) {
    bool is_long = work->still || (is_slow_to_encode(work) && !work->job->is_alone);
    return thread->is_nice == is_long;
}

/* Is another frame of its session being encoded? */
static bool has_thread(const struct srv_render_pool *s, const struct srv_encode_task *work) {
    bool has = false;
    for (unsigned t = 0; work->job && t < s->encode_thread_count; t++)
        has = has || s->encode_threads[t].session == work->job->session;
    return has;
}

static bool has_video(const struct srv_encode_task *work) {
    for (uint32_t i = 0; work->job && i < work->job->target_count; i++)
        if (work->job->targets[i].video != SP_VIDEO_CODEC_COUNT)
            return true;
    return false;
}

/* The oldest work that this thread may do, of a session that has no thread before others, where
 * video would but wait for the frame before it; encode_count if there is none. */
static unsigned find_work(const struct srv_encode_thread *thread) {
    const struct srv_render_pool *s = thread->render_pool;
    unsigned found = s->encode_count;
    for (unsigned i = 0; i < s->encode_count; i++) {
        const struct srv_encode_task *work = &s->encode_queue[i];
        if (!may_take(thread, work))
            continue;
        if (!has_thread(s, work))
            return i;
        if (found == s->encode_count && !has_video(work))
            found = i;
    }
    return found;
}

/* With the mutex held; false if there is nothing to take. */
static bool take_work(struct srv_encode_thread *thread, struct srv_encode_task *work) {
    struct srv_render_pool *s = thread->render_pool;
    unsigned found = find_work(thread);
    if (found == s->encode_count)
        return false;
    *work = s->encode_queue[found];
    s->encode_count--;
    memmove(s->encode_queue + found, s->encode_queue + found + 1,
            (s->encode_count - found) * sizeof *work);
    struct srv_worker *lane = lane_of(s, work);
    lane->encodes -= !is_slow_to_encode(work); /* there is room */
    srv_worker_wake(lane);
    thread->at_still = work->still;
    thread->session = work->job ? work->job->session : 0;
    return true;
}

/* With the scheduler's mutex held, and held again after. */
static void give_back_videos(struct srv_render_pool *s) {
    s->videos_due = false;
    pthread_mutex_unlock(&s->mutex);
    srv_video_encoders_tick(s->videos, srv_clock_ms());
    pthread_mutex_lock(&s->mutex);
}

static void *encode_main(void *user) {
    struct srv_encode_thread *thread = user;
    struct srv_render_pool *s = thread->render_pool;
    if (thread->is_nice)
        srv_background_thread_enter("an encode thread");
    pthread_mutex_lock(&s->mutex);
    for (;;) {
        struct srv_encode_task work;
        if (!take_work(thread, &work)) {
            if (lend_hand(thread))
                continue;
            if (s->encode_stop)
                break;
            if (s->videos_due)
                give_back_videos(s);
            else
                pthread_cond_wait(&s->encode, &s->mutex);
            continue;
        }
        pthread_mutex_unlock(&s->mutex);
        if (work.job)
            encode_job(s, thread->encoder, &work);
        else
            encode_still(s, thread->encoder, &work);
        sp_frame_unref(&work.frame);
        pthread_mutex_lock(&s->mutex);
        thread->session = 0;
        if (s->encode_count > 0) /* what it kept from others */
            pthread_cond_broadcast(&s->encode);
    }
    pthread_mutex_unlock(&s->mutex);
    return NULL;
}

void srv_encode_submit(struct srv_render_pool *s, struct srv_encode_task work) {
    pthread_mutex_lock(&s->mutex);
    lane_of(s, &work)->encodes += !is_slow_to_encode(&work);
    assert(s->encode_count < SRV_ENCODE_QUEUE);
    s->encode_queue[s->encode_count++] = work;
    pthread_cond_broadcast(&s->encode); /* not every thread takes it */
    pthread_mutex_unlock(&s->mutex);
}

bool srv_encode_create(struct srv_render_pool *s, struct sp_error *err) {
    const unsigned streams = s->options.encode_threads, count = streams > 1 ? 2 * streams - 1 : 2;
    s->encode_thread_count = count;
    for (unsigned i = 0; i < count; i++) {
        struct srv_encode_thread *thread = &s->encode_threads[i];
        thread->render_pool = s;
        thread->is_nice = i >= streams;
        thread->is_first = i == 0 && streams > 1;
        thread->encoder = sp_encoder_create(err);
        if (!thread->encoder)
            return false;
        if (streams > 1)
            sp_encoder_set_share(thread->encoder, share_stripes, thread);
    }
    return true;
}

bool srv_encode_start(struct srv_render_pool *s, struct sp_error *err) {
    for (unsigned i = 0; i < s->encode_thread_count; i++) {
        struct srv_encode_thread *thread = &s->encode_threads[i];
        int failed = pthread_create(&thread->thread, NULL, encode_main, thread);
        if (failed)
            return sp_fail(err, SP_ERR_IO, NULL, "cannot start an encode thread: %s",
                           strerror(failed));
        thread->running = true;
    }
    return true;
}

void srv_encode_stop(struct srv_render_pool *s) {
    pthread_mutex_lock(&s->mutex);
    s->encode_stop = true;
    pthread_cond_broadcast(&s->encode);
    pthread_mutex_unlock(&s->mutex);
    for (unsigned i = 0; i < s->encode_thread_count; i++) {
        struct srv_encode_thread *thread = &s->encode_threads[i];
        if (thread->running)
            pthread_join(thread->thread, NULL);
        thread->running = false;
    }
}

void srv_encode_destroy(struct srv_render_pool *s) {
    for (unsigned i = 0; i < s->encode_thread_count; i++)
        sp_encoder_destroy(&s->encode_threads[i].encoder);
}
