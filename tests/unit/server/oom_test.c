/* SPDX-License-Identifier: Apache-2.0
 *
 * Out of memory while a client is served: the whole daemon in this process, a client on a socket,
 * and an allocator that fails once per run, at each place of the code in turn
 * (memory_fail_at_place()). Each time the answer is correct, or a problem document with status 500
 * or 503, or the connection ends. The request is executed completely or not at all, and the next
 * request is answered normally. Allocations of the HTTP, TLS and image libraries do not fail. The
 * leak checker of the ASan build finds leaks on these paths.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "support/compare.h"
#include "support/fake_memory.h"
#include "unit/server/oom.h"

static char control[64]; /* the control token of the session */

/* Requests. */

static void wait_for_volume(void) {
    do
        oom_must("GET", "volumes/engine", "", 200);
    while (strstr(oom_http.bytes, "\"loading\""));
    oom_must("POST", "sessions", "{\"view\":{\"size\":[8,8]}}", 201);
    oom_member("id", oom_session);
    oom_member("control", control);
    oom_must("POST", "views", "{\"size\":[9,9]}", 201);
    oom_member("id", oom_saved_view);
}

static void reading(void **state) {
    (void)state;
    static const char *const texts[] = {
        "/healthz",
        "/readyz",
        "/metrics",
        "/",
        "openapi.json",
        "openapi.yaml",
        "stream.md",
        "view.schema.json",
        "stream.schema.json",
        "volumes/engine",
        "volumes",
        "volumes/engine/view",
        "presets",
        "sessions",
        "views",
        "files",
        "files/series",
    };
    char path[128];
    wait_for_volume();
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++)
        oom_each_allocation("GET", texts[i], "", 200);
    oom_each_allocation("GET", "volumes/engine/histogram?axis=value,gradient", "", 200);
    snprintf(path, sizeof path, "sessions/%s/histogram", oom_session);
    oom_each_allocation("GET", path, "", 200);
    snprintf(path, sizeof path, "sessions/%s/visible", oom_session);
    oom_each_allocation("GET", path, "", 200);
    static const char *const volumes[] = { "", "/engine", "/engine/view" };
    for (size_t i = 0; i < sizeof volumes / sizeof *volumes; i++) {
        snprintf(path, sizeof path, "sessions/%s/volumes%s", oom_session, volumes[i]);
        oom_each_allocation("GET", path, "", 200);
    }
    oom_each_allocation("GET", "volumes/engine/slice?axis=2&index=1&format=raw", "", 200);
    oom_each_allocation("GET", "volumes/engine/slice?axis=2&index=1", "", 200);
    snprintf(path, sizeof path, "sessions/%s/slice?axis=0&index=0&color=transfer", oom_session);
    oom_each_allocation("GET", path, "", 200);
    snprintf(path, sizeof path, "sessions/%s/measures", oom_session);
    oom_each_allocation("GET", path, "", 200);
    snprintf(path, sizeof path, "sessions/%s/measures?format=csv", oom_session);
    oom_each_allocation("GET", path, "", 200);
    oom_each_allocation("POST", "measure",
                        "{\"volume\":\"engine\",\"kind\":\"profile\",\"points\":[[0,0,0],[3,3,3]]}",
                        200);
    snprintf(path, sizeof path, "sessions/%s/measure", oom_session);
    oom_each_allocation("POST", path,
                        "{\"kind\":\"rectangle\",\"points\":[[0,0,0],[3,0,0],[0,3,0]]}", 200);
    snprintf(path, sizeof path, "views/%s", oom_saved_view);
    oom_each_allocation("GET", path, "", 200);
    snprintf(path, sizeof path, "sessions/%s", oom_session);
    oom_each_allocation("GET", path, "", 200);
    oom_must("PUT", "presets/one", "{\"background\":[0.5,0,0,1]}", 201);
    oom_each_allocation("GET", "presets/one", "", 200);
}

