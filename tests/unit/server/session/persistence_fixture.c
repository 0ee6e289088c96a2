/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "support/compare.h"
#include "unit/server/session/persistence_fixture.h"

/* The JSON library's own hook; its header belongs to protocol/json.c. */
void json_set_alloc_funcs(void *(*allocate)(size_t), void (*release)(void *));

struct persistence_fixture persist;
long persist_allocations = -1;
bool persist_deletes;

static void *allocate(size_t size) {
    if (persist_allocations == 0)
        return NULL;
    persist_allocations -= persist_allocations > 0;
    if (persist_deletes) {
        persist_deletes = false;
        assert_true(srv_hub_session_delete(persist.hub, persist.id, NULL));
    }
    return malloc(size);
}

static void on_changed(void *user) {
    (void)user;
    persist.changes++;
}

static void on_ended(void *user, const char *id) {
    (void)user;
    persist.ends++;
    snprintf(persist.ended, sizeof persist.ended, "%s", id);
}

static bool supports(void *user, const struct sp_view *view, struct sp_error *err) {
    (void)user;
    (void)view;
    return !persist.is_refused ||
           sp_fail(err, SP_ERR_UNSUPPORTED, "/filter", "not by this backend");
}

bool persist_save(void *user, const char *id, const char *text, size_t size) {
    (void)user;
    if (persist.refuses_save)
        return false;
    persist.saves++;
    assert_string_equal(id, persist.id);
    assert_compare(size, <, sizeof persist.text);
    assert_int_equal(strlen(text), size);
    memcpy(persist.text, text, size + 1);
    persist.size = size;
    return true;
}

bool persist_save_each(void *user, const char *id, const char *text, size_t size) {
    (void)user;
    (void)size;
    int i = 0;
    while (i < PERSIST_RECORDS && persist.records[i].text && strcmp(persist.records[i].id, id) != 0)
        i++;
    assert_compare(i, <, PERSIST_RECORDS);
    free(persist.records[i].text);
    strcpy(persist.records[i].id, id);
    persist.records[i].text = strdup(text);
    return persist.records[i].text != NULL;
}

static char *recall(void *user, const char *id, size_t *size, struct sp_error *err) {
    (void)user;
    for (int i = 0; i < PERSIST_RECORDS; i++)
        if (persist.records[i].text && strcmp(persist.records[i].id, id) == 0) {
            *size = strlen(persist.records[i].text);
            return strdup(persist.records[i].text);
        }
    if (strcmp(id, persist.id) != 0) {
        sp_fail(err, SP_ERR_NOT_FOUND, NULL, "no record");
        return NULL;
    }
    char *copy = malloc(persist.size + 1);
    assert_non_null(copy);
    memcpy(copy, persist.text, persist.size + 1);
    *size = persist.size;
    return copy;
}

static bool token(void *user, const char *name, unsigned *rights, struct srv_quota *quota) {
    (void)user;
    assert_string_equal(name, "ann");
    *rights = SRV_RIGHT_VIEW;
    if (persist.quota)
        *quota = *persist.quota;
    return persist.quota != NULL;
}

void persist_create_hub(void) {
    struct srv_hub_options options = { .volumes = fake_volume_source(&persist.volumes),
                                       .sessions_max =
                                           persist.sessions_max ? persist.sessions_max : 2,
                                       .hibernation_ms = 50000,
                                       .past_run_ms = persist.ran_ms,
                                       .hibernated_max = 2,
                                       .participants_max = 3,
                                       .session_idle_ms = 1000,
                                       .rest_ms = 100,
                                       .stream_bytes = 1 << 20,
                                       .ready = fake_ignore,
                                       .recall = recall,
                                       .token = token,
                                       .supports = supports,
                                       .changed = on_changed,
                                       .ended = on_ended };
    persist.hub = srv_hub_create(&options, NULL);
    assert_non_null(persist.hub);
}

int persist_set_up(void **state) {
    (void)state;
    memset(&persist, 0, sizeof persist);
    persist.volumes.only = "v";
    persist_allocations = -1;
    json_set_alloc_funcs(allocate, free);
    persist_create_hub();
    proto_json *patch = proto_json_parse("{\"size\":[30,20]}", 16, NULL);
    proto_json *json = srv_hub_session_create(
        persist.hub, patch, &(const struct srv_owner){ .name = "" }, false, 0, persist.id, NULL);
    proto_json_free(&patch);
    proto_json_free(&json);
    return json || !persist.id[0] ? -1 : 0;
}

int persist_tear_down(void **state) {
    (void)state;
    srv_hub_destroy(&persist.hub);
    json_set_alloc_funcs(malloc, free);
    for (int i = 0; i < PERSIST_RECORDS; i++)
        free(persist.records[i].text);
    return persist.volumes.uses; /* each use must be released */
}

struct srv_hub_numbers persist_numbers(void) {
    struct srv_hub_numbers numbers;
    srv_hub_numbers(persist.hub, &numbers);
    return numbers;
}

char *persist_text_at(double now_ms) {
    struct sp_error err;
    proto_json *json = srv_hub_session_get(persist.hub, persist.id, true, now_ms, &err);
    if (!json)
        fail_msg("%s", err.text);
    char *text = proto_json_to_canonical(json, NULL);
    proto_json_free(&json);
    return text;
}

char *persist_text(void) {
    return persist_text_at(0);
}

void persist_patch(const char *text) {
    proto_json *json = proto_json_parse(text, strlen(text), NULL);
    proto_json *view = srv_hub_session_patch(persist.hub, persist.id, json, 10, NULL);
    assert_non_null(view);
    proto_json_free(&view);
    proto_json_free(&json);
}

void persist_restart(void) {
    struct sp_error err;
    srv_hub_destroy(&persist.hub);
    assert_int_equal(persist.volumes.uses, 0);
    persist_create_hub();
    persist.volumes.is_loading = true;
    if (!srv_hub_restore(persist.hub, persist.id, persist.text, persist.size, 0, &err))
        fail_msg("%s", err.text);
}

void persist_is_hibernated_because(const char *why) {
    struct sp_error err;
    assert_null(srv_hub_session_get(persist.hub, persist.id, true, 0, &err));
    assert_int_equal(err.code, SP_ERR_NOT_READY);
    if (!strstr(err.text, why))
        fail_msg("'%s' does not say '%s'", err.text, why);
}

bool persist_create(const struct srv_owner *owner, bool is_guest, double now_ms,
                    struct sp_error *err) {
    char id[SRV_SESSION_ID_BYTES];
    proto_json *json = srv_hub_session_create(persist.hub, NULL, owner, is_guest, now_ms, id, err);
    bool made = json != NULL;
    proto_json_free(&json);
    if (made)
        strcpy(persist.id, id);
    return made;
}
