/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/state.h"

#include <assert.h>
#include <epoxy/gl.h>
#include <string.h>

#include "backend/gl/compositor.h"
#include "backend/gl/depth_order.h"
#include "backend/gl/layer_drawing.h"
#include "backend/gl/memory.h"
#include "backend/gl/resample.h"
#include "base/clock.h"
#include "draw/light/light.h"
#include "draw/resample/resample.h"

enum {
    GROUPS_MAX = 65535, /* along an axis of a dispatch; every GPU supports this many */
    CHUNKS_SHARE = 8    /* memory for records over memory for their chunks */
};

struct draw {
    struct gl_band band;
    struct gl_layer_drawing layers;     /* if the slot has layers */
    struct gl_resample_frame resampled; /* GL_PATH_RESAMPLED */
    struct gl_frame frame;              /* GL_PATH_SPLATS */
    unsigned compositor;                /* the same: program */
};

/* Returns how many batches or passes may be queued on the GPU: together they have at most as many
 * pairs as one may have. */
static unsigned queued_max(const struct draw *d) {
    const struct gl_workload *workload = &d->band.state->workload;
    uint64_t n = gl_workload_limits(workload).pairs / workload->pairs;
    return n < GL_QUEUED_MIN ? GL_QUEUED_MIN : n < GL_QUEUED_MAX ? (unsigned)n : GL_QUEUED_MAX;
}

static struct gl_bins_space space_of(const struct draw *d, const struct gl_batch *batch) {
    return (struct gl_bins_space){ d->band.columns, d->band.y, d->band.end, gl_band_rows(&d->band),
                                   batch->layers };
}

static void use(const struct draw *d, unsigned program, const struct gl_batch *batch) {
    const struct gl_bins_space space = space_of(d, batch);
    glUseProgram(program);
    gl_bins_set_space(&space);
}

static void project(struct draw *d, const struct gl_batch *batch) {
    struct gl_state *s = d->band.state;
    use(d, s->project, batch);
    glUniform2ui(4, (GLuint)s->workload.pairs, d->band.slot->pieces.splat_rounds);
    gl_buffer_bind(&s->upload.constants.buffer, 0);
    gl_buffer_bind(&s->upload.chunks, 1);
    gl_buffer_bind(&s->buffers.records, 5);
    gl_buffer_bind(&s->buffers.spans, 6);
    gl_buffer_bind(&s->bins.counts, 7);
    for (int l = 0; l < SP_LEVELS; l++) {
        const struct gl_visible_list *list = d->frame.lists[l];
        if (!batch->chunks[l])
            continue;
        gl_buffer_bind(&list->entries, 2);
        gl_buffer_bind(&list->tables, 3);
        gl_buffer_bind(list->normal_bytes ? &list->normals : &list->tables, 4);
        glUniform1ui(3, d->frame.stride);
        glUniform4ui(2, list->has_keys, list->normal_bytes, list->first_class, list->has_scales);
        for (uint32_t done = 0, n; done < batch->chunks[l]; done += n) {
            uint32_t left = batch->chunks[l] - done;
            n = left < GROUPS_MAX ? left : GROUPS_MAX;
            glUniform2ui(1, batch->chunk[l] - s->upload.chunk_first + done, batch->first);
            glDispatchCompute(n, 1, 1);
        }
    }
    gl_band_barrier();
    gl_timer_stamp(&d->band.slot->timer, GL_STAGE_SPLAT);
}

static void bin(struct draw *d, const struct gl_batch *batch) {
    struct gl_state *s = d->band.state;
    const struct gl_bins_space space = space_of(d, batch);
    gl_bins_sort(&s->bins, &space, &s->buffers.spans, batch->records, (uint32_t)s->workload.pairs);
    gl_timer_stamp(&d->band.slot->timer, GL_STAGE_BIN);
    if (d->frame.compositing != SP_COMPOSITE_SPLAT)
        return;
    gl_bins_order(&s->bins, &space, (uint32_t)s->workload.pairs, d->band.slot->pieces.bin_pairs);
    gl_timer_stamp(&d->band.slot->timer, GL_STAGE_BIN);
}

