/* SPDX-License-Identifier: Apache-2.0 */
#include "sp/renderer.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "backend/defaults.h"
#include "backend/support.h"
#include "base/clock.h"
#include "data/volume/volume.h"
#include "draw/layers/layers.h"
#include "draw/resample/resample.h"
#include "draw/slices/slices.h"
#include "frame/antialias.h"
#include "frame/depth.h"
#include "renderer/renderer_private.h"
#include "sp/budget.h"

enum { GPUS_MAX = 64 };

/* "auto" or an index. */
static bool parse_gpu(const char *text, int *gpu, struct sp_error *err) {
    *gpu = -1;
    if (!text || strcmp(text, "auto") == 0)
        return true;
    char *end;
    unsigned long index = strtoul(text, &end, 10);
    if (*text < '0' || *text > '9' || *end || index >= GPUS_MAX)
        return sp_fail(err, SP_ERR_INVALID, "",
                       "GPU \"%.32s\" is neither auto nor in [0, %d]; splatd --probe lists them",
                       text, GPUS_MAX - 1);
    *gpu = (int)index;
    return true;
}

static bool read_options(struct sp_renderer *r, const struct sp_renderer_options *o,
                         struct sp_error *err) {
    if (o->threads > SP_THREADS_MAX)
        return sp_fail(err, SP_ERR_INVALID, "", "%u render threads; at most %d can be used",
                       o->threads, SP_THREADS_MAX);
    r->wanted = (struct sp_backend_options){
        .threads = o->threads ? o->threads : sp_default_threads(),
        .memory_bytes = o->memory_bytes ? o->memory_bytes : sp_default_memory(),
        .video_bytes = o->video_bytes,
        .frame_budget = o->frame_budget,
        .isa = strdup(o->isa ? o->isa : "auto"),
        .require_gpu = o->require_gpu,
        .refused = o->refused,
        .refused_user = o->user,
    };
    if (!r->wanted.isa)
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for a renderer");
    return parse_gpu(o->gpu, &r->wanted.gpu, err);
}

struct sp_renderer *sp_renderer_create(const struct sp_renderer_options *options,
                                       struct sp_error *err) {
    static const struct sp_renderer_options defaults;
    const struct sp_renderer_options *o = options ? options : &defaults;
    const char *name = o->backend ? o->backend : "auto";
    struct sp_renderer *r = calloc(1, sizeof *r);
    if (!r) {
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory for a renderer");
        return NULL;
    }
    atomic_init(&r->backend, NULL);
    sp_arena_init(&r->rows);
    r->is_auto = strcmp(name, "auto") == 0;
    const struct sp_backend *backend = NULL;
    void *state = NULL;
    if (read_options(r, o, err))
        backend = sp_registry_start(name, &r->wanted, &state, err);
    r->rows.budget = r->wanted.frame_budget;
    r->wanted.refused = NULL; /* the caller's user pointer is valid in this call only */
    if (backend)
        sp_renderer_adopt(r, backend, state);
    else
        sp_renderer_destroy(&r);
    return r;
}

/* Removes the oldest frame from the queue. */
static void pop_oldest(struct sp_renderer *r) {
    struct sp_renderer_frame *f = sp_renderer_frame_at(r, 0);
    sp_volume_unref(&f->job.volume);
    sp_volume_unref(&f->original);
    sp_layer_volumes_finish(&f->others);
    sp_frame_unref(&f->job.frame);
    r->oldest = (r->oldest + 1) % SP_IN_FLIGHT_MAX;
    r->begun--;
}

void sp_renderer_destroy(struct sp_renderer **renderer) {
    struct sp_renderer *r = *renderer;
    if (!r)
        return;
    if (r->state)
        atomic_load(&r->backend)->destroy(r->state);
    if (r->fallback.backend)
        r->fallback.backend->destroy(r->fallback.state);
    while (r->begun)
        pop_oldest(r);
    sp_volume_unref(&r->edited);
    sp_pool_destroy(&r->workers);
    sp_frame_pool_destroy(&r->frames);
    sp_arena_finish(&r->rows);
    free((char *)r->wanted.isa);
    free(r);
    *renderer = NULL;
}

void sp_renderer_info(const struct sp_renderer *renderer, struct sp_renderer_info *info) {
    *info = renderer->info;
}

bool sp_renderer_supports(const struct sp_renderer *renderer, const struct sp_view *view,
                          struct sp_error *err) {
    const struct sp_backend *backend = atomic_load(&renderer->backend);
    bool is_alone = !renderer->is_auto || renderer->wanted.require_gpu;
    return sp_support_check(backend, view, err) &&
           sp_support_check_kind(backend, is_alone, view, err);
}

/* A frame with slices in it. */
struct composing {
    struct sp_renderer *renderer;
    const struct sp_renderer_frame *whole;
};

