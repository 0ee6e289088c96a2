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
        while (srv_hub_next_message(c->f->hub, c->participant, false, NOW_MS + i * 100.0,
                                    &message) == SRV_MESSAGE_TEXT)
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
    while (srv_hub_next_message(f->hub, p, false, 0, &message) == SRV_MESSAGE_TEXT) {
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

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(threads_share_the_list, hub_set_up, hub_tear_down),
        cmocka_unit_test_setup_teardown(changes_are_told_once, hub_set_up, hub_tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
