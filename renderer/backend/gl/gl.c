/* SPDX-License-Identifier: Apache-2.0
 *
 * The GPU backend: one implementation with two entries, for hardware and for software GL.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "backend/gl/context.h"
#include "backend/gl/egl.h"
#include "backend/gl/state.h"

static void name_device(struct gl_state *state) {
    const struct gl_info *info = gl_context_info(state->context);
    snprintf(state->device, sizeof state->device, "%.90s%s", info->renderer,
             info->software ? ", software GL, for correctness only" : "");
}

/* Drops a lost context, and the fences of frames in flight with it. */
static void drop_context(struct gl_state *state) {
    gl_context_destroy(&state->context);
    gl_residency_lose(&state->residency);
    for (int i = 0; i < GL_IN_FLIGHT; i++)
        state->slots[i].readback.fence = NULL;
}

/* Destroys the context and everything on it. */
static void stop(struct gl_state *state) {
    if (state->context && gl_context_bind(state->context, NULL)) {
        gl_draw_finish(state);
        gl_context_unbind(state->context);
    }
    drop_context(state);
}

static void gl_destroy(void *pointer) {
    struct gl_state *state = pointer;
    stop(state);
    sp_classify_cache_evict(&state->cache, NULL);
    sp_samples_evict(&state->samples, NULL);
    gl_layers_evict(&state->layers, NULL);
    sp_pool_destroy(&state->pool);
    sp_arena_finish(&state->arena);
    gl_partition_finish(&state->partition);
    free(state);
}

/* Creates the objects on the context that never change. A new context after a lost one has none of
 * the old GL names, so gl_draw_finish() clears them first. */
static bool init(struct gl_state *state, struct sp_error *err) {
    const struct sp_backend_options budget = { .video_bytes = state->video_bytes,
                                               .memory_bytes = state->memory_bytes };
    if (!gl_context_bind(state->context, err))
        return false;
    state->residency.limit_bytes = gl_video_budget(gl_context_info(state->context), &budget);
    state->options.gpu = gl_context_info(state->context)->gpu;
    state->options.platform = gl_context_info(state->context)->platform;
    name_device(state);
    gl_draw_finish(state);
    bool ok = gl_draw_init(state, err);
    gl_context_unbind(state->context);
    return ok;
}

struct starting {
    struct gl_state *state;
    const struct sp_backend_options *options; /* NULL = the state passed the checks before */
};

static bool start_with(void *user, struct gl_context *context, struct sp_error *err) {
    const struct starting *s = user;
    const struct sp_backend_options *o = s->options;
    s->state->context = context;
    bool ok = init(s->state, err) && (!o || !o->passes || o->passes(o->user, s->state, err));
    if (!ok)
        stop(s->state);
    return ok;
}

/* Starts on the first place that works; after a lost context only on the same place. */
static bool start(struct gl_state *state, const struct sp_backend_options *options,
                  struct sp_error *err) {
    const struct gl_options wanted = state->options;
    struct starting starting = { state, options };
    bool ok = gl_contexts_try(&wanted, start_with, &starting, err);
    if (!ok)
        state->options = wanted;
    return ok;
}

/* Creates a state without a context. */
static struct gl_state *make(const struct sp_backend_options *options, bool software,
                             struct sp_error *err) {
    struct gl_state *state = calloc(1, sizeof *state);
    if (!state) {
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the gl backend");
        return NULL;
    }
    sp_arena_init(&state->arena);
    state->arena.budget = options->frame_budget;
    gl_partition_init(&state->partition, options->frame_budget);
    state->options = (struct gl_options){ .gpu = options->gpu, .software = software };
    state->video_bytes = options->video_bytes;
    state->memory_bytes = state->cache.limit_bytes = options->memory_bytes;
    state->pool = sp_pool_create(options->threads, err);
    if (state->pool)
        return state;
    gl_destroy(state);
    return NULL;
}

static void *create(const struct sp_backend_options *options, bool software, struct sp_error *err) {
    struct gl_state *state = make(options, software, err);
    if (state && start(state, options, err))
        return state;
    if (state)
        gl_destroy(state);
    return NULL;
}

bool gl_works(struct gl_context **context, const struct sp_backend_options *options,
              struct sp_error *err) {
    bool software = gl_context_info(*context)->software;
    struct sp_backend_options own = *options;
    if (software)
        own.passes = NULL;
    struct gl_state *state = make(&own, software, err);
    if (!state)
        return false;
    struct starting starting = { state, &own };
    bool ok = start_with(&starting, *context, err);
    *context = NULL;
    gl_destroy(state);
    return ok;
}

static void *gl_create(const struct sp_backend_options *options, struct sp_error *err) {
    return create(options, false, err);
}

static void *gl_create_software(const struct sp_backend_options *options, struct sp_error *err) {
    return create(options, true, err);
}

static void gl_info(const void *pointer, struct sp_renderer_info *info) {
    const struct gl_state *state = pointer;
    *info = (struct sp_renderer_info){ .backend = state->options.software ? "gl-software" : "gl",
                                       .isa = "",
                                       .has_depth = true,
                                       .threads = sp_pool_threads(state->pool) };
    memcpy(info->device, state->device, sizeof info->device);
}