static bool composite(struct draw *d, const struct gl_batch *batch, struct sp_error *err) {
    struct gl_state *s = d->band.state;
    const struct gl_frame *f = &d->frame;
    const struct gl_fragments_band fragments = gl_band_fragments(&d->band);
    use(d, d->compositor, batch);
    glUniform3ui(1, d->band.job->frame->width, (GLuint)s->workload.pairs,
                 d->band.slot->pieces.pass_pairs);
    glUniform1f(3, gl_frame_ewa(f)->cut);
    glUniform2ui(4, gl_frame_ewa(f)->clip.count, f->stride);
    glUniform2f(5, (float)batch->first, (float)f->thickness);
    gl_buffer_bind(&s->upload.constants.buffer, 0);
    gl_buffer_bind(&s->buffers.records, 1);
    gl_buffer_bind(&s->bins.totals, 2);
    gl_buffer_bind(&s->bins.pairs, 3);
    gl_buffer_bind(&s->buffers.image, 4);
    gl_buffer_bind(f->is_post ? &s->curve.buffer : &s->buffers.image, 5);
    gl_buffer_bind(&s->buffers.cubic, 6);
    gl_buffer_bind(&s->bins.counts, 7);
    gl_fragments_use(&fragments);
    for (uint32_t pass = 0; pass < s->workload.passes; pass++) {
        glUniform4ui(2, batch->resumes, batch->stays_open, pass, s->workload.passes);
        glDispatchCompute(d->band.columns, gl_band_rows(&d->band), 1);
        gl_band_barrier();
        gl_timer_stamp(&d->band.slot->timer, GL_STAGE_TILE);
        if (!gl_band_follow(&d->band, err))
            return false;
    }
    return true;
}

/* Reserves memory for the largest batch and for a band. */
static bool reserve(struct draw *d, struct sp_error *err) {
    struct gl_state *s = d->band.state;
    uint64_t most = s->block_bytes, records = 1, bins = 1;
    for (uint32_t i = 0; i < d->band.state->partition.batch_count; i++) {
        const struct gl_batch *b = &d->band.state->partition.batches[i];
        uint64_t own = (uint64_t)gl_band_tiles(&d->band) * b->layers;
        records = b->records > records ? b->records : records;
        bins = own > bins ? own : bins;
    }
    struct {
        struct gl_buffer *buffer;
        const char *what;
        uint64_t bytes;
        enum gl_usage usage;
    } wanted[] = {
        { &s->buffers.records, "splats", records * 16 * d->frame.stride, GL_USE_SCRATCH },
        { &s->buffers.spans, "tiles of splats", records * GL_SPAN_BYTES, GL_USE_SCRATCH },
    };
    for (size_t i = 0; i < sizeof wanted / sizeof wanted[0]; i++)
        if (!gl_buffer_reserve(wanted[i].buffer, wanted[i].what, wanted[i].bytes, most,
                               wanted[i].usage, err))
            return false;
    return gl_band_reserve(&d->band, err) &&
           gl_bins_reserve(&s->bins, bins, s->workload.pairs, most, err) &&
           gl_layer_drawing_reserve(&d->layers, &d->band, err);
}

/* Returns the number of layers per batch that the bins can hold. */
static uint32_t layers_of_batch(const struct draw *d) {
    uint32_t capacity = gl_workload_limits(&d->band.state->workload).bins / gl_band_tiles(&d->band);
    capacity = capacity < 1 ? 1 : capacity;
    return capacity < d->band.state->workload.layers ? capacity : d->band.state->workload.layers;
}

/* Returns the costs of a pair and a record of the frame. */
static struct gl_costs costs_of(const struct draw *d) {
    const struct gl_frame *f = &d->frame;
    struct gl_costs costs = { .columns = d->band.columns,
                              .pair_rounds = f->has_depths ? 3 : 1, /* Φ */
                              .pair_loads = gl_frame_ewa(f)->clip.count,
                              .record_bytes = 16 * f->stride,
                              .block_bytes = d->band.state->block_bytes };
    if (f->is_post) /* closing a layer searches for a value and a magnitude */
        costs.pair_loads += 9 + d->band.job->view->transfer_function.gradient_count;
    if (gl_layer_drawing_rounds(&d->layers) && costs.record_bytes < GL_SPLAT_RECORD_BYTES)
        costs.record_bytes = GL_SPLAT_RECORD_BYTES;
    costs.element_rounds = gl_layer_drawing_rounds(&d->layers);
    return costs;
}

/* Makes the batches of the band. */
static bool cut(struct draw *d, struct sp_error *err) {
    struct gl_state *s = d->band.state;
    if (!gl_partition_make(&s->partition, layers_of_batch(d), d->band.slot->pieces.records, err))
        return false;
    uint64_t enough = gl_workload_limits(&s->workload).record_bytes / CHUNKS_SHARE;
    return reserve(d, err) &&
           gl_upload_chunks(&s->upload, &s->partition, enough, s->block_bytes, err) &&
           gl_memory_fit(s, err);
}

