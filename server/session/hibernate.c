/* SPDX-License-Identifier: Apache-2.0
 *
 * What is saved of a session, hibernation, and how a hibernated session becomes active again.
 *
 * Saved text: {"tokens": {"control", "view"}, "view": {…}, "owner": {…}, "guest": true,
 * "measures": […], "used"}; "guest" if a join token made it.
 * "used" is the time of the last use, in seconds that daemons ran with this store (past_run_ms of
 * srv_hub_options), exact to a thousandth of --hibernation-time. So the limit --hibernation-time
 * continues after a restart and does not depend on the time of day. Without "used" it is now.
 *
 *     created ──► active ──(unused)──► hibernated ──(--hibernation-time, or deleted)──► ended
 *                   └──◄──(any request)──┘   └──◄── saved in an earlier run
 *
 * A hibernated session has only its id, tokens and names in memory, some hundred bytes. It uses no
 * volume; its view is in the store. It becomes active when its volume is ready; until then requests
 * fail with the reason.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/pagination.h"
#include "protocol/view.h"
#include "session/session.h"
#include "session/view_check.h"
#include "sp/log.h"

struct srv_hibernated_owner { /* a token that has hibernated sessions */
    struct srv_hibernated_owner *next;
    char name[SRV_TOKEN_NAME_BYTES]; /* "" = sessions without an owner */
    unsigned count, guests;          /* guests: sessions among `count` that join tokens made */
};

struct srv_hibernated_session {
    struct srv_hibernated_session *next;
    struct srv_hibernated_owner *owner;
    struct srv_timer end; /* hibernated for --hibernation-time */
    char id[SRV_SESSION_ID_BYTES];
    char tokens[2][SRV_TOKEN_DIGITS + 1];
    char volume[SP_NAME_BYTES];
    bool is_guests;
    double used_ms;
};

/* Saving. */

static double grain_ms(const struct srv_hub *hub) {
    return fmax(hub->options.hibernation_ms / 2000, 1000);
}

static double used_ms(const struct srv_session *s, double now_ms) {
    return s->participants ? now_ms : srv_hub_used_ms(s);
}

static bool is_saved(const struct srv_hub *hub, const struct srv_session *s, double now_ms) {
    return srv_hub_is_view_saved(s) && used_ms(s, now_ms) - s->saved.used_ms < grain_ms(hub);
}

static void set_unsaved(struct srv_hub *hub, struct srv_session *session) {
    if (!session->saved.unsaved.is_set)
        srv_timer_set(&hub->persistence.unsaved, &session->saved.unsaved,
                      (double)++hub->persistence.next_unsaved);
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
    if (!hub->options.recall || hub->active.count + hub->hibernated.count == 0 ||
        now_ms - hub->persistence.noted_ms < grain_ms(hub))
        return;
    hub->persistence.noted_ms = now_ms;
    for (struct srv_session *s = hub->active.first; s; s = s->next)
        if (!is_saved(hub, s, now_ms))
            set_unsaved(hub, s);
    tell_unsaved(hub);
}

struct snapshot {
    struct srv_session_identity identity;
    uint64_t version;
    double used_ms, past_run_ms;
    struct sp_view view;
    struct srv_measures measures; /* owned */
    bool is_complete;             /* false: memory was short for the measurements */
};

/* Takes the session that has been unsaved for the longest time, if its number is at most `last`. */
static bool pop_unsaved(struct srv_hub *hub, uint64_t last, double now_ms,
                        struct snapshot *snapshot) {
    const struct srv_session *next;
    pthread_mutex_lock(&hub->mutex);
    do
        next = srv_timer_pop(&hub->persistence.unsaved, (double)last);
    while (next && is_saved(hub, next, now_ms));
    if (next) {
        snapshot->identity = next->identity;
        snapshot->version = next->shared.version;
        snapshot->used_ms = used_ms(next, now_ms);
        snapshot->past_run_ms = hub->options.past_run_ms;
        snapshot->view = next->shared.view;
        snapshot->is_complete = srv_measures_copy(&next->measures, &snapshot->measures);
    }
    pthread_mutex_unlock(&hub->mutex);
    return next != NULL;
}

