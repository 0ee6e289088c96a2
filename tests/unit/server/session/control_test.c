/* SPDX-License-Identifier: Apache-2.0
 *
 * Control of a session's view: when it passes on, and to which participant. --control-time is
 * 500 ms.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "support/compare.h"
#include "unit/server/session/hub_fixture.h"

/* Returns the answer that comes among the notifications. */
static char *late_answer(struct fixture *f, struct srv_participant *p, double now_ms) {
    struct srv_message message;
    while (srv_hub_next_message(f->hub, p, SRV_NEXT_ALL, now_ms, &message) == SRV_MESSAGE_TEXT) {
        if (strstr(message.text, "\"id\":1,") || strstr(message.text, "\"id\":1}"))
            return message.text;
        free(message.text);
    }
    fail_msg("there is no answer");
    return NULL;
}

/* Sends a request; true if it was answered with a result that holds `text`. */
static bool call(struct fixture *f, struct srv_participant *p, const char *method,
                 const char *params, double now_ms, const char *text) {
    char message[256], *answer;
    size_t size;
    snprintf(message, sizeof message,
             "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"%s\",\"params\":%s}", method, params);
    assert_true(srv_hub_message(f->hub, p, message, strlen(message), now_ms, &answer, &size));
    if (!answer)
        answer = late_answer(f, p, now_ms);
    bool found = strstr(answer, "\"result\"") && strstr(answer, text);
    free(answer);
    return found;
}

static bool can_move(struct fixture *f, struct srv_participant *p, double now_ms) {
    return call(f, p, "view.update", "{\"seq\":1,\"patch\":{}}", now_ms, "seq");
}

static bool asks(struct fixture *f, struct srv_participant *p, double now_ms) {
    return call(f, p, "session.request_control", "{}", now_ms, "true");
}

/* True if the newest session.control notification of the participant contains `text`. */
static bool is_notified(struct fixture *f, struct srv_participant *p, const char *text,
                        double now_ms) {
    struct srv_message message;
    bool found = false;
    while (srv_hub_next_message(f->hub, p, SRV_NEXT_ALL, now_ms, &message) == SRV_MESSAGE_TEXT) {
        if (strstr(message.text, "session.control"))
            found = strstr(message.text, text) != NULL;
        free(message.text);
    }
    return found;
}

static void each_new_holder_has_the_full_time_to_answer(void **state) {
    struct fixture *f = *state;
    struct srv_participant *a = hub_join(f, SRV_ROLE_CONTROL, 0);
    struct srv_participant *b = hub_join(f, SRV_ROLE_CONTROL, 0);
    struct srv_participant *c = hub_join(f, SRV_ROLE_CONTROL, 0);
    assert_true(can_move(f, a, 0));
    assert_false(asks(f, b, 100));
    assert_false(asks(f, c, 200));
    assert_false(asks(f, b, 300)); /* a repeated request keeps its place and its time */
    assert_compare(srv_hub_tick(f->hub, 590), <=, 10);
    assert_true(is_notified(f, c, "\"seconds\":0.01}", 590));
    assert_true(can_move(f, a, 590));
    srv_hub_tick(f->hub, 600);
    assert_false(can_move(f, a, 600));
    assert_true(can_move(f, b, 600));
    srv_hub_tick(f->hub, 1099); /* c asked at 200, but b has been asked since 600 */
    assert_true(can_move(f, b, 1099));
    srv_hub_tick(f->hub, 1100);
    assert_true(can_move(f, c, 1100));
    srv_hub_leave(f->hub, &a, 1200);
    srv_hub_leave(f->hub, &b, 1200);
    srv_hub_leave(f->hub, &c, 1200);
}

/* A name must not be able to change how the names beside it are displayed. */
static void names_with_control_characters_are_refused(void **state) {
    struct fixture *f = *state;
    static const char *const bad[] = { "",
                                       "a\\nb",
                                       "a\\u0000b",
                                       "a\x7f",
                                       "a\xc2\x85",
                                       "\xd8\x9c",
                                       "\xe2\x80\x8f",
                                       "\xe2\x80\xa8",
                                       "\xe2\x80\xae",
                                       "a\xe2\x81\xa6",
                                       "\xe2\x81\xa9",
                                       "\xe2\x81\xaa",
                                       "\xe2\x81\xaf" };
    static const char *const good[] = { "a",
                                        "\xd8\x9b",
                                        "\xd9\x8b\xd8\xa8",
                                        "\xc2\xa0\xc3\xbc",
                                        "\xe2\x80\x8d",
                                        "\xe2\x80\x90",
                                        "\xe2\x81\xb0",
                                        "\xe2\x82\xac" };
    char params[64];
    struct srv_participant *p = hub_join(f, SRV_ROLE_VIEW, 0);
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        snprintf(params, sizeof params, "{\"name\":\"%s\"}", bad[i]);
        if (call(f, p, "stream.configure", params, 0, "name"))
            fail_msg("bad name %zu is accepted", i);
    }
    for (size_t i = 0; i < sizeof good / sizeof *good; i++) {
        snprintf(params, sizeof params, "{\"name\":\"%s\"}", good[i]);
        if (!call(f, p, "stream.configure", params, 0, good[i]))
            fail_msg("name %zu is refused", i);
    }
    srv_hub_leave(f->hub, &p, 0);
}

