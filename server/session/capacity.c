/* SPDX-License-Identifier: Apache-2.0
 *
 * Capacity for one more active session: the shares of the owners.
 */
#include <stdlib.h>
#include <string.h>

#include "common/fair_share.h"
#include "session/session.h"

struct use {              /* of --sessions by one owner */
    unsigned own, guests; /* guests: sessions among `own` that join tokens made */
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
    if (!identity->is_guests)
        return left;
    return left > 1 ? srv_fair_left(&owners, true) : 0; /* the last one is the owner's */
}

/* True if the session may hibernate now, and was unused for longer than `than`; NULL = any. */
static bool is_idle_longer(struct srv_session *s, struct srv_session *than) {
    return !s->participants && srv_hub_is_view_saved(s) &&
           (!than || srv_hub_used_ms(s) < srv_hub_used_ms(than));
}

/* Returns the owner's session that was unused for the longest time; NULL = none may hibernate. */
static struct srv_session *find_own(const struct srv_hub *hub, const char *owner) {
    struct srv_session *found = NULL;
    for (struct srv_session *s = hub->active.first; s; s = s->next)
        if (is_of(s, owner) && is_idle_longer(s, found))
            found = s;
    return found;
}

static int compare_owners(const void *a, const void *b) {
    const struct srv_session *const *x = a, *const *y = b;
    return strcmp((*x)->identity.owner.name, (*y)->identity.owner.name);
}

/* Returns the same of another owner: the owner with the most sessions, if these are more than
 * `least`. */
static struct srv_session *find_others(const struct srv_hub *hub, const char *owner,
                                       unsigned least) {
    struct srv_session *found = NULL, **sorted = malloc(hub->active.count * sizeof *sorted);
    unsigned count = 0, most = least;
    for (struct srv_session *s = hub->active.first; s && sorted; s = s->next)
        sorted[count++] = s;
    if (sorted)
        qsort(sorted, count, sizeof *sorted, compare_owners);
    for (unsigned first = 0, end; first < count; first = end) { /* the sessions of one owner */
        struct srv_session *idle = NULL;
        for (end = first; end < count && !compare_owners(&sorted[first], &sorted[end]); end++)
            if (is_idle_longer(sorted[end], idle))
                idle = sorted[end];
        if (idle && end - first > most && !is_of(idle, owner)) {
            found = idle;
            most = end - first;
        }
    }
    free(sorted);
    return found;
}

/* Returns the session that may hibernate instead: one of the owner, or of another one, which must
 * have more sessions if the owner's share is limited. */
static struct srv_session *find_surplus(const struct srv_hub *hub,
                                        const struct srv_session_identity *identity,
                                        const struct use *use) {
    const struct srv_owner *owner = &identity->owner;
    if (!hub->options.recall || identity->is_guests)
        return NULL;
    struct srv_session *own = find_own(hub, owner->name);
    return own ? own : find_others(hub, owner->name, owner->quota.is_limited ? use->own : 0);
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
