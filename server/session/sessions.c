/* SPDX-License-Identifier: Apache-2.0
 *
 * Sessions for HTTP: create, list, read, change and end them.
 */

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/fair_share.h"
#include "common/pagination.h"
#include "protocol/view.h"
#include "session/session.h"

/* Returns the largest image that a participant may request, px. */
static int64_t max_pixels(const struct srv_hub *hub, const struct srv_session *session) {
    uint64_t most = (uint64_t)SP_SIZE_MAX * SP_SIZE_MAX;
    const uint64_t limits[] = { hub->options.frame_px, session->identity.owner.quota.frame_px };
    for (int i = 0; i < 2; i++)
        most = limits[i] && limits[i] < most ? limits[i] : most;
    return (int64_t)most;
}

static proto_json *encode_session(const struct srv_hub *hub, const struct srv_session *session,
                                  bool with_tokens, struct sp_error *err) {
    proto_json *json = proto_json_object();
    proto_json_set_string(&json, "id", session->identity.id);
    if (with_tokens) {
        proto_json *tokens = proto_json_object();
        proto_json_set_string(&tokens, "control", session->identity.tokens[SRV_ROLE_CONTROL]);
        proto_json_set_string(&tokens, "view", session->identity.tokens[SRV_ROLE_VIEW]);
        proto_json_set(&json, "tokens", tokens);
    }
    proto_json_set(&json, "view", proto_view_encode(&session->shared.view));
    proto_json_set_integer(&json, "max_pixels", max_pixels(hub, session));
    proto_json_set(&json, "holder", srv_hub_encode_holder(session));
    proto_json_set(&json, "participants", srv_hub_encode_participants(session));
    if (!json)
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for the answer");
    return json;
}

/* True if the owner may have one more session, active or hibernated. Its guests may have a share of
 * them and leave the last one to the owner. */
static bool has_quota(struct srv_hub *hub, const struct srv_session_identity *identity,
                      struct sp_error *err) {
    const struct srv_owner *owner = &identity->owner;
    struct srv_pool pool = { .most = owner->quota.sessions };
    if (!pool.most)
        return true;
    for (const struct srv_session *s = hub->active.first; s; s = s->next) {
        const bool is_owners = strcmp(s->identity.owner.name, owner->name) == 0;
        pool.used += is_owners;
        pool.own += is_owners && s->identity.is_guests;
    }
    unsigned guests, hibernated = srv_hibernated_count(hub, owner->name, &guests);
    pool.used += hibernated;
    pool.own += guests;
    if (!identity->is_guests)
        return pool.used < pool.most ||
               sp_fail(err, SP_ERR_QUOTA, NULL,
                       "%s has %u sessions (%u hibernated) and its token allows %u; delete some",
                       owner->name, (unsigned)pool.used, hibernated, (unsigned)pool.most);
    return (pool.used + 1 < pool.most && srv_fair_left(&pool, true) > 0) ||
           sp_fail(err, SP_ERR_QUOTA, NULL,
                   "the owner has %u sessions, %u of them by guests, and its token allows %u; the "
                   "rest is kept for the owner",
                   (unsigned)pool.used, (unsigned)pool.own, (unsigned)pool.most);
}

static bool session_add(struct srv_hub *hub, struct srv_session *session, double now_ms,
                        struct sp_error *err) {
    struct srv_session_identity *identity = &session->identity;
    if (hub->is_draining)
        return sp_fail(err, SP_ERR_BUDGET, NULL, "the daemon is shutting down");
    if (identity->is_guests && !srv_hub_renew_quota(hub, &identity->owner))
        return sp_fail(err, SP_ERR_DENIED, NULL,
                       "the token that created the session was removed; fork it with a token of "
                       "the daemon");
    if (!has_quota(hub, identity, err) || !srv_hub_ensure_capacity(hub, identity, err))
        return false;
    identity->has_token = true;
    srv_hub_link_session(hub, session, now_ms);
    srv_hub_unsaved(hub, session);
    return true;
}

proto_json *srv_hub_session_create(struct srv_hub *hub, const proto_json *patch,
                                   const struct srv_owner *owner, bool is_guest, double now_ms,
                                   char id[SRV_SESSION_ID_BYTES], struct sp_error *err) {
    struct srv_session *session = srv_hub_alloc_session(hub);
    if (!session) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for a session");
        return NULL;
    }
    if (!srv_hub_resolve_view(hub, NULL, patch, &session->shared.view, &session->shared.volume,
                              err)) {
        srv_hub_free_session(hub, session);
        return NULL;
    }
    proto_json *json = NULL;
    session->identity.owner = *owner;
    session->identity.is_guests = is_guest;
    pthread_mutex_lock(&hub->mutex);
    bool ok = srv_owner_allows_size(owner, session->shared.view.size, err) &&
              srv_secret_hex(session->identity.id, sizeof session->identity.id - 1, err) &&
              srv_secret_hex(session->identity.tokens[0], SRV_TOKEN_DIGITS, err) &&
              srv_secret_hex(session->identity.tokens[1], SRV_TOKEN_DIGITS, err) &&
              (json = encode_session(hub, session, true, err)) &&
              session_add(hub, session, now_ms, err);
    if (ok)
        memcpy(id, session->identity.id, sizeof session->identity.id);
    pthread_mutex_unlock(&hub->mutex);
    if (!ok) {
        proto_json_free(&json);
        srv_hub_free_session(hub, session);
    }
    return json;
}

