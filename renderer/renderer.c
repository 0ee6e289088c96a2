/* SPDX-License-Identifier: Apache-2.0 */
#include "sp/renderer.h"

#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "backend/backend.h"
#include "backend/defaults.h"
#include "backend/support.h"
#include "base/clock.h"
#include "data/volume/volume.h"
#include "draw/layers/layers.h"
#include "draw/layers/others.h"
#include "draw/light/light.h"
#include "draw/resample/resample.h"
#include "draw/slices/slices.h"
#include "draw/working_set/channels.h"
#include "draw/working_set/shown.h"
#include "sp/budget.h"
#include "sp/edit.h"
#include "sp/inflight.h"
#include "sp/log.h"

/* A frame in flight. */
struct inflight {
    struct sp_backend_job job;  /* with references to volume and frame */
    struct sp_volume *original; /* a reference: the volume without the view's edits */
    struct sp_others others;    /* with references */
    struct sp_view view;
    struct sp_frame_bricks bricks;
    bool is_begun;       /* the backend works on it */
    bool may_be_pre;     /* order "auto" chose post, and pre is possible, too */
    struct sp_error why; /* why the backend's begin() failed; SP_OK = it did not fail */
    double ms, cpu_ms;   /* spent in sp_renderer_begin() */
};

/* Draws frames that the backend cannot draw. All zero until the first such frame. */
struct fallback {
    const struct sp_backend *backend;
    void *state;
    struct sp_renderer_info info;
    bool is_missing; /* no other backend starts */
};

struct sp_renderer {
    _Atomic(const struct sp_backend *) backend; /* other threads read it */
    void *state;
    struct sp_renderer_info info;
    struct fallback fallback;
    struct sp_backend_options wanted; /* for every backend that is started; isa is owned */
    bool is_auto;                     /* created with "auto": may change the backend */
    unsigned failures;                /* of the backend, in a row */
    struct inflight queue[SP_IN_FLIGHT_MAX];
    struct sp_volume *edited; /* the last one that was drawn, a reference; NULL = none */
    unsigned oldest, begun;   /* a ring: `begun` frames from queue[oldest] on */
    struct sp_pool *workers;  /* compose slices; both are NULL until the first one */
    struct sp_frame_pool *frames;
};

enum { GPUS_MAX = 64, FAILURES_MAX = 3 };

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

/* Adopts a backend that has just started. */
static void adopt(struct sp_renderer *r, const struct sp_backend *backend, void *state) {
    r->state = state;
    r->failures = 0;
    backend->info(state, &r->info);
    atomic_store(&r->backend, backend);
    sp_log(SP_LOG_INFO, "backend %s renders on %s%s%s", r->info.backend, r->info.device,
           r->info.isa[0] ? " with " : "", r->info.isa);
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
    r->is_auto = strcmp(name, "auto") == 0;
    const struct sp_backend *backend = NULL;
    void *state = NULL;
    if (read_options(r, o, err))
        backend = sp_registry_start(name, &r->wanted, &state, err);
    r->wanted.refused = NULL; /* the caller's user pointer is valid in this call only */
    if (backend)
        adopt(r, backend, state);
    else
        sp_renderer_destroy(&r);
    return r;
}

static struct inflight *inflight_at(struct sp_renderer *r, unsigned i) {
    return &r->queue[(r->oldest + i) % SP_IN_FLIGHT_MAX];
}

/* Removes the oldest frame from the queue. */
static void pop_oldest(struct sp_renderer *r) {
    struct inflight *f = inflight_at(r, 0);
    sp_volume_unref(&f->job.volume);
    sp_volume_unref(&f->original);
    sp_others_finish(&f->others);
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
    free((char *)r->wanted.isa);
    free(r);
    *renderer = NULL;
}

void sp_renderer_info(const struct sp_renderer *renderer, struct sp_renderer_info *info) {
    *info = renderer->info;
}

/* The order that "auto" stands for. Interpolated sheets are sharper and need no filter. A view that
 * chooses a filter is drawn with it. Means of classified voxels are closer to the truth than means
 * of values, so views use them whose voxels are much smaller than pixels. They are not used for
 * smaller differences, so that a smaller frame looks like a larger one. Coarse frames keep sheets:
 * they look like the sharp frame, and a new transfer function costs them nothing. */
