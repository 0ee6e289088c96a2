/* SPDX-License-Identifier: Apache-2.0
 *
 * What the encode threads do with a rendered frame: encode it once per format and quality, and
 * deliver the bytes to the outboxes of participants, or to the waiters of a snapshot.
 */
#include <stdlib.h>
#include <string.h>

#include "common/clock.h"
#include "render/render_pool_private.h"
#include "sp/log.h"

static double stage_ms(const struct sp_frame_stats *stats, const char *name) {
    for (uint32_t i = 0; i < stats->stage_count; i++)
        if (strcmp(stats->stages[i].name, name) == 0)
            return stats->stages[i].ms;
    return 0;
}

static void count_render(struct srv_render_pool *pool, const struct srv_encode_task *task) {
    const struct sp_frame_stats *stats = &task->frame->stats;
    if (task->is_cached)
        return;
    srv_metrics_time(pool->options.metrics, SRV_TIME_RENDER, stats->render_ms);
    srv_metrics_time(pool->options.metrics, SRV_TIME_READBACK,
                     stage_ms(stats, "resolve") + stage_ms(stats, "read"));
}

/* Snapshots. */

static void encode_snapshot(struct srv_render_pool *pool, struct sp_encoder *encoder,
                            const struct srv_encode_task *task) {
    struct srv_snapshot_result result = { .stats = task->frame->stats };
    const struct srv_snapshot *snapshot = &task->snapshot->snapshot;
    const uint64_t encoder_bytes = task->snapshot->encoder_bytes;
    const struct srv_encode_params params =
        srv_encode_params_from(snapshot->format, snapshot->quality, snapshot->chroma);
    double start_ms = srv_clock_ms();
    struct srv_blob *cached = srv_frame_cache_find_bytes(&pool->cache, task->frame, &params);
    if (cached) {
        result.ok = true;
        result.bytes = cached->bytes;
        result.size = cached->size;
    } else {
        sp_encoder_set_chroma(encoder, params.chroma);
        result.ok = sp_encode(encoder, task->frame, params.format, params.quality, &result.bytes,
                              &result.size, &result.err);
    }
    result.encode_ms = srv_clock_ms() - start_ms;
    srv_snapshot_queue_charge(&pool->snapshots, task->snapshot, result.encode_ms);
    count_render(pool, task);
    if (!cached)
        srv_metrics_time(pool->options.metrics, SRV_TIME_ENCODE, result.encode_ms);
    srv_metrics_add(pool->options.metrics, result.ok ? SRV_COUNT_SNAPSHOTS : SRV_COUNT_DROP_FAILED,
                    1);
    srv_snapshot_queue_answer(&pool->snapshots, task->snapshot, &result);
    srv_blob_unref(&cached);
    sp_encoder_trim(encoder);
    sp_budget_release(pool->options.frame_memory.snapshots, SP_BUDGET_ENCODERS, encoder_bytes);
    srv_worker_wake(&pool->workers[SRV_WORKER_SNAPSHOT]); /* the next one may wait for the memory */
}

/* Session frames. */

static uint8_t codec_of(enum sp_image_format format) {
    return format == SP_IMAGE_PNG    ? PROTO_CODEC_PNG
           : format == SP_IMAGE_WEBP ? PROTO_CODEC_WEBP
                                     : PROTO_CODEC_JPEG;
}

static struct srv_encode_params params_of(const struct srv_frame_target *target) {
    struct srv_encode_params params =
        srv_encode_params_from(target->format, target->quality, target->chroma);
    params.depth = target->depth;
    return params;
}

static bool wants(const struct srv_frame_target *target, const struct srv_encode_params *params) {
    const struct srv_encode_params own = params_of(target);
    return srv_encode_params_equal(&own, params);
}

static struct srv_blob *encode_blob(struct srv_blob_pool *blobs, struct sp_encoder *encoder,
                                    const struct srv_encode_task *task,
                                    const struct srv_encode_params *params, uint64_t set,
                                    struct sp_error *err) {
    const uint8_t *bytes;
    size_t size;
    sp_encoder_set_chroma(encoder, params->chroma);
    if (!sp_encode(encoder, task->frame, params->format, params->quality, &bytes, &size, err))
        return NULL;
    const struct srv_blob_owner owner = srv_render_job_owner(task->job, set);
    const struct srv_bytes none = { .size = 0 };
    struct srv_blob *blob = srv_blob_create_with(
        blobs, &owner, params->depth ? &task->job->depth : &none, bytes, size, err);
    if (!blob)
        task->job->too_large = set;
    return blob;
}

/* Encodes the frame for the first target of the set `images` (one bit per target), and delivers the
 * bytes to all targets of the set with the same parameters. Removes these from the set. */
