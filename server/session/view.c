/* SPDX-License-Identifier: Apache-2.0
 *
 * The view of a session: how patches change it, and which sizes are allowed.
 */

#include <string.h>

#include "protocol/view.h"
#include "session/session.h"

bool srv_hub_allows_size(const struct srv_hub *hub, const uint32_t size[2], struct sp_error *err) {
    uint64_t px = (uint64_t)size[0] * size[1], most = hub->options.frame_px;
    return !most || px <= most ||
           sp_fail(err, SP_ERR_INVALID, "/size", "%u x %u are %llu px and --frame-size allows %llu",
                   size[0], size[1], (unsigned long long)px, (unsigned long long)most);
}

/* True if the valid view is within the limits, suits the volume, and the renderer can draw it. */
static bool can_show(const struct srv_hub *hub, struct srv_volume *volume,
                     const struct sp_view *view, struct sp_error *err) {
    const struct srv_volume_source *source = &hub->options.volumes;
    return srv_hub_allows_size(hub, view->size, err) &&
           (!source->fits || source->fits(source->user, volume, view, err)) &&
           (!hub->options.supports || hub->options.supports(hub->options.user, view, err));
}

bool srv_hub_resolve_view(struct srv_hub *hub, const proto_json *base, const proto_json *patch,
                          struct sp_view *view, struct srv_volume **volume, struct sp_error *err) {
    const struct srv_volume_source *source = &hub->options.volumes;
    const char *of_base = base ? proto_view_volume(base) : NULL;
    const char *id = of_base || !patch ? of_base : proto_view_volume(patch);
    *volume = source->acquire(source->user, id, err);
    if (!*volume)
        return false;
    source->default_view(source->user, *volume, view);
    struct sp_view defaults = *view;
    if ((!base || proto_view_merge(base, &defaults, view, err)) &&
        (patch ? proto_view_apply(patch, &defaults, view, err) : sp_view_validate(view, err)) &&
        can_show(hub, *volume, view, err))
        return true;
    source->release(source->user, *volume);
    *volume = NULL;
    return false;
}

bool srv_hub_view_names(const struct sp_view *view, const char *id) {
    bool is_named = strcmp(view->volume, id) == 0;
    for (uint32_t i = 0; i < view->layer_count && !is_named; i++)
        is_named =
            strcmp(view->layers[i].id, id) == 0 ||
            (strcmp(view->layers[i].color_by, id) == 0 && strcmp(id, SP_COLOR_BY_LENGTH) != 0);
    return is_named;
}

bool srv_hub_apply(struct srv_hub *hub, struct srv_session *session, const proto_json *patch,
                   uint64_t by, double now_ms, struct sp_error *err) {
    const struct srv_volume_source *source = &hub->options.volumes;
    const char *id = proto_view_volume(patch);
    struct srv_volume *volume = NULL;
    struct sp_view view = session->shared.view, defaults;
    if (id && strcmp(id, session->shared.view.volume) != 0) {
        volume = source->acquire(source->user, id, err);
        if (!volume)
            return false;
        source->default_view(source->user, volume, &view);
        defaults = view;
        memcpy(view.size, session->shared.view.size, sizeof view.size);
        memcpy(view.background, session->shared.view.background, sizeof view.background);
    } else {
        source->default_view(source->user, session->shared.volume, &defaults);
    }
    if (!proto_view_apply(patch, &defaults, &view, err) ||
        !can_show(hub, volume ? volume : session->shared.volume, &view, err) ||
        (memcmp(view.size, session->shared.view.size, sizeof view.size) != 0 &&
         !srv_owner_allows_size(&session->identity.owner, view.size, err))) {
        if (volume)
            source->release(source->user, volume);
        return false;
    }
    enum srv_session_event event = SRV_VIEW_CHANGED;
    const bool is_other_step = volume || view.time.step != session->shared.view.time.step;
    const bool shows_others = srv_steps_show_others(&view, &session->shared.view);
    if (volume)
        event = SRV_VOLUME_CHANGED;
    else if (is_other_step || !sp_transfer_function_equal(&session->shared.view.transfer_function,
                                                          &view.transfer_function))
        event = SRV_TRANSFER_FUNCTION_CHANGED;
    else if (!sp_view_equal(&session->shared.view, &view) &&
             sp_view_is_same_image(&session->shared.view, &view))
        event = SRV_SLICES_CHANGED;
    if (volume) {
        source->release(source->user, session->shared.volume);
        session->shared.volume = volume;
    }
    session->shared.view = view;
    for (struct srv_participant *p = session->participants; p; p = p->next)
        if (now_ms >= p->memory.until_ms)
            p->memory.px = 0;
    srv_play_place(session, now_ms, &session->shared.view);
    if (volume)
        srv_play_stop_steps(hub, session);
    if (is_other_step)
        session->play.step_ms = now_ms;
    if (is_other_step || shows_others) {
        srv_steps_follow(hub, session);
        if (session->shared.is_waiting)
            srv_hub_notify_others(hub, session, 0, SRV_NOTIFY_TIME);
    }
    session->shared.version++;
    session->shared.image += event != SRV_SLICES_CHANGED;
    session->shared.changed_by = by;
    session->shared.changed_ms = now_ms;
    srv_hub_unsaved(hub, session);
    srv_hub_notify_others(hub, session, by, SRV_NOTIFY_VIEW);
    srv_hub_emit(hub, event, session, NULL, now_ms);
    return true;
}

void srv_hub_size(const struct srv_session *session, const struct srv_participant *participant,
                  uint32_t size[2]) {
    for (int i = 0; i < 2; i++)
        size[i] = participant->settings.size[0] ? participant->settings.size[i]
                                                : session->shared.view.size[i];
    /* The limits may be lower than when the size was set. */
    srv_fit_size(session->identity.owner.quota.frame_px, size);
    srv_fit_size(participant->memory.px, size);
}
