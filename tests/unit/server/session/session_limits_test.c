/* SPDX-License-Identifier: Apache-2.0
 *
 * Limits on the number of sessions: --sessions, --hibernated-sessions, quotas of owners, and
 * guests.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdlib.h>
#include <string.h>

#include "common/pagination.h"
#include "unit/server/session/persistence_fixture.h"

static void hibernated_sessions_have_a_limit_and_can_be_deleted(void **state) {
    (void)state;
    char other[SRV_SESSION_ID_BYTES];
    struct sp_error err;
    enum srv_role role;
    assert_true(srv_hub_save(persist.hub, 0, persist_save, NULL));
    proto_json *record = proto_json_parse(persist.text, persist.size, NULL);
    const char *token =
        proto_json_string(proto_json_get(proto_json_get(record, "tokens"), "control"));
    persist_restart();
    assert_true(srv_hub_authorize(persist.hub, persist.id, token, &role, &err));
    assert_int_equal(role, SRV_ROLE_CONTROL);
    assert_false(srv_hub_authorize(persist.hub, persist.id, "x", &role, &err));
    assert_int_equal(err.code, SP_ERR_DENIED);
    proto_json_free(&record);
    persist.volumes.is_loading = false;
    for (int i = 0; i < 3; i++) {
        proto_json *json = srv_hub_session_create(
            persist.hub, NULL, &(const struct srv_owner){ .name = "" }, false, 0, other, &err);
        assert_int_equal(json != NULL, i < 2); /* two may be active */
        proto_json_free(&json);
    }
    assert_non_null(strstr(err.text, "--sessions"));
    assert_null(srv_hub_session_get(persist.hub, persist.id, true, 0,
                                    &err)); /* nor can a hibernated session become active */
    assert_int_equal(err.code, SP_ERR_BUDGET);
    assert_true(srv_hub_session_delete(persist.hub, other, NULL));
    assert_true(
        srv_hub_restore(persist.hub, "0123456789abcdef", persist.text, persist.size, 0, &err));
    assert_true(srv_hub_session_delete(persist.hub, persist.id, NULL));
    assert_string_equal(persist.ended, persist.id);
    assert_false(srv_hub_session_delete(persist.hub, persist.id, NULL));
    assert_null(srv_hub_session_get(persist.hub, persist.id, true, 0, &err));
    assert_int_equal(err.code, SP_ERR_NOT_FOUND);
}

static unsigned count_of(const char *owner) {
    struct srv_session_info infos[4];
    struct srv_page page = { .items = infos, .item_bytes = sizeof *infos, .max = 4, .after = "" };
    srv_hub_list(persist.hub, owner, 5000, &page);
    return page.count;
}

static void hibernated_sessions_count_towards_the_quota_of_their_owner(void **state) {
    (void)state;
    const struct srv_owner ann = { .name = "ann", .quota = { .sessions = 1 } };
    const struct srv_owner bob = { .name = "bob", .quota = { .sessions = 1 } };
    struct srv_quota current = { .sessions = 1 };
    struct sp_error err;
    persist.quota = &current;
    assert_true(srv_hub_session_delete(persist.hub, persist.id, NULL));
    assert_true(persist_create(&ann, false, 0, &err));
    assert_true(srv_hub_save(persist.hub, 0, persist_save, NULL));
    assert_false(persist_create(&ann, false, 0, &err));
    srv_hub_tick(persist.hub, 5000);
    assert_int_equal(persist_numbers().hibernated, 1);
    for (int run = 0; run < 2; run++) { /* before and after a restart */
        assert_false(persist_create(&ann, run, 5000, &err));
        assert_int_equal(err.code, SP_ERR_QUOTA);
        assert_non_null(strstr(err.text, run ? "the owner has 1 sessions, 0 of them by guests"
                                             : "1 sessions (1 hibernated)"));
        assert_int_equal(count_of("ann") + 10 * count_of("bob") + 100 * count_of(NULL), 101);
        if (run == 0)
            persist_restart();
        persist.volumes.is_loading = false;
    }
    char hibernated[SRV_SESSION_ID_BYTES];
    strcpy(hibernated, persist.id);
    assert_true(persist_create(&bob, false, 5000, &err));
    assert_int_equal(count_of("ann") + 10 * count_of("bob") + 100 * count_of(NULL), 211);
    assert_true(srv_hub_session_delete(persist.hub, hibernated, NULL));
    assert_true(persist_create(&ann, false, 5000, &err));
    persist.quota = NULL;
}

