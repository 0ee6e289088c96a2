/* SPDX-License-Identifier: Apache-2.0
 *
 * What is kept of a session, and how it comes back:
 *
 *   {"tokens": {"control", "view"}, "view": {…}, "owner": {…}, "used"}
 *
 * used: when it was used last, in seconds that daemons ran which kept it (ran_ms of
 * srv_hub_options), to a thousandth of --sleep-time, so that sleep goes on where the last daemon
 * ended. Without it, it is now.
 *
 *     created ──► awake ──(nobody uses it)──► asleep ──(for too long, or deleted)──► gone
 *                   └──◄──(somebody asks for it)──┘ └──◄── saved in an earlier run
 *
 * One that sleeps has its id and tokens but takes part in nothing and uses no volume; all else is
 * where it was saved, so that it takes some hundred bytes. It wakes when its volume is ready; until
 * then whoever asks for it is told what it waits for.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/pagination.h"
#include "protocol/view.h"
#include "session/hub_private.h"
#include "sp/log.h"

struct srv_sleeper {
    struct srv_sleeper *next;
    struct srv_timer end; /* it has slept for too long then */
    char id[SRV_SESSION_ID_BYTES];
    char tokens[2][SRV_TOKEN_DIGITS + 1];
    char volume[SP_NAME_BYTES];
    char owner[SRV_TOKEN_NAME_BYTES];
    double used_ms;
};

/* Saving. */

static double grain_ms(const struct srv_hub *hub) {
    return fmax(hub->options.sleep_ms / 2000, 1000);
}

static double used_ms(const struct srv_session *s, double now_ms) {
    return s->participants ? now_ms : srv_hub_used_ms(s);
}

static bool is_saved(const struct srv_hub *hub, const struct srv_session *s, double now_ms) {
    return s->saved_version == s->version && used_ms(s, now_ms) - s->saved_used_ms < grain_ms(hub);
}

static void set_unsaved(struct srv_hub *hub, struct srv_session *session) {
    if (!session->unsaved.is_set)
        srv_timer_set(&hub->unsaved, &session->unsaved, (double)++hub->next_unsaved);
}

static void tell_unsaved(struct srv_hub *hub) {
    if (hub->options.changed)
        hub->options.changed(hub->options.user);
}

void srv_hub_unsaved(struct srv_hub *hub, struct srv_session *session) {
    set_unsaved(hub, session);
    tell_unsaved(hub);
}

void srv_hub_note_time(struct srv_hub *hub, double now_ms) {
    if (!hub->options.recall || hub->session_count + hub->sleeper_count == 0 ||
        now_ms - hub->noted_ms < grain_ms(hub))
        return;
    hub->noted_ms = now_ms;
    for (struct srv_session *s = hub->sessions; s; s = s->next)
        if (!is_saved(hub, s, now_ms))
            set_unsaved(hub, s);
    tell_unsaved(hub);
}

struct snapshot {
    uint64_t number, version;
    double used_ms, ran_ms;
    char id[SRV_SESSION_ID_BYTES];
    char tokens[2][SRV_TOKEN_DIGITS + 1];
    struct srv_owner owner;
    struct sp_view view;
};

/* Of the session that is unsaved for the longest time, if that is so since `last` or before. */
static bool take_snapshot(struct srv_hub *hub, uint64_t last, double now_ms,
                          struct snapshot *snapshot) {
    const struct srv_session *next;
    pthread_mutex_lock(&hub->mutex);
    do
        next = srv_timer_take(&hub->unsaved, (double)last);
    while (next && is_saved(hub, next, now_ms));
    if (next) {
        snapshot->number = next->number;
        snapshot->version = next->version;
        snapshot->used_ms = used_ms(next, now_ms);
        snapshot->ran_ms = hub->options.ran_ms;
        snapshot->view = next->view;
        snapshot->owner = next->owner;
        memcpy(snapshot->id, next->id, sizeof snapshot->id);
        memcpy(snapshot->tokens, next->tokens, sizeof snapshot->tokens);
    }
    pthread_mutex_unlock(&hub->mutex);
    return next != NULL;
}