static void making(void **state) {
    (void)state;
    char path[160], body[128];
    oom_each_allocation("POST", "render?format=jpeg",
                        "{\"size\":[8,8],\"camera\":{\"fov_y\":20.%ld}}", 200);
    snprintf(path, sizeof path, "render/%s?size=8,8&camera=%%7B%%22fov_y%%22:30%%7D",
             oom_saved_view);
    oom_each_allocation("GET", path, "", 200);
    oom_each_allocation("POST", "views", "{\"background\":[0.%ld,0,0,1]}", 201);
    oom_each_allocation("POST", "sessions", "{\"view\":{\"background\":[0.%ld,0,0,1]}}", 201);
    snprintf(body, sizeof body, "{\"from\":\"%s\"}", oom_saved_view);
    oom_each_allocation("POST", "sessions", body, 201);
    snprintf(body, sizeof body, "{\"from\":\"%s\"}", oom_session);
    oom_token = control;
    oom_each_allocation("POST", "sessions", body, 201);
    oom_token = OOM_ADMIN;
    snprintf(path, sizeof path, "sessions/%s", oom_session);
    oom_each_allocation("PATCH", path, "{\"view\":{\"background\":[0.%ld,0,0,1]}}", 200);
    snprintf(path, sizeof path, "sessions/%s/snapshot?size=8,8", oom_session);
    oom_each_allocation("GET", path, "", 200);
    snprintf(path, sizeof path, "views/%s", oom_saved_view);
    oom_each_allocation("PATCH", path, "{\"name\":\"%ld\"}", 204);
}

/* Replaces an existing preset (`status` 204) or creates a new one (201). */
static void each_allocation_of_putting(int status) {
    long n = 0;
    memory_forget_places();
    for (bool refused = true; refused; n++) {
        char body[64];
        int put;
        oom_ask(status == 204 ? "PUT" : "DELETE", "presets/two", "{}");
        snprintf(body, sizeof body, "{\"background\":[0.%ld,0,0,1]}", n);
        refused = oom_try("PUT", "presets/two", body, status, &put);
        bool is_there = oom_ask("GET", "presets/two", "") == 200;
        bool is_new = is_there && strstr(oom_http.bytes, "background");
        assert_true(is_there || status == 201);
        assert_true(is_new || put != status);
        assert_true(!is_new || put < 500);
        oom_must("PUT", "presets/two", body, is_there ? 204 : 201);
    }
    print_message("PUT presets, %d: %ld allocations\n", status, n - 1);
    assert_compare(n, >, 3);
    oom_cover("PUT", "presets/two");
}

/* Returns the state of the volume "made" once it is not loading; "" = no such volume. Works while
 * allocations fail. */
static const char *state_of_made(void) {
    int status;
    do
        status = oom_ask("GET", "volumes/made", "");
    while (oom_is_no_memory(status) || (status == 200 && strstr(oom_http.bytes, "\"loading\"")));
    return status == 404                                     ? ""
           : strstr(oom_http.bytes, "\"state\":\"ready\"")   ? "ready"
           : strstr(oom_http.bytes, "\"reason\":\"") != NULL ? "failed"
                                                             : "neither";
}

/* From the request until the volume is loaded. */
static void each_allocation_of_loading(void) {
    static const char body[] = "{\"uri\":\"demo:engine?size=9\",\"id\":\"made\"}";
    long n = 0;
    memory_forget_places();
    for (bool refused = true; refused; n++) {
        memory_fail_at_place();
        int status = oom_ask("POST", "volumes", body);
        state_of_made();
        refused = memory_restore();
        if (status != 202) {
            assert_true(refused);
            assert_true(oom_is_no_memory(status));
        }
        const char *made = state_of_made();
        if (strcmp(made, "failed") == 0 ? !refused || !strstr(oom_http.bytes, "memory")
            : made[0]                   ? strcmp(made, "ready") != 0
                                        : status == 202)
            fail_msg("loading with allocation %ld refused: %d: %.600s", n, status, oom_http.bytes);
        oom_must("POST", "volumes", body, strcmp(made, "ready") == 0 ? 201 : 202);
        assert_string_equal(state_of_made(), "ready");
        oom_must("DELETE", "volumes/made", "", 204);
        assert_string_equal(state_of_made(), "");
    }
    print_message("POST volumes: %ld allocations\n", n - 1);
    assert_compare(n, >, 3);
    oom_cover("POST", "volumes");
}

/* Creates an object of `kind` from `body` (answer: status `made`), then deletes it without memory:
 * the object is gone or unchanged, and the next request shows which. The id of a volume is "made".
 */