/* Guests leave a part of the quota, and at least one session, to the owner. */
static void guests_leave_a_part_of_the_quota(void **state) {
    (void)state;
    const struct srv_owner ann = { .name = "ann", .quota = { .sessions = 3 } };
    struct srv_quota current = ann.quota;
    struct sp_error err;
    srv_hub_destroy(&persist.hub);
    persist.sessions_max = 16;
    persist_create_hub();
    persist.quota = &current;
    for (int i = 0; i < 2; i++)
        assert_true(persist_create(&ann, true, 0, &err));
    assert_true(srv_hub_save(persist.hub, 0, persist_save_each, NULL));
    for (int i = 0; i < 2; i++) { /* active, and hibernated */
        assert_false(persist_create(&ann, true, 5000, &err));
        assert_int_equal(err.code, SP_ERR_QUOTA);
        assert_non_null(strstr(err.text, "the owner has 2 sessions, 2 of them by guests"));
        srv_hub_tick(persist.hub, 5000);
        assert_int_equal(persist_numbers().hibernated, 2);
    }
    assert_true(persist_create(&ann, false, 5000, &err));
    assert_false(persist_create(&ann, false, 5000, &err));
    assert_non_null(strstr(err.text, "3 sessions (2 hibernated)"));
    persist.quota = NULL;
}

static int granted_fps(struct srv_participant *p) {
    static const char request[] =
        "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"stream.configure\",\"params\":{}}";
    char *answer = NULL;
    size_t size;
    int64_t fps = -1;
    assert_true(srv_hub_message(persist.hub, p, request, sizeof request - 1, 0, &answer, &size));
    proto_json *json = proto_json_parse(answer, size, NULL);
    proto_json_integer(proto_json_get(proto_json_get(json, "result"), "max_fps"), &fps);
    proto_json_free(&json);
    free(answer);
    return (int)fps;
}

/* A hibernated session becomes active although its owner may not create another session. The limits
 * of the owner's token at that time apply; if the token was removed, the last known limits. */
static void quotas_follow_the_current_token(void **state) {
    (void)state;
    const struct srv_owner ann = { .name = "ann", .quota = { .sessions = 1, .fps = 9 } };
    struct srv_quota current = { .sessions = 1 };
    struct sp_error err;
    assert_true(srv_hub_session_delete(persist.hub, persist.id, NULL));
    assert_true(persist_create(&ann, false, 0, &err));
    assert_true(srv_hub_save(persist.hub, 0, persist_save, NULL));
    for (int known = 0; known < 2; known++) {
        persist_restart();
        persist.volumes.is_loading = false;
        current.fps = 20;
        persist.quota = known ? &current : NULL;
        struct srv_participant *p =
            srv_hub_join(persist.hub, persist.id, SRV_ROLE_VIEW, "", NULL, 0, &err);
        if (!p)
            fail_msg("%s", err.text);
        assert_int_equal(granted_fps(p), known ? 20 : 9);
        current.fps = 25;
        srv_hub_renew_tokens(persist.hub);
        assert_int_equal(granted_fps(p), known ? 25 : 9);
        current.fps = 0;
        srv_hub_renew_tokens(persist.hub);
        assert_int_equal(granted_fps(p), known ? 30 : 9);
        srv_hub_leave(persist.hub, &p, 0);
    }
}

static void guests_leave_a_quarter_of_the_sessions_to_others(void **state) {
    (void)state;
    const struct srv_owner anonymous = { .name = "" };
    struct sp_error err;
    srv_hub_destroy(&persist.hub);
    persist.sessions_max = 8;
    persist_create_hub();
    for (int i = 0; i < 6; i++)
        assert_true(persist_create(&anonymous, true, 0, &err));
    assert_false(persist_create(&anonymous, true, 0, &err));
    assert_int_equal(err.code, SP_ERR_QUOTA);
    assert_non_null(strstr(err.text, "the guests of this session's owner have 6 active sessions"));
    assert_true(persist_create(&anonymous, false, 0, &err));
    assert_true(persist_create(&anonymous, false, 0, &err));
    assert_false(persist_create(&anonymous, false, 0, &err));
    assert_non_null(strstr(err.text, "--sessions allows 8"));
}

