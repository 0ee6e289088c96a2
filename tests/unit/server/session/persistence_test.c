/* SPDX-License-Identifier: Apache-2.0
 *
 * Which sessions are saved and when, and what a restart restores.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdlib.h>
#include <string.h>

#include "support/compare.h"
#include "unit/server/session/persistence_fixture.h"

static void a_change_is_saved_once(void **state) {
    (void)state;
    assert_int_equal(persist.changes, 1);
    assert_true(srv_hub_save(persist.hub, 0, persist_save, NULL));
    assert_int_equal(persist.saves, 1);
    assert_true(srv_hub_save(persist.hub, 0, persist_save, NULL));
    assert_int_equal(persist.saves, 1);
    persist_patch("{\"size\":[40,20]}");
    persist_patch("{\"size\":[41,20]}");
    assert_int_equal(persist.changes, 3);
    persist.refuses_save = true;
    assert_false(srv_hub_save(persist.hub, 0, persist_save, NULL));
    persist.refuses_save = false;
    assert_true(srv_hub_save(persist.hub, 0, persist_save, NULL));
    assert_int_equal(persist.saves, 2);
    assert_non_null(strstr(persist.text, "[41,20]"));
}

static void a_deleted_session_is_not_saved(void **state) {
    (void)state;
    persist_deletes = true; /* while its record is written, without the lock */
    assert_true(srv_hub_save(persist.hub, 0, persist_save, NULL));
    assert_false(persist_deletes);
    assert_int_equal(persist.saves, 0);
    assert_int_equal(persist.ends, 1);
    assert_string_equal(persist.ended, persist.id);
}

static void a_restart_restores_the_view(void **state) {
    (void)state;
    persist_patch("{\"camera\":{\"position\":[0.1,7.3,3e5]},\"background\":[0.1,0.2,0.3,1]}");
    assert_true(srv_hub_save(persist.hub, 0, persist_save, NULL));
    char *before = persist_text();
    persist_restart();
    persist_is_hibernated_because("the volume v is not available");
    persist.volumes.is_loading = false;
    char *after = persist_text_at(5000);
    assert_string_equal(before, after);
    free(before);
    free(after);
    assert_true(srv_hub_save(persist.hub, 5000, persist_save, NULL));
    assert_int_equal(persist.saves, 2); /* the time of its last use */
    assert_true(srv_hub_save(persist.hub, 5000, persist_save, NULL));
    assert_int_equal(persist.saves, 2); /* nothing has changed */
    assert_int_equal(persist_numbers().sessions, 1);
    assert_int_equal(persist_numbers().hibernated, 0);
}

/* A participant uses a session without a change that would be saved. */
static void use_is_saved_at_intervals(void **state) {
    (void)state;
    assert_true(srv_hub_save(persist.hub, 0, persist_save, NULL));
    assert_int_equal(persist.saves, 1);
    struct srv_participant *p =
        srv_hub_join(persist.hub, persist.id, SRV_ROLE_VIEW, "", NULL, 100, NULL);
    persist.changes = 0;
    srv_hub_tick(persist.hub, 999);
    assert_int_equal(persist.changes, 0);
    assert_true(srv_hub_save(persist.hub, 999, persist_save, NULL));
    assert_int_equal(persist.saves, 1);
    srv_hub_tick(persist.hub, 1000);
    srv_hub_tick(persist.hub, 1001);
    assert_int_equal(persist.changes, 1);
    assert_true(srv_hub_save(persist.hub, 1001, persist_save, NULL));
    assert_int_equal(persist.saves, 2);
    assert_non_null(strstr(persist.text, "\"used\":1.001"));
    srv_hub_leave(persist.hub, &p, 1500);
    assert_true(srv_hub_save(persist.hub, 9000, persist_save, NULL));
    assert_int_equal(persist.saves, 2); /* not used since then */
}

static void a_session_that_cannot_be_shown_stays_hibernated(void **state) {
    (void)state;
    assert_true(srv_hub_save(persist.hub, 0, persist_save, NULL));
    persist_restart();
    persist.is_refused = true;
    persist.volumes.is_loading = false;
    persist_is_hibernated_because("cannot be shown here: /filter: not by this backend");
    persist.is_refused = false;
    free(persist_text());
}

#define TOKEN "0123456789abcdef0123456789abcdef"

static void invalid_records_are_refused(void **state) {
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
        assert_false(srv_hub_restore(persist.hub, "0123456789abcdef", records[i],
                                     strlen(records[i]), 0, &err));
        assert_int_equal(err.code, SP_ERR_FORMAT);
    }
    assert_true(srv_hub_save(persist.hub, 0, persist_save, NULL));
    assert_false(srv_hub_restore(persist.hub, "short", persist.text, persist.size, 0, &err));
}

static void assert_memory_or_format(enum sp_code code) {
    if (code != SP_ERR_MEMORY)
        assert_int_equal(code, SP_ERR_FORMAT);
}

/* Each allocation of JSON fails once: no session is lost or saved in part. */
static void out_of_memory_loses_no_session(void **state) {
    (void)state;
    char whole[8192];
    struct sp_error err;
    int unsaved = 0, unrestored = 0, unshown = 0;
    proto_json *json;
    persist_patch("{}"); /* its time of use is also saved */
    assert_true(srv_hub_save(persist.hub, 0, persist_save, NULL));
    strcpy(whole, persist.text);
    for (persist_allocations = 0;; persist_allocations = ++unsaved) {
        bool ok;
        long allowed = persist_allocations;
        persist_allocations = -1;
        persist_patch("{}"); /* another version of the same view */
        persist_allocations = allowed;
        ok = srv_hub_save(persist.hub, 0, persist_save, NULL);
        persist_allocations = -1;
        assert_string_equal(persist.text, whole);
        if (ok)
            break;
    }
    srv_hub_destroy(&persist.hub);
    persist_create_hub();
    for (persist_allocations = 0;
         !srv_hub_restore(persist.hub, persist.id, persist.text, persist.size, 0, &err);
         persist_allocations = ++unrestored)
        assert_memory_or_format(err.code);
    persist_allocations = -1;
    for (persist_allocations = 0;
         !(json = srv_hub_session_get(persist.hub, persist.id, true, 0, &err));
         persist_allocations = ++unshown)
        assert_memory_or_format(err.code);
    persist_allocations = -1;
    proto_json_free(&json);
    assert_compare(unsaved, >, 100);
    assert_compare(unrestored, >, 100);
    assert_compare(unshown, >, 100);
}

int main(void) {
    const struct CMUnitTest tests[] = {
#define TEST(name) cmocka_unit_test_setup_teardown(name, persist_set_up, persist_tear_down)
        TEST(a_change_is_saved_once),
        TEST(a_deleted_session_is_not_saved),
        TEST(a_restart_restores_the_view),
        TEST(use_is_saved_at_intervals),
        TEST(a_session_that_cannot_be_shown_stays_hibernated),
        TEST(invalid_records_are_refused),
        TEST(out_of_memory_loses_no_session),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
