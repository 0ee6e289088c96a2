/* SPDX-License-Identifier: Apache-2.0
 *
 * The time step that a session shows. Until the step of the view is loaded, frames show the loaded
 * step that is nearest to it, in moving detail, and none of them is final.
 */
#include <string.h>

#include "session/session.h"

static void report(struct srv_hub *hub, struct srv_session *session, const struct sp_error *err) {
    for (struct srv_participant *p = session->participants; p; p = p->next) {
        p->pending.error = *err;
        srv_hub_notify(hub, p, SRV_NOTIFY_ERROR);
    }
}

void srv_steps_release(struct srv_hub *hub, struct srv_session *session) {
    const struct srv_volume_source *source = &hub->options.volumes;
    struct srv_view_state *shared = &session->shared;
    if (shared->step)
        source->release(source->user, shared->step);
    if (shared->shown)
        source->release(source->user, shared->shown);
    shared->step = shared->shown = NULL;
}

/* The memory is full: frames show the step that is always loaded, and the memory of the one that
 * they showed serves the step of the view. False if that has been done. */
static bool free_memory(struct srv_hub *hub, struct srv_session *session) {
    const struct srv_volume_source *source = &hub->options.volumes;
    struct srv_view_state *shared = &session->shared;
    if (!shared->shown || shared->shown == shared->volume)
        return false;
    source->release(source->user, shared->shown);
    source->release(source->user, shared->step);
    shared->shown = source->ref(source->user, shared->volume);
    shared->step = source->step(source->user, shared->volume, shared->view.time.step);
    return shared->step != NULL;
}

/* True if the step of the view is loaded. A failure is reported. */
static bool is_ready(struct srv_hub *hub, struct srv_session *session) {
    const struct srv_volume_source *source = &hub->options.volumes;
    struct sp_error err;
    if (!session->shared.step) {
        sp_fail(&err, SP_ERR_MEMORY, "/time/step", "out of memory for a time step");
        report(hub, session, &err);
        return false;
    }
    if (source->step_is_ready(source->user, session->shared.step, &err))
        return true;
    if (err.code != SP_ERR_NOT_READY && !(err.code == SP_ERR_BUDGET && free_memory(hub, session))) {
        report(hub, session, &err);
        srv_play_stop_steps(hub, session);
    }
    return false;
}

void srv_steps_follow(struct srv_hub *hub, struct srv_session *session) {
    const struct srv_volume_source *source = &hub->options.volumes;
    struct srv_view_state *shared = &session->shared;
    struct srv_session old = { .shared = { .step = shared->step, .shown = shared->shown } };
    const uint32_t number = shared->view.time.step;
    shared->shown = NULL;
    shared->steps = source->steps ? source->steps(source->user, shared->volume) : 1;
    if (source->step) {
        shared->step = source->step(source->user, shared->volume, number);
        shared->is_waiting = !is_ready(hub, session);
        shared->shown = shared->is_waiting
                            ? source->nearest_step(source->user, shared->volume, number)
                            : source->ref(source->user, shared->step);
    } else {
        shared->step = source->ref(source->user, shared->volume);
        shared->shown = source->ref(source->user, shared->volume);
    }
    srv_steps_release(hub, &old);
}

void srv_hub_step_loaded(struct srv_hub *hub, const char *id, double now_ms) {
    const struct srv_volume_source *source = &hub->options.volumes;
    pthread_mutex_lock(&hub->mutex);
    for (struct srv_session *s = hub->active.first; s; s = s->next) {
        struct srv_view_state *shared = &s->shared;
        if (!shared->is_waiting || strcmp(shared->view.volume, id) != 0 || !is_ready(hub, s))
            continue;
        source->release(source->user, shared->shown);
        shared->shown = source->ref(source->user, shared->step);
        shared->is_waiting = false;
        shared->version++;
        shared->image++;
        shared->changed_ms = now_ms;
        srv_hub_notify_others(hub, s, 0, SRV_NOTIFY_TIME);
        srv_hub_emit(hub, SRV_TRANSFER_FUNCTION_CHANGED, s, NULL, now_ms);
    }
    pthread_mutex_unlock(&hub->mutex);
}