static bool encode_group(struct srv_render_pool *pool, struct sp_encoder *encoder,
                         const struct srv_encode_task *task, uint64_t *images, double *encode_ms,
                         struct sp_error *err) {
    uint32_t first = (uint32_t)__builtin_ctzll(*images);
    struct srv_render_job *job = task->job;
    const struct sp_frame *frame = task->frame;
    const struct srv_frame_target *like = &job->targets[first];
    const struct srv_encode_params params = params_of(like);
    uint64_t set = 0;
    for (uint32_t i = first; i < job->target_count; i++)
        if (*images >> i & 1 && wants(&job->targets[i], &params))
            set |= UINT64_C(1) << i;
    double start_ms = srv_clock_ms();
    struct srv_blob *blob = srv_frame_cache_find_bytes(&pool->cache, frame, &params);
    const bool is_cached = blob != NULL;
    if (!is_cached) {
        blob = encode_blob(pool->blobs, encoder, task, &params, set, err);
        if (!blob)
            return false;
        srv_frame_cache_put_bytes(&pool->cache, frame, &params, blob);
    }
    double took_ms = srv_clock_ms() - start_ms;
    *encode_ms += took_ms;
    if (!is_cached)
        srv_metrics_time(pool->options.metrics, SRV_TIME_ENCODE, took_ms);
    struct proto_frame_header header = {
        .codec = codec_of(like->format),
        .flags = (like->format == SP_IMAGE_PNG ? PROTO_FRAME_LOSSLESS : 0) |
                 (sp_frame_bricks_is_complete(&frame->stats.bricks) ? 0 : PROTO_FRAME_INCOMPLETE),
        .width = (uint16_t)frame->width,
        .height = (uint16_t)frame->height,
        .render_us = (uint32_t)(frame->stats.render_ms * 1000),
        .encode_us = (uint32_t)(took_ms * 1000),
    };
    const struct srv_drawn_frame drawn = srv_render_job_frame(job);
    for (uint32_t i = first; i < job->target_count; i++)
        if (set >> i & 1)
            srv_hub_deliver(srv_schedule_hub(pool->schedule), &drawn, &job->targets[i], &header,
                            blob);
    *images &= ~set;
    srv_blob_unref(&blob);
    return true;
}

/* Encodes the depth of the job's frame if some target gets it. */
static bool encode_depth(struct sp_encoder *encoder, const struct srv_encode_task *task,
                         double *encode_ms, struct sp_error *err) {
    struct srv_render_job *job = task->job;
    if (!srv_render_job_wants_depth(job))
        return true;
    const double start_ms = srv_clock_ms();
    const bool ok = srv_frame_depth_init(&job->depth, encoder, task->frame, &job->view.camera, err);
    *encode_ms += srv_clock_ms() - start_ms;
    return ok;
}

/* An encoder cannot be interrupted: call this before each encoding. */
static bool is_wanted(struct srv_render_pool *pool, const struct srv_render_job *job,
                      struct sp_error *err) {
    return !job->is_refinement || srv_schedule_is_newest(pool->schedule, job) ||
           sp_fail(err, SP_ERR_CANCELLED, NULL, "a newer view exists");
}

static void encode_session_frame(struct srv_render_pool *pool, struct sp_encoder *encoder,
                                 const struct srv_encode_task *task) {
    static const char *const step_words[] = { "", " intermediate", " final" };
    struct srv_render_job *job = task->job;
    const struct sp_frame *frame = task->frame;
    struct srv_render_result result = { .width = frame->width,
                                        .height = frame->height,
                                        .mip_level = frame->stats.mip_level,
                                        .is_draft = frame->stats.is_draft,
                                        .has_depth = frame->depth != NULL,
                                        .render_ms = frame->stats.render_ms,
                                        /* The renderer caches the classification until the volume
                                           or the transfer function changes. */
                                        .once_ms = stage_ms(&frame->stats, "classify"),
                                        .splats = frame->stats.splats,
                                        .visible_voxels = frame->stats.visible_voxels,
                                        .bricks = frame->stats.bricks,
                                        .again = task->is_cached };
    struct sp_error err = { .code = SP_OK };
    count_render(pool, task);
    bool ok = is_wanted(pool, job, &err) && encode_depth(encoder, task, &result.encode_ms, &err);
    uint64_t images = ok ? srv_video_encoders_encode(pool->videos, pool->schedule, job, frame,
                                                     srv_clock_ms(), &result.encode_ms)
                         : 0;
    while (ok && images)
        ok = is_wanted(pool, job, &err) &&
             encode_group(pool, encoder, task, &images, &result.encode_ms, &err);
    if (!ok) {
        srv_session_frame_fail(pool, job, &err, 0);
        return;
    }
    sp_log(SP_LOG_DEBUG, "frame %ux%u%s for %u clients: rendered %.1f ms, encoded %.1f ms",
           result.width, result.height, step_words[job->step], job->target_count,
           result.again ? 0 : result.render_ms, result.encode_ms);
    srv_schedule_done(pool->schedule, job, &result);
    sp_encoder_trim(encoder);
    srv_session_frame_free(pool, job);
}

void srv_encode_task_run(void *user, struct sp_encoder *encoder,
                         const struct srv_encode_task *task) {
    if (task->job)
        encode_session_frame(user, encoder, task);
    else
        encode_snapshot(user, encoder, task);
    srv_render_pool_note_work(user);
}