static char *text_of(const struct snapshot *snapshot, size_t *size) {
    proto_json *json = proto_json_object(), *tokens = proto_json_object();
    bool ok = proto_json_set_string(tokens, "control", snapshot->tokens[SRV_ROLE_CONTROL]);
    ok = proto_json_set_string(tokens, "view", snapshot->tokens[SRV_ROLE_VIEW]) && ok;
    ok = proto_json_set(json, "tokens", tokens) && ok;
    ok = proto_json_set(json, "view", proto_view_encode(&snapshot->view)) && ok;
    ok = proto_json_set_number(json, "used", (snapshot->used_ms + snapshot->ran_ms) / 1000) && ok;
    if (snapshot->owner.name[0])
        ok = proto_json_set(json, "owner", srv_owner_encode(&snapshot->owner)) && ok;
    char *text = ok ? proto_json_to_text(json, size) : NULL;
    proto_json_free(&json);
    return text;
}

bool srv_hub_save(struct srv_hub *hub, double now_ms,
                  bool (*save)(void *user, const char *id, const char *text, size_t size),
                  void *user) {
    struct snapshot *snapshot = malloc(sizeof *snapshot);
    bool ok = snapshot != NULL;
    pthread_mutex_lock(&hub->mutex);
    const uint64_t last = hub->next_unsaved;
    pthread_mutex_unlock(&hub->mutex);
    while (ok && take_snapshot(hub, last, now_ms, snapshot)) {
        size_t size;
        char *text = text_of(snapshot, &size);
        pthread_mutex_lock(&hub->mutex);
        struct srv_session *s = srv_hub_find_awake(hub, snapshot->id);
        if (s && s->number != snapshot->number)
            s = NULL; /* it slept meanwhile, and is another one */
        /* One that ended meanwhile must not come back. */
        ok = !s || (text && save(user, s->id, text, size));
        if (s && ok) {
            s->saved_version = snapshot->version;
            s->saved_used_ms = snapshot->used_ms;
            srv_hub_saved(hub, s);
        } else if (s) {
            set_unsaved(hub, s);
        }
        pthread_mutex_unlock(&hub->mutex);
        free(text);
    }
    free(snapshot);
    return ok;
}

/* Falling asleep. */

unsigned srv_hub_bucket(const char *id) {
    uint32_t hash = 2166136261; /* FNV-1a */
    for (; *id; id++)
        hash = (hash ^ (unsigned char)*id) * 16777619;
    return hash % SRV_HUB_BUCKETS;
}

static struct srv_sleeper **find(struct srv_hub *hub, const char *id) {
    struct srv_sleeper **link = &hub->sleepers[srv_hub_bucket(id)];
    while (*link && strcmp((*link)->id, id) != 0)
        link = &(*link)->next;
    return link;
}

static void link_sleeper(struct srv_hub *hub, struct srv_sleeper *sleeper) {
    struct srv_sleeper **bucket = &hub->sleepers[srv_hub_bucket(sleeper->id)];
    sleeper->next = *bucket;
    *bucket = sleeper;
    hub->sleeper_count++;
    sleeper->end.of = sleeper;
    srv_timer_set(&hub->sleeper_dues, &sleeper->end, sleeper->used_ms + hub->options.sleep_ms);
}

static void unlink_sleeper(struct srv_hub *hub, struct srv_sleeper **link) {
    struct srv_sleeper *sleeper = *link;
    *link = sleeper->next;
    hub->sleeper_count--;
    srv_timer_clear(&hub->sleeper_dues, &sleeper->end);
    free(sleeper);
}

bool srv_hub_add_sleeper(struct srv_hub *hub, const struct srv_session *session) {
    struct srv_sleeper *sleeper = calloc(1, sizeof *sleeper);
    if (!sleeper)
        return false;
    memcpy(sleeper->id, session->id, sizeof sleeper->id);
    memcpy(sleeper->tokens, session->tokens, sizeof sleeper->tokens);
    memcpy(sleeper->volume, session->view.volume, sizeof sleeper->volume);
    memcpy(sleeper->owner, session->owner.name, sizeof sleeper->owner);
    sleeper->used_ms = srv_hub_used_ms(session);
    link_sleeper(hub, sleeper);
    return true;
}

