/* SPDX-License-Identifier: Apache-2.0
 *
 * Every allocation of the JSON library fails once: each function then says so, and loses nothing
 * (the leak checker of the ASan build looks on).
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdlib.h>
#include <string.h>

#include "protocol/fixture.h"
#include "protocol/rpc.h"
#include "protocol/view.h"
#include "protocol/volume.h"

/* The JSON library's own hook; its header belongs to protocol/json.c. */
void json_set_alloc_funcs(void *(*allocate)(size_t), void (*release)(void *));

static long countdown = -1; /* allocations that still succeed; < 0 = all */

static void *allocate(size_t size) {
    if (countdown == 0)
        return NULL;
    countdown -= countdown > 0;
    return malloc(size);
}

static int set_up(void **state) {
    (void)state;
    json_set_alloc_funcs(allocate, free);
    return 0;
}

static int tear_down(void **state) {
    (void)state;
    json_set_alloc_funcs(malloc, free);
    return 0;
}

/* Calls `attempt` with 0, 1, 2 … allocations left until it succeeds; returns how often it failed.
 */
static int fail_each(bool (*attempt)(void)) {
    for (long n = 0; n < 100000; n++) {
        countdown = n;
        bool ok = attempt();
        countdown = -1;
        if (ok)
            return (int)n;
    }
    fail_msg("never succeeds");
    return 0;
}

static const char text[] =
    "{\"camera\":{\"up\":[0,1,0.5]},\"volume\":\"é\",\"filter\":{\"c_max\":null}}";

static int memory_errors;

static bool parse(void) {
    struct sp_error err = { 0 };
    proto_json *json = proto_json_parse(text, sizeof text - 1, &err);
    if (!json) {
        memory_errors += err.code == SP_ERR_MEMORY;
        assert_true(err.code == SP_ERR_MEMORY || err.code == SP_ERR_FORMAT);
        assert_true(err.text[0]);
        return false;
    }
    proto_json_free(&json);
    return true;
}

static void parsing(void **state) {
    (void)state;
    /* For a few the library blames the document: see proto_json_parse(). */
    memory_errors = 0;
    int failed = fail_each(parse);
    assert_true(failed > 10 && memory_errors > failed / 2);
}

static bool encode_view(void) {
    const struct sp_view view = fixture_view();
    proto_json *json = proto_view_encode(&view);
    bool ok = json != NULL;
    proto_json_free(&json);
    return ok;
}

static bool encode_volume(void) {
    struct sp_volume_info info = fixture_info();
    double z[32] = { 0 };
    info.grid.coordinates[2] = z;
    proto_json *json = proto_volume_encode(&info, "id", true);
    bool ok = json != NULL;
    proto_json_free(&json);
    return ok;
}

static void encoding(void **state) {
    (void)state;
    assert_true(fail_each(encode_view) > 100);
    assert_true(fail_each(encode_volume) > 100);
}

static bool answer_result(void) {
    static const char request[] = "{\"jsonrpc\":\"2.0\",\"id\":\"a\",\"method\":\"ping\"}";
    struct proto_rpc_message message;
    enum proto_rpc_code code = PROTO_RPC_PARSE;
    char *answer = NULL;
    if (proto_rpc_decode(request, sizeof request - 1, &message, &code, NULL))
        answer = proto_rpc_result(message.id, proto_json_object(), NULL);
    else
        assert_true(code == PROTO_RPC_INTERNAL || code == PROTO_RPC_PARSE);
    proto_rpc_finish(&message);
    bool ok = answer != NULL;
    free(answer);
    return ok;
}

static bool answer_error(void) {
    struct sp_error err;
    sp_fail(&err, SP_ERR_INVALID, "/camera", "no");
    char *answer = proto_rpc_error(NULL, PROTO_RPC_VIEW, &err, NULL);
    bool ok = answer != NULL;
    free(answer);
    return ok;
}

static void answering(void **state) {
    (void)state;
    assert_true(fail_each(answer_result) > 10);
    assert_true(fail_each(answer_error) > 10);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(parsing),
        cmocka_unit_test(encoding),
        cmocka_unit_test(answering),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
