/* SPDX-License-Identifier: Apache-2.0
 *
 * What is kept of sessions: saved when they changed, back when their volumes are; the clock is
 * given.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "session/hub.h"
#include "sp/volume.h"

/* The JSON library's own hook; its header belongs to protocol/json.c. */
void json_set_alloc_funcs(void *(*allocate)(size_t), void (*release)(void *));

static struct fixture {
    struct srv_hub *hub;
    int uses, saves, changes, ends;
    bool is_loading, is_refused, refuses_save;
    char ended[32], id[SRV_SESSION_ID_BYTES];
    char text[8192]; /* of the session that was saved last */
    size_t size;
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

static void *acquire(void *user, const char *id, struct sp_error *err) {
    if (f.is_loading || (id && *id && strcmp(id, "v") != 0)) {
        sp_fail(err, f.is_loading ? SP_ERR_TIMEOUT : SP_ERR_NOT_FOUND, "/volume", "no %s now", id);
        return NULL;
    }
    f.uses++;
    return user;
}

static void *add_use(void *user, void *volume) {
    (void)user;
    f.uses++;
    return volume;
}

static void release(void *user, void *volume) {
    (void)user;
    (void)volume;
    f.uses--;
}

static void default_view(void *user, void *volume, struct sp_view *view) {
    struct sp_volume_info info = { .type = SP_UINT8, .components = 1, .range = { 0, 255 } };
    (void)user;
    (void)volume;
    for (int i = 0; i < 3; i++) {
        info.grid.dims[i] = 8;
        info.grid.spacing[i] = info.grid.direction[i][i] = 1;
    }
    sp_view_init(view, &info, "v");
}

static void ignore(void *user) {
    (void)user;
}

static void ignore_interrupt(void *user, uint64_t session, enum srv_interrupt why) {
    (void)user;
    (void)session;
    (void)why;
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
    assert_true(size < sizeof f.text && strlen(text) == size);
    memcpy(f.text, text, size + 1);
    f.size = size;
    return true;
}

static void create_hub(void) {
    struct srv_hub_options options = { .volumes = { &f, acquire, add_use, release, default_view,
                                                    NULL },
                                       .sessions_max = 2,
                                       .participants_max = 3,
                                       .session_idle_ms = 1000,
                                       .rest_ms = 100,
                                       .stream_bytes = 1 << 20,
                                       .work = ignore,
                                       .ready = ignore,
                                       .interrupt = ignore_interrupt,
                                       .supports = supports,
                                       .changed = on_changed,
                                       .ended = on_ended };
    f.hub = srv_hub_create(&options, NULL);
    assert_non_null(f.hub);
}

static int set_up(void **state) {
    (void)state;
    memset(&f, 0, sizeof f);
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
    return f.uses; /* every use was given back */
}

static char *session_text(void) {
    struct sp_error err;
    proto_json *json = srv_hub_session_get(f.hub, f.id, true, &err);
    if (!json)
        fail_msg("%s", err.text);
    char *text = proto_json_to_canonical(json, NULL);
    proto_json_free(&json);
    return text;
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
    assert_int_equal(f.uses, 0);
    create_hub();
    f.is_loading = true;
    if (!srv_hub_restore(f.hub, f.id, f.text, f.size, &err))
        fail_msg("%s", err.text);
}

static void volume_is_ready(double now_ms) {
    f.is_loading = false;
    srv_hub_volume_progress(f.hub, "v", "ready", 1, "", now_ms);
}

static void asleep_because(const char *why) {
    struct sp_error err;
    assert_null(srv_hub_session_get(f.hub, f.id, true, &err));
    assert_int_equal(err.code, SP_ERR_TIMEOUT);
    if (!strstr(err.text, why))
        fail_msg("'%s' does not say '%s'", err.text, why);
}

static void what_changed_is_saved_once(void **state) {
    (void)state;
    assert_true(f.changes == 1 && srv_hub_save(f.hub, save, NULL) && f.saves == 1);
    assert_true(srv_hub_save(f.hub, save, NULL) && f.saves == 1);
    patch("{\"size\":[40,20]}");
    patch("{\"size\":[41,20]}");
    assert_int_equal(f.changes, 3);
    f.refuses_save = true;
    assert_false(srv_hub_save(f.hub, save, NULL));
    f.refuses_save = false;
    assert_true(srv_hub_save(f.hub, save, NULL) && f.saves == 2);
    assert_non_null(strstr(f.text, "[41,20]"));
}

static void one_that_ended_is_not_saved(void **state) {
    (void)state;
    delete_meanwhile = true; /* while its record is written, with no lock held */
    assert_true(srv_hub_save(f.hub, save, NULL));
    assert_false(delete_meanwhile);
    assert_true(f.saves == 0 && f.ends == 1);
    assert_string_equal(f.ended, f.id);
}

static void comes_back_as_it_was(void **state) {
    (void)state;
    patch("{\"camera\":{\"position\":[0.1,7.3,3e5]},\"background\":[0.1,0.2,0.3,1]}");
    assert_true(srv_hub_save(f.hub, save, NULL));
    char *before = session_text();
    restart();
    asleep_because("no v now");
    srv_hub_volume_progress(f.hub, "another", "ready", 1, "", 0);
    asleep_because("waits for its volume");
    volume_is_ready(5000);
    char *after = session_text();
    assert_string_equal(before, after);
    free(before);
    free(after);
    assert_true(srv_hub_save(f.hub, save, NULL) && f.saves == 1); /* nothing has changed */
    srv_hub_tick(f.hub, 5900);
    struct srv_hub_numbers numbers;
    srv_hub_numbers(f.hub, &numbers);
    assert_true(numbers.sessions == 1 && numbers.asleep == 0);
    srv_hub_tick(f.hub, 6001); /* idle since it came back */
    assert_int_equal(f.ends, 1);
}

static void a_sleeper_counts_and_can_be_deleted(void **state) {
    (void)state;
    char other[SRV_SESSION_ID_BYTES];
    struct sp_error err;
    enum srv_role role;
    assert_true(srv_hub_save(f.hub, save, NULL));
    proto_json *record = proto_json_parse(f.text, f.size, NULL);
    const char *token =
        proto_json_string(proto_json_get(proto_json_get(record, "tokens"), "control"));
    restart();
    assert_true(srv_hub_authorize(f.hub, f.id, token, &role, &err) && role == SRV_ROLE_CONTROL);
    assert_false(srv_hub_authorize(f.hub, f.id, "x", &role, &err));
    assert_int_equal(err.code, SP_ERR_DENIED);
    proto_json_free(&record);
    f.is_loading = false;
    for (int i = 0; i < 2; i++) {
        proto_json *json = srv_hub_session_create(f.hub, NULL, 0, other, &err);
        assert_int_equal(json != NULL, i == 0); /* of two, one sleeps */
        proto_json_free(&json);
    }
    assert_int_equal(err.code, SP_ERR_BUDGET);
    srv_hub_tick(f.hub, 1e9); /* what sleeps does not end by itself, what is awake does */
    assert_int_equal(f.ends, 1);
    assert_true(srv_hub_session_delete(f.hub, f.id, NULL));
    assert_string_equal(f.ended, f.id);
    assert_false(srv_hub_session_delete(f.hub, f.id, NULL));
    volume_is_ready(0);
    assert_null(srv_hub_session_get(f.hub, f.id, true, &err));
    assert_int_equal(err.code, SP_ERR_NOT_FOUND);
}

static void what_cannot_be_shown_sleeps_on(void **state) {
    (void)state;
    assert_true(srv_hub_save(f.hub, save, NULL));
    restart();
    f.is_refused = true;
    volume_is_ready(0);
    asleep_because("the log says why");
    f.is_refused = false;
    volume_is_ready(0); /* loaded once more */
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
            srv_hub_restore(f.hub, "0123456789abcdef", records[i], strlen(records[i]), &err));
        assert_int_equal(err.code, SP_ERR_FORMAT);
    }
    assert_true(srv_hub_save(f.hub, save, NULL));
    assert_false(srv_hub_restore(f.hub, "short", f.text, f.size, &err));
}