static enum sp_tf_order choose_order(const struct sp_renderer *r, const struct sp_volume *volume,
                                     const struct sp_view *v) {
    const struct sp_backend *backend = atomic_load(&r->backend);
    struct sp_camera_transform camera;
    if (sp_compositing_is_projection(v->compositing.mode)) /* of interpolated values */
        return SP_TF_POST;
    if (v->transfer_function.order != SP_TF_AUTO)
        return v->transfer_function.order;
    if (sp_light_is_wanted(v) || sp_view_has_channels(v)) /* support.c has found sheets */
        return SP_TF_POST;
    if (v->compositing.mode == SP_COMPOSITE_SPLAT || !backend->capabilities.interpolated_sheets ||
        !sp_view_has_default_filter(v))
        return SP_TF_PRE;
    sp_camera_transform_init(&camera, &v->camera, v->size);
    return sp_resample_level(&sp_volume_info(volume)->grid, &camera) < 2 ? SP_TF_POST : SP_TF_PRE;
}

bool sp_renderer_supports(const struct sp_renderer *renderer, const struct sp_view *view,
                          struct sp_error *err) {
    const struct sp_backend *backend = atomic_load(&renderer->backend);
    bool is_alone = !renderer->is_auto || renderer->wanted.require_gpu;
    return sp_view_validate(view, err) && sp_support_check(backend, view, err) &&
           sp_support_check_kind(backend, is_alone, view, err);
}

/* Starts the backend after this one, unless it runs already. False if no other backend starts, or
 * if the caller has named the backend to use. */
static bool start_fallback(struct sp_renderer *r) {
    struct fallback *s = &r->fallback;
    if (r->is_auto && !s->backend && !s->is_missing) {
        s->backend = sp_registry_follow(atomic_load(&r->backend), &r->wanted, &s->state, NULL);
        s->is_missing = !s->backend;
        if (s->backend)
            s->backend->info(s->state, &s->info);
    }
    return s->backend != NULL;
}

/* Replaces the failing backend by the next one; false if there is none. */
static bool fail_over(struct sp_renderer *r, const struct sp_error *why) {
    const struct sp_backend *failed = atomic_load(&r->backend);
    void *failed_state = r->state;
    r->fallback.is_missing = false; /* try again: it may start now */
    if (!start_fallback(r))
        return false;
    const struct fallback next = r->fallback;
    r->fallback = (struct fallback){ .backend = NULL };
    adopt(r, next.backend, next.state);
    failed->destroy(failed_state);
    snprintf(r->info.failover_reason, sizeof r->info.failover_reason,
             "backend %s failed %d times in a row: %.300s", failed->entry.name, FAILURES_MAX,
             why->text);
    sp_log(SP_LOG_WARN, "%s; backend %s has taken over", r->info.failover_reason, r->info.backend);
    return true;
}

/* Names the backend that draws the frame in its statistics. */
static void name_backend(struct sp_frame *frame, const struct sp_renderer_info *by) {
    frame->stats =
        (struct sp_frame_stats){ .backend = by->backend, .isa = by->isa, .threads = by->threads };
    memcpy(frame->stats.device, by->device, sizeof by->device);
}

/* True if the backend works but cannot draw this view. */
static bool is_beyond_backend(const struct sp_error *why) {
    return why->code == SP_ERR_MEMORY || why->code == SP_ERR_BUDGET ||
           why->code == SP_ERR_UNSUPPORTED;
}

/* Draws a frame on the fallback backend, whose cache then serves other frames of this kind. False
 * with *why set if there is no fallback that supports the view, or if it fails. */
static bool draw_on_fallback(struct sp_renderer *r, const struct inflight *f,
                             struct sp_error *why) {
    struct fallback *s = &r->fallback;
    if (!start_fallback(r) || !sp_support_check(s->backend, &f->view, NULL))
        return false;
    const struct sp_error first = *why;
    name_backend(f->job.frame, &s->info);
    if (!s->backend->render(s->state, &f->job, why))
        return false;
    if (!r->info.fallback_reason[0]) {
        snprintf(r->info.fallback_reason, sizeof r->info.fallback_reason,
                 "backend %s cannot draw some views, which %s draws: %.300s", r->info.backend,
                 s->info.backend, first.text);
        sp_log(SP_LOG_WARN, "%s", r->info.fallback_reason);
    }
    return true;
}

/* Draws the frame on the backend. False with *why set; after SP_ERR_BACKEND the backend works on no
 * frame any more. */
static bool draw_once(struct sp_renderer *r, struct inflight *f, struct sp_error *why) {
    const struct sp_backend *backend = atomic_load(&r->backend);
    bool ok = false, is_begun = f->is_begun;
    f->is_begun = false;
    name_backend(f->job.frame, &r->info);
    if (f->why.code != SP_OK)
        *why = f->why;
    else if (!sp_support_check_layers(backend, &f->view, why))
        ok = false;
    else if (is_begun)
        ok = backend->finish(r->state, &f->job, why);
    else
        ok = backend->render(r->state, &f->job, why);
    f->why.code = SP_OK;
    for (unsigned i = 0; !ok && why->code == SP_ERR_BACKEND && i < r->begun; i++)
        inflight_at(r, i)->is_begun = false;
    return ok;
}