static char *text_of(const struct snapshot *snapshot, size_t *size) {
    proto_json *json = proto_json_object(), *tokens = proto_json_object();
    proto_json_set_string(&tokens, "control", snapshot->identity.tokens[SRV_ROLE_CONTROL]);
    proto_json_set_string(&tokens, "view", snapshot->identity.tokens[SRV_ROLE_VIEW]);
    proto_json_set(&json, "tokens", tokens);
    proto_json_set(&json, "view", proto_view_encode(&snapshot->view));
    proto_json_set_number(&json, "used", (snapshot->used_ms + snapshot->past_run_ms) / 1000);
    if (snapshot->measures.count > 0)
        proto_json_set(&json, "measures", srv_measures_encode(&snapshot->measures));
    if (snapshot->identity.is_guests)
        proto_json_set_bool(&json, "guest", true);
    if (snapshot->identity.owner.name[0])
        proto_json_set(&json, "owner", srv_owner_encode(&snapshot->identity.owner));
    char *text = snapshot->is_complete ? proto_json_to_text(json, size) : NULL;
    proto_json_free(&json);
    return text;
}

bool srv_hub_save(struct srv_hub *hub, double now_ms,
                  bool (*save)(void *user, const char *id, const char *text, size_t size),
                  void *user) {
    struct snapshot *snapshot = malloc(sizeof *snapshot);
    bool ok = snapshot != NULL;
    pthread_mutex_lock(&hub->mutex);
    const uint64_t last = hub->persistence.next_unsaved;
    pthread_mutex_unlock(&hub->mutex);
    while (ok && pop_unsaved(hub, last, now_ms, snapshot)) {
        size_t size;
        char *text = text_of(snapshot, &size);
        pthread_mutex_lock(&hub->mutex);
        struct srv_session *s = srv_hub_find_active(hub, snapshot->identity.id);
        if (s && s->identity.number != snapshot->identity.number)
            s = NULL; /* it hibernated meanwhile; this is another session */
        /* A session that ended meanwhile must not be stored again. */
        ok = !s || (text && save(user, s->identity.id, text, size));
        if (s && ok) {
            s->saved.version = snapshot->version;
            s->saved.measures_clock = snapshot->measures.clock;
            s->saved.used_ms = snapshot->used_ms;
            srv_hub_saved(hub, s);
        } else if (s) {
            set_unsaved(hub, s);
        }
        pthread_mutex_unlock(&hub->mutex);
        srv_measures_finish(&snapshot->measures);
        free(text);
    }
    free(snapshot);
    return ok;
}

/* Hibernation. */

unsigned srv_hub_bucket(const char *id) {
    uint32_t hash = 2166136261; /* FNV-1a */
    for (; *id; id++)
        hash = (hash ^ (unsigned char)*id) * 16777619;
    return hash % SRV_HUB_BUCKETS;
}

static struct srv_hibernated_session **find_hibernated(struct srv_hub *hub, const char *id) {
    struct srv_hibernated_session **link = &hub->hibernated.buckets[srv_hub_bucket(id)];
    while (*link && strcmp((*link)->id, id) != 0)
        link = &(*link)->next;
    return link;
}

static struct srv_hibernated_owner **find_owner(struct srv_hub *hub, const char *name) {
    struct srv_hibernated_owner **link = &hub->hibernated.owners;
    while (*link && strcmp((*link)->name, name) != 0)
        link = &(*link)->next;
    return link;
}

/* Adds an empty entry of an owner, or returns NULL when out of memory. */
static struct srv_hibernated_session *create(struct srv_hub *hub, const char *owner) {
    struct srv_hibernated_session *entry = calloc(1, sizeof *entry);
    struct srv_hibernated_owner **by = find_owner(hub, owner);
    if (entry && !*by && (*by = calloc(1, sizeof **by)))
        snprintf((*by)->name, sizeof(*by)->name, "%s", owner);
    if (!entry || !*by) {
        free(entry);
        return NULL;
    }
    entry->owner = *by;
    entry->owner->count++;
    return entry;
}