static bool read_token(const proto_json *record, const char *role,
                       char token[SRV_TOKEN_DIGITS + 1]) {
    const char *text = proto_json_string(proto_json_get(proto_json_get(record, "tokens"), role));
    if (!text || strlen(text) != SRV_TOKEN_DIGITS)
        return false;
    memcpy(token, text, SRV_TOKEN_DIGITS + 1);
    return true;
}

bool srv_hub_restore(struct srv_hub *hub, const char *id, const char *text, size_t size,
                     double now_ms, struct sp_error *err) {
    struct srv_sleeper *sleeper = calloc(1, sizeof *sleeper);
    if (!sleeper)
        return sp_fail(err, SP_ERR_MEMORY, NULL, "no memory for a session");
    proto_json *record = proto_json_parse(text, size, err);
    const char *volume = proto_view_volume(proto_json_get(record, "view"));
    bool ok = record != NULL;
    if (ok && (strlen(id) != sizeof sleeper->id - 1 || !volume || strlen(volume) >= SP_NAME_BYTES ||
               !read_token(record, "control", sleeper->tokens[SRV_ROLE_CONTROL]) ||
               !read_token(record, "view", sleeper->tokens[SRV_ROLE_VIEW])))
        ok = sp_fail(err, SP_ERR_FORMAT, NULL, "this is no session");
    if (ok) {
        strcpy(sleeper->id, id);
        strcpy(sleeper->volume, volume);
        struct srv_owner owner;
        srv_owner_decode(proto_json_get(record, "owner"), &owner);
        memcpy(sleeper->owner, owner.name, sizeof sleeper->owner);
        double used_s = 0;
        sleeper->used_ms = now_ms;
        if (proto_json_number(proto_json_get(record, "used"), &used_s))
            sleeper->used_ms = fmin(now_ms, used_s * 1000 - hub->options.ran_ms);
        pthread_mutex_lock(&hub->mutex);
        link_sleeper(hub, sleeper);
        pthread_mutex_unlock(&hub->mutex);
    } else {
        free(sleeper);
    }
    proto_json_free(&record);
    return ok;
}

/* Coming back. */

/* Its view as it was, of its volume, which has to be there. */
static bool resolve(struct srv_hub *hub, struct srv_session *session, struct sp_error *err) {
    struct sp_error why = { .code = SP_OK };
    size_t size;
    char *text = hub->options.recall(hub->options.user, session->id, &size, err);
    proto_json *record = text ? proto_json_parse(text, size, err) : NULL;
    srv_owner_decode(proto_json_get(record, "owner"), &session->owner);
    session->has_token = srv_hub_renew_quota(hub, &session->owner); /* nothing new is made */
    bool ok = record && srv_hub_resolve_view(hub, proto_json_get(record, "view"), NULL,
                                             &session->view, &session->volume, &why);
    if (record && !ok && why.code == SP_ERR_MEMORY)
        *err = why;
    else if (record && !ok &&
             (why.code == SP_ERR_NOT_READY || why.code == SP_ERR_VOLUME_UNKNOWN ||
              why.code == SP_ERR_VOLUME_FAILED))
        sp_fail(err, SP_ERR_NOT_READY, NULL, "the session waits for its volume: %s", why.text);
    else if (record && !ok)
        sp_fail(err, SP_ERR_NOT_READY, NULL, "the session's view cannot be shown here: %s: %s",
                why.place, why.text);
    proto_json_free(&record);
    free(text);
    return ok;
}