static bool draw_batches(struct draw *d, struct sp_error *err) {
    for (uint32_t i = 0; i < d->band.state->partition.batch_count; i++) {
        const struct gl_batch *batch = &d->band.state->partition.batches[i];
        if (sp_job_is_cancelled(d->band.job))
            return sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
        const struct gl_bins_space space = space_of(d, batch);
        gl_bins_clear(&d->band.state->bins, &space);
        gl_upload_batch(&d->band.state->upload, &d->band.state->partition, batch);
        project(d, batch);
        bin(d, batch);
        if (!composite(d, batch, err))
            return false;
    }
    return true;
}

/* Returns the largest number of layers of a batch. */
static uint32_t most_layers(const struct gl_partition *partition) {
    uint32_t most = 1;
    for (uint32_t i = 0; i < partition->batch_count; i++)
        most = partition->batches[i].layers > most ? partition->batches[i].layers : most;
    return most;
}

/* Plans the rows and batches of the band that begins at d->band.y. */
static bool plan_band(struct draw *d, struct sp_error *err) {
    const struct gl_state *s = d->band.state;
    const struct gl_costs costs = costs_of(d);
    uint32_t rows = gl_workload_limits(&s->workload).tiles / d->band.columns;
    rows = rows < 1 ? 1 : rows < s->workload.rows ? rows : s->workload.rows;
    gl_band_end(&d->band, rows);
    d->band.slot->pieces = gl_workload_plan(&s->workload, &costs);
    gl_layer_drawing_divide(&d->layers, &d->band);
    if (!cut(d, err))
        return false;
    d->band.slot->pieces.layers = most_layers(&s->partition);
    d->band.slot->pieces.rows = gl_band_rows(&d->band);
    d->band.queued_max = queued_max(d);
    return true;
}

static bool is_out_of_memory(const struct sp_error *why) {
    return why->code == SP_ERR_MEMORY || why->code == SP_ERR_BUDGET;
}

/* Plans the band in smaller and smaller pieces until they fit into memory. */
static bool plan_within_memory(struct draw *d, struct sp_error *why) {
    struct gl_state *s = d->band.state;
    unsigned halvings = s->workload.halvings;
    bool ok = plan_band(d, why);
    while (!ok && is_out_of_memory(why) && gl_workload_halve(&s->workload)) {
        gl_memory_release(s);
        gl_readback_finish(&d->band.slot->readback);
        ok = plan_band(d, why);
    }
    if (!ok)
        s->workload.halvings = halvings;
    return ok;
}

/* The same. If even the smallest pieces do not fit, the samples are dropped: their lists are
 * complete. */
static bool plan_in_capacity(struct draw *d, struct sp_error *err) {
    struct sp_error why = { .code = SP_OK };
    if (plan_within_memory(d, &why) ||
        (is_out_of_memory(&why) && gl_residency_drop_samples(&d->band.state->residency) &&
         plan_within_memory(d, &why)))
        return true;
    return sp_fail(err, why.code, why.place, "%s", why.text);
}

/* Draws the batches, if there are any, and what is behind them. */
static bool draw_splats(struct draw *d, struct sp_error *err) {
    const struct gl_fragments_band fragments = gl_band_fragments(&d->band);
    d->band.layer = 0;
    for (uint32_t layer = 1; d->band.fragments && layer < 3; layer++)
        gl_band_clear(&d->band, layer);
    if (d->band.slot->path == GL_PATH_SPLATS && !draw_batches(d, err))
        return false;
    gl_fragments_finish(&fragments);
    gl_band_barrier();
    gl_timer_stamp(&d->band.slot->timer, GL_STAGE_LAYERS);
    return true;
}

/* Submits the band. */
static bool draw_band(struct draw *d, struct sp_error *err) {
    bool ok;
    if (!gl_band_start(&d->band, err))
        return false;
    if (d->band.slot->has_layers && !gl_layer_drawing_draw(&d->layers, &d->band, err))
        return false;
    if (d->band.slot->path == GL_PATH_RESAMPLED)
        ok = gl_resample_draw(&d->resampled, &d->band, err);
    else
        ok = draw_splats(d, err);
    return ok && gl_band_send(&d->band, err);
}