static void link_hibernated(struct srv_hub *hub, struct srv_hibernated_session *entry) {
    struct srv_hibernated_session **bucket = &hub->hibernated.buckets[srv_hub_bucket(entry->id)];
    entry->next = *bucket;
    *bucket = entry;
    hub->hibernated.count++;
    entry->owner->guests += entry->is_guests;
    entry->end.of = entry;
    srv_timer_set(&hub->hibernated.ends, &entry->end, entry->used_ms + hub->options.hibernation_ms);
}

static void unlink_hibernated(struct srv_hub *hub, struct srv_hibernated_session **link) {
    struct srv_hibernated_session *entry = *link;
    *link = entry->next;
    hub->hibernated.count--;
    entry->owner->guests -= entry->is_guests;
    srv_timer_clear(&hub->hibernated.ends, &entry->end);
    if (--entry->owner->count == 0) {
        struct srv_hibernated_owner **by = find_owner(hub, entry->owner->name);
        *by = entry->owner->next;
        free(entry->owner);
    }
    free(entry);
}

/* Finds the session to end when there are too many. It belongs to the owner with the most: first
 * sessions of guests, and among them the session that was unused for the longest time. */
static struct srv_hibernated_session *find_surplus(const struct srv_hub *hub) {
    const struct srv_hibernated_owner *most = hub->hibernated.owners;
    struct srv_hibernated_session *found = NULL;
    for (const struct srv_hibernated_owner *by = most; by; by = by->next)
        most = by->count > most->count ? by : most;
    for (unsigned i = 0; i < SRV_HUB_BUCKETS; i++)
        for (struct srv_hibernated_session *s = hub->hibernated.buckets[i]; s; s = s->next)
            if (s->owner == most && s != hub->hibernated.resumed &&
                (!found || s->is_guests > found->is_guests ||
                 (s->is_guests == found->is_guests && s->used_ms < found->used_ms)))
                found = s;
    return found;
}

static void end_hibernated(struct srv_hub *hub, const struct srv_hibernated_session *entry,
                           const char *why) {
    sp_log_with(SP_LOG_INFO, SP_LOG_FIELDS({ "session", entry->id }), "session %s ended: %s",
                entry->id, why);
    srv_hub_ended(hub, entry->id);
    unlink_hibernated(hub, find_hibernated(hub, entry->id));
}

