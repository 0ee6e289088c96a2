/* SPDX-License-Identifier: Apache-2.0
 *
 * The measurements of a session while several threads use it.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include <pthread.h>

#include "common/work_queue.h"
#include "session/session.h"
#include "unit/server/session/hub_fixture.h"

enum { ROUNDS = 400, NOW_MS = 2000 };

static bool call(struct srv_hub *hub, struct srv_participant *p, const char *method,
                 const char *params, double now_ms, char **answer) {
    char message[256];
    size_t size;
    snprintf(message, sizeof message,
             "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"%s\",\"params\":%s}", method, params);
    return srv_hub_message(hub, p, message, strlen(message), now_ms, answer, &size);
}

struct client {
    struct fixture *f;
    struct srv_participant *participant;
    char name;
    int failures;
};

/* Puts and removes its own three measurements, and takes its notifications. */
static void *edit(void *user) {
    struct client *c = user;
    for (int i = 0; i < ROUNDS; i++) {
        char params[160], *answer = NULL;
        const bool removes = i % 5 == 4;
        struct srv_message message;
        if (removes)
            snprintf(params, sizeof params, "{\"id\":\"%c%d\"}", c->name, i / 5 % 3);
        else
            snprintf(params, sizeof params,
                     "{\"id\":\"%c%d\",\"kind\":\"marker\",\"points\":[[%d,0,0]]}", c->name, i % 3,
                     i);
        const bool ok = call(c->f->hub, c->participant, removes ? "measure.remove" : "measure.put",
                             params, NOW_MS + i * 100.0, &answer);
        /* A measurement that is removed may be gone already. */
        c->failures += !ok || (!removes && !strstr(answer, "\"result\""));
        free(answer);
        while (srv_hub_next_message(c->f->hub, c->participant, SRV_NEXT_NOTIFICATIONS,
                                    NOW_MS + i * 100.0, &message) == SRV_MESSAGE_TEXT)
            free(message.text);
    }
    return NULL;
}

static bool drop(void *user, const char *id, const char *text, size_t size) {
    (void)user;
    (void)id;
    return text[size] == 0;
}

static void threads_share_the_list(void **state) {
    struct fixture *f = *state;
    struct client clients[2] = { { f, hub_join(f, SRV_ROLE_CONTROL, 0), 'a', 0 },
                                 { f, hub_join(f, SRV_ROLE_CONTROL, 0), 'b', 0 } };
    pthread_t threads[2];
    for (int i = 0; i < 2; i++)
        assert_int_equal(pthread_create(&threads[i], NULL, edit, &clients[i]), 0);
    for (int i = 0; i < ROUNDS; i++) {
        struct srv_measures measures;
        struct sp_error err;
        assert_true(srv_hub_measures(f->hub, f->id, 0, &measures, &err));
        assert_in_range(measures.count, 0, 6);
        srv_measures_finish(&measures);
        assert_true(srv_hub_save(f->hub, 0, drop, NULL));
    }
    for (int i = 0; i < 2; i++) {
        pthread_join(threads[i], NULL);
        assert_int_equal(clients[i].failures, 0);
        srv_hub_leave(f->hub, &clients[i].participant, 0);
    }
}

/* The text of the newest session.measures; NULL = none. The caller frees it. */
static char *told(struct fixture *f, struct srv_participant *p) {
    struct srv_message message;
    char *newest = NULL;
    while (srv_hub_next_message(f->hub, p, SRV_NEXT_NOTIFICATIONS, 0, &message) ==
           SRV_MESSAGE_TEXT) {
        if (strstr(message.text, "session.measures")) {
            free(newest);
            newest = message.text;
        } else {
            free(message.text);
        }
    }
    return newest;
}