static void an_error_names_the_unknown_member(void **state) {
    struct fixture *f = *state;
    static const char text[] = "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"stream.ack\","
                               "\"params\":{\"frame\":1,\"a/b~\":2}}";
    char *answer;
    size_t size;
    struct srv_participant *p = hub_join(f, SRV_ROLE_VIEW, 0);
    assert_true(srv_hub_message(f->hub, p, text, sizeof text - 1, 0, &answer, &size));
    assert_non_null(strstr(answer, "\"code\":-32602"));
    assert_non_null(strstr(answer, "\"pointer\":\"/a~1b~0\""));
    assert_non_null(strstr(answer, "unknown member; known: "));
    free(answer);
    srv_hub_leave(f->hub, &p, 0);
}

static void a_view_role_gets_no_control_by_waiting(void **state) {
    struct fixture *f = *state;
    struct srv_participant *a = hub_join(f, SRV_ROLE_CONTROL, 0);
    struct srv_participant *b = hub_join(f, SRV_ROLE_VIEW, 0);
    assert_true(can_move(f, a, 0));
    assert_false(asks(f, b, 0));
    assert_true(is_notified(f, a, "\"seconds\":null", 0));
    srv_hub_tick(f->hub, 1e9);
    assert_false(can_move(f, b, 1e9));
    assert_true(can_move(f, a, 1e9));
    srv_hub_leave(f->hub, &a, 1e9);
    assert_false(can_move(f, b, 1e9));
    srv_hub_tick(f->hub, 2e9);
    assert_false(can_move(f, b, 2e9));
    srv_hub_leave(f->hub, &b, 2e9);
}

static void an_answer_ends_the_request(void **state) {
    struct fixture *f = *state;
    struct srv_participant *a = hub_join(f, SRV_ROLE_CONTROL, 0);
    struct srv_participant *b = hub_join(f, SRV_ROLE_CONTROL, 0);
    char params[32];
    assert_true(asks(f, a, 0));
    assert_false(asks(f, b, 0));
    snprintf(params, sizeof params, "{\"to\":%u}", (unsigned)srv_participant_id(b));
    assert_true(call(f, a, "session.refuse_control", params, 400, "true"));
    srv_hub_tick(f->hub, 5000);
    assert_true(can_move(f, a, 5000));
    assert_false(asks(f, b, 5000));
    assert_true(call(f, b, "session.release_control", "{}", 5100, "false")); /* withdrawn */
    srv_hub_tick(f->hub, 9000);
    assert_true(can_move(f, a, 9000));
    assert_false(asks(f, b, 9000));
    srv_hub_leave(f->hub, &b, 9100); /* leaving withdraws the request */
    assert_true(is_notified(f, a, "\"requests\":[]", 9100));
    srv_hub_leave(f->hub, &a, 9200);
}

static void picks_are_limited_per_second(void **state) {
    struct fixture *f = *state;
    struct srv_participant *a = hub_join(f, SRV_ROLE_VIEW, 10000);
    unsigned answered = 0;
    for (int i = 0; i < 100; i++)
        answered += call(f, a, "pick", "{\"at\":[512,0]}", 10000, "\"position\":[1");
    assert_int_equal(answered, 20);
    for (int i = 0; i < 100; i++) /* during the next second */
        answered += call(f, a, "pick", "{\"at\":[0,0]}", 10010 + 10 * i, "\"position\":null");
    assert_int_equal(answered, 40);
    srv_hub_leave(f->hub, &a, 20000);
}

static void picks_of_many_elements_are_limited_more(void **state) {
    struct fixture *f = *state;
    struct srv_participant *a = hub_join(f, SRV_ROLE_VIEW, 10000);
    unsigned answered = 0;
    f->picked.elements = 2500000; /* a tenth of the limit per second, and the pick itself 50 ms */
    for (int i = 0; i < 100; i++)
        answered += call(f, a, "pick", "{\"at\":[512,0]}", 10000, "\"position\":[1");
    assert_int_equal(answered, 7);
    assert_false(call(f, a, "pick", "{\"at\":[512,0]}", 10050, "\"position\":[1"));
    assert_true(call(f, a, "pick", "{\"at\":[512,0]}", 10150, "\"position\":[1"));
    srv_hub_leave(f->hub, &a, 20000);
}

static void a_pick_may_have_no_value_and_may_fail(void **state) {
    struct fixture *f = *state;
    struct srv_participant *a = hub_join(f, SRV_ROLE_VIEW, 10000);
    assert_true(call(f, a, "pick", "{\"at\":[512,0]}", 10000, "\"value\":7"));
    assert_true(call(f, a, "pick", "{\"at\":[3,0],\"size\":[4,4]}", 10050, "\"opacity\":0.75"));
    assert_false(call(f, a, "pick", "{\"at\":[5,0],\"size\":[4,4]}", 10050, ""));
    assert_false(call(f, a, "pick", "{\"at\":[1,0],\"size\":[4,0]}", 10050, ""));
    f->picked.value = NAN;
    assert_true(call(f, a, "pick", "{\"at\":[512,0]}", 10100, "\"value\":null"));
    f->picked.elements = UINT64_MAX;
    assert_false(call(f, a, "pick", "{\"at\":[512,0]}", 10200, ""));
    srv_hub_leave(f->hub, &a, 20000);
}

int main(void) {
    const struct CMUnitTest tests[] = {
#define TEST(name) cmocka_unit_test_setup_teardown(name, hub_set_up, hub_tear_down)
        TEST(names_with_control_characters_are_refused),
        TEST(an_error_names_the_unknown_member),
        TEST(each_new_holder_has_the_full_time_to_answer),
        TEST(a_view_role_gets_no_control_by_waiting),
        TEST(an_answer_ends_the_request),
        TEST(picks_are_limited_per_second),
        TEST(picks_of_many_elements_are_limited_more),
        TEST(a_pick_may_have_no_value_and_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