/* Restores a record of ann's that was used at `used` s. */
static void restore(const char *id, double used, bool is_guests) {
    struct sp_error err;
    size_t size;
    proto_json *record = proto_json_parse(persist.text, persist.size, &err);
    proto_json_set_number(&record, "used", used);
    if (is_guests)
        proto_json_set_bool(&record, "guest", true);
    char *text = proto_json_to_text(record, &size);
    assert_true(srv_hub_restore(persist.hub, id, text, size, 9000, &err));
    free(text);
    proto_json_free(&record);
}

/* Over --hibernated-sessions one session of the owner with the most sessions ends: a guest's
 * session before others, and of these the session that was unused for the longest time. */
static void too_many_hibernated_sessions_cost_the_owner_with_the_most(void **state) {
    (void)state;
    static const char *const old = "aaaaaaaaaaaaaaaa", *const newer = "bbbbbbbbbbbbbbbb",
                             *const guests = "cccccccccccccccc";
    const struct srv_owner ann = { .name = "ann" };
    struct srv_quota quota = { .sessions = 0 };
    struct sp_error err;
    persist.quota = &quota;
    assert_true(srv_hub_session_delete(persist.hub, persist.id, NULL));
    assert_true(persist_create(&ann, false, 0, &err));
    assert_true(srv_hub_save(persist.hub, 0, persist_save, NULL));
    assert_true(srv_hub_session_delete(persist.hub, persist.id, NULL));
    restore(old, 1, false);
    restore(newer, 2, false);
    restore(guests, 3, true);
    const struct srv_owner none = { .name = "" };
    assert_true(persist_create(&none, false, 9000, &err));
    assert_true(srv_hub_save(persist.hub, 9000, persist_save, NULL));
    srv_hub_tick(persist.hub, 20000); /* it hibernates; two may stay */
    assert_int_equal(persist_numbers().hibernated, 2);
    assert_int_equal(count_of("ann"), 1);
    assert_string_equal(persist.ended, old);
    assert_int_equal(count_of(""), 1);
    assert_true(srv_hub_session_delete(persist.hub, newer, &err));
}

/* One owner cannot take all active sessions; an owner without a limit can. */
static void an_owner_has_a_share_of_the_sessions(void **state) {
    (void)state;
    const struct srv_owner ann = { .name = "ann", .quota = { .is_limited = true } };
    const struct srv_owner bob = { .name = "bob", .quota = { .is_limited = true } };
    const struct srv_owner admin = { .name = "root" };
    struct sp_error err;
    srv_hub_destroy(&persist.hub);
    persist.sessions_max = 8;
    persist_create_hub();
    for (int i = 0; i < 6; i++)
        assert_true(persist_create(&ann, false, 0, &err));
    assert_false(persist_create(&ann, false, 0, &err));
    assert_int_equal(err.code, SP_ERR_QUOTA);
    assert_non_null(strstr(err.text, "ann has 6 active sessions"));
    assert_true(persist_create(&bob, false, 0, &err));
    assert_false(persist_create(&bob, false, 0, &err)); /* ann's are not saved */
    assert_int_equal(err.code, SP_ERR_QUOTA);
    assert_true(persist_create(&admin, false, 0, &err));
    assert_false(persist_create(&admin, false, 0, &err));
    assert_int_equal(err.code, SP_ERR_BUDGET);
}

/* An owner with fewer sessions takes the place of an idle one of the owner with the most. */
static void the_owner_with_the_most_gives_its_idle_sessions(void **state) {
    (void)state;
    const struct srv_owner ann = { .name = "ann", .quota = { .is_limited = true } };
    const struct srv_owner bob = { .name = "bob", .quota = { .is_limited = true } };
    struct srv_owner other = { .quota = { .is_limited = true } };
    struct sp_error err;
    srv_hub_destroy(&persist.hub);
    persist.sessions_max = 8;
    persist_create_hub();
    assert_true(persist_create(&bob, false, 0, &err)); /* unused for longest */
    for (int i = 0; i < 5; i++)
        assert_true(persist_create(&ann, false, 10, &err));
    assert_true(srv_hub_save(persist.hub, 10, persist_save_each, NULL));
    for (int i = 0; i < 4; i++) {
        snprintf(other.name, sizeof other.name, "owner %d", i);
        if (!persist_create(&other, false, 20, &err))
            fail_msg("%s: %s", other.name, err.text);
    }
    assert_int_equal(count_of("bob"), 1);
    assert_int_equal(persist_numbers().hibernated, 2); /* ann's */
}

