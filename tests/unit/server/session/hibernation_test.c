/* SPDX-License-Identifier: Apache-2.0
 *
 * Unused sessions hibernate, end after a longer time, and become active again.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdlib.h>
#include <string.h>

#include "common/pagination.h"
#include "support/compare.h"
#include "unit/server/session/persistence_fixture.h"

/* An unused session hibernates without a loss, until its own, longer limit ends it. */
static void an_idle_session_hibernates(void **state) {
    (void)state;
    persist_patch("{\"size\":[44,20]}"); /* at 10 ms */
    char *before = persist_text();
    srv_hub_tick(persist.hub, 1009);
    assert_int_equal(persist_numbers().sessions, 1);
    persist.changes = 0;
    srv_hub_tick(persist.hub, 1011);
    assert_int_equal(persist_numbers().sessions, 1);
    assert_int_equal(persist.changes, 1); /* it does not hibernate before it is saved */
    assert_true(srv_hub_save(persist.hub, 0, persist_save, NULL));
    srv_hub_tick(persist.hub, 1012);
    assert_int_equal(persist_numbers().sessions, 0);
    assert_int_equal(persist_numbers().hibernated, 1);
    assert_int_equal(persist.volumes.uses, 0);
    char *after = persist_text_at(3000);
    assert_string_equal(before, after);
    free(before);
    free(after);
    assert_true(srv_hub_save(persist.hub, 3000, persist_save, NULL));
    assert_int_equal(persist.saves, 2); /* the time of its last use */
    assert_true(srv_hub_save(persist.hub, 3900, persist_save, NULL));
    assert_int_equal(persist.saves, 2); /* nothing has changed */
    srv_hub_tick(persist.hub, 3999);    /* idle since it became active */
    assert_int_equal(persist_numbers().sessions, 1);
    assert_compare(srv_hub_tick(persist.hub, 4000), >, 0);
    assert_int_equal(persist_numbers().hibernated, 1);
    srv_hub_tick(persist.hub, 52999); /* last used at 3000 */
    assert_int_equal(persist_numbers().hibernated, 1);
    assert_int_equal(persist.ends, 0);
    srv_hub_tick(persist.hub, 53000);
    assert_int_equal(persist_numbers().hibernated, 0);
    assert_int_equal(persist.ends, 1);
    assert_string_equal(persist.ended, persist.id);
}

static void a_session_whose_volume_is_missing_ends_as_well(void **state) {
    (void)state;
    assert_true(srv_hub_save(persist.hub, 0, persist_save, NULL));
    persist_restart();
    srv_hub_tick(persist.hub, 49999);
    persist_is_hibernated_because("waits for its volume"); /* this request does not count as use */
    srv_hub_tick(persist.hub, 50000);
    assert_int_equal(persist_numbers().hibernated, 0);
    assert_int_equal(persist.ends, 1);
}

static void a_restart_continues_the_time_of_hibernation(void **state) {
    (void)state;
    persist_patch("{\"size\":[44,20]}"); /* at 10 ms */
    assert_true(srv_hub_save(persist.hub, 10, persist_save, NULL));
    persist.ran_ms = 30000;
    persist_restart();
    srv_hub_tick(persist.hub, 20009);
    assert_int_equal(persist_numbers().hibernated, 1);
    assert_int_equal(persist.ends, 0);
    srv_hub_tick(persist.hub, 20010);
    assert_int_equal(persist_numbers().hibernated, 0);
    assert_int_equal(persist.ends, 1);
}

static void a_record_without_time_of_use_hibernates_from_now_on(void **state) {
    (void)state;
    assert_true(srv_hub_save(persist.hub, 0, persist_save, NULL));
    char *used = strstr(persist.text, ",\"used\":");
    assert_non_null(used);
    strcpy(used, "}"); /* it is the last member */
    persist.size = strlen(persist.text);
    persist.ran_ms = 1e9;
    persist_restart();
    srv_hub_tick(persist.hub, 49999);
    assert_int_equal(persist_numbers().hibernated, 1);
    srv_hub_tick(persist.hub, 50000);
    assert_int_equal(persist_numbers().hibernated, 0);
}

/* The daemon was killed before it wrote how long it had run. */
static void a_time_of_use_in_the_future_counts_as_now(void **state) {
    (void)state;
    persist_patch("{\"size\":[44,20]}");
    persist.ran_ms = 0;
    assert_true(srv_hub_save(persist.hub, 10, persist_save, NULL));
    persist.ran_ms = -1e6;
    persist_restart();
    srv_hub_tick(persist.hub, 49999);
    assert_int_equal(persist_numbers().hibernated, 1);
    srv_hub_tick(persist.hub, 50000);
    assert_int_equal(persist_numbers().hibernated, 0);
}

static void active_and_hibernated_sessions_are_listed(void **state) {
    (void)state;
    struct srv_session_info infos[4];
    struct srv_page page = { .items = infos, .item_bytes = sizeof *infos, .max = 4, .after = "" };
    char other[SRV_SESSION_ID_BYTES];
    assert_true(srv_hub_save(persist.hub, 0, persist_save, NULL));
    srv_hub_tick(persist.hub, 1000);
    proto_json *json = srv_hub_session_create(
        persist.hub, NULL, &(const struct srv_owner){ .name = "" }, false, 2000, other, NULL);
    proto_json_free(&json);
    struct srv_participant *p =
        srv_hub_join(persist.hub, other, SRV_ROLE_VIEW, "", NULL, 2500, NULL);
    assert_non_null(p);
    srv_hub_list(persist.hub, NULL, 3000, &page);
    assert_int_equal(page.count, 2);
    int first = strcmp(persist.id, other) < 0 ? 0 : 1;
    const struct srv_session_info *hibernated = &infos[first], *active = &infos[!first];
    assert_string_equal(hibernated->id, persist.id);
    assert_string_equal(hibernated->volume, "v");
    assert_true(hibernated->is_hibernated);
    assert_int_equal(hibernated->participants, 0);
    assert_compare(hibernated->idle_ms, ==, 3000);
    assert_string_equal(active->id, other);
    assert_false(active->is_hibernated);
    assert_int_equal(active->participants, 1);
    assert_compare(active->idle_ms, ==, 0);
    srv_hub_leave(persist.hub, &p, 2800);
    page.count = 0;
    srv_hub_list(persist.hub, NULL, 3000, &page);
    assert_int_equal(active->participants, 0);
    assert_compare(active->idle_ms, ==, 200);
}

int main(void) {
    const struct CMUnitTest tests[] = {
#define TEST(name) cmocka_unit_test_setup_teardown(name, persist_set_up, persist_tear_down)
        TEST(an_idle_session_hibernates),
        TEST(a_session_whose_volume_is_missing_ends_as_well),
        TEST(a_restart_continues_the_time_of_hibernation),
        TEST(a_record_without_time_of_use_hibernates_from_now_on),
        TEST(a_time_of_use_in_the_future_counts_as_now),
        TEST(active_and_hibernated_sessions_are_listed),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