static double longest_dispatch(const double longest[GL_STAGES]) {
    double ms = 0;
    for (int i = 0; i < GL_STAGES; i++)
        ms = i != GL_STAGE_READ && longest[i] > ms ? longest[i] : ms;
    return ms;
}

static void add_counts(struct gl_slot *slot, const struct gl_bins_head *head) {
    slot->splats += head->splats;
    slot->fragments += (uint64_t)head->carry << 32 | head->fragments;
}

/* Waits for the submitted band. If it did not fit, it was not drawn and the next attempt gets other
 * sizes; otherwise its pixels are in the image and the slot's y is its end. */
static bool finish_band(struct gl_state *s, struct gl_slot *slot, const struct sp_backend_job *job,
                        struct sp_error *err) {
    struct gl_bins_head head;
    if (!gl_fence_wait(&slot->readback.fence, job->cancel, err))
        return false;
    double start_ms = sp_clock_ms();
    if (!gl_band_read(slot, job->frame, &head, err))
        return false;
    slot->stage_ms[GL_STAGE_READ] += sp_clock_ms() - start_ms;
    double longest[GL_STAGES] = { 0 };
    gl_timer_read(&slot->timer, slot->stage_ms, longest);
    if (slot->path == GL_PATH_RESAMPLED)
        gl_resample_adapt(&s->resample, longest[GL_STAGE_TILE], s->workload.limits.dispatch_ms);
    if (!gl_fragments_fit(s, head.stored, slot->fragments_most,
                          (uint64_t)job->frame->width * (slot->end - slot->y))) {
        slot->end = slot->y;
        return true;
    }
    if (!slot->has_pieces) {
        add_counts(slot, &head);
        slot->y = slot->end;
        return true;
    }
    longest[GL_STAGE_TILE] = slot->path == GL_PATH_RESAMPLED ? 0 : longest[GL_STAGE_TILE];
    gl_workload_adapt(&s->workload, &slot->pieces, longest_dispatch(longest));
    bool fits = gl_workload_fits(&slot->pieces, &head);
    slot->y = slot->end = fits ? slot->end : slot->y;
    s->needed = head.needed > s->needed ? head.needed : s->needed;
    if (!fits)
        return gl_workload_retry(&s->workload, &slot->pieces, &head, err);
    gl_workload_grow(&s->workload, &slot->pieces, &head);
    add_counts(slot, &head);
    return true;
}

static void write_stats(const struct gl_slot *slot, struct sp_frame_stats *stats) {
    static const char *const names[GL_STAGES] = { "classify", "splat", "bin",   "tile",
                                                  "resolve",  "read",  "layers" };
    stats->mip_level = slot->mip_level;
    stats->visible_voxels = slot->visible;
    stats->splats = slot->splats;
    stats->fragments = slot->fragments;
    stats->stage_count = slot->has_layers ? GL_STAGES : GL_STAGE_LAYERS;
    for (uint32_t i = 0; i < stats->stage_count; i++)
        stats->stages[i] = (struct sp_stage_time){ names[i], slot->stage_ms[i] };
}

static bool write_curve(struct draw *d, struct sp_error *err) {
    const struct gl_frame *f = &d->frame;
    return !f->is_post ||
           gl_curve_update(&d->band.state->curve, d->band.job->volume, f->lists[f->finest]->base,
                           &d->band.job->view->transfer_function,
                           f->thickness * gl_frame_ewa(f)->unit, err);
}

static bool plan_splats(struct draw *d, struct sp_error *err) {
    struct gl_state *s = d->band.state;
    const struct gl_frame *f = &d->frame;
    const struct gl_sources from = { &s->cache, &s->residency, s->pool, &s->arena, &s->partition };
    uint64_t used = sp_samples_bytes(&s->samples, NULL) + gl_layers_bytes(&s->layers, NULL);
    s->cache.limit_bytes = used < s->memory_bytes ? s->memory_bytes - used : 0;
    if (!gl_frame_begin(&d->frame, d->band.job, &from, err) ||
        (d->band.fragments && !gl_fragments_relate(&d->layers.fragments, f, s, err)) ||
        !gl_upload_frame(&s->upload, f, &s->partition, s->block_bytes, err) ||
        !write_curve(d, err) ||
        !(d->compositor = gl_compositor_choose(s, f, d->band.job->view, d->band.fragments, err)))
        return false;
    d->band.slot->stage_ms[GL_STAGE_CLASSIFY] += f->classify_ms;
    d->band.slot->mip_level = f->mip_level;
    d->band.slot->visible = f->mip_level ? f->lists[f->finest]->count : f->visible;
    return true;
}