/* Several changes before a notification is sent give one, with the newest state. */
static void changes_are_told_once(void **state) {
    struct fixture *f = *state;
    struct srv_participant *a = hub_join(f, SRV_ROLE_CONTROL, 0);
    struct srv_participant *b = hub_join(f, SRV_ROLE_VIEW, 0);
    assert_null(told(f, b));
    hub_send(f, a, "measure.put", "{\"id\":\"x\",\"kind\":\"marker\",\"points\":[[1,0,0]]}",
             NOW_MS + 0);
    hub_send(f, a, "measure.put", "{\"id\":\"y\",\"kind\":\"marker\",\"points\":[[2,0,0]]}",
             NOW_MS + 1);
    hub_send(f, a, "measure.put", "{\"id\":\"x\",\"text\":\"new\"}", NOW_MS + 2);
    char *text = told(f, b);
    assert_non_null(text);
    assert_non_null(strstr(text, "\"ids\":[\"x\",\"y\"]"));
    assert_non_null(strstr(text, "\"text\":\"new\""));
    free(text);
    hub_send(f, a, "measure.remove", "{\"id\":\"x\"}", NOW_MS + 3);
    text = told(f, b);
    assert_non_null(strstr(text, "{\"ids\":[\"y\"],\"changed\":[]}"));
    free(text);
    assert_null(told(f, a)); /* its own changes */
    srv_hub_leave(f->hub, &a, 0);
    srv_hub_leave(f->hub, &b, 0);
}

/* A client that changes what another one has removed is told so. */
static void an_unknown_id_is_said_to_be_unknown(void **state) {
    struct fixture *f = *state;
    struct srv_participant *a = hub_join(f, SRV_ROLE_CONTROL, 0);
    static const char *const params[] = { "{\"id\":\"gone\",\"text\":\"t\"}",
                                          "{\"id\":\"gone\",\"points\":[[1,0,0]]}" };
    for (int i = 0; i < 2; i++) {
        char *answer = NULL;
        assert_true(call(f->hub, a, "measure.put", params[i], NOW_MS + i, &answer));
        assert_non_null(strstr(answer, "-32002"));
        assert_non_null(strstr(answer, "there is no measurement 'gone'"));
        assert_non_null(strstr(answer, "\"pointer\":\"/id\""));
        free(answer);
    }
    srv_hub_leave(f->hub, &a, 0);
}

static proto_json *put(struct fixture *f, const char *id, enum srv_measure_change change,
                       const char *body, double now_ms, bool *is_new, struct sp_error *err) {
    proto_json *json = proto_json_parse(body, strlen(body), err);
    struct srv_measure_answer answer;
    const struct srv_measure_request request = { id, change, json, "script" };
    char *text = srv_hub_measure_put(f->hub, f->id, &request, now_ms, &answer, err);
    proto_json *made = NULL;
    if (text) {
        struct sp_error unreadable;
        *is_new = answer.is_new;
        made = proto_json_parse(text, answer.size, &unreadable);
        assert_string_equal(proto_json_string(proto_json_get(made, "id")), answer.id);
    }
    free(text);
    proto_json_free(&json);
    return made;
}

/* Changes over HTTP run the same code as changes over the stream; all participants are told. */
static void scripts_change_measurements(void **state) {
    struct fixture *f = *state;
    struct srv_participant *a = hub_join(f, SRV_ROLE_VIEW, 0);
    struct sp_error err = { .code = SP_OK };
    bool is_new = false;
    proto_json *made =
        put(f, "s", SRV_MEASURE_REPLACE,
            "{\"kind\":\"marker\",\"points\":[[1,0,0]],\"text\":\"t\"}", NOW_MS, &is_new, &err);
    assert_non_null(made);
    assert_true(is_new);
    assert_string_equal(proto_json_string(proto_json_get(made, "author")), "script");
    proto_json_free(&made);
    char *text = told(f, a);
    assert_non_null(strstr(text, "{\"ids\":[\"s\"]"));
    free(text);
    made = put(f, "s", SRV_MEASURE_CHANGE, "{\"hidden\":true}", NOW_MS, &is_new, &err);
    assert_false(is_new);
    assert_string_equal(proto_json_string(proto_json_get(made, "text")), "t");
    proto_json_free(&made);
    made = put(f, "s", SRV_MEASURE_REPLACE, "{\"kind\":\"marker\",\"points\":[[2,0,0]]}", NOW_MS,
               &is_new, &err);
    assert_false(is_new);
    assert_string_equal(proto_json_string(proto_json_get(made, "text")), "");
    assert_int_equal(proto_json_type(proto_json_get(made, "hidden")), PROTO_JSON_BOOL);
    proto_json_free(&made);
    assert_null(put(f, "s", SRV_MEASURE_REPLACE, "{\"text\":\"t\"}", NOW_MS, &is_new, &err));
    assert_string_equal(err.place, "/kind");
    assert_null(put(f, "x", SRV_MEASURE_CHANGE, "{\"text\":\"t\"}", NOW_MS, &is_new, &err));
    assert_int_equal(err.code, SP_ERR_NOT_FOUND);
    assert_null(put(f, "a b", SRV_MEASURE_CHANGE, "{\"text\":\"t\"}", NOW_MS, &is_new, &err));
    assert_int_equal(err.code, SP_ERR_INVALID);
    assert_true(srv_hub_measure_remove(f->hub, f->id, "s", NOW_MS, &err));
    assert_false(srv_hub_measure_remove(f->hub, f->id, "s", NOW_MS, &err));
    assert_int_equal(err.code, SP_ERR_NOT_FOUND);
    text = told(f, a);
    assert_non_null(strstr(text, "{\"ids\":[],\"changed\":[]}"));
    free(text);
    srv_hub_leave(f->hub, &a, 0);
}

