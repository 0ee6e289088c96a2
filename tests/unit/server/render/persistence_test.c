/* SPDX-License-Identifier: Apache-2.0
 *
 * What is kept of sessions: saved when they changed, asleep when nobody uses them, awake when
 * somebody asks; the clock is given.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/pagination.h"
#include "config/tokens.h"
#include "session/participant.h"
#include "support/compare.h"
#include "support/fake_volumes.h"

/* The JSON library's own hook; its header belongs to protocol/json.c. */
void json_set_alloc_funcs(void *(*allocate)(size_t), void (*release)(void *));

static struct fixture {
    struct srv_hub *hub;
    struct fake_volumes volumes;
    int saves, changes, ends;
    bool is_refused, refuses_save;
    char ended[32], id[SRV_SESSION_ID_BYTES];
    char text[8192]; /* of the session that was saved last */
    size_t size;
    unsigned sessions_max;   /* 0 = 2 */
    struct srv_quota *quota; /* of the token ann; NULL = there is none of that name */
    double ran_ms;           /* before this start */
    struct {
        char id[SRV_SESSION_ID_BYTES], *text;
    } kept[4]; /* of save_each() */
} f;

static long left = -1; /* allocations of JSON that still succeed; < 0 = all */
static bool delete_meanwhile;

static void *allocate(size_t size) {
    if (left == 0)
        return NULL;
    left -= left > 0;
    if (delete_meanwhile) {
        delete_meanwhile = false;
        assert_true(srv_hub_session_delete(f.hub, f.id, NULL));
    }
    return malloc(size);
}

static void on_changed(void *user) {
    (void)user;
    f.changes++;
}

static void on_ended(void *user, const char *id) {
    (void)user;
    f.ends++;
    snprintf(f.ended, sizeof f.ended, "%s", id);
}

static bool supports(void *user, const struct sp_view *view, struct sp_error *err) {
    (void)user;
    (void)view;
    return !f.is_refused || sp_fail(err, SP_ERR_UNSUPPORTED, "/filter", "not by this backend");
}

static bool save(void *user, const char *id, const char *text, size_t size) {
    (void)user;
    if (f.refuses_save)
        return false;
    f.saves++;
    assert_string_equal(id, f.id);
    assert_compare(size, <, sizeof f.text);
    assert_int_equal(strlen(text), size);
    memcpy(f.text, text, size + 1);
    f.size = size;
    return true;
}

/* As save(), of several sessions. */
static bool save_each(void *user, const char *id, const char *text, size_t size) {
    (void)user;
    (void)size;
    int i = 0;
    while (i < 4 && f.kept[i].text && strcmp(f.kept[i].id, id) != 0)
        i++;
    assert_compare(i, <, 4);
    free(f.kept[i].text);
    strcpy(f.kept[i].id, id);
    f.kept[i].text = strdup(text);
    return f.kept[i].text != NULL;
}

static char *recall(void *user, const char *id, size_t *size, struct sp_error *err) {
    (void)user;
    for (int i = 0; i < 4; i++)
        if (f.kept[i].text && strcmp(f.kept[i].id, id) == 0) {
            *size = strlen(f.kept[i].text);
            return strdup(f.kept[i].text);
        }
    if (strcmp(id, f.id) != 0) {
        sp_fail(err, SP_ERR_NOT_FOUND, NULL, "not kept");
        return NULL;
    }
    char *copy = malloc(f.size + 1);
    assert_non_null(copy);
    memcpy(copy, f.text, f.size + 1);
    *size = f.size;
    return copy;
}

static bool token(void *user, const char *name, unsigned *rights, struct srv_quota *quota) {
    (void)user;
    assert_string_equal(name, "ann");
    *rights = SRV_RIGHT_VIEW;
    if (f.quota)
        *quota = *f.quota;
    return f.quota != NULL;
}