/* Adds the statistics of a part to the statistics of the whole frame. */
static void add_stats(struct sp_frame_stats *to, const struct sp_frame_stats *part) {
    const struct sp_frame_stats sum = *to;
    *to = *part;
    to->visible_voxels =
        sum.visible_voxels > part->visible_voxels ? sum.visible_voxels : part->visible_voxels;
    to->splats += sum.splats;
    to->fragments += sum.fragments;
    for (uint32_t i = 0; i < sum.stage_count; i++) {
        uint32_t at = 0;
        while (at < to->stage_count && strcmp(to->stages[at].name, sum.stages[i].name) != 0)
            at++;
        if (at < to->stage_count)
            to->stages[at].ms += sum.stages[i].ms;
        else if (at < SP_STAGES_MAX)
            to->stages[to->stage_count++] = sum.stages[i];
    }
}

static bool draw_part(void *user, const struct sp_clip *clip, struct sp_frame *frame,
                      struct sp_error *err) {
    const struct composing *c = user;
    struct sp_renderer_frame part = *c->whole;
    part.view.clip = *clip;
    memset(part.view.background, 0, sizeof part.view.background);
    part.view.slices.mode = SP_SLICES_NONE;
    part.job.view = &part.view;
    part.job.frame = frame;
    part.job.light_clip = &c->whole->view.clip;
    if (!sp_renderer_draw(c->renderer, &part, err))
        return false;
    add_stats(&c->whole->job.frame->stats, &frame->stats);
    return true;
}

/* Starts the threads that work on finished images. */
static bool open_workers(struct sp_renderer *r, struct sp_error *err) {
    if (!r->workers)
        r->workers = sp_pool_create(r->wanted.threads, err);
    return r->workers != NULL;
}

static bool draw_composed(struct sp_renderer *r, struct sp_renderer_frame *f,
                          struct sp_error *err) {
    const size_t idle_bytes = (size_t)64 << 20;
    struct composing composing = { r, f };
    if (open_workers(r, err) && !r->frames && (r->frames = sp_frame_pool_create(idle_bytes, err)))
        sp_frame_pool_set_budget(r->frames, r->wanted.frame_budget);
    if (!r->workers || !r->frames)
        return false;
    sp_renderer_name_backend(f->job.frame, &r->info);
    const struct sp_compose_job job = { .volume = f->job.volume,
                                        .view = &f->view,
                                        .workers = r->workers,
                                        .frames = r->frames,
                                        .interrupt = sp_job_interrupt(&f->job),
                                        .draw = draw_part,
                                        .user = &composing };
    return sp_compose(&job, f->job.frame, err);
}

/* Filters the pixels of the finished image as its samples need. Without memory for it the image
 * stays as it is. */
static void antialias(struct sp_renderer *r, const struct sp_renderer_frame *f) {
    if (!sp_layers_have_volume(&f->view))
        return;
    const float strength =
        sp_resample_antialiasing(&f->view, &sp_volume_info(f->job.volume)->grid, f->job.mip_level);
    sp_arena_reset(&r->rows);
    if (strength > 0 && open_workers(r, NULL))
        sp_antialias(f->job.frame, strength, &r->rows, r->workers, NULL);
}

/* A footprint that reaches across the plane of the eye has the depth of its centre, which may lie
 * behind the eye. What a pixel shows in perspective lies behind the near plane. */
static void bound_depth(struct sp_frame *frame, const struct sp_camera *camera) {
    const float near = (float)camera->near;
    if (!frame->depth || camera->projection != SP_PERSPECTIVE)
        return;
    for (uint32_t y = 0; y < frame->height; y++) {
        float *depths = sp_depth_row(frame, frame->depth, y);
        for (uint32_t x = 0; x < frame->width; x++)
            depths[x] = depths[x] < near ? near : depths[x];
    }
}

unsigned sp_renderer_depth(const struct sp_renderer *renderer) {
    unsigned depth = atomic_load(&renderer->backend)->depth;
    return depth > 1 ? depth : 1;
}

/* Hands the frame to a backend that takes several frames at a time, unless an older frame has still
 * to be handed over. sp_renderer_finish() reports a failure. */
static void begin(struct sp_renderer *r, struct sp_renderer_frame *f) {
    const struct sp_backend *backend = atomic_load(&r->backend);
    for (unsigned i = 0; i < r->begun; i++)
        if (!sp_renderer_frame_at(r, i)->is_begun)
            return;
    if (sp_view_draws_slices(&f->view) || !sp_support_check_layers(backend, &f->view, NULL))
        return;
    f->is_begun = r->begun < backend->depth && backend->begin(r->state, &f->job, &f->why);
    for (unsigned i = 0; f->why.code == SP_ERR_BACKEND && i < r->begun; i++)
        sp_renderer_frame_at(r, i)->is_begun = false;
}

static void evict(const struct sp_backend *backend, void *state, const struct sp_volume *volume) {
    if (backend && backend->evict)
        backend->evict(state, volume);
}