/* Order "auto" becomes pre for a frame that does not fit the memory as post; false = it does not.
 * Lists of visible voxels may be much smaller than the volume's samples. */
static bool choose_pre(struct inflight *f, const struct sp_error *why) {
    if (!f->may_be_pre || (why->code != SP_ERR_MEMORY && why->code != SP_ERR_BUDGET))
        return false;
    f->view.transfer_function.order = SP_TF_PRE;
    f->may_be_pre = false;
    return true;
}

/* Draws the frame. A backend that fails is tried again, so that no frame is lost if its device
 * comes back, and replaced after three failures in a row. Failures that are due to the view or to
 * memory do not count. */
static bool draw(struct sp_renderer *r, struct inflight *f, struct sp_error *err) {
    struct sp_error why = { .code = SP_OK };
    while (!draw_once(r, f, &why)) {
        bool again = why.code == SP_ERR_BACKEND;
        if (is_beyond_backend(&why) && draw_on_fallback(r, f, &why))
            return true;
        if (choose_pre(f, &why))
            continue;
        if (again) {
            sp_log(SP_LOG_WARN, "backend %s failed: %s", r->info.backend, why.text);
            again = ++r->failures < FAILURES_MAX || fail_over(r, &why);
        }
        if (!again || sp_job_is_cancelled(&f->job) ||
            !sp_support_check(atomic_load(&r->backend), &f->view, &why))
            return sp_fail(err, why.code, why.place, "%s", why.text);
    }
    r->failures = 0;
    return true;
}

/* A frame with slices in it. */
struct composing {
    struct sp_renderer *renderer;
    const struct inflight *whole;
};

/* Adds the statistics of a part to those of the whole frame. */
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
    struct inflight part = *c->whole;
    part.view.clip = *clip;
    memset(part.view.background, 0, sizeof part.view.background);
    part.view.slices.mode = SP_SLICES_NONE;
    part.job.view = &part.view;
    part.job.frame = frame;
    part.job.light_clip = &c->whole->view.clip;
    if (!draw(c->renderer, &part, err))
        return false;
    add_stats(&c->whole->job.frame->stats, &frame->stats);
    return true;
}

static bool draw_composed(struct sp_renderer *r, struct inflight *f, struct sp_error *err) {
    const size_t idle_bytes = (size_t)64 << 20;
    struct composing composing = { r, f };
    if (!r->workers)
        r->workers = sp_pool_create(r->wanted.threads, err);
    if (r->workers && !r->frames && (r->frames = sp_frame_pool_create(idle_bytes, err)))
        sp_frame_pool_set_budget(r->frames, r->wanted.frame_budget);
    if (!r->workers || !r->frames)
        return false;
    name_backend(f->job.frame, &r->info);
    const struct sp_compose_job job = { .volume = f->job.volume,
                                        .view = &f->view,
                                        .workers = r->workers,
                                        .frames = r->frames,
                                        .interrupt = sp_job_interrupt(&f->job),
                                        .draw = draw_part,
                                        .user = &composing };
    return sp_compose(&job, f->job.frame, err);
}

unsigned sp_renderer_depth(const struct sp_renderer *renderer) {
    unsigned depth = atomic_load(&renderer->backend)->depth;
    return depth > 1 ? depth : 1;
}

/* Hands the frame to a backend that takes several frames at a time, unless an older frame has still
 * to be handed over. sp_renderer_finish() reports a failure. */
