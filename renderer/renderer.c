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
#include "sp/log.h"

struct sp_renderer {
    _Atomic(const struct sp_backend *) backend; /* read by other threads too */
    void *state;
    struct sp_renderer_info info;
    struct sp_backend_options wanted; /* for the next backend; isa is owned */
    bool any;                         /* was started with "auto" */
    unsigned failures;                /* of the backend, in a row */
};

enum { THREADS_MAX = 256, GPUS_MAX = 64, FAILURES_MAX = 3 };

static unsigned count_cores(void) {
    long n = sysconf(_SC_NPROCESSORS_ONLN);
    return n < 1 ? 1 : n > THREADS_MAX ? THREADS_MAX : (unsigned)n;
}

static uint64_t half_of_memory(void) {
    long pages = sysconf(_SC_PHYS_PAGES), page = sysconf(_SC_PAGESIZE);
    return pages > 0 && page > 0 ? (uint64_t)pages * (uint64_t)page / 2 : UINT64_C(1) << 30;
}

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
    if (o->threads > THREADS_MAX)
        return sp_fail(err, SP_ERR_INVALID, "", "%u render threads; at most %d can be used",
                       o->threads, THREADS_MAX);
    r->wanted = (struct sp_backend_options){
        .threads = o->threads ? o->threads : count_cores(),
        .memory_bytes = o->memory_bytes ? o->memory_bytes : half_of_memory(),
        .video_bytes = o->video_bytes,
        .isa = strdup(o->isa ? o->isa : "auto"),
        .require_gpu = o->require_gpu,
    };
    if (!r->wanted.isa)
        return sp_fail(err, SP_ERR_MEMORY, "", "no memory for a renderer");
    return parse_gpu(o->gpu, &r->wanted.gpu, err);
}

/* Makes a backend that has just started the renderer's. */
static void take(struct sp_renderer *r, const struct sp_backend *backend, void *state) {
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
        sp_fail(err, SP_ERR_MEMORY, "", "no memory for a renderer");
        return NULL;
    }
    atomic_init(&r->backend, NULL);
    r->any = strcmp(name, "auto") == 0;
    const struct sp_backend *backend = NULL;
    void *state = NULL;
    if (read_options(r, o, err))
        backend = sp_registry_start(name, &r->wanted, &state, err);
    if (backend)
        take(r, backend, state);
    else
        sp_renderer_destroy(&r);
    return r;
}

void sp_renderer_destroy(struct sp_renderer **renderer) {
    struct sp_renderer *r = *renderer;
    if (!r)
        return;
    if (r->state)
        atomic_load(&r->backend)->destroy(r->state);
    free((char *)r->wanted.isa);
    free(r);
    *renderer = NULL;
}

struct probing {
    sp_device_visit *visit;
    void *user;
    bool works; /* a GPU */
};

static void note_gpu(void *user, const struct sp_device *device) {
    struct probing *probing = user;
    probing->works = probing->works || (device->is_gpu && !device->refusal[0]);
    probing->visit(probing->user, device);
}

bool sp_probe(sp_device_visit *visit, void *user) {
    const struct sp_backend_options options = {
        .threads = count_cores(), .memory_bytes = half_of_memory(), .isa = "auto", .gpu = -1
    };
    const struct sp_device none = {
        .backend = "none", .place = "GPU", .refusal = "this build has no backend for one", .gpu = -1
    };
    struct probing probing = { .visit = visit, .user = user };
    bool has_gpu = false;
    const struct sp_backend *backend;
    for (unsigned i = 0; (backend = sp_registry_at(i)); i++)
        has_gpu = has_gpu || backend->is_gpu;
    if (!has_gpu)
        visit(user, &none);
    for (unsigned i = 0; (backend = sp_registry_at(i)); i++)
        if (backend->probe)
            backend->probe(&options, note_gpu, &probing);
    return probing.works;
}

void sp_renderer_info(const struct sp_renderer *renderer, struct sp_renderer_info *info) {
    *info = renderer->info;
}

/* One choice of the view against a capability mask. `names`: the protocol's words, NULL at the end.
 */
static bool check_choice(const char *backend, const char *pointer, unsigned value, uint32_t mask,
                         const char *const *names, struct sp_error *err) {
    if (mask & SP_CAN(value))
        return true;
    char supported[160] = "nothing";
    size_t used = 0;
    for (unsigned i = 0; names[i] && used < sizeof supported; i++)
        if (mask & SP_CAN(i))
            used += (size_t)snprintf(supported + used, sizeof supported - used, "%s%s",
                                     used ? ", " : "", names[i]);
    return sp_fail(err, SP_ERR_UNSUPPORTED, pointer,
                   "the %s backend cannot do \"%s\"; it supports %s", backend, names[value],
                   supported);
}