static void each_allocation_of_ending(const char *kind, const char *body, int made) {
    char text[256], id[64], path[128];
    long n = 0;
    memory_forget_places();
    for (bool refused = true; refused; n++) {
        int status;
        snprintf(text, sizeof text, body, n);
        snprintf(path, sizeof path, "%s/two", kind);
        oom_must(made == 202 || strcmp(kind, "presets") != 0 ? "POST" : "PUT",
                 strcmp(kind, "presets") != 0 ? kind : path, text, made);
        if (strcmp(kind, "presets") != 0) {
            oom_member("id", id);
            snprintf(path, sizeof path, "%s/%s", kind, id);
        }
        if (strcmp(kind, "volumes") == 0)
            assert_string_equal(state_of_made(), "ready");
        refused = oom_try("DELETE", path, "", 204, &status);
        int found = oom_ask("GET", path, "");
        if (found != 404) {
            assert_int_equal(found, 200);
            assert_int_not_equal(status, 204);
        }
        assert_true(found == 200 || status < 500);
        oom_must("DELETE", path, "", found == 200 ? 204 : 404);
        oom_must("GET", path, "", 404);
    }
    print_message("DELETE %s: %ld allocations\n", kind, n - 1);
    assert_compare(n, >, 0);
    oom_cover("DELETE", path);
}

/* Sends the only byte of an upload: it counts, or it does not and can be sent again. */
static void each_allocation_of_uploading(void) {
    char id[64], path[96];
    long n = 0;
    memory_forget_places();
    for (bool refused = true; refused; n++) {
        int status;
        oom_must("POST", "uploads", "{\"name\":\"a.nrrd\",\"bytes\":1}", 201);
        oom_member("id", id);
        snprintf(path, sizeof path, "uploads/%s", id);
        oom_type = "application/offset+octet-stream\r\nUpload-Checksum: md5 "
                   "DMF1ucDxtqgxw5niaXcmYQ==\r\nUpload-Offset: 0";
        refused = oom_try("PATCH", path, "a", 204, &status);
        oom_type = OOM_JSON;
        oom_must("GET", path, "", 200);
        assert_non_null(strstr(oom_http.bytes, status == 204 ? "\"offset\":1" : "\"offset\":"));
        oom_must("DELETE", path, "", 204);
    }
    print_message("PATCH uploads: %ld allocations\n", n - 1);
    assert_compare(n, >, 3);
    oom_cover("PATCH", path);
}

static void uploading(void **state) {
    (void)state;
    char id[64], path[96];
    oom_each_allocation("OPTIONS", "uploads", "", 204);
    oom_each_allocation("POST", "uploads", "{\"name\":\"%ld.nrrd\",\"bytes\":8}", 201);
    oom_must("POST", "uploads", "{\"name\":\"a.nrrd\",\"bytes\":1}", 201);
    oom_member("id", id);
    oom_each_allocation("GET", "uploads", "", 200);
    snprintf(path, sizeof path, "uploads/%s", id);
    oom_each_allocation("GET", path, "", 200);
    oom_must("DELETE", path, "", 204);
    each_allocation_of_uploading();
    each_allocation_of_ending("uploads", "{\"name\":\"%ld.nrrd\",\"bytes\":8}", 201);
}

/* The body of the last answer; its head has the date. */
static const char *last_body(void) {
    const char *end = strstr(oom_http.bytes, "\r\n\r\n");
    assert_non_null(end);
    return end;
}

/* Changes the measurements of a session that has one, "one": a refused change leaves the list as it
 * was. Each try has a session of its own, because a session limits changes per second. */
static void each_allocation_of_measuring(const char *method, const char *item, const char *body,
                                         int expected) {
    char id[64], session[96], list[128], path[192];
    long n = 0;
    memory_forget_places();
    for (bool refused = true; refused; n++) {
        int status;
        oom_must("POST", "sessions", "{}", 201);
        oom_member("id", id);
        snprintf(session, sizeof session, "sessions/%s", id);
        snprintf(list, sizeof list, "%s/measures", session);
        snprintf(path, sizeof path, "%s/one", list);
        oom_must("PUT", path, "{\"kind\":\"distance\",\"points\":[[0,0,0],[3,3,3]]}", 201);
        snprintf(path, sizeof path, "%s%s", list, item);
        oom_must("GET", list, "", 200);
        char *before = strdup(last_body());
        assert_non_null(before);
        refused = oom_try(method, path, body, expected, &status);
        oom_must("GET", list, "", 200);
        assert_true(status == 0 || (strcmp(last_body(), before) == 0) == (status != expected));
        free(before);
        oom_must("DELETE", session, "", 204);
    }
    print_message("%s measures%s: %ld allocations\n", method, item, n - 1);
    assert_compare(n, >, 1);
    oom_cover(method, path);
}

