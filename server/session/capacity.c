/* SPDX-License-Identifier: Apache-2.0
 *
 * Capacity for one more active session: the shares of the owners.
 */
#include <string.h>

#include "common/fair_share.h"
#include "session/session.h"

struct use {              /* of --sessions by one owner */
    unsigned own, guests; /* guests: those of `own` that join tokens made */
};

static bool is_of(const struct srv_session *session, const char *owner) {
    return strcmp(session->identity.owner.name, owner) == 0;
}

static struct use use_of(const struct srv_hub *hub, const char *owner) {
    struct use use = { .own = 0 };
    for (const struct srv_session *s = hub->active.first; s; s = s->next)
        if (is_of(s, owner)) {
            use.own++;
            use.guests += s->identity.is_guests;
        }
    return use;
}

/* Returns how many more sessions may be active. Guests share what the owner may have. */
static uint64_t left_for(const struct srv_hub *hub, const struct srv_session_identity *identity,
                         const struct use *use) {
    const struct srv_pool all = { hub->options.sessions_max, hub->active.count, use->own };
    const uint64_t left = srv_fair_left(&all, identity->owner.quota.is_limited);
    const struct srv_pool owners = { use->own + left, use->own, use->guests };
    return identity->is_guests ? srv_fair_left(&owners, true) : left;
}

/* Returns the saved session without participants that was unused for the longest time, of the owner
 * or of the others; NULL = there is none. */
static struct srv_session *find_idle(const struct srv_hub *hub, const char *owner, bool is_owners) {
    struct srv_session *found = NULL;
    for (struct srv_session *s = hub->active.first; s; s = s->next)
        if (!s->participants && srv_hub_is_view_saved(s) && is_of(s, owner) == is_owners &&
            (!found || srv_hub_used_ms(s) < srv_hub_used_ms(found)))
            found = s;
    return found;
}

/* Returns the session that may hibernate instead: one of the owner, or, if all places are
 * taken, of another one, which must have more sessions than an owner whose share is limited. */
static struct srv_session *find_surplus(const struct srv_hub *hub,
                                        const struct srv_session_identity *identity,
                                        const struct use *use) {
    const struct srv_owner *owner = &identity->owner;
    if (!hub->options.recall || identity->is_guests)
        return NULL;
    struct srv_session *own = find_idle(hub, owner->name, true);
    if (own || hub->active.count < hub->options.sessions_max)
        return own;
    struct srv_session *other = find_idle(hub, owner->name, false);
    const bool is_free = other && (!owner->quota.is_limited ||
                                   use_of(hub, other->identity.owner.name).own > use->own);
    return is_free ? other : NULL;
}

bool srv_hub_ensure_capacity(struct srv_hub *hub, const struct srv_session_identity *identity,
                             struct sp_error *err) {
    const char *owner = identity->owner.name;
    struct use use = use_of(hub, owner);
    while (left_for(hub, identity, &use) == 0) {
        struct srv_session *idle = find_surplus(hub, identity, &use);
        if (!idle || !srv_hub_hibernate(hub, idle, "another session needs its place (--sessions)"))
            break;
        use = use_of(hub, owner);
    }
    if (left_for(hub, identity, &use) > 0)
        return true;
    if (hub->active.count >= hub->options.sessions_max)
        return sp_fail(err, SP_ERR_BUDGET, NULL,
                       "%u sessions are active and --sessions allows %u; try again later",
                       hub->active.count, hub->options.sessions_max);
    if (identity->is_guests)
        return sp_fail(err, SP_ERR_QUOTA, NULL,
                       "the guests of this session's owner have %u active sessions, and all "
                       "sessions are %u of the %u that --sessions allows; the rest is kept for "
                       "others; try again later",
                       use.guests, hub->active.count, hub->options.sessions_max);
    return sp_fail(err, SP_ERR_QUOTA, NULL,
                   "%s has %u active sessions and all owners %u of the %u that --sessions allows; "
                   "the rest is kept for the others; close or delete some",
                   owner, use.own, hub->active.count, hub->options.sessions_max);
}