void srv_hub_session_owner(struct srv_hub *hub, const char *id, struct srv_owner *owner) {
    *owner = (struct srv_owner){ .name = "" };
    pthread_mutex_lock(&hub->mutex);
    const struct srv_session *session = srv_hub_find_active(hub, id);
    if (session) {
        *owner = session->identity.owner;
    } else {
        snprintf(owner->name, sizeof owner->name, "%s", srv_hibernated_owner(hub, id));
        srv_hub_renew_quota(hub, owner);
    }
    pthread_mutex_unlock(&hub->mutex);
}

proto_json *srv_hub_session_get(struct srv_hub *hub, const char *id, bool with_tokens,
                                double now_ms, struct sp_error *err) {
    pthread_mutex_lock(&hub->mutex);
    struct srv_session *session = srv_hub_find(hub, id, now_ms, err);
    proto_json *json = session ? encode_session(hub, session, with_tokens, err) : NULL;
    pthread_mutex_unlock(&hub->mutex);
    return json;
}

proto_json *srv_hub_session_patch(struct srv_hub *hub, const char *id, const proto_json *patch,
                                  double now_ms, struct sp_error *err) {
    proto_json *json = NULL;
    pthread_mutex_lock(&hub->mutex);
    struct srv_session *session = srv_hub_find(hub, id, now_ms, err);
    if (session && srv_hub_apply(hub, session, patch, 0, now_ms, err)) {
        json = proto_view_encode(&session->shared.view);
        if (!json)
            sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for the answer");
    }
    pthread_mutex_unlock(&hub->mutex);
    return json;
}

bool srv_hub_session_delete(struct srv_hub *hub, const char *id, struct sp_error *err) {
    pthread_mutex_lock(&hub->mutex);
    struct srv_session *session = srv_hub_find_active(hub, id);
    struct sp_error why = { .code = SP_OK };
    bool found = session || srv_hibernated_remove(hub, id) ||
                 srv_hibernated_missing(hub, id, &why) || why.code == SP_ERR_IO; /* damaged */
    if (!found && err)
        *err = why;
    if (session)
        srv_hub_end_session(hub, session);
    else if (found)
        srv_hub_ended(hub, id);
    pthread_mutex_unlock(&hub->mutex);
    return found;
}

bool srv_hub_session_is_guests(struct srv_hub *hub, const char *id) {
    pthread_mutex_lock(&hub->mutex);
    const struct srv_session *session = srv_hub_find_active(hub, id);
    bool is_guests = session && session->identity.is_guests;
    pthread_mutex_unlock(&hub->mutex);
    return is_guests;
}

bool srv_hub_authorize(struct srv_hub *hub, const char *id, const char *token, enum srv_role *role,
                       struct sp_error *err) {
    pthread_mutex_lock(&hub->mutex);
    const struct srv_session *session = srv_hub_find_active(hub, id);
    const char *tokens[2];
    for (int r = 0; r < 2; r++)
        tokens[r] =
            session ? session->identity.tokens[r] : srv_hibernated_token(hub, id, (enum srv_role)r);
    bool ok = false;
    if (!tokens[0]) {
        srv_hibernated_missing(hub, id, err);
    } else {
        bool control = srv_secret_equal(tokens[SRV_ROLE_CONTROL], token);
        bool view = srv_secret_equal(tokens[SRV_ROLE_VIEW], token);
        *role = control ? SRV_ROLE_CONTROL : SRV_ROLE_VIEW;
        ok =
            control || view ||
            sp_fail(err, SP_ERR_DENIED, NULL,
                    "the token does not belong to that session; POST /api/v1/sessions returns one");
    }
    pthread_mutex_unlock(&hub->mutex);
    return ok;
}

void srv_hub_list(struct srv_hub *hub, const char *owner, double now_ms, struct srv_page *page) {
    pthread_mutex_lock(&hub->mutex);
    for (const struct srv_session *s = hub->active.first; s; s = s->next) {
        if (owner && strcmp(s->identity.owner.name, owner) != 0)
            continue;
        struct srv_session_info *note = srv_page_slot(page, s->identity.id);
        if (!note)
            continue;
        *note = (struct srv_session_info){ .participants = s->participant_count };
        note->idle_ms = s->participants ? 0 : now_ms - srv_hub_used_ms(s);
        memcpy(note->id, s->identity.id, sizeof note->id);
        memcpy(note->volume, s->shared.view.volume, sizeof note->volume);
        memcpy(note->owner, s->identity.owner.name, sizeof note->owner);
    }
    srv_hibernated_list(hub, owner, now_ms, page);
    pthread_mutex_unlock(&hub->mutex);
}