static void changing(void **state) {
    (void)state;
    each_allocation_of_measuring("POST", "", "{\"kind\":\"marker\",\"points\":[[1,1,1]]}", 201);
    each_allocation_of_measuring("PUT", "/two", "{\"kind\":\"marker\",\"points\":[[1,1,1]]}", 201);
    each_allocation_of_measuring("PATCH", "/one", "{\"text\":\"Wall\"}", 200);
    each_allocation_of_measuring("DELETE", "/one", "", 204);
    each_allocation_of_putting(201);
    each_allocation_of_putting(204);
    oom_must("DELETE", "presets/two", "", 204);
    each_allocation_of_loading();
    each_allocation_of_ending("presets", "{\"background\":[0.%ld,0,0,1]}", 201);
    each_allocation_of_ending("views", "{\"background\":[0.%ld,0,1,1]}", 201);
    oom_token = OOM_GALLERY; /* not an admin, so that the daemon must find the owner of the view */
    each_allocation_of_ending("views", "{\"background\":[0.%ld,1,1,1]}", 201);
    oom_token = OOM_ADMIN;
    each_allocation_of_ending("sessions", "{\"view\":{\"background\":[0.%ld,0,0,1]}}", 201);
    each_allocation_of_ending(
        "volumes", "{\"uri\":\"demo:engine?size=9\",\"id\":\"made\",\"name\":\"%ld\"}", 202);
}

/* Clients without a token. */

/* Sends a body of a million blanks. Returns the status of the answer, and the largest allocation
 * meanwhile. */
static int send_long_body(const char *method, const char *path, const char *token,
                          size_t *largest) {
    enum { BYTES = 1000000 };
    char head[512], *blanks = malloc(BYTES);
    int status = 0;
    assert_non_null(blanks);
    memset(blanks, ' ', BYTES);
    int size = snprintf(head, sizeof head,
                        "%s /api/v1/%s HTTP/1.1\r\nHost: x\r\nConnection: close\r\n%s%s"
                        "Content-Type: application/json\r\nContent-Length: %d\r\n\r\n",
                        method, path, token, token[0] ? "\r\n" : "", BYTES);
    oom_connect(&oom_http);
    memory_consume_largest();
    oom_send(&oom_http, head, (size_t)size);
    oom_send(&oom_http, blanks, BYTES);
    while (oom_receive(&oom_http)) {
    }
    *largest = memory_consume_largest();
    oom_hang_up(&oom_http);
    free(blanks);
    assert_int_equal(sscanf(oom_http.bytes, "HTTP/1.1 %d", &status), 1);
    return status;
}

static void a_body_without_a_valid_token_is_not_stored(void **state) {
    (void)state;
    static const char *const strangers[] = { "", "Authorization: Bearer nonsense-nonsense" };
    char known[128], target[96];
    size_t largest;
    snprintf(target, sizeof target, "sessions/%s", oom_session);
    for (size_t i = 0; i < sizeof strangers / sizeof *strangers; i++) {
        assert_int_equal(send_long_body("POST", "sessions", strangers[i], &largest), 401);
        assert_in_range(largest, 1, 64 * 1024);
        assert_int_equal(send_long_body("PATCH", target, strangers[i], &largest), 401);
        assert_in_range(largest, 1, 64 * 1024);
        assert_int_equal(send_long_body("POST", "views", strangers[i], &largest), 401);
        assert_in_range(largest, 1, 64 * 1024);
    }
    /* With a valid token the body is stored. */
    snprintf(known, sizeof known, "Authorization: Bearer %s", oom_token);
    assert_int_equal(send_long_body("POST", "sessions", known, &largest), 400);
    assert_in_range(largest, 1000000, 8000000);
    oom_must("DELETE", target, "", 204);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(reading),
        cmocka_unit_test(making),
        cmocka_unit_test(changing),
        cmocka_unit_test(uploading),
        cmocka_unit_test(oom_paths),
        cmocka_unit_test(oom_streams),
        cmocka_unit_test(oom_all_is_covered),
        cmocka_unit_test(a_body_without_a_valid_token_is_not_stored),
    };
    memory_exempt_thread(true);
    signal(SIGPIPE, SIG_IGN);
    memory_fake_sqlite();
    return cmocka_run_group_tests(tests, oom_set_up, oom_tear_down);
}
