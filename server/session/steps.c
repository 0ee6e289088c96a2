/* SPDX-License-Identifier: Apache-2.0
 *
 * The time steps that a session shows: of its volume, and of the others that its layers name. Until
 * the steps of the view are loaded, frames show the nearest loaded steps, in moving detail, and
 * none of these frames is final.
 */
#include <string.h>

#include "session/session.h"

static void report(struct srv_hub *hub, struct srv_session *session, const struct sp_error *err) {
    for (struct srv_participant *p = session->participants; p; p = p->next) {
        p->pending.error = *err;
        srv_hub_notify(hub, p, SRV_NOTIFY_ERROR);
    }
}

/* Takes uses of the steps of the view; step = NULL when out of memory. */
static void use_steps(struct srv_hub *hub, struct srv_session *session) {
    const struct srv_volume_source *source = &hub->options.volumes;
    struct srv_view_state *shared = &session->shared;
    shared->step = source->step(source->user, shared->volume, shared->view.time.step);
    if (source->other_steps && shared->step &&
        !source->other_steps(source->user, shared->volume, &shared->view, shared->others,
                             &shared->other_count)) {
        source->release(source->user, shared->step);
        shared->step = NULL;
    }
}

void srv_steps_release(struct srv_hub *hub, struct srv_session *session) {
    const struct srv_volume_source *source = &hub->options.volumes;
    struct srv_view_state *shared = &session->shared;
    if (shared->step)
        source->release(source->user, shared->step);
    if (shared->displayed)
        source->release(source->user, shared->displayed);
    shared->step = shared->displayed = NULL;
    while (shared->other_count > 0)
        source->release(source->user, shared->others[--shared->other_count]);
}

/* Called when the memory is full. Frames now show the step that is always loaded, so that the steps
 * of the view can have the memory of the step that frames showed until now. False if this was done
 * already. */
static bool free_memory(struct srv_hub *hub, struct srv_session *session) {
    const struct srv_volume_source *source = &hub->options.volumes;
    struct srv_view_state *shared = &session->shared;
    if (!shared->displayed || shared->displayed == shared->volume)
        return false;
    srv_steps_release(hub, session);
    shared->displayed = source->ref(source->user, shared->volume);
    use_steps(hub, session);
    return shared->step != NULL;
}

static bool are_loaded(const struct srv_volume_source *source, const struct srv_view_state *shared,
                       struct sp_error *err) {
    bool ok = source->step_is_ready(source->user, shared->step, err);
    for (unsigned i = 0; ok && i < shared->other_count; i++)
        ok = source->step_is_ready(source->user, shared->others[i], err);
    return ok;
}

/* True if the steps of the view are loaded. A failure is reported. */
static bool is_ready(struct srv_hub *hub, struct srv_session *session) {
    const struct srv_volume_source *source = &hub->options.volumes;
    struct sp_error err;
    if (!session->shared.step) {
        sp_fail(&err, SP_ERR_MEMORY, "/time/step", "out of memory for a time step");
        report(hub, session, &err);
        return false;
    }
    if (are_loaded(source, &session->shared, &err))
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
    struct srv_session old = { .shared = { .step = shared->step,
                                           .displayed = shared->displayed,
                                           .other_count = shared->other_count } };
    const uint32_t number = shared->view.time.step;
    memcpy(old.shared.others, shared->others, sizeof shared->others);
    shared->displayed = NULL;
    shared->other_count = 0;
    shared->steps = source->steps ? source->steps(source->user, shared->volume) : 1;
    if (source->step) {
        use_steps(hub, session);
        shared->is_waiting = !is_ready(hub, session);
        shared->displayed = shared->is_waiting
                                ? source->nearest_step(source->user, shared->volume, number)
                                : source->ref(source->user, shared->step);
    } else {
        shared->step = source->ref(source->user, shared->volume);
        shared->displayed = source->ref(source->user, shared->volume);
    }
    srv_steps_release(hub, &old);
}

/* The volume that a layer shows, or is coloured by; "" = none other. */
static const char *other_of(const struct sp_view *view, uint32_t layer, bool is_color) {
    const struct sp_layer *l = &view->layers[layer];
    return layer >= view->layer_count || !l->visible ? "" : is_color ? l->color_by : l->id;
}

bool srv_steps_show_others(const struct sp_view *a, const struct sp_view *b) {
    for (uint32_t i = 0; i < SP_LAYERS_MAX; i++)
        if (strcmp(other_of(a, i, false), other_of(b, i, false)) != 0 ||
            strcmp(other_of(a, i, true), other_of(b, i, true)) != 0)
            return true;
    return false;
}

static bool shows(const struct sp_view *view, const char *id) {
    bool found = strcmp(view->volume, id) == 0;
    for (uint32_t i = 0; i < SP_LAYERS_MAX; i++)
        found = found || strcmp(other_of(view, i, false), id) == 0 ||
                strcmp(other_of(view, i, true), id) == 0;
    return found;
}

void srv_hub_step_loaded(struct srv_hub *hub, const char *id, double now_ms) {
    const struct srv_volume_source *source = &hub->options.volumes;
    pthread_mutex_lock(&hub->mutex);
    for (struct srv_session *s = hub->active.first; s; s = s->next) {
        struct srv_view_state *shared = &s->shared;
        if (!shared->is_waiting || !shows(&shared->view, id) || !is_ready(hub, s))
            continue;
        source->release(source->user, shared->displayed);
        shared->displayed = source->ref(source->user, shared->step);
        shared->is_waiting = false;
        shared->version++;
        shared->image++;
        shared->changed_ms = now_ms;
        srv_hub_notify_others(hub, s, 0, SRV_NOTIFY_TIME);
        srv_hub_emit(hub, SRV_TRANSFER_FUNCTION_CHANGED, s, NULL, now_ms);
    }
    pthread_mutex_unlock(&hub->mutex);
}
