/* SPDX-License-Identifier: Apache-2.0 */
#include "sp/renderer.h"

#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "backend/backend.h"
#include "base/clock.h"

struct sp_renderer {
    const struct sp_backend *backend;
    void *state;
    struct sp_renderer_info info;
};

enum { THREADS_MAX = 256 };

static unsigned count_cores(void) {
    long n = sysconf(_SC_NPROCESSORS_ONLN);
    return n < 1 ? 1 : n > THREADS_MAX ? THREADS_MAX : (unsigned)n;
}

static uint64_t half_of_memory(void) {
    long pages = sysconf(_SC_PHYS_PAGES), page = sysconf(_SC_PAGESIZE);
    return pages > 0 && page > 0 ? (uint64_t)pages * (uint64_t)page / 2 : UINT64_C(1) << 30;
}

struct sp_renderer *sp_renderer_create(const struct sp_renderer_options *options,
                                       struct sp_error *err) {
    static const struct sp_renderer_options defaults;
    const struct sp_renderer_options *o = options ? options : &defaults;
    if (o->threads > THREADS_MAX) {
        sp_fail(err, SP_ERR_INVALID, "", "%u render threads; at most %d can be used", o->threads,
                THREADS_MAX);
        return NULL;
    }
    struct sp_backend_options wanted = { .threads = o->threads ? o->threads : count_cores(),
                                         .memory_bytes =
                                             o->memory_bytes ? o->memory_bytes : half_of_memory(),
                                         .isa = o->isa ? o->isa : "auto" };
    struct sp_renderer *r = calloc(1, sizeof *r);
    if (!r) {
        sp_fail(err, SP_ERR_MEMORY, "", "no memory for a renderer");
        return NULL;
    }
    r->backend = sp_registry_start(o->backend ? o->backend : "auto", &wanted, &r->state, err);
    if (!r->backend) {
        free(r);
        return NULL;
    }
    r->backend->info(r->state, &r->info);
    return r;
}

void sp_renderer_destroy(struct sp_renderer **renderer) {
    struct sp_renderer *r = *renderer;
    if (!r)
        return;
    r->backend->destroy(r->state);
    free(r);
    *renderer = NULL;
}

void sp_renderer_info(const struct sp_renderer *renderer, struct sp_renderer_info *info) {
    *info = renderer->info;
}

/* One choice of the view against a capability mask. `names`: the protocol's words, NULL at the end.
 */
static bool check_choice(const struct sp_renderer *r, const char *pointer, unsigned value,
                         uint32_t mask, const char *const *names, struct sp_error *err) {
    if (mask & SP_CAN(value))
        return true;
    char supported[160] = "nothing";
    size_t used = 0;
    for (unsigned i = 0; names[i] && used < sizeof supported; i++)
        if (mask & SP_CAN(i))
            used += (size_t)snprintf(supported + used, sizeof supported - used, "%s%s",
                                     used ? ", " : "", names[i]);
    return sp_fail(err, SP_ERR_UNSUPPORTED, pointer,
                   "the %s backend cannot do \"%s\"; it supports %s", r->info.backend, names[value],
                   supported);
}

static bool has_clip_box(const struct sp_clip *clip) {
    for (int i = 0; i < 3; i++)
        if (clip->box[0][i] > 0 || clip->box[1][i] < 1)
            return true;
    return false;
}

