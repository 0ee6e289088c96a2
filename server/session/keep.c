/* SPDX-License-Identifier: Apache-2.0
 *
 * What is kept of a session, and how it comes back:
 *
 *   {"tokens": {"control", "view"}, "view": {…}}
 *
 * A session of an earlier run sleeps until its volume is ready. It has its id and tokens then, but
 * takes part in nothing; whoever asks for it is told what it waits for.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "protocol/view.h"
#include "session/hub_private.h"
#include "sp/log.h"

struct srv_sleeper {
    struct srv_sleeper *next;
    char id[SRV_SESSION_ID_BYTES];
    char tokens[2][SRV_TOKEN_DIGITS + 1];
    char volume[SP_NAME_BYTES];
    proto_json *record;
};

/* Saving. */

struct snapshot {
    uint64_t number, version;
    char id[SRV_SESSION_ID_BYTES];
    char tokens[2][SRV_TOKEN_DIGITS + 1];
    struct sp_view view;
};

/* Of the unsaved session with the lowest number above `after`. */
static bool take_snapshot(struct srv_hub *hub, uint64_t after, struct snapshot *snapshot) {
    const struct srv_session *next = NULL;
    pthread_mutex_lock(&hub->mutex);
    for (const struct srv_session *s = hub->sessions; s; s = s->next)
        if (s->number > after && s->saved_version != s->version &&
            (!next || s->number < next->number))
            next = s;
    if (next) {
        snapshot->number = next->number;
        snapshot->version = next->version;
        snapshot->view = next->view;
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
    char *text = ok ? proto_json_to_text(json, size) : NULL;
    proto_json_free(&json);
    return text;
}

bool srv_hub_save(struct srv_hub *hub,
                  bool (*save)(void *user, const char *id, const char *text, size_t size),
                  void *user) {
    struct snapshot *snapshot = malloc(sizeof *snapshot);
    bool ok = snapshot != NULL;
    for (uint64_t number = 0; ok && take_snapshot(hub, number, snapshot);) {
        size_t size;
        char *text = text_of(snapshot, &size);
        number = snapshot->number;
        pthread_mutex_lock(&hub->mutex);
        struct srv_session *s = hub->sessions;
        while (s && s->number != number)
            s = s->next;
        /* One that ended meanwhile must not come back. */
        ok = !s || (text && save(user, s->id, text, size));
        if (s && ok)
            s->saved_version = snapshot->version;
        pthread_mutex_unlock(&hub->mutex);
        free(text);
    }
    free(snapshot);
    return ok;
}

/* Coming back. */

static void sleeper_free(struct srv_sleeper *sleeper) {
    proto_json_free(&sleeper->record);
    free(sleeper);
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
                     struct sp_error *err) {
    struct srv_sleeper *sleeper = calloc(1, sizeof *sleeper);
    if (!sleeper)
        return sp_fail(err, SP_ERR_MEMORY, NULL, "no memory for a session");
    sleeper->record = proto_json_parse(text, size, err);
    const char *volume = proto_view_volume(proto_json_get(sleeper->record, "view"));
    bool ok = sleeper->record != NULL;
    if (ok && (strlen(id) != sizeof sleeper->id - 1 || !volume || strlen(volume) >= SP_NAME_BYTES ||
               !read_token(sleeper->record, "control", sleeper->tokens[SRV_ROLE_CONTROL]) ||
               !read_token(sleeper->record, "view", sleeper->tokens[SRV_ROLE_VIEW])))
        ok = sp_fail(err, SP_ERR_FORMAT, NULL, "this is no session");
    if (!ok) {
        sleeper_free(sleeper);
        return false;
    }
    strcpy(sleeper->id, id);
    strcpy(sleeper->volume, volume);
    pthread_mutex_lock(&hub->mutex);
    sleeper->next = hub->sleepers;
    hub->sleepers = sleeper;
    hub->sleeper_count++;
    pthread_mutex_unlock(&hub->mutex);
    return true;
}

static struct srv_sleeper **find(struct srv_hub *hub, const char *id) {
    struct srv_sleeper **link = &hub->sleepers;
    while (*link && strcmp((*link)->id, id) != 0)
        link = &(*link)->next;
    return link;
}

static void unlink_sleeper(struct srv_hub *hub, struct srv_sleeper **link) {
    struct srv_sleeper *sleeper = *link;
    *link = sleeper->next;
    hub->sleeper_count--;
    sleeper_free(sleeper);
}

static bool wake(struct srv_hub *hub, const struct srv_sleeper *sleeper, double now_ms,
                 struct sp_error *err) {
    struct srv_session *session = calloc(1, sizeof *session);
    if (!session)
        return sp_fail(err, SP_ERR_MEMORY, NULL, "no memory for a session");
    if (!srv_hub_resolve_view(hub, proto_json_get(sleeper->record, "view"), NULL, &session->view,
                              &session->volume, err)) {
        free(session);
        return false;
    }
    memcpy(session->id, sleeper->id, sizeof session->id);
    memcpy(session->tokens, sleeper->tokens, sizeof session->tokens);
    srv_hub_link_session(hub, session, now_ms);
    session->saved_version = session->version;
    return true;
}

void srv_hub_wake(struct srv_hub *hub, const char *volume, double now_ms) {
    struct sp_error err;
    for (struct srv_sleeper **link = &hub->sleepers; *link;) {
        struct srv_sleeper *sleeper = *link;
        if (strcmp(sleeper->volume, volume) == 0 && wake(hub, sleeper, now_ms, &err)) {
            sp_log(SP_LOG_INFO, "session %s is back", sleeper->id);
            unlink_sleeper(hub, link);
            continue;
        }
        if (strcmp(sleeper->volume, volume) == 0)
            sp_log(SP_LOG_ERROR, "session %s cannot come back: %s%s%s", sleeper->id, err.place,
                   err.place[0] ? ": " : "", err.text);
        link = &sleeper->next;
    }
}

bool srv_hub_is_asleep(struct srv_hub *hub, const char *id, struct sp_error *err) {
    const struct srv_volume_source *source = &hub->options.volumes;
    const struct srv_sleeper *sleeper = *find(hub, id);
    struct sp_error why;
    if (!sleeper)
        return false;
    void *volume = source->acquire(source->user, sleeper->volume, &why);
    if (volume)
        source->release(source->user, volume);
    sp_fail(err, SP_ERR_TIMEOUT, NULL, "the session waits for its volume: %s",
            volume ? "its view could not be shown again, the log says why" : why.text);
    return true;
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

void srv_hub_free_sleepers(struct srv_hub *hub) {
    while (hub->sleepers)
        unlink_sleeper(hub, &hub->sleepers);
}