bool srv_hibernated_add(struct srv_hub *hub, const struct srv_session *session) {
    char why[128];
    const unsigned resumed = hub->hibernated.resumed != NULL;
    const struct srv_hibernated_session *surplus;
    while (hub->hibernated.count - resumed >= hub->options.hibernated_max &&
           (surplus = find_surplus(hub))) {
        snprintf(why, sizeof why,
                 "%u sessions are hibernated (--hibernated-sessions), %u of them of %s",
                 hub->hibernated.count, surplus->owner->count, surplus->owner->name);
        end_hibernated(hub, surplus, why);
    }
    struct srv_hibernated_session *entry = create(hub, session->identity.owner.name);
    if (!entry)
        return false;
    memcpy(entry->id, session->identity.id, sizeof entry->id);
    memcpy(entry->tokens, session->identity.tokens, sizeof entry->tokens);
    memcpy(entry->volume, session->shared.view.volume, sizeof entry->volume);
    entry->is_guests = session->identity.is_guests;
    entry->used_ms = srv_hub_used_ms(session);
    link_hibernated(hub, entry);
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

/* Creates the entry of a record. The caller holds the mutex. */
static bool restore(struct srv_hub *hub, const char *id, const proto_json *record, double now_ms,
                    struct sp_error *err) {
    char tokens[2][SRV_TOKEN_DIGITS + 1];
    const char *volume = proto_view_volume(proto_json_get(record, "view"));
    struct srv_owner owner;
    double used_s = 0;
    srv_owner_decode(proto_json_get(record, "owner"), &owner);
    if (strlen(id) != SRV_SESSION_ID_BYTES - 1)
        return sp_fail(err, SP_ERR_FORMAT, NULL, "the id is not one of a session");
    if (!read_token(record, "control", tokens[SRV_ROLE_CONTROL]) ||
        !read_token(record, "view", tokens[SRV_ROLE_VIEW]))
        return sp_fail(err, SP_ERR_FORMAT, "/tokens", "the join tokens are missing");
    struct srv_hibernated_session *entry = create(hub, owner.name);
    if (!entry)
        return sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for a session");
    strcpy(entry->id, id);
    snprintf(entry->volume, sizeof entry->volume, "%s", volume ? volume : "");
    memcpy(entry->tokens, tokens, sizeof tokens);
    proto_json_bool(proto_json_get(record, "guest"), &entry->is_guests);
    entry->used_ms = now_ms;
    if (proto_json_number(proto_json_get(record, "used"), &used_s))
        entry->used_ms = fmin(now_ms, used_s * 1000 - hub->options.past_run_ms);
    link_hibernated(hub, entry);
    return true;
}

/* Checks what is read when the session becomes active. */
static bool check(const char *id, const proto_json *record, struct sp_error *err) {
    const proto_json *view = proto_json_get(record, "view");
    const proto_json *measures = proto_json_get(record, "measures");
    const char *volume = proto_view_volume(view);
    struct proto_measure measure;
    struct sp_view read;
    struct sp_error why;
    if (!volume || strlen(volume) >= SP_NAME_BYTES)
        return sp_fail(err, SP_ERR_FORMAT, "/view/volume", "is not the id of a volume");
    if (!srv_view_check(view, &read, &why)) {
        sp_fail(err, SP_ERR_FORMAT, NULL, "/view%.80s: %.280s", why.place, why.text);
        return false;
    }
    for (size_t i = 0; i < proto_json_size(measures); i++)
        if (!proto_measure_restore(proto_json_at(measures, i), &measure))
            sp_log_with(SP_LOG_ERROR, SP_LOG_FIELDS({ "session", id }),
                        "the record of the session %s is damaged: /measures/%zu is no measurement; "
                        "it is left out",
                        id, i);
    return true;
}

bool srv_hub_restore(struct srv_hub *hub, const char *id, const char *text, size_t size,
                     double now_ms, struct sp_error *err) {
    proto_json *record = proto_json_parse(text, size, err);
    pthread_mutex_lock(&hub->mutex);
    bool ok = record && restore(hub, id, record, now_ms, err);
    pthread_mutex_unlock(&hub->mutex);
    ok = ok && check(id, record, err);
    proto_json_free(&record);
    return ok;
}

bool srv_hibernated_missing(const struct srv_hub *hub, const char *id, struct sp_error *err) {
    struct sp_error why = { .code = SP_ERR_NOT_FOUND };
    size_t size;
    char *text =
        hub->options.recall ? hub->options.recall(hub->options.user, id, &size, &why) : NULL;
    const bool is_damaged = !text && why.code == SP_ERR_IO;
    free(text);
    if (is_damaged)
        return sp_fail(err, why.code, NULL, "%s", why.text);
    return sp_fail(err, SP_ERR_NOT_FOUND, NULL, "there is no session '%s'; it may have ended", id);
}

/* Becoming active again. */

/* Restores the view and owner from the store; the volume has to be ready. */
static bool resolve(struct srv_hub *hub, struct srv_session *session, struct sp_error *err) {
    struct sp_error why = { .code = SP_OK };
    size_t size;
    char *text = hub->options.recall(hub->options.user, session->identity.id, &size, err);
    proto_json *record = text ? proto_json_parse(text, size, err) : NULL;
    srv_owner_decode(proto_json_get(record, "owner"), &session->identity.owner);
    session->identity.has_token = srv_hub_renew_quota(hub, &session->identity.owner);
    bool ok = record && srv_hub_resolve_view(hub, proto_json_get(record, "view"), NULL,
                                             &session->shared.view, &session->shared.volume, &why);
    if (record && !ok && why.code == SP_ERR_MEMORY)
        *err = why;
    else if (record && !ok &&
             (why.code == SP_ERR_NOT_READY || why.code == SP_ERR_VOLUME_UNKNOWN ||
              why.code == SP_ERR_VOLUME_FAILED))
        sp_fail(err, SP_ERR_NOT_READY, NULL, "the session waits for its volume: %s", why.text);
    else if (record && !ok)
        sp_fail(err, SP_ERR_NOT_READY, NULL, "the session's view cannot be shown here: %s: %s",
                why.place, why.text);
    if (ok && !srv_measures_restore(&session->measures, proto_json_get(record, "measures")))
        ok = sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for the measurements");
    proto_json_free(&record);
    free(text);
    return ok;
}

struct srv_session *srv_hibernated_resume(struct srv_hub *hub, const char *id, double now_ms,
                                          struct sp_error *err) {
    struct srv_hibernated_session **link = find_hibernated(hub, id);
    if (!*link) {
        srv_hibernated_missing(hub, id, err);
        return NULL;
    }
    struct srv_session *session = srv_hub_alloc_session(hub);
    if (!session) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for a session");
        return NULL;
    }
    memcpy(session->identity.id, (*link)->id, sizeof session->identity.id);
    memcpy(session->identity.tokens, (*link)->tokens, sizeof session->identity.tokens);
    if (!resolve(hub, session, err)) {
        srv_hub_free_session(hub, session);
        return NULL;
    }
    session->identity.is_guests = (*link)->is_guests;
    hub->hibernated.resumed = *link;
    const bool has_capacity = srv_hub_ensure_capacity(hub, &session->identity, err);
    hub->hibernated.resumed = NULL;
    if (!has_capacity) {
        srv_hub_free_session(hub, session);
        return NULL;
    }
    link = find_hibernated(hub, id); /* ensure_capacity() may have changed the list */
    session->saved.used_ms = (*link)->used_ms;
    unlink_hibernated(hub, link);
    srv_hub_link_session(hub, session, now_ms);
    session->saved.version = session->shared.version;
    session->saved.measures_clock = session->measures.clock;
    srv_hub_unsaved(hub, session);
    sp_log_with(SP_LOG_INFO, SP_LOG_FIELDS({ "session", session->identity.id }),
                "session %s is active", session->identity.id);
    return session;
}

