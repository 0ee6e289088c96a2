/* SPDX-License-Identifier: Apache-2.0
 *
 * The snapshot worker: renders the entries of the snapshot queue, one at a time. Its renderer is
 * created for the first of them.
 */
#include <inttypes.h>

#include "common/background.h"
#include "common/clock.h"
#include "render/render_pool_private.h"

/* How long a snapshot waits for bricks of its volume, before it says that it is not complete. */
#define BRICKS_MS 30000.0

/* Passes the frame to callers that encode it themselves. */
static void answer_with_frame(struct srv_render_pool *pool, struct srv_snapshot_entry *entry,
                              struct sp_frame *frame, double drawn_ms) {
    struct srv_snapshot_result result = {
        .ok = true, .frame = frame, .stats = frame->stats, .drawn_ms = drawn_ms
    };
    srv_snapshot_queue_answer(&pool->snapshots, entry, &result);
    sp_frame_unref(&frame);
}

/* Returns the cached frame (*is_cached) or renders one. */
static struct sp_frame *find_or_render(struct srv_render_pool *pool,
                                       struct srv_snapshot_entry *entry, bool *is_cached,
                                       struct sp_error *err) {
    struct srv_worker *worker = &pool->workers[SRV_WORKER_SNAPSHOT];
    const struct srv_snapshot *snapshot = &entry->snapshot;
    *is_cached = false;
    if (!srv_snapshot_has_steps(pool->options.catalog, entry, err))
        return NULL;
    bool wants_float = sp_image_format_info(snapshot->format)->wants_float;
    struct sp_frame *frame =
        wants_float ? NULL : srv_render_pool_find(pool, snapshot->volume, &snapshot->view, false);
    *is_cached = frame != NULL;
    if (frame)
        return frame;
    struct sp_renderer_options renderer = pool->options.renderer;
    renderer.frame_budget = pool->options.frame_memory.snapshots;
    if (!worker->renderer && !(worker->renderer = sp_renderer_create(&renderer, err)))
        return NULL;
    struct srv_loaded_search search = { .catalog = pool->options.catalog,
                                        .volume = snapshot->volume,
                                        .step = snapshot->view.time.step };
    const struct sp_render_options options = { .format = wants_float ? SP_RGBAF32 : SP_RGBA8,
                                               .wants_depth = snapshot->format == SP_IMAGE_EXR,
                                               .is_valid = true, /* session/view.c, paths/ */
                                               .find = srv_catalog_find_loaded,
                                               .user = &search,
                                               .wait_ms = BRICKS_MS,
                                               .cancel = &entry->cancel };
    frame = sp_renderer_render(worker->renderer, srv_volume_voxels(snapshot->volume),
                               &snapshot->view, pool->snapshot_frames, &options, err);
    srv_render_pool_note_frame(pool, SRV_WORKER_SNAPSHOT, snapshot->volume);
    return frame;
}

/* Frees what is kept for the next frame. */
static void trim(struct srv_render_pool *pool) {
    if (pool->workers[SRV_WORKER_SNAPSHOT].renderer)
        sp_renderer_trim(pool->workers[SRV_WORKER_SNAPSHOT].renderer);
    sp_frame_pool_trim(pool->snapshot_frames);
}

/* The frame did not fit the memory. True: it did not fit beside others, and is rendered again when
 * they have given theirs back. Else it can never fit, and *err says so. */
static bool may_fit_alone(struct srv_render_pool *pool, struct srv_snapshot_entry *entry,
                          struct sp_error *err) {
    const struct sp_budget *budget = pool->options.frame_memory.snapshots;
    trim(pool);
    srv_snapshot_queue_release(&pool->snapshots, entry);
    if (sp_budget_total(budget) > 0 && !entry->needs_all) {
        entry->needs_all = true;
        return true;
    }
    err->code = SP_ERR_BUDGET;
    return false;
}

static void refuse(struct srv_render_pool *pool, struct srv_snapshot_entry *entry) {
    const struct sp_budget *budget = pool->options.frame_memory.snapshots;
    struct sp_error err;
    srv_snapshot_queue_end_rendering(&pool->snapshots, entry, false, 0);
    sp_fail(&err, SP_ERR_FRAME_BUDGET, NULL,
            "other images have %" PRIu64 " bytes, this one needs at least %" PRIu64
            ", and the half of --render-bytes for images over HTTP is %" PRIu64 "; try again later",
            sp_budget_total(budget),
            srv_frame_memory_of(entry->snapshot.format, entry->snapshot.view.size),
            sp_budget_limit(budget));
    srv_snapshot_queue_fail(&pool->snapshots, entry, &err);
}

static void render(struct srv_render_pool *pool, struct srv_snapshot_entry *entry) {
    struct sp_error err = { .code = SP_OK };
    double start_ms = srv_clock_ms();
    bool is_cached = false;
    struct sp_frame *frame = find_or_render(pool, entry, &is_cached, &err);
    double render_ms = is_cached ? 0 : srv_clock_ms() - start_ms;
    bool is_again = !frame && (err.code == SP_ERR_CANCELLED || (err.code == SP_ERR_FRAME_BUDGET &&
                                                                may_fit_alone(pool, entry, &err)));
    if (!frame)
        srv_snapshot_queue_release(&pool->snapshots, entry);
    bool waits_again =
        srv_snapshot_queue_end_rendering(&pool->snapshots, entry, is_again, render_ms);
    if (frame && entry->snapshot.wants_frame)
        answer_with_frame(pool, entry, frame, render_ms);
    else if (frame)
        srv_encode_pool_submit(pool->encoders,
                               &(struct srv_encode_task){ .frame = frame,
                                                          .snapshot = entry,
                                                          .worker = SRV_WORKER_SNAPSHOT,
                                                          .is_cached = is_cached });
    else if (!waits_again)
        srv_snapshot_queue_fail(&pool->snapshots, entry, &err);
}

/* Takes the next entry, and frees memory for it if that is what it waits for. */
static struct srv_snapshot_entry *next_entry(struct srv_render_pool *pool, double *wait_ms) {
    bool needs_memory;
    struct srv_snapshot_entry *entry =
        srv_snapshot_queue_pop(&pool->snapshots, wait_ms, &needs_memory);
    if (!needs_memory)
        return entry;
    trim(pool);
    return srv_snapshot_queue_pop(&pool->snapshots, wait_ms, &needs_memory);
}

void *srv_snapshot_worker_main(void *user) {
    struct srv_render_pool *pool = user;
    struct srv_worker *worker = &pool->workers[SRV_WORKER_SNAPSHOT];
    /* The renderer's threads inherit the priority: it is created on this thread. */
    srv_background_thread_enter("the snapshot worker", SRV_NICE_BACKGROUND);
    for (;;) {
        struct srv_worker_round round = srv_worker_begin_round(worker);
        if (round.stop)
            break;
        double wait_ms = 1000;
        struct srv_snapshot_entry *entry =
            srv_encode_pool_has_capacity(pool->encoders, SRV_WORKER_SNAPSHOT)
                ? next_entry(pool, &wait_ms)
                : NULL;
        if (entry && entry->is_refused) {
            refuse(pool, entry);
        } else if (entry) {
            render(pool, entry);
        } else {
            srv_render_pool_rest(pool, SRV_WORKER_SNAPSHOT);
            srv_worker_wait(worker, round.generation, wait_ms);
        }
    }
    return NULL;
}