static bool activate(const char *id, double now_ms, struct sp_error *err) {
    proto_json *json = srv_hub_session_get(persist.hub, id, true, now_ms, err);
    bool is_active = json != NULL;
    proto_json_free(&json);
    return is_active;
}

static bool is_hibernated(const char *id) {
    struct srv_session_info infos[8];
    struct srv_page page = { .items = infos, .item_bytes = sizeof *infos, .max = 8, .after = "" };
    srv_hub_list(persist.hub, NULL, 5000, &page);
    for (unsigned i = 0; i < page.count; i++)
        if (strcmp(infos[i].id, id) == 0)
            return infos[i].is_hibernated;
    fail_msg("%s is not listed", id);
    return false;
}

/* At the limit of --sessions, the longest idle session hibernates at once if it is saved and has no
 * participant. */
static void at_the_limit_the_longest_idle_session_hibernates(void **state) {
    (void)state;
    const struct srv_owner anonymous = { .name = "" };
    char one[SRV_SESSION_ID_BYTES], two[SRV_SESSION_ID_BYTES], three[SRV_SESSION_ID_BYTES];
    struct sp_error err;
    strcpy(one, persist.id);
    assert_true(persist_create(&anonymous, false, 10, &err));
    strcpy(two, persist.id);
    assert_false(persist_create(&anonymous, false, 20, &err)); /* unsaved sessions would be lost */
    assert_int_equal(err.code, SP_ERR_BUDGET);
    assert_true(srv_hub_save(persist.hub, 20, persist_save_each, NULL));
    assert_false(
        persist_create(&anonymous, true, 30, &err)); /* no session hibernates for a guest */
    assert_int_equal(persist_numbers().hibernated, 0);
    assert_true(persist_create(&anonymous, false, 30, &err));
    strcpy(three, persist.id);
    assert_true(is_hibernated(one));
    assert_false(is_hibernated(two));
    assert_false(is_hibernated(three));
    assert_true(activate(one, 40, &err));
    assert_false(is_hibernated(one));
    assert_true(is_hibernated(two));
    assert_false(is_hibernated(three));
    assert_true(srv_hub_save(persist.hub, 50, persist_save_each, NULL));
    struct srv_participant *in_one =
        srv_hub_join(persist.hub, one, SRV_ROLE_VIEW, "", NULL, 50, NULL);
    assert_true(activate(two, 60, &err));
    assert_false(is_hibernated(one));
    assert_false(is_hibernated(two));
    assert_true(is_hibernated(three));
    struct srv_participant *in_two =
        srv_hub_join(persist.hub, two, SRV_ROLE_VIEW, "", NULL, 60, NULL);
    assert_true(in_one);
    assert_true(in_two);
    assert_false(activate(three, 70, &err));
    assert_int_equal(err.code, SP_ERR_BUDGET);
    assert_false(persist_create(&anonymous, false, 70, &err));
    assert_int_equal(err.code, SP_ERR_BUDGET);
    assert_int_equal(persist_numbers().sessions * 10 + persist_numbers().hibernated, 21);
    srv_hub_leave(persist.hub, &in_one, 80);
    srv_hub_leave(persist.hub, &in_two, 90);
    assert_true(activate(three, 100, &err));
    assert_true(is_hibernated(one));
    assert_false(is_hibernated(two));
}

int main(void) {
    const struct CMUnitTest tests[] = {
#define TEST(name) cmocka_unit_test_setup_teardown(name, persist_set_up, persist_tear_down)
        TEST(hibernated_sessions_have_a_limit_and_can_be_deleted),
        TEST(hibernated_sessions_count_towards_the_quota_of_their_owner),
        TEST(quotas_follow_the_current_token),
        TEST(guests_leave_a_quarter_of_the_sessions_to_others),
        TEST(too_many_hibernated_sessions_cost_the_owner_with_the_most),
        TEST(guests_leave_a_part_of_the_quota),
        TEST(an_owner_has_a_share_of_the_sessions),
        TEST(the_owner_with_the_most_gives_its_idle_sessions),
        TEST(at_the_limit_the_longest_idle_session_hibernates),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
