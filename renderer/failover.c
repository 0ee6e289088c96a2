/* SPDX-License-Identifier: Apache-2.0
 *
 * Draws a frame on the backend. Another backend draws the views that it cannot draw, and replaces
 * it after failures in a row.
 */
#include <stdio.h>
#include <string.h>

#include "backend/support.h"
#include "renderer/renderer_private.h"
#include "sp/log.h"

enum { FAILURES_MAX = 3 };

void sp_renderer_adopt(struct sp_renderer *r, const struct sp_backend *backend, void *state) {
    r->state = state;
    r->failures = 0;
    backend->info(state, &r->info);
    atomic_store(&r->backend, backend);
    sp_log(SP_LOG_INFO, "backend %s renders on %s%s%s", r->info.backend, r->info.device,
           r->info.isa[0] ? " with " : "", r->info.isa);
}

/* Starts the backend after this one, unless it runs already. False if no other backend starts, or
 * if the caller has named the backend to use. */
static bool start_fallback(struct sp_renderer *r) {
    struct sp_fallback *s = &r->fallback;
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
    const struct sp_fallback next = r->fallback;
    r->fallback = (struct sp_fallback){ .backend = NULL };
    sp_renderer_adopt(r, next.backend, next.state);
    failed->destroy(failed_state);
    snprintf(r->info.failover_reason, sizeof r->info.failover_reason,
             "backend %s failed %d times in a row: %.300s", failed->entry.name, FAILURES_MAX,
             why->text);
    sp_log(SP_LOG_WARN, "%s; backend %s has taken over", r->info.failover_reason, r->info.backend);
    return true;
}

void sp_renderer_name_backend(struct sp_frame *frame, const struct sp_renderer_info *by) {
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
static bool draw_on_fallback(struct sp_renderer *r, const struct sp_renderer_frame *f,
                             struct sp_error *why) {
    struct sp_fallback *s = &r->fallback;
    if (!start_fallback(r) || !sp_support_check(s->backend, &f->view, NULL))
        return false;
    const struct sp_error first = *why;
    sp_renderer_name_backend(f->job.frame, &s->info);
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
static bool draw_once(struct sp_renderer *r, struct sp_renderer_frame *f, struct sp_error *why) {
    const struct sp_backend *backend = atomic_load(&r->backend);
    bool ok = false, is_begun = f->is_begun;
    f->is_begun = false;
    sp_renderer_name_backend(f->job.frame, &r->info);
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
        sp_renderer_frame_at(r, i)->is_begun = false;
    return ok;
}

/* Order "auto" becomes pre for a frame that does not fit the memory as post; false = it does not.
 * Lists of visible voxels may be much smaller than the volume's samples. */
static bool choose_pre(struct sp_renderer_frame *f, const struct sp_error *why) {
    if (!f->may_be_pre || (why->code != SP_ERR_MEMORY && why->code != SP_ERR_BUDGET))
        return false;
    f->view.transfer_function.order = SP_TF_PRE;
    f->may_be_pre = false;
    return true;
}

bool sp_renderer_draw(struct sp_renderer *r, struct sp_renderer_frame *f, struct sp_error *err) {
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
