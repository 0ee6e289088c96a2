/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/cpu/draw.h"

#include "backend/cpu/caches.h"
#include "backend/cpu/general.h"
#include "backend/cpu/layers.h"

/* Draws the frame by the fast path if that is worthwhile; *is_drawn says whether it did. */
static bool draw_fast(struct cpu_frame *f, bool *is_drawn, struct sp_error *err) {
    struct cpu_state *state = f->state;
    struct sp_postconv postconv;
    struct sp_postconv_input input = { .view = f->job->view,
                                       .frame = f->job->frame,
                                       .interrupt = sp_job_interrupt(f->job),
                                       .tables = &state->postconv,
                                       .camera = &f->camera,
                                       .shade = f->shading,
                                       .grid = &f->levels[0].grid,
                                       .parts = f->parts,
                                       .detail = &f->detail,
                                       .fragments = f->fragments,
                                       .axis = f->axis,
                                       .classify_ms = f->stage_ms[CPU_CLASSIFY],
                                       .draw_tile = state->kernels.postconv_tile,
                                       .pool = state->pool,
                                       .arena = &state->arena };
    if (!sp_postconv_prepare(&input, &postconv, err))
        return false;
    f->stage_ms[CPU_SPLAT] += postconv.prepare_ms;
    *is_drawn = sp_postconv_is_worthwhile(&postconv);
    if (!*is_drawn)
        return true;
    cpu_frame_write_stats(f);
    return sp_postconv_draw(&input, &postconv, err);
}

/* What is made once for a transfer function counts as classification. */
static void add_light_time(struct sp_frame_stats *stats, const struct sp_light_field *light,
                           double ms) {
    if (light->is_made)
        stats->stages[0].ms += ms;
    else
        stats->stages[stats->stage_count++] = (struct sp_stage_time){ "light", ms };
}

/* Draws the volume and the channels of the view, of which `input` has what all of them share. */
static bool draw_channels(const struct sp_backend_job *job, struct sp_resample_input *input,
                          struct sp_error *err) {
    const struct sp_view *view = job->view;
    struct sp_resample_input inputs[SP_LAYERS_MAX], *last = NULL;
    for (uint32_t i = 0; i < view->layer_count; i++) {
        struct sp_resample_input *own = last ? last + 1 : inputs;
        if (view->layers[i].type != SP_LAYER_VOLUME && view->layers[i].type != SP_LAYER_CHANNEL)
            continue;
        *own = *input;
        if (view->layers[i].type == SP_LAYER_CHANNEL) {
            struct sp_view *seen = sp_arena_alloc(input->arena, "channels", 1, sizeof *seen);
            if (!seen)
                return sp_arena_fail(input->arena, "data", err);
            sp_layers_channel_view(view, i, sp_volume_info(job->layer_volumes[i]), seen);
            own->view = seen;
            own->volume = job->layer_volumes[i];
        }
        if (last) {
            last->next = own;
            own->fragments = NULL;
        }
        last = own;
    }
    return sp_resample_draw(inputs, err);
}

static bool draw_resampled(struct cpu_state *state, const struct sp_backend_job *job,
                           struct sp_fragments *fragments, struct sp_error *err) {
    struct sp_camera_transform camera;
    struct sp_shade shade;
    struct sp_light_field light;
    bool is_lit = job->view->shading.mode == SP_SHADING_PHONG;
    bool has_light = sp_light_is_wanted(job->view);
    sp_camera_transform_init(&camera, &job->view->camera, job->view->size);
    if (is_lit)
        sp_shade_init(&shade, &camera, &job->view->shading);
    const struct sp_light_job light_job = { .volume = job->volume,
                                            .view = job->view,
                                            .clip = job->light_clip,
                                            .direction = is_lit && shade.light_count
                                                             ? shade.lights[0].world
                                                             : NULL,
                                            .bytes_max = cpu_cache_rest(state, CPU_CACHE_LIGHT),
                                            .kernels = &state->kernels.light,
                                            .pool = state->pool,
                                            .interrupt = sp_job_interrupt(job) };
    double begin = sp_job_clock_ms(job);
    if (has_light && !sp_light_get(&state->light, &light_job, &light, err))
        return false;
    double light_ms = sp_job_clock_ms(job) - begin;
    struct sp_resample_input input = { .view = job->view,
                                       .whole = job->light_clip,
                                       .volume = job->volume,
                                       .frame = job->frame,
                                       .interrupt = sp_job_interrupt(job),
                                       .camera = &camera,
                                       .shade = is_lit ? &shade : NULL,
                                       .light = has_light ? &light : NULL,
                                       .fragments = fragments,
                                       .cache = &state->samples,
                                       .bytes_max = cpu_cache_rest(state, CPU_CACHE_SAMPLES),
                                       .mip_level = job->mip_level,
                                       .is_draft = job->is_draft,
                                       .draw_tile = state->kernels.resample_tile,
                                       .compute_ranges = state->kernels.ranges_compute,
                                       .pool = state->pool,
                                       .arena = &state->arena };
    if (!draw_channels(job, &input, err))
        return false;
    if (has_light)
        add_light_time(&job->frame->stats, &light, light_ms);
    return true;
}