static void create_hub(void) {
    struct srv_hub_options options = { .volumes = fake_volume_source(&f.volumes),
                                       .sessions_max = f.sessions_max ? f.sessions_max : 2,
                                       .hibernation_ms = 50000,
                                       .past_run_ms = f.ran_ms,
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
    f.hub = srv_hub_create(&options, NULL);
    assert_non_null(f.hub);
}

static int set_up(void **state) {
    (void)state;
    memset(&f, 0, sizeof f);
    f.volumes.only = "v";
    left = -1;
    json_set_alloc_funcs(allocate, free);
    create_hub();
    proto_json *patch = proto_json_parse("{\"size\":[30,20]}", 16, NULL);
    proto_json *json = srv_hub_session_create(f.hub, patch, 0, f.id, NULL);
    proto_json_free(&patch);
    proto_json_free(&json);
    return json || !f.id[0] ? -1 : 0;
}

static int tear_down(void **state) {
    (void)state;
    srv_hub_destroy(&f.hub);
    json_set_alloc_funcs(malloc, free);
    for (int i = 0; i < 4; i++)
        free(f.kept[i].text);
    return f.volumes.uses; /* every use was given back */
}

static struct srv_hub_numbers numbers(void) {
    struct srv_hub_numbers numbers;
    srv_hub_numbers(f.hub, &numbers);
    return numbers;
}

static char *session_text_at(double now_ms) {
    struct sp_error err;
    proto_json *json = srv_hub_session_get(f.hub, f.id, true, now_ms, &err);
    if (!json)
        fail_msg("%s", err.text);
    char *text = proto_json_to_canonical(json, NULL);
    proto_json_free(&json);
    return text;
}

static char *session_text(void) {
    return session_text_at(0);
}

static void patch(const char *text) {
    proto_json *json = proto_json_parse(text, strlen(text), NULL);
    proto_json *view = srv_hub_session_patch(f.hub, f.id, json, 10, NULL);
    assert_non_null(view);
    proto_json_free(&view);
    proto_json_free(&json);
}

/* The daemon ends and starts again, and the volume is still loading. */
static void restart(void) {
    struct sp_error err;
    srv_hub_destroy(&f.hub);
    assert_int_equal(f.volumes.uses, 0);
    create_hub();
    f.volumes.is_loading = true;
    if (!srv_hub_restore(f.hub, f.id, f.text, f.size, 0, &err))
        fail_msg("%s", err.text);
}

static void asleep_because(const char *why) {
    struct sp_error err;
    assert_null(srv_hub_session_get(f.hub, f.id, true, 0, &err));
    assert_int_equal(err.code, SP_ERR_NOT_READY);
    if (!strstr(err.text, why))
        fail_msg("'%s' does not say '%s'", err.text, why);
}

static void what_changed_is_saved_once(void **state) {
    (void)state;
    assert_int_equal(f.changes, 1);
    assert_true(srv_hub_save(f.hub, 0, save, NULL));
    assert_int_equal(f.saves, 1);
    assert_true(srv_hub_save(f.hub, 0, save, NULL));
    assert_int_equal(f.saves, 1);
    patch("{\"size\":[40,20]}");
    patch("{\"size\":[41,20]}");
    assert_int_equal(f.changes, 3);
    f.refuses_save = true;
    assert_false(srv_hub_save(f.hub, 0, save, NULL));
    f.refuses_save = false;
    assert_true(srv_hub_save(f.hub, 0, save, NULL));
    assert_int_equal(f.saves, 2);
    assert_non_null(strstr(f.text, "[41,20]"));
}

static void one_that_ended_is_not_saved(void **state) {
    (void)state;
    delete_meanwhile = true; /* while its record is written, with no lock held */
    assert_true(srv_hub_save(f.hub, 0, save, NULL));
    assert_false(delete_meanwhile);
    assert_int_equal(f.saves, 0);
    assert_int_equal(f.ends, 1);
    assert_string_equal(f.ended, f.id);
}

static void comes_back_as_it_was(void **state) {
    (void)state;
    patch("{\"camera\":{\"position\":[0.1,7.3,3e5]},\"background\":[0.1,0.2,0.3,1]}");
    assert_true(srv_hub_save(f.hub, 0, save, NULL));
    char *before = session_text();
    restart();
    asleep_because("no v now");
    f.volumes.is_loading = false;
    char *after = session_text_at(5000);
    assert_string_equal(before, after);
    free(before);
    free(after);
    assert_true(srv_hub_save(f.hub, 5000, save, NULL));
    assert_int_equal(f.saves, 2); /* that it was used */
    assert_true(srv_hub_save(f.hub, 5000, save, NULL));
    assert_int_equal(f.saves, 2); /* nothing has changed */
    assert_int_equal(numbers().sessions, 1);
    assert_int_equal(numbers().hibernated, 0);
}

/* Nothing is lost when nobody uses a session, whatever happened to it, but for its own long limit.
 */
static void an_idle_one_sleeps(void **state) {
    (void)state;
    patch("{\"size\":[44,20]}"); /* at 10 ms */
    char *before = session_text();
    srv_hub_tick(f.hub, 1009);
    assert_int_equal(numbers().sessions, 1);
    f.changes = 0;
    srv_hub_tick(f.hub, 1011);
    assert_int_equal(numbers().sessions, 1);
    assert_int_equal(f.changes, 1); /* not before it is saved */
    assert_true(srv_hub_save(f.hub, 0, save, NULL));
    srv_hub_tick(f.hub, 1012);
    assert_int_equal(numbers().sessions, 0);
    assert_int_equal(numbers().hibernated, 1);
    assert_int_equal(f.volumes.uses, 0);
    char *after = session_text_at(3000);
    assert_string_equal(before, after);
    free(before);
    free(after);
    assert_true(srv_hub_save(f.hub, 3000, save, NULL));
    assert_int_equal(f.saves, 2); /* that it was used */
    assert_true(srv_hub_save(f.hub, 3900, save, NULL));
    assert_int_equal(f.saves, 2); /* nothing has changed */
    srv_hub_tick(f.hub, 3999);    /* idle since it woke */
    assert_int_equal(numbers().sessions, 1);
    assert_compare(srv_hub_tick(f.hub, 4000), >, 0);
    assert_int_equal(numbers().hibernated, 1);
    srv_hub_tick(f.hub, 52999); /* used last at 3000 */
    assert_int_equal(numbers().hibernated, 1);
    assert_int_equal(f.ends, 0);
    srv_hub_tick(f.hub, 53000);
    assert_int_equal(numbers().hibernated, 0);
    assert_int_equal(f.ends, 1);
    assert_string_equal(f.ended, f.id);
}

static void one_whose_volume_is_gone_ends_as_well(void **state) {
    (void)state;
    assert_true(srv_hub_save(f.hub, 0, save, NULL));
    restart();
    srv_hub_tick(f.hub, 49999);
    asleep_because("waits for its volume"); /* which is no use of it */
    srv_hub_tick(f.hub, 50000);
    assert_int_equal(numbers().hibernated, 0);
    assert_int_equal(f.ends, 1);
}

static void sleep_goes_on_where_the_last_daemon_ended(void **state) {
    (void)state;
    patch("{\"size\":[44,20]}"); /* at 10 ms */
    assert_true(srv_hub_save(f.hub, 10, save, NULL));
    f.ran_ms = 30000;
    restart();
    srv_hub_tick(f.hub, 20009);
    assert_int_equal(numbers().hibernated, 1);
    assert_int_equal(f.ends, 0);
    srv_hub_tick(f.hub, 20010);
    assert_int_equal(numbers().hibernated, 0);
    assert_int_equal(f.ends, 1);
}

static void what_does_not_say_when_it_was_used_sleeps_from_now_on(void **state) {
    (void)state;
    assert_true(srv_hub_save(f.hub, 0, save, NULL));
    char *used = strstr(f.text, ",\"used\":");
    assert_non_null(used);
    strcpy(used, "}"); /* it is the last one */
    f.size = strlen(f.text);
    f.ran_ms = 1e9;
    restart();
    srv_hub_tick(f.hub, 49999);
    assert_int_equal(numbers().hibernated, 1);
    srv_hub_tick(f.hub, 50000);
    assert_int_equal(numbers().hibernated, 0);
}

/* The daemon was killed before it wrote for how long it ran. */
static void so_does_what_was_used_later_than_now(void **state) {
    (void)state;
    patch("{\"size\":[44,20]}");
    f.ran_ms = 0;
    assert_true(srv_hub_save(f.hub, 10, save, NULL));
    f.ran_ms = -1e6;
    restart();
    srv_hub_tick(f.hub, 49999);
    assert_int_equal(numbers().hibernated, 1);
    srv_hub_tick(f.hub, 50000);
    assert_int_equal(numbers().hibernated, 0);
}

/* Who watches uses a session, without a change that would be saved. */
static void that_it_is_used_is_saved_now_and_then(void **state) {
    (void)state;
    assert_true(srv_hub_save(f.hub, 0, save, NULL));
    assert_int_equal(f.saves, 1);
    struct srv_participant *p = srv_hub_join(f.hub, f.id, SRV_ROLE_VIEW, "", NULL, 100, NULL);
    f.changes = 0;
    srv_hub_tick(f.hub, 999);
    assert_int_equal(f.changes, 0);
    assert_true(srv_hub_save(f.hub, 999, save, NULL));
    assert_int_equal(f.saves, 1);
    srv_hub_tick(f.hub, 1000);
    srv_hub_tick(f.hub, 1001);
    assert_int_equal(f.changes, 1);
    assert_true(srv_hub_save(f.hub, 1001, save, NULL));
    assert_int_equal(f.saves, 2);
    assert_non_null(strstr(f.text, "\"used\":1.001"));
    srv_hub_leave(f.hub, &p, 1500);
    assert_true(srv_hub_save(f.hub, 9000, save, NULL));
    assert_int_equal(f.saves, 2); /* not used since */
}

static void all_are_listed(void **state) {
    (void)state;
    struct srv_session_info notes[4];
    struct srv_page page = { .items = notes, .item_bytes = sizeof *notes, .max = 4, .after = "" };
    char other[SRV_SESSION_ID_BYTES];
    assert_true(srv_hub_save(f.hub, 0, save, NULL));
    srv_hub_tick(f.hub, 1000);
    proto_json *json = srv_hub_session_create(f.hub, NULL, 2000, other, NULL);
    proto_json_free(&json);
    struct srv_participant *p = srv_hub_join(f.hub, other, SRV_ROLE_VIEW, "", NULL, 2500, NULL);
    assert_non_null(p);
    srv_hub_list(f.hub, NULL, 3000, &page);
    assert_int_equal(page.count, 2);
    int first = strcmp(f.id, other) < 0 ? 0 : 1;
    const struct srv_session_info *asleep = &notes[first], *awake = &notes[!first];
    assert_string_equal(asleep->id, f.id);
    assert_string_equal(asleep->volume, "v");
    assert_true(asleep->is_hibernated);
    assert_int_equal(asleep->participants, 0);
    assert_compare(asleep->idle_ms, ==, 3000);
    assert_string_equal(awake->id, other);
    assert_false(awake->is_hibernated);
    assert_int_equal(awake->participants, 1);
    assert_compare(awake->idle_ms, ==, 0);
    srv_hub_leave(f.hub, &p, 2800);
    page.count = 0;
    srv_hub_list(f.hub, NULL, 3000, &page);
    assert_int_equal(awake->participants, 0);
    assert_compare(awake->idle_ms, ==, 200);
}

static void sleepers_have_a_limit_and_can_be_deleted(void **state) {
    (void)state;
    char other[SRV_SESSION_ID_BYTES];
    struct sp_error err;
    enum srv_role role;
    assert_true(srv_hub_save(f.hub, 0, save, NULL));
    proto_json *record = proto_json_parse(f.text, f.size, NULL);
    const char *token =
        proto_json_string(proto_json_get(proto_json_get(record, "tokens"), "control"));
    restart();
    assert_true(srv_hub_authorize(f.hub, f.id, token, &role, &err));
    assert_int_equal(role, SRV_ROLE_CONTROL);
    assert_false(srv_hub_authorize(f.hub, f.id, "x", &role, &err));
    assert_int_equal(err.code, SP_ERR_DENIED);
    proto_json_free(&record);
    f.volumes.is_loading = false;
    for (int i = 0; i < 3; i++) {
        proto_json *json = srv_hub_session_create(f.hub, NULL, 0, other, &err);
        assert_int_equal(json != NULL, i < 2); /* two may be awake */
        proto_json_free(&json);
    }
    assert_non_null(strstr(err.text, "--sessions"));
    assert_null(srv_hub_session_get(f.hub, f.id, true, 0, &err)); /* nor can one wake */
    assert_int_equal(err.code, SP_ERR_BUDGET);
    assert_true(srv_hub_session_delete(f.hub, other, NULL));
    assert_true(srv_hub_restore(f.hub, "0123456789abcdef", f.text, f.size, 0, &err));
    assert_null(srv_hub_session_create(f.hub, NULL, 0, other, &err));
    assert_int_equal(err.code, SP_ERR_BUDGET);
    assert_non_null(strstr(err.text, "--sleeping-sessions"));
    assert_true(srv_hub_session_delete(f.hub, f.id, NULL));
    assert_string_equal(f.ended, f.id);
    assert_false(srv_hub_session_delete(f.hub, f.id, NULL));
    assert_null(srv_hub_session_get(f.hub, f.id, true, 0, &err));
    assert_int_equal(err.code, SP_ERR_NOT_FOUND);
}

static bool create(const struct srv_owner *owner, bool is_guest, double now_ms,
                   struct sp_error *err) {
    char id[SRV_SESSION_ID_BYTES];
    proto_json *json = srv_hub_session_create_owned(f.hub, NULL, owner, is_guest, now_ms, id, err);
    bool made = json != NULL;
    proto_json_free(&json);
    if (made)
        strcpy(f.id, id);
    return made;
}

static unsigned count_of(const char *owner) {
    struct srv_session_info notes[4];
    struct srv_page page = { .items = notes, .item_bytes = sizeof *notes, .max = 4, .after = "" };
    srv_hub_list(f.hub, owner, 5000, &page);
    return page.count;
}

static void sleepers_count_for_their_owner(void **state) {
    (void)state;
    const struct srv_owner ann = { .name = "ann", .quota = { .sessions = 1 } };
    const struct srv_owner bob = { .name = "bob", .quota = { .sessions = 1 } };
    struct srv_quota today = { .sessions = 1 };
    struct sp_error err;
    f.quota = &today;
    assert_true(srv_hub_session_delete(f.hub, f.id, NULL));
    assert_true(create(&ann, false, 0, &err));
    assert_true(srv_hub_save(f.hub, 0, save, NULL));
    assert_false(create(&ann, false, 0, &err));
    srv_hub_tick(f.hub, 5000);
    assert_int_equal(numbers().hibernated, 1);
    for (int run = 0; run < 2; run++) { /* in this run of the daemon, and in the next */
        assert_false(create(&ann, run, 5000, &err));
        assert_int_equal(err.code, SP_ERR_QUOTA);
        assert_non_null(strstr(err.text, "1 sessions (1 hibernated)"));
        assert_int_equal(count_of("ann") + 10 * count_of("bob") + 100 * count_of(NULL), 101);
        if (run == 0)
            restart();
        f.volumes.is_loading = false;
    }
    char sleeper[SRV_SESSION_ID_BYTES];
    strcpy(sleeper, f.id);
    assert_true(create(&bob, false, 5000, &err));
    assert_int_equal(count_of("ann") + 10 * count_of("bob") + 100 * count_of(NULL), 211);
    assert_true(srv_hub_session_delete(f.hub, sleeper, NULL));
    assert_true(create(&ann, false, 5000, &err));
    f.quota = NULL;
}

static int granted_fps(struct srv_participant *p) {
    static const char request[] =
        "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"stream.configure\",\"params\":{}}";
    char *answer = NULL;
    size_t size;
    int64_t fps = -1;
    assert_true(srv_hub_message(f.hub, p, request, sizeof request - 1, 0, &answer, &size));
    proto_json *json = proto_json_parse(answer, size, NULL);
    proto_json_integer(proto_json_get(proto_json_get(json, "result"), "max_fps"), &fps);
    proto_json_free(&json);
    free(answer);
    return (int)fps;
}

/* A session wakes for an owner who may not make one more, and is allowed what the token of that
 * name allows then; of a name that has no token any more what was known holds on. */
static void quotas_are_those_of_today(void **state) {
    (void)state;
    const struct srv_owner ann = { .name = "ann", .quota = { .sessions = 1, .fps = 9 } };
    struct srv_quota today = { .sessions = 1 };
    struct sp_error err;
    assert_true(srv_hub_session_delete(f.hub, f.id, NULL));
    assert_true(create(&ann, false, 0, &err));
    assert_true(srv_hub_save(f.hub, 0, save, NULL));
    for (int known = 0; known < 2; known++) {
        restart();
        f.volumes.is_loading = false;
        today.fps = 20;
        f.quota = known ? &today : NULL;
        struct srv_participant *p = srv_hub_join(f.hub, f.id, SRV_ROLE_VIEW, "", NULL, 0, &err);
        if (!p)
            fail_msg("%s", err.text);
        assert_int_equal(granted_fps(p), known ? 20 : 9);
        today.fps = 25;
        srv_hub_renew_tokens(f.hub);
        assert_int_equal(granted_fps(p), known ? 25 : 9);
        today.fps = 0;
        srv_hub_renew_tokens(f.hub);
        assert_int_equal(granted_fps(p), known ? 30 : 9);
        srv_hub_leave(f.hub, &p, 0);
    }
}

static void guests_leave_a_quarter_to_others(void **state) {
    (void)state;
    const struct srv_owner nobody = { .name = "" };
    struct sp_error err;
    srv_hub_destroy(&f.hub);
    f.sessions_max = 8;
    create_hub();
    for (int i = 0; i < 6; i++)
        assert_true(create(&nobody, true, 0, &err));
    assert_false(create(&nobody, true, 0, &err));
    assert_int_equal(err.code, SP_ERR_BUDGET);
    assert_non_null(strstr(err.text, "--sessions allows guests 6"));
    assert_true(create(&nobody, false, 0, &err));
    assert_true(create(&nobody, false, 0, &err));
    assert_false(create(&nobody, false, 0, &err));
    assert_non_null(strstr(err.text, "--sessions allows 8"));
}

static bool wake(const char *id, double now_ms, struct sp_error *err) {
    proto_json *json = srv_hub_session_get(f.hub, id, true, now_ms, err);
    bool is_awake = json != NULL;
    proto_json_free(&json);
    return is_awake;
}

static bool is_hibernated(const char *id) {
    struct srv_session_info notes[8];
    struct srv_page page = { .items = notes, .item_bytes = sizeof *notes, .max = 8, .after = "" };
    srv_hub_list(f.hub, NULL, 5000, &page);
    for (unsigned i = 0; i < page.count; i++)
        if (strcmp(notes[i].id, id) == 0)
            return notes[i].is_hibernated;
    fail_msg("%s is not listed", id);
    return false;
}

/* At --sessions the one that was idle longest sleeps at once, if it is saved and nobody is in it.
 */
static void idle_ones_make_room(void **state) {
    (void)state;
    const struct srv_owner nobody = { .name = "" };
    char one[SRV_SESSION_ID_BYTES], two[SRV_SESSION_ID_BYTES], three[SRV_SESSION_ID_BYTES];
    struct sp_error err;
    strcpy(one, f.id);
    assert_true(create(&nobody, false, 10, &err));
    strcpy(two, f.id);
    assert_false(create(&nobody, false, 20, &err)); /* what is not saved would be lost */
    assert_int_equal(err.code, SP_ERR_BUDGET);
    assert_true(srv_hub_save(f.hub, 20, save_each, NULL));
    assert_false(create(&nobody, true, 30, &err)); /* for guests nobody makes room */
    assert_int_equal(numbers().hibernated, 0);
    assert_true(create(&nobody, false, 30, &err));
    strcpy(three, f.id);
    assert_true(is_hibernated(one));
    assert_false(is_hibernated(two));
    assert_false(is_hibernated(three));
    assert_true(wake(one, 40, &err));
    assert_false(is_hibernated(one));
    assert_true(is_hibernated(two));
    assert_false(is_hibernated(three));
    assert_true(srv_hub_save(f.hub, 50, save_each, NULL));
    struct srv_participant *in_one = srv_hub_join(f.hub, one, SRV_ROLE_VIEW, "", NULL, 50, NULL);
    assert_true(wake(two, 60, &err));
    assert_false(is_hibernated(one));
    assert_false(is_hibernated(two));
    assert_true(is_hibernated(three));
    struct srv_participant *in_two = srv_hub_join(f.hub, two, SRV_ROLE_VIEW, "", NULL, 60, NULL);
    assert_true(in_one);
    assert_true(in_two);
    assert_false(wake(three, 70, &err));
    assert_int_equal(err.code, SP_ERR_BUDGET);
    assert_false(create(&nobody, false, 70, &err));
    assert_int_equal(err.code, SP_ERR_BUDGET);
    assert_int_equal(numbers().sessions * 10 + numbers().hibernated, 21);
    srv_hub_leave(f.hub, &in_one, 80);
    srv_hub_leave(f.hub, &in_two, 90);
    assert_true(wake(three, 100, &err));
    assert_true(is_hibernated(one));
    assert_false(is_hibernated(two));
}

static void what_cannot_be_shown_sleeps_on(void **state) {
    (void)state;
    assert_true(srv_hub_save(f.hub, 0, save, NULL));
    restart();
    f.is_refused = true;
    f.volumes.is_loading = false;
    asleep_because("cannot be shown here: /filter: not by this backend");
    f.is_refused = false;
    free(session_text());
}

#define TOKEN "0123456789abcdef0123456789abcdef"

static void what_is_no_session(void **state) {
    (void)state;
    static const char *const records[] = {
        "",
        "[]",
        "{}",
        "{\"view\":{\"volume\":\"v\"}}",
        "{\"tokens\":{\"control\":\"x\",\"view\":\"y\"},\"view\":{\"volume\":\"v\"}}",
        "{\"tokens\":{\"control\":\"" TOKEN "\",\"view\":\"" TOKEN "\"},\"view\":{}}",
    };
    struct sp_error err;
    for (size_t i = 0; i < sizeof records / sizeof *records; i++) {
        assert_false(
            srv_hub_restore(f.hub, "0123456789abcdef", records[i], strlen(records[i]), 0, &err));
        assert_int_equal(err.code, SP_ERR_FORMAT);
    }
    assert_true(srv_hub_save(f.hub, 0, save, NULL));
    assert_false(srv_hub_restore(f.hub, "short", f.text, f.size, 0, &err));
}

/* Every allocation of JSON fails once: nothing is lost, and nothing is half saved. */
static void no_memory(void **state) {
    (void)state;
    char whole[8192];
    struct sp_error err;
    int unsaved = 0, unrestored = 0, unshown = 0;
    proto_json *json;
    patch("{}"); /* when it was used is saved, too */
    assert_true(srv_hub_save(f.hub, 0, save, NULL));
    strcpy(whole, f.text);
    for (left = 0;; left = ++unsaved) {
        bool ok;
        long allowed = left;
        left = -1;
        patch("{}"); /* another version of the same view */
        left = allowed;
        ok = srv_hub_save(f.hub, 0, save, NULL);
        left = -1;
        assert_string_equal(f.text, whole);
        if (ok)
            break;
    }
    srv_hub_destroy(&f.hub);
    create_hub();
    for (left = 0; !srv_hub_restore(f.hub, f.id, f.text, f.size, 0, &err); left = ++unrestored)
        assert_true(err.code == SP_ERR_MEMORY || err.code == SP_ERR_FORMAT);
    left = -1;
    for (left = 0; !(json = srv_hub_session_get(f.hub, f.id, true, 0, &err)); left = ++unshown)
        assert_true(err.code == SP_ERR_MEMORY || err.code == SP_ERR_FORMAT);
    left = -1;
    proto_json_free(&json);
    assert_compare(unsaved, >, 100);
    assert_compare(unrestored, >, 100);
    assert_compare(unshown, >, 100);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(what_changed_is_saved_once, set_up, tear_down),
        cmocka_unit_test_setup_teardown(one_that_ended_is_not_saved, set_up, tear_down),
        cmocka_unit_test_setup_teardown(comes_back_as_it_was, set_up, tear_down),
        cmocka_unit_test_setup_teardown(an_idle_one_sleeps, set_up, tear_down),
        cmocka_unit_test_setup_teardown(one_whose_volume_is_gone_ends_as_well, set_up, tear_down),
        cmocka_unit_test_setup_teardown(sleep_goes_on_where_the_last_daemon_ended, set_up,
                                        tear_down),
        cmocka_unit_test_setup_teardown(what_does_not_say_when_it_was_used_sleeps_from_now_on,
                                        set_up, tear_down),
        cmocka_unit_test_setup_teardown(so_does_what_was_used_later_than_now, set_up, tear_down),
        cmocka_unit_test_setup_teardown(that_it_is_used_is_saved_now_and_then, set_up, tear_down),
        cmocka_unit_test_setup_teardown(all_are_listed, set_up, tear_down),
        cmocka_unit_test_setup_teardown(sleepers_count_for_their_owner, set_up, tear_down),
        cmocka_unit_test_setup_teardown(quotas_are_those_of_today, set_up, tear_down),
        cmocka_unit_test_setup_teardown(guests_leave_a_quarter_to_others, set_up, tear_down),
        cmocka_unit_test_setup_teardown(idle_ones_make_room, set_up, tear_down),
        cmocka_unit_test_setup_teardown(sleepers_have_a_limit_and_can_be_deleted, set_up,
                                        tear_down),
        cmocka_unit_test_setup_teardown(what_cannot_be_shown_sleeps_on, set_up, tear_down),
        cmocka_unit_test_setup_teardown(what_is_no_session, set_up, tear_down),
        cmocka_unit_test_setup_teardown(no_memory, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