static void begin(struct sp_renderer *r, struct inflight *f) {
    const struct sp_backend *backend = atomic_load(&r->backend);
    for (unsigned i = 0; i < r->begun; i++)
        if (!inflight_at(r, i)->is_begun)
            return;
    if (sp_view_draws_slices(&f->view) || !sp_support_check_layers(backend, &f->view, NULL))
        return;
    f->is_begun = r->begun < backend->depth && backend->begin(r->state, &f->job, &f->why);
    for (unsigned i = 0; f->why.code == SP_ERR_BACKEND && i < r->begun; i++)
        inflight_at(r, i)->is_begun = false;
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

/* Replaces the volumes of channels by what the view's edits leave of them. */
static bool edit_channels(const struct sp_view *view, struct sp_others *others,
                          struct sp_error *err) {
    for (uint32_t i = 0; i < view->layer_count && view->edit_count > 0; i++) {
        struct sp_view own;
        if (!view->layers[i].visible || view->layers[i].type != SP_LAYER_CHANNEL)
            continue;
        sp_layers_channel_view(view, i, sp_volume_info(others->shown[i]), &own);
        struct sp_volume *edited = sp_edit_volume(others->shown[i], &own, err);
        if (!edited)
            return false;
        sp_volume_unref(&others->shown[i]);
        others->shown[i] = edited;
    }
    return true;
}

/* Drops hidden layers, and says which volume each of the others shows. */
static void choose_layers(struct inflight *f) {
    const bool has_elements = sp_volume_elements(f->original);
    uint32_t kept = 0;
    for (uint32_t i = 0; i < f->view.layer_count; i++) {
        const struct sp_layer *layer = &f->view.layers[i];
        if (!layer->visible)
            continue;
        f->job.shown[kept] = f->others.shown[i] ? f->others.shown[i]
                             : has_elements     ? f->original
                                                : NULL;
        f->job.colors[kept] = f->others.colors[i];
        f->view.layers[kept++] = *layer;
    }
    f->view.layer_count = kept;
}

bool sp_renderer_begin(struct sp_renderer *renderer, struct sp_volume *volume,
                       const struct sp_view *view, struct sp_frame_pool *pool,
                       const struct sp_render_options *options, struct sp_error *err) {
    static const struct sp_render_options defaults = { .format = SP_RGBA8 };
    const struct sp_render_options *o = options ? options : &defaults;
    double start_ms = sp_clock_ms(), start_cpu_ms = sp_clock_cpu_ms();
    assert(renderer->begun < SP_IN_FLIGHT_MAX && o->mip_level <= SP_MIP_LEVEL_MAX);
    if (!sp_renderer_supports(renderer, view, err) ||
        !sp_view_fits(view, sp_volume_info(volume), err))
        return false;
    const struct sp_backend *backend = atomic_load(&renderer->backend);
    struct inflight *f = inflight_at(renderer, renderer->begun);
    struct sp_volume *edited = NULL;
    struct sp_frame *frame = NULL;
    struct sp_shown shown = { .volume = NULL };
    const struct sp_shown_job wanted = { .view = view,
                                         .options = o,
                                         .reads_blocks = backend->capabilities.blocks };
    if (sp_others_find(view, volume, o, &f->others, err) &&
        sp_shown_find(volume, &wanted, &shown, err) &&
        sp_channels_show(volume, &wanted, &shown, f->others.shown, err) &&
        sp_shown_find_colors(view, o, &shown, f->others.colors, err) &&
        edit_channels(&shown.view, &f->others, err))
        edited = sp_edit_volume(shown.volume, &shown.view, err);
    sp_volume_unref(&shown.volume);
    if (edited)
        frame = sp_frame_create(pool, view->size[0], view->size[1], o->format, err);
    if (!frame) {
        sp_volume_unref(&edited);
        sp_others_finish(&f->others);
        return false;
    }
    if (edited != volume)
        set_edited(renderer, edited);
    frame->is_opaque = view->background[3] == 1; /* frame/resolve.h */
    f->view = shown.view;
    f->bricks = shown.bricks;
    const bool has_blocks = sp_volume_blocks(edited) != NULL;
    f->view.transfer_function.order =
        has_blocks ? SP_TF_POST : choose_order(renderer, edited, view);
    bool is_projection = sp_compositing_is_projection(view->compositing.mode);
    if (is_projection)
        f->view.shading.mode = SP_SHADING_NONE;
    f->may_be_pre = !is_projection && view->transfer_function.order == SP_TF_AUTO &&
                    f->view.transfer_function.order == SP_TF_POST && !sp_light_is_wanted(view) &&
                    !sp_view_has_channels(view) && !has_blocks;
    f->original = sp_volume_ref(volume);
    f->job = (struct sp_backend_job){ .volume = edited,
                                      .view = &f->view,
                                      .mip_level = shown.mip_level,
                                      .frame = frame,
                                      .cancel = o->cancel,
                                      .pause = o->pause };
    choose_layers(f);
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
}

/* Leaves the memory to others if it is scarce. */
static void trim_if_tight(struct sp_renderer *r) {
    const struct sp_budget *budget = r->wanted.frame_budget;
    if (r->begun == 0 && sp_budget_total(budget) > sp_budget_limit(budget) / 2)
        sp_renderer_trim(r);
}

struct sp_frame *sp_renderer_finish(struct sp_renderer *renderer, struct sp_error *err) {
    assert(renderer->begun > 0);
    struct inflight *f = inflight_at(renderer, 0);
    double start_ms = sp_job_clock_ms(&f->job), start_cpu_ms = sp_clock_cpu_ms();
    bool ok =
        sp_view_draws_slices(&f->view) ? draw_composed(renderer, f, err) : draw(renderer, f, err);
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