static bool draw_classified(struct cpu_state *state, const struct sp_backend_job *job,
                            struct sp_fragments *fragments, struct sp_error *err) {
    struct cpu_frame frame;
    const struct sp_grid *grid = &sp_volume_info(job->volume)->grid;
    bool can_be_fast = state->kernels.has_fast_path && sp_postconv_can_draw(job->view, grid);
    bool is_drawn = false;
    state->cache.limit_bytes = cpu_cache_rest(state, CPU_CACHE_LISTS);
    if (!cpu_frame_init(&frame, state, job, err))
        return false;
    frame.fragments = fragments;
    if (can_be_fast && !draw_fast(&frame, &is_drawn, err))
        return false;
    return is_drawn || cpu_general_draw(&frame, err);
}

static bool draw(struct cpu_state *state, const struct sp_backend_job *job, struct sp_error *err) {
    struct sp_frame_stats *stats = &job->frame->stats;
    struct cpu_layers layers;
    struct sp_fragments *fragments = NULL;
    double begin = sp_job_clock_ms(job), layers_ms = 0;
    sp_arena_reset(&state->arena);
    if (sp_layers_are_wanted(job->view)) {
        if (!cpu_layers_draw(state, job, &layers, err))
            return false;
        if (!sp_layers_have_volume(job->view))
            return true;
        fragments = &layers.fragments;
        layers_ms = sp_job_clock_ms(job) - begin;
    }
    if (!(sp_resample_draws(job->view) ? draw_resampled(state, job, fragments, err)
                                       : draw_classified(state, job, fragments, err)))
        return false;
    if (fragments && stats->stage_count < SP_STAGES_MAX)
        stats->stages[stats->stage_count++] =
            (struct sp_stage_time){ "layers", layers_ms + fragments->ms };
    return true;
}

static bool has_layer(const struct sp_view *view, enum sp_layer_type type) {
    for (uint32_t i = 0; i < view->layer_count; i++)
        if (view->layers[i].type == type)
            return true;
    return false;
}

/* True if frames of the view use the cache. */
static bool needs_cache(const struct sp_view *view, enum cpu_cache cache) {
    bool is_resampled = sp_resample_draws(view), has_volume = sp_layers_have_volume(view);
    switch (cache) {
    case CPU_CACHE_LISTS:
        return has_volume && !is_resampled;
    case CPU_CACHE_SAMPLES:
        return has_volume && is_resampled;
    case CPU_CACHE_LIGHT:
        return has_volume && is_resampled && sp_light_is_wanted(view);
    case CPU_CACHE_SURFACES:
        return has_layer(view, SP_LAYER_SURFACE);
    case CPU_CACHE_SHELLS:
        return has_layer(view, SP_LAYER_SHELL);
    case CPU_CACHE_VECTORS:
        return has_layer(view, SP_LAYER_VECTORS);
    case CPU_CACHE_CLOUDS:
        return has_layer(view, SP_LAYER_POINTS);
    case CPU_CACHES:
        break;
    }
    return false;
}

/* Evicts the caches that the view does not need. False if they are empty. */
static bool free_other_caches(struct cpu_state *state, const struct sp_view *view) {
    uint64_t bytes = 0;
    for (enum cpu_cache cache = 0; cache < CPU_CACHES; cache++) {
        if (needs_cache(view, cache))
            continue;
        bytes += cpu_cache_bytes(state, cache, NULL);
        cpu_cache_evict(state, cache, NULL);
    }
    return bytes > 0;
}

bool cpu_draw(void *pointer, const struct sp_backend_job *job, struct sp_error *err) {
    struct cpu_state *state = pointer;
    struct sp_error why = { 0 };
    bool is_drawn = draw(state, job, &why);
    if (!is_drawn && why.code == SP_ERR_BUDGET && free_other_caches(state, job->view))
        is_drawn = draw(state, job, &why);
    if (!is_drawn && err)
        *err = why;
    return is_drawn;
}