/* Replaces what the caches have of the last edited volume by what they will have of this one. */
static void set_edited(struct sp_renderer *r, struct sp_volume *edited) {
    if (r->edited == edited || r->begun > 0)
        return;
    if (r->edited) {
        evict(atomic_load(&r->backend), r->state, r->edited);
        evict(r->fallback.backend, r->fallback.state, r->edited);
    }
    sp_volume_unref(&r->edited);
    r->edited = sp_volume_ref(edited);
}

bool sp_renderer_begin(struct sp_renderer *renderer, struct sp_volume *volume,
                       const struct sp_view *view, struct sp_frame_pool *pool,
                       const struct sp_render_options *options, struct sp_error *err) {
    static const struct sp_render_options defaults = { .format = SP_RGBA8 };
    const struct sp_render_options *o = options ? options : &defaults;
    double start_ms = sp_clock_ms(), start_cpu_ms = sp_clock_cpu_ms();
    assert(renderer->begun < SP_IN_FLIGHT_MAX && o->mip_level <= SP_MIP_LEVEL_MAX);
    if ((!o->is_valid && !sp_view_validate(view, err)) ||
        !sp_renderer_supports(renderer, view, err) ||
        !sp_view_fits(view, sp_volume_info(volume), err))
        return false;
    struct sp_renderer_frame *f = sp_renderer_frame_at(renderer, renderer->begun);
    if (!sp_renderer_prepare(renderer, f, volume, view, pool, o, err))
        return false;
    if (f->job.volume != volume)
        set_edited(renderer, f->job.volume);
    f->is_begun = false;
    f->why.code = SP_OK;
    begin(renderer, f);
    renderer->begun++;
    f->ms = sp_clock_ms() - start_ms;
    f->cpu_ms = sp_clock_cpu_ms() - start_cpu_ms;
    return true;
}

static void trim(const struct sp_backend *backend, void *state) {
    if (backend && backend->trim)
        backend->trim(state);
}

void sp_renderer_trim(struct sp_renderer *renderer) {
    assert(renderer->begun == 0);
    trim(atomic_load(&renderer->backend), renderer->state);
    trim(renderer->fallback.backend, renderer->fallback.state);
    if (renderer->frames)
        sp_frame_pool_trim(renderer->frames);
    sp_arena_trim(&renderer->rows);
}

/* Leaves the memory to others if it is scarce. */
static void trim_if_tight(struct sp_renderer *r) {
    const struct sp_budget *budget = r->wanted.frame_budget;
    if (r->begun == 0 && sp_budget_total(budget) > sp_budget_limit(budget) / 2)
        sp_renderer_trim(r);
}

struct sp_frame *sp_renderer_finish(struct sp_renderer *renderer, struct sp_error *err) {
    assert(renderer->begun > 0);
    struct sp_renderer_frame *f = sp_renderer_frame_at(renderer, 0);
    double start_ms = sp_job_clock_ms(&f->job), start_cpu_ms = sp_clock_cpu_ms();
    bool ok = sp_view_draws_slices(&f->view) ? draw_composed(renderer, f, err)
                                             : sp_renderer_draw(renderer, f, err);
    if (ok)
        antialias(renderer, f);
    bound_depth(f->job.frame, &f->view.camera);
    struct sp_frame *frame = ok ? sp_frame_ref(f->job.frame) : NULL;
    if (frame) {
        frame->stats.render_ms = fmax(f->ms + sp_job_clock_ms(&f->job) - start_ms, 0);
        frame->stats.bricks = f->bricks;
        frame->stats.cpu_ms = f->cpu_ms + sp_clock_cpu_ms() - start_cpu_ms;
    }
    pop_oldest(renderer);
    trim_if_tight(renderer);
    return frame;
}

struct sp_frame *sp_renderer_render(struct sp_renderer *renderer, struct sp_volume *volume,
                                    const struct sp_view *view, struct sp_frame_pool *pool,
                                    const struct sp_render_options *options, struct sp_error *err) {
    assert(renderer->begun == 0);
    return sp_renderer_begin(renderer, volume, view, pool, options, err)
               ? sp_renderer_finish(renderer, err)
               : NULL;
}

void sp_renderer_evict(struct sp_renderer *renderer, const struct sp_volume *volume) {
    if (sp_volume_is_of(renderer->edited, volume))
        sp_volume_unref(&renderer->edited);
    evict(atomic_load(&renderer->backend), renderer->state, volume);
    evict(renderer->fallback.backend, renderer->fallback.state, volume);
}

static uint64_t memory(const struct sp_backend *backend, const void *state,
                       const struct sp_volume *volume) {
    return backend && backend->memory ? backend->memory(state, volume) : 0;
}

uint64_t sp_renderer_memory(const struct sp_renderer *renderer, const struct sp_volume *volume) {
    uint64_t edited = renderer->edited && sp_volume_is_of(renderer->edited, volume)
                          ? sp_volume_info(renderer->edited)->voxel_bytes
                          : 0;
    return edited + memory(atomic_load(&renderer->backend), renderer->state, volume) +
           memory(renderer->fallback.backend, renderer->fallback.state, volume);
}
