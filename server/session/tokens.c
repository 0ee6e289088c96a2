/* SPDX-License-Identifier: Apache-2.0
 *
 * What the tokens of the daemon allow in a session, and what happens when they change.
 */

#include "config/tokens.h"
#include "session/session.h"

bool srv_hub_renew_quota(const struct srv_hub *hub, struct srv_owner *owner) {
    unsigned unused;
    return !hub->options.token || !owner->name[0] ||
           hub->options.token(hub->options.user, owner->name, &unused, &owner->quota);
}

void srv_hub_close_stream(struct srv_hub *hub, struct srv_participant *p, uint16_t code,
                          const char *reason) {
    p->pending.close_code = code;
    p->pending.close_reason = reason;
    srv_hub_notify(hub, p, SRV_NOTIFY_CLOSE);
}

const char *srv_hub_denies(const struct srv_hub *hub, const struct srv_participant *p) {
    struct srv_quota unused;
    unsigned rights;
    enum srv_role role;
    if (!hub->options.token || !p->identity.token[0])
        return NULL;
    if (!hub->options.token(hub->options.user, p->identity.token, &rights, &unused))
        return "the token is no longer valid";
    bool has_role = srv_owner_role(&p->session->identity.owner, p->identity.token, rights, &role);
    return has_role && role >= p->identity.role ? NULL : "the role of the token is lower now";
}

void srv_hub_renew_tokens(struct srv_hub *hub) {
    pthread_mutex_lock(&hub->mutex);
    for (struct srv_session *s = hub->active.first; s; s = s->next) {
        bool had_token = s->identity.has_token;
        s->identity.has_token = srv_hub_renew_quota(hub, &s->identity.owner);
        for (struct srv_participant *p = s->participants; p; p = p->next) {
            const char *why = srv_hub_denies(hub, p);
            p->settings.max_fps = srv_owner_fps(&s->identity.owner, p->settings.wanted_fps);
            srv_hub_notify(hub, p, SRV_NOTIFY_POLICY); /* the quota may allow another size */
            if (why)
                srv_hub_close_stream(hub, p, 1008, why);
            else if (had_token && !s->identity.has_token)
                srv_hub_close_stream(hub, p, 1008,
                                     "the token that created the session is no longer valid");
        }
    }
    pthread_mutex_unlock(&hub->mutex);
}