static bool upload_shading(struct draw *d, struct sp_error *err) {
    struct gl_state *s = d->band.state;
    const struct sp_view *view = d->band.job->view;
    struct sp_camera_transform camera;
    sp_camera_transform_init(&camera, &view->camera, view->size);
    return gl_upload_shading(&s->upload, &camera, view, s->block_bytes, err);
}

static bool plan_volume(struct draw *d, struct sp_error *err) {
    struct gl_slot *slot = d->band.slot;
    switch (slot->path) {
    case GL_PATH_SPLATS:
        return plan_splats(d, err);
    case GL_PATH_RESAMPLED:
        return gl_resample_begin(&d->resampled, &d->band, err);
    case GL_PATH_LAYERS:
        break;
    }
    const struct gl_layers_made *made = &d->layers.fragments.made;
    const bool is_alone = made->splat_count == 1 && d->band.job->view->layer_count == 1;
    slot->mip_level = is_alone ? made->splats[0].source.mip_level : 0;
    slot->visible = gl_layers_count(made, &slot->splats);
    return upload_shading(d, err);
}

static bool plan_frame(struct draw *d, struct sp_error *err) {
    struct gl_slot *slot = d->band.slot;
    sp_arena_reset(&d->band.state->arena);
    d->band.columns = gl_divide_up(d->band.job->frame->width, GL_TILE);
    if ((slot->has_layers && !gl_layer_drawing_make(&d->layers, &d->band, err)) ||
        !plan_volume(d, err) ||
        (slot->has_layers && !gl_layer_drawing_begin(&d->layers, &d->band, err)))
        return false;
    slot->has_pieces = slot->path == GL_PATH_SPLATS || gl_layer_drawing_rounds(&d->layers) > 0;
    return true;
}

/* Divides other layers into dispatches, in a frame without splats of the volume. */
static void divide_layers(struct draw *d) {
    struct gl_state *s = d->band.state;
    const struct gl_costs costs = { .columns = d->band.columns,
                                    .element_rounds = gl_layer_drawing_rounds(&d->layers),
                                    .record_bytes = GL_SPLAT_RECORD_BYTES,
                                    .block_bytes = s->block_bytes };
    if (d->band.slot->has_pieces)
        d->band.slot->pieces = gl_workload_plan(&s->workload, &costs);
    d->band.slot->pieces.layers = 1;
    gl_layer_drawing_divide(&d->layers, &d->band);
}

static bool reserve_elements(struct draw *d, struct sp_error *err) {
    d->band.slot->pieces.rows = gl_band_rows(&d->band);
    return gl_layer_drawing_reserve(&d->layers, &d->band, err) && gl_memory_fit(d->band.state, err);
}

static bool plan_rows(struct draw *d, struct sp_error *err) {
    bool ok;
    if (d->band.slot->path == GL_PATH_SPLATS)
        return plan_in_capacity(d, err);
    if (d->band.slot->has_layers)
        divide_layers(d);
    d->band.queued_max = GL_QUEUED_MAX;
    if (d->band.slot->path == GL_PATH_RESAMPLED)
        ok = gl_resample_plan(&d->resampled, &d->band, err);
    else
        ok = gl_band_plan(&d->band, err);
    return ok && (!d->band.slot->has_pieces || reserve_elements(d, err));
}

/* Returns how many batches or passes the band has. */
static uint64_t count_dispatches(const struct draw *d) {
    const struct gl_state *s = d->band.state;
    uint64_t layers = gl_layer_drawing_dispatches(&d->layers);
    switch (d->band.slot->path) {
    case GL_PATH_SPLATS:
        return layers + (uint64_t)s->partition.batch_count * s->workload.passes;
    case GL_PATH_RESAMPLED:
        return layers + d->resampled.dispatches;
    case GL_PATH_LAYERS:
        break;
    }
    return layers + 1;
}

/* Draws the bands from the slot's y on and submits the last one. Does nothing if that requires
 * waiting and may_wait is false. */
static bool hand_over(struct draw *d, bool may_wait, struct sp_error *err) {
    struct gl_slot *slot = d->band.slot;
    uint32_t height = d->band.job->frame->height;
    bool ok = true;
    do {
        d->band.y = slot->y;
        if (!plan_rows(d, err))
            return false;
        if (!may_wait && (d->band.end < height || count_dispatches(d) > d->band.queued_max))
            return true;
        ok = draw_band(d, err) &&
             (d->band.end == height || finish_band(d->band.state, slot, d->band.job, err));
    } while (ok && slot->end < height);
    return ok;
}