struct srv_session *srv_hub_wake(struct srv_hub *hub, const char *id, double now_ms,
                                 struct sp_error *err) {
    struct srv_sleeper **link = find(hub, id);
    if (!*link) {
        sp_fail(err, SP_ERR_NOT_FOUND, NULL, "there is no session '%s'; it may have ended", id);
        return NULL;
    }
    struct srv_session *session = calloc(1, sizeof *session);
    if (!session) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "no memory for a session");
        return NULL;
    }
    memcpy(session->id, (*link)->id, sizeof session->id);
    memcpy(session->tokens, (*link)->tokens, sizeof session->tokens);
    if (!resolve(hub, session, err)) {
        free(session);
        return NULL;
    }
    if (!srv_hub_make_room(hub)) {
        sp_fail(err, SP_ERR_BUDGET, NULL,
                "the session sleeps, and %u others are in use while --sessions allows %u; try "
                "again later",
                hub->session_count, hub->options.sessions_max);
        hub->options.volumes.release(hub->options.volumes.user, session->volume);
        free(session);
        return NULL;
    }
    link = find(hub, id); /* another one may lie before it */
    session->saved_used_ms = (*link)->used_ms;
    unlink_sleeper(hub, link);
    srv_hub_link_session(hub, session, now_ms);
    session->saved_version = session->version;
    srv_hub_unsaved(hub, session);
    sp_log_with(SP_LOG_INFO, SP_LOG_FIELDS({ "session", session->id }), "session %s is awake",
                session->id);
    return session;
}

const char *srv_hub_sleeping_owner(struct srv_hub *hub, const char *id) {
    const struct srv_sleeper *sleeper = *find(hub, id);
    return sleeper ? sleeper->owner : "";
}

const char *srv_hub_sleeping_token(struct srv_hub *hub, const char *id, enum srv_role role) {
    const struct srv_sleeper *sleeper = *find(hub, id);
    return sleeper ? sleeper->tokens[role] : NULL;
}

bool srv_hub_forget_sleeper(struct srv_hub *hub, const char *id) {
    struct srv_sleeper **link = find(hub, id);
    if (!*link)
        return false;
    unlink_sleeper(hub, link);
    return true;
}

double srv_hub_end_sleepers(struct srv_hub *hub, double now_ms) {
    for (const struct srv_sleeper *sleeper;
         (sleeper = srv_timer_take(&hub->sleeper_dues, now_ms));) {
        sp_log_with(SP_LOG_INFO, SP_LOG_FIELDS({ "session", sleeper->id }),
                    "session %s ended: nobody asked for it for %.0f s (--sleep-time)", sleeper->id,
                    hub->options.sleep_ms / 1000);
        srv_hub_ended(hub, sleeper->id);
        unlink_sleeper(hub, find(hub, sleeper->id));
    }
    return srv_timer_next(&hub->sleeper_dues);
}

unsigned srv_hub_count_sleepers(const struct srv_hub *hub, const char *owner) {
    unsigned count = 0;
    for (unsigned i = 0; i < SRV_HUB_BUCKETS; i++)
        for (const struct srv_sleeper *s = hub->sleepers[i]; s; s = s->next)
            count += strcmp(s->owner, owner) == 0;
    return count;
}

void srv_hub_list_sleepers(struct srv_hub *hub, const char *owner, double now_ms,
                           struct srv_page *page) {
    for (unsigned i = 0; i < SRV_HUB_BUCKETS; i++)
        for (const struct srv_sleeper *s = hub->sleepers[i]; s; s = s->next) {
            if (owner && strcmp(s->owner, owner) != 0)
                continue;
            struct srv_session_info *note = srv_page_slot(page, s->id);
            if (!note)
                continue;
            *note = (struct srv_session_info){ .is_asleep = true, .idle_ms = now_ms - s->used_ms };
            strcpy(note->id, s->id);
            strcpy(note->volume, s->volume);
            strcpy(note->owner, s->owner);
        }
}

void srv_hub_free_sleepers(struct srv_hub *hub) {
    for (unsigned i = 0; i < SRV_HUB_BUCKETS; i++)
        while (hub->sleepers[i])
            unlink_sleeper(hub, &hub->sleepers[i]);
}