/* Unbinds the context, unless frames are in flight: drivers wait for them before they unbind. */
static void unbind(struct gl_state *state) {
    if (state->begun == 0)
        gl_context_unbind(state->context);
}

/* Unbinds the context and reports the result. If the context is lost, all frames in flight fail and
 * the next frame creates a new context. The processor keeps its cached lists, which are uploaded
 * again. */
static bool leave(struct gl_state *state, bool ok, struct sp_error *why, struct sp_error *err) {
    if (state->context && gl_context_is_lost(state->context, why)) {
        drop_context(state);
        ok = false;
    }
    if (state->context && !ok && why->code == SP_ERR_BACKEND)
        gl_draw_drop(state);
    if (state->context)
        unbind(state);
    return ok || sp_fail(err, why->code, why->place, "%s", why->text);
}

/* Makes the context current and creates a new one if there is none. A context that cannot be made
 * current is destroyed. */
static bool enter(struct gl_state *state, struct sp_error *why) {
    bool ok = (state->context || start(state, NULL, why)) && gl_context_bind(state->context, why);
    if (ok)
        return true;
    drop_context(state);
    /* The backend started before, so a missing device now is not the view's fault. */
    why->code = why->code == SP_ERR_MEMORY ? SP_ERR_MEMORY : SP_ERR_BACKEND;
    return false;
}

static bool gl_begin(void *pointer, const struct sp_backend_job *job, struct sp_error *err) {
    struct gl_state *state = pointer;
    struct sp_error why = { .code = SP_OK };
    return leave(state, enter(state, &why) && gl_draw_begin(state, job, &why), &why, err);
}

static bool gl_end(void *pointer, const struct sp_backend_job *job, struct sp_error *err) {
    struct gl_state *state = pointer;
    struct sp_error why = { .code = SP_OK };
    return leave(state, enter(state, &why) && gl_draw_end(state, job, &why), &why, err);
}

static bool gl_render(void *pointer, const struct sp_backend_job *job, struct sp_error *err) {
    return gl_begin(pointer, job, err) && gl_end(pointer, job, err);
}

static void gl_evict(void *pointer, const struct sp_volume *volume) {
    struct gl_state *state = pointer;
    /* The lists of a lost context are already gone. */
    if (state->context && gl_context_bind(state->context, NULL)) {
        gl_residency_evict(&state->residency, volume);
        unbind(state);
    }
    sp_classify_cache_evict(&state->cache, volume);
    sp_samples_evict(&state->samples, volume);
    gl_layers_evict(&state->layers, volume);
}

static uint64_t gl_memory(const void *pointer, const struct sp_volume *volume) {
    const struct gl_state *state = pointer;
    uint64_t bytes = sp_classify_cache_bytes(&state->cache, volume) +
                     sp_samples_bytes(&state->samples, volume) +
                     gl_layers_bytes(&state->layers, volume);
    if (state->context)
        bytes += gl_residency_bytes(&state->residency, volume);
    if (state->context && !volume)
        bytes += gl_draw_bytes(state);
    return bytes;
}

static void gl_trim(void *pointer) {
    struct gl_state *state = pointer;
    sp_arena_trim(&state->arena);
    gl_partition_trim(&state->partition);
}

/* The same as the CPU backend, except light. */
#define CAPABILITIES                                                                               \
    {                                                                                              \
        .projections = SP_CAN(SP_PERSPECTIVE) | SP_CAN(SP_ORTHOGRAPHIC), .filters = SP_CAN_ALL,    \
        .kernels = SP_CAN_ALL, .compositings = SP_CAN_ALL, .attenuations = SP_CAN_ALL,             \
        .orders = SP_CAN_ALL, .shadings = SP_CAN(SP_SHADING_NONE) | SP_CAN(SP_SHADING_PHONG),      \
        .levels_of_detail = SP_CAN(SP_LOD_AUTO) | SP_CAN(SP_LOD_OFF), .gradient_axis = true,       \
        .interpolated_sheets = true, .depth = true, .clip_box = true, .clip_planes = true,         \
        .layers = SP_CAN_ALL & ~SP_CAN(SP_LAYER_CHANNEL)                                           \
    }

extern const struct sp_backend gl_backend, gl_software_backend;
const struct sp_backend gl_backend = {
    .entry = { "gl", "EWA splatting on a GPU, with compute shaders through EGL" },
    .is_gpu = true,
    .capabilities = CAPABILITIES,
    .create = gl_create,
    .destroy = gl_destroy,
    .info = gl_info,
    .render = gl_render,
    .depth = GL_IN_FLIGHT,
    .begin = gl_begin,
    .finish = gl_end,
    .evict = gl_evict,
    .memory = gl_memory,
    .trim = gl_trim,
    .probe = gl_probe, /* lists the devices of both entries */
};
const struct sp_backend gl_software_backend = {
    .entry = { "gl-software", "the same on the processor, by software GL: for tests" },
    .by_name_only = true,
    .capabilities = CAPABILITIES,
    .create = gl_create_software,
    .destroy = gl_destroy,
    .info = gl_info,
    .render = gl_render,
    .depth = GL_IN_FLIGHT,
    .begin = gl_begin,
    .finish = gl_end,
    .evict = gl_evict,
    .memory = gl_memory,
    .trim = gl_trim,
};