static bool check_support(const struct sp_renderer *r, const struct sp_view *v,
                          struct sp_error *err) {
    static const char *const projections[] = { "perspective", "orthographic", NULL };
    static const char *const filters[] = { "adaptive", "ewa", "reconstruction", "lowpass", "swan",
                                           "none",     NULL };
    static const char *const kernels[] = { "gaussian", "cubic", NULL };
    static const char *const compositings[] = { "splat", "sheet", "slab", NULL };
    static const char *const attenuations[] = { "exponential", "linear", NULL };
    static const char *const orders[] = { "pre", "post", NULL };
    static const char *const shadings[] = { "none", "phong", NULL };
    static const char *const primitives[] = { "volume", "surface", "shell", "vector", NULL };
    static const char *const lods[] = { "auto", "off", NULL };
    const struct sp_capabilities *can = &r->backend->capabilities;
    const struct {
        const char *pointer;
        unsigned value;
        uint32_t mask;
        const char *const *names;
    } choices[] = {
        { "/camera/projection", v->camera.projection, can->projections, projections },
        { "/filter/mode", v->filter.mode, can->filters, filters },
        { "/filter/kernel", v->filter.kernel, can->kernels, kernels },
        { "/compositing/mode", v->compositing.mode, can->compositings, compositings },
        { "/compositing/attenuation", v->compositing.attenuation, can->attenuations, attenuations },
        { "/transfer_function/order", v->transfer_function.order, can->orders, orders },
        { "/shading/mode", v->shading.mode, can->shadings, shadings },
        { "/primitive/type", v->primitive, can->primitives, primitives },
        { "/quality/level_of_detail", v->level_of_detail, can->levels_of_detail, lods },
    };
    for (size_t i = 0; i < sizeof choices / sizeof choices[0]; i++)
        if (!check_choice(r, choices[i].pointer, choices[i].value, choices[i].mask,
                          choices[i].names, err))
            return false;
    if (v->transfer_function.gradient_count && !can->gradient_axis)
        return sp_fail(err, SP_ERR_UNSUPPORTED, "/transfer_function/gradient",
                       "the %s backend has no gradient axis; leave the list empty",
                       r->info.backend);
    if (has_clip_box(&v->clip) && !can->clip_box)
        return sp_fail(err, SP_ERR_UNSUPPORTED, "/clip/box",
                       "the %s backend does not clip; use [[0,0,0],[1,1,1]]", r->info.backend);
    if (v->clip.plane_count && !can->clip_planes)
        return sp_fail(err, SP_ERR_UNSUPPORTED, "/clip/planes",
                       "the %s backend does not clip; leave the list empty", r->info.backend);
    return true;
}

bool sp_renderer_supports(const struct sp_renderer *renderer, const struct sp_view *view,
                          struct sp_error *err) {
    return sp_view_validate(view, err) && check_support(renderer, view, err);
}

struct sp_frame *sp_renderer_render(struct sp_renderer *renderer, struct sp_volume *volume,
                                    const struct sp_view *view, struct sp_frame_pool *pool,
                                    const struct sp_render_options *options, struct sp_error *err) {
    static const struct sp_render_options defaults = { .format = SP_RGBA8 };
    const struct sp_render_options *o = options ? options : &defaults;
    double start_ms = sp_clock_ms(), start_cpu_ms = sp_clock_cpu_ms();
    if (!sp_renderer_supports(renderer, view, err))
        return NULL;
    struct sp_frame *frame = sp_frame_create(pool, view->size[0], view->size[1], o->format, err);
    if (!frame)
        return NULL;
    assert(o->coarse <= SP_COARSE_MAX);
    struct sp_backend_job job = {
        .volume = volume, .view = view, .coarse = o->coarse, .frame = frame, .cancel = o->cancel
    };
    frame->stats = (struct sp_frame_stats){ .backend = renderer->info.backend,
                                            .device = renderer->info.device,
                                            .isa = renderer->info.isa,
                                            .threads = renderer->info.threads };
    if (!renderer->backend->render(renderer->state, &job, err)) {
        sp_frame_unref(&frame);
        return NULL;
    }
    frame->stats.render_ms = sp_clock_ms() - start_ms;
    frame->stats.cpu_ms = sp_clock_cpu_ms() - start_cpu_ms;
    return frame;
}

void sp_renderer_forget(struct sp_renderer *renderer, const struct sp_volume *volume) {
    if (renderer->backend->forget)
        renderer->backend->forget(renderer->state, volume);
}

uint64_t sp_renderer_memory(const struct sp_renderer *renderer, const struct sp_volume *volume) {
    return renderer->backend->memory ? renderer->backend->memory(renderer->state, volume) : 0;
}