static enum gl_path choose_path(const struct sp_view *view) {
    if (!sp_layers_have_volume(view))
        return GL_PATH_LAYERS;
    return sp_resample_draws(view) ? GL_PATH_RESAMPLED : GL_PATH_SPLATS;
}

static bool try_draw(struct gl_state *s, struct gl_slot *slot, const struct sp_backend_job *job,
                     bool may_wait, struct sp_error *err) {
    struct draw d = { .band = { .state = s, .job = job, .slot = slot } };
    slot->has_layers = sp_layers_are_wanted(job->view);
    slot->path = choose_path(job->view);
    bool ok = plan_frame(&d, err) && hand_over(&d, may_wait, err);
    gl_band_drop_fences(&d.band);
    return ok;
}

/* Evicts the processor's caches that the view does not need. */
static void evict_other_caches(struct gl_state *s, const struct gl_slot *slot) {
    if (slot->path != GL_PATH_SPLATS)
        sp_classify_cache_evict(&s->cache, NULL);
    if (slot->path != GL_PATH_RESAMPLED)
        sp_samples_evict(&s->samples, NULL);
    if (!slot->has_layers)
        gl_layers_evict(&s->layers, NULL);
}

/* Draws the frame. If memory is short, tries again without the scratch memory of earlier frames;
 * then the processor classifies volumes whose samples do not fit. */
static bool draw(struct gl_state *s, struct gl_slot *slot, const struct sp_backend_job *job,
                 bool may_wait, struct sp_error *err) {
    struct sp_error why = { .code = SP_OK };
    s->residency.tries_again = true;
    if (try_draw(s, slot, job, may_wait, &why))
        return true;
    if (!is_out_of_memory(&why))
        return sp_fail(err, why.code, why.place, "%s", why.text);
    gl_memory_release(s);
    evict_other_caches(s, slot);
    s->residency.tries_again = false;
    return try_draw(s, slot, job, may_wait, err);
}

/* Only sheets of interpolated values have a depth here: other frames lose it. */
static void drop_depth(const struct sp_backend_job *job) {
    if (choose_path(job->view) == GL_PATH_RESAMPLED &&
        !sp_compositing_is_projection(job->view->compositing.mode))
        return;
    job->frame->depth = job->frame->spread = NULL;
    job->frame->depth_stride_bytes = 0;
}

bool gl_draw_begin(struct gl_state *s, const struct sp_backend_job *job, struct sp_error *err) {
    assert(s->begun < GL_IN_FLIGHT);
    struct gl_slot *slot = &s->slots[(s->oldest + s->begun) % GL_IN_FLIGHT];
    slot->y = slot->end = 0;
    slot->splats = slot->fragments = 0;
    memset(slot->stage_ms, 0, sizeof slot->stage_ms);
    if (sp_light_is_wanted(job->view))
        return sp_fail(err, SP_ERR_UNSUPPORTED, "/shading",
                       "this backend draws neither ambient occlusion nor shadows");
    drop_depth(job);
    gl_memory_begin(s);
    gl_upload_next(&s->upload);
    gl_resample_next(&s->resample);
    bool ok = draw(s, slot, job, s->begun == 0, err);
    s->begun += ok;
    return ok;
}

bool gl_draw_end(struct gl_state *s, const struct sp_backend_job *job, struct sp_error *err) {
    assert(s->begun > 0);
    struct gl_slot *slot = &s->slots[s->oldest];
    bool ok = true;
    while (ok && slot->y < job->frame->height) {
        if (slot->y == slot->end) {
            /* What is uploaded now would change what the next frame reads. */
            if (s->begun > 1)
                glFinish();
            ok = draw(s, slot, job, true, err);
        }
        ok = ok && finish_band(s, slot, job, err);
    }
    gl_fence_drop(&slot->readback.fence);
    s->oldest = (s->oldest + 1) % GL_IN_FLIGHT;
    s->begun--;
    if (ok)
        write_stats(slot, &job->frame->stats);
    return ok;
}

void gl_draw_drop(struct gl_state *s) {
    for (int i = 0; i < GL_IN_FLIGHT; i++)
        gl_fence_drop(&s->slots[i].readback.fence);
    s->begun = 0;
}