/* Every allocation of JSON fails once: nothing is lost, and nothing is half saved. */
static void no_memory(void **state) {
    (void)state;
    char whole[8192];
    struct sp_error err;
    int unsaved = 0, unrestored = 0;
    assert_true(srv_hub_save(f.hub, save, NULL));
    strcpy(whole, f.text);
    for (left = 0;; left = ++unsaved) {
        bool ok;
        long allowed = left;
        left = -1;
        patch("{}"); /* another version of the same view */
        left = allowed;
        ok = srv_hub_save(f.hub, save, NULL);
        left = -1;
        assert_string_equal(f.text, whole);
        if (ok)
            break;
    }
    srv_hub_destroy(&f.hub);
    create_hub();
    for (left = 0; !srv_hub_restore(f.hub, f.id, f.text, f.size, &err); left = ++unrestored)
        assert_true(err.code == SP_ERR_MEMORY || err.code == SP_ERR_FORMAT);
    left = -1;
    assert_true(unsaved > 100 && unrestored > 100);
    volume_is_ready(0);
    free(session_text());
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(what_changed_is_saved_once, set_up, tear_down),
        cmocka_unit_test_setup_teardown(one_that_ended_is_not_saved, set_up, tear_down),
        cmocka_unit_test_setup_teardown(comes_back_as_it_was, set_up, tear_down),
        cmocka_unit_test_setup_teardown(a_sleeper_counts_and_can_be_deleted, set_up, tear_down),
        cmocka_unit_test_setup_teardown(what_cannot_be_shown_sleeps_on, set_up, tear_down),
        cmocka_unit_test_setup_teardown(what_is_no_session, set_up, tear_down),
        cmocka_unit_test_setup_teardown(no_memory, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