static bool has_clip_box(const struct sp_clip *clip) {
    for (int i = 0; i < 3; i++)
        if (clip->box[0][i] > 0 || clip->box[1][i] < 1)
            return true;
    return false;
}

static bool check_support(const struct sp_backend *backend, const struct sp_view *v,
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
    const struct sp_capabilities *can = &backend->capabilities;
    const char *name = backend->entry.name;
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
        if (!check_choice(name, choices[i].pointer, choices[i].value, choices[i].mask,
                          choices[i].names, err))
            return false;
    if (v->transfer_function.gradient_count && !can->gradient_axis)
        return sp_fail(err, SP_ERR_UNSUPPORTED, "/transfer_function/gradient",
                       "the %s backend has no gradient axis; leave the list empty", name);
    if (has_clip_box(&v->clip) && !can->clip_box)
        return sp_fail(err, SP_ERR_UNSUPPORTED, "/clip/box",
                       "the %s backend does not clip; use [[0,0,0],[1,1,1]]", name);
    if (v->clip.plane_count && !can->clip_planes)
        return sp_fail(err, SP_ERR_UNSUPPORTED, "/clip/planes",
                       "the %s backend does not clip; leave the list empty", name);
    return true;
}

bool sp_renderer_supports(const struct sp_renderer *renderer, const struct sp_view *view,
                          struct sp_error *err) {
    return sp_view_validate(view, err) && check_support(atomic_load(&renderer->backend), view, err);
}

/* Puts the next backend that starts by itself in the place of the one that fails; false if there is
 * none, or if the user has named the one to use. */
static bool give_up(struct sp_renderer *r, const struct sp_error *why) {
    const struct sp_backend *failed = atomic_load(&r->backend);
    void *state;
    const struct sp_backend *next =
        r->any ? sp_registry_follow(failed, &r->wanted, &state, NULL) : NULL;
    if (!next)
        return false;
    void *failed_state = r->state;
    take(r, next, state);
    failed->destroy(failed_state);
    snprintf(r->info.given_up, sizeof r->info.given_up,
             "backend %s failed %d times in a row: %.300s", failed->entry.name, FAILURES_MAX,
             why->text);
    sp_log(SP_LOG_WARN, "%s; backend %s has taken over", r->info.given_up, r->info.backend);
    return true;
}

static bool draw_once(struct sp_renderer *r, const struct sp_backend_job *job,
                      struct sp_error *err) {
    job->frame->stats = (struct sp_frame_stats){ .backend = r->info.backend,
                                                 .isa = r->info.isa,
                                                 .threads = r->info.threads };
    memcpy(job->frame->stats.device, r->info.device, sizeof r->info.device);
    return atomic_load(&r->backend)->render(r->state, job, err);
}

/* A backend that fails is tried again, so that one whose device comes back loses no frame, and
 * given up after three times. What a view or the machine's memory is to blame for does not count.
 */
static bool draw(struct sp_renderer *r, const struct sp_backend_job *job, struct sp_error *err) {
    struct sp_error why = { .code = SP_OK };
    while (!draw_once(r, job, &why)) {
        bool again = why.code == SP_ERR_BACKEND;
        if (again) {
            sp_log(SP_LOG_WARN, "backend %s fails: %s", r->info.backend, why.text);
            again = ++r->failures < FAILURES_MAX || give_up(r, &why);
        }
        if (!again || sp_job_is_cancelled(job) ||
            !check_support(atomic_load(&r->backend), job->view, &why))
            return sp_fail(err, why.code, why.place, "%s", why.text);
    }
    r->failures = 0;
    return true;
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
    if (!draw(renderer, &job, err)) {
        sp_frame_unref(&frame);
        return NULL;
    }
    frame->stats.render_ms = sp_clock_ms() - start_ms;
    frame->stats.cpu_ms = sp_clock_cpu_ms() - start_cpu_ms;
    return frame;
}

void sp_renderer_forget(struct sp_renderer *renderer, const struct sp_volume *volume) {
    const struct sp_backend *backend = atomic_load(&renderer->backend);
    if (backend->forget)
        backend->forget(renderer->state, volume);
}

uint64_t sp_renderer_memory(const struct sp_renderer *renderer, const struct sp_volume *volume) {
    const struct sp_backend *backend = atomic_load(&renderer->backend);
    return backend->memory ? backend->memory(renderer->state, volume) : 0;
}