const char *srv_hibernated_owner(struct srv_hub *hub, const char *id) {
    const struct srv_hibernated_session *entry = *find_hibernated(hub, id);
    return entry ? entry->owner->name : "";
}

const char *srv_hibernated_token(struct srv_hub *hub, const char *id, enum srv_role role) {
    const struct srv_hibernated_session *entry = *find_hibernated(hub, id);
    return entry ? entry->tokens[role] : NULL;
}

bool srv_hibernated_remove(struct srv_hub *hub, const char *id) {
    struct srv_hibernated_session **link = find_hibernated(hub, id);
    if (!*link)
        return false;
    unlink_hibernated(hub, link);
    return true;
}

double srv_hibernated_tick(struct srv_hub *hub, double now_ms) {
    char why[64];
    snprintf(why, sizeof why, "unused for %.0f s (--hibernation-time)",
             hub->options.hibernation_ms / 1000);
    for (const struct srv_hibernated_session *entry;
         (entry = srv_timer_pop(&hub->hibernated.ends, now_ms));)
        end_hibernated(hub, entry, why);
    return srv_timer_next(&hub->hibernated.ends);
}

unsigned srv_hibernated_count(struct srv_hub *hub, const char *owner, unsigned *guests) {
    const struct srv_hibernated_owner *by = *find_owner(hub, owner);
    *guests = by ? by->guests : 0;
    return by ? by->count : 0;
}

void srv_hibernated_list(struct srv_hub *hub, const char *owner, double now_ms,
                         struct srv_page *page) {
    for (unsigned i = 0; i < SRV_HUB_BUCKETS; i++)
        for (const struct srv_hibernated_session *s = hub->hibernated.buckets[i]; s; s = s->next) {
            if (owner && strcmp(s->owner->name, owner) != 0)
                continue;
            struct srv_session_info *note = srv_page_slot(page, s->id);
            if (!note)
                continue;
            *note =
                (struct srv_session_info){ .is_hibernated = true, .idle_ms = now_ms - s->used_ms };
            strcpy(note->id, s->id);
            strcpy(note->volume, s->volume);
            strcpy(note->owner, s->owner->name);
        }
}

void srv_hibernated_free(struct srv_hub *hub) {
    for (unsigned i = 0; i < SRV_HUB_BUCKETS; i++)
        while (hub->hibernated.buckets[i])
            unlink_hibernated(hub, &hub->hibernated.buckets[i]);
}