static void scripts_have_a_quota_and_a_limit(void **state) {
    struct fixture *f = *state;
    struct sp_error err = { .code = SP_OK };
    bool is_new;
    static const char marker[] = "{\"kind\":\"marker\",\"points\":[[1,0,0]]}";
    double now_ms = NOW_MS;
    int refused = 0;
    for (int i = 0; i < SRV_MEASURES_PER_SECOND + 1; i++) {
        proto_json *made = put(f, "s", SRV_MEASURE_REPLACE, marker, now_ms, &is_new, &err);
        refused += !made;
        proto_json_free(&made);
    }
    assert_int_equal(refused, 1);
    assert_int_equal(err.code, SP_ERR_QUOTA);
    for (int i = 1; i < SRV_MEASURES_MAX; i++) {
        proto_json *made = put(f, NULL, SRV_MEASURE_REPLACE, marker, now_ms += 100, &is_new, &err);
        assert_non_null(made);
        proto_json_free(&made);
    }
    assert_null(put(f, NULL, SRV_MEASURE_REPLACE, marker, now_ms + 100, &is_new, &err));
    assert_int_equal(err.code, SP_ERR_QUOTA);
    assert_non_null(strstr(err.text, "has 100 measurements"));
}

/* The measuring thread answers. A participant that has left gets no answer; the list has the
 * result. */
static void parts_are_answered_later(void **state) {
    static const char put_part[] =
        "{\"id\":\"%s\",\"kind\":\"part\",\"points\":[[7,0,0]],\"range\":[1,2]}";
    struct fixture *f = *state;
    struct sp_error err;
    struct srv_participant *a = hub_join(f, SRV_ROLE_CONTROL, 0);
    struct srv_participant *b = hub_join(f, SRV_ROLE_CONTROL, 0);
    struct srv_work_queue *queue = srv_work_queue_create("test", 10, &err);
    char params[160], *answer = NULL;
    struct srv_measures measures;
    f->hub->options.measuring = queue;
    free(told(f, a));
    snprintf(params, sizeof params, put_part, "a");
    assert_true(call(f->hub, a, "measure.put", params, NOW_MS, &answer));
    assert_null(answer);
    snprintf(params, sizeof params, put_part, "b");
    assert_true(call(f->hub, b, "measure.put", params, NOW_MS, &answer));
    assert_null(answer);
    srv_hub_leave(f->hub, &b, 0);
    srv_work_queue_stop(queue);
    struct srv_message message;
    assert_int_equal(srv_hub_next_message(f->hub, a, SRV_NEXT_NOTIFICATIONS, 0, &message),
                     SRV_MESSAGE_TEXT);
    assert_non_null(strstr(message.text, "\"result\""));
    assert_non_null(strstr(message.text, "\"value\":7"));
    free(message.text);
    assert_true(srv_hub_measures(f->hub, f->id, 0, &measures, &err));
    assert_int_equal(measures.count, 2);
    srv_measures_finish(&measures);
    srv_hub_leave(f->hub, &a, 0);
    srv_work_queue_destroy(&queue);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(threads_share_the_list, hub_set_up, hub_tear_down),
        cmocka_unit_test_setup_teardown(changes_are_told_once, hub_set_up, hub_tear_down),
        cmocka_unit_test_setup_teardown(an_unknown_id_is_said_to_be_unknown, hub_set_up,
                                        hub_tear_down),
        cmocka_unit_test_setup_teardown(scripts_change_measurements, hub_set_up, hub_tear_down),
        cmocka_unit_test_setup_teardown(scripts_have_a_quota_and_a_limit, hub_set_up,
                                        hub_tear_down),
        cmocka_unit_test_setup_teardown(parts_are_answered_later, hub_set_up, hub_tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
