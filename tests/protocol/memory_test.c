/* SPDX-License-Identifier: Apache-2.0
 *
 * Makes every allocation fail, alone or with all later allocations. Each function then reports that
 * memory ran out and leaks nothing (the ASan build checks for leaks).
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "protocol/fixture.h"
#include "protocol/rpc.h"
#include "protocol/view.h"
#include "protocol/volume.h"
#include "support/compare.h"
#include "support/fake_memory.h"

/* Calls `attempt` with 0, 1, 2 … allocations left until it succeeds. Returns the number of
 * failures.
 */
static int fail_each(bool (*attempt)(void), enum memory_end end) {
    for (long n = 0; n < 100000; n++) {
        memory_fail_after(n, end);
        bool ok = attempt();
        bool refused = memory_restore();
        if (!ok)
            assert_true(refused);
        if (!refused)
            return (int)n;
    }
    fail_msg("still fails with 100000 allocations");
    return 0;
}

static char text[256]; /* input of parse() */

static bool parse(void) {
    struct sp_error err = { 0 };
    proto_json *json = proto_json_parse(text, strlen(text), &err);
    memory_exempt_thread(true);
    if (json) { /* the document equals the text */
        char *back = proto_json_to_text(json, NULL);
        assert_string_equal(back, text);
        free(back);
    } else {
        assert_int_equal(err.code, SP_ERR_MEMORY);
        assert_true(err.text[0]);
    }
    bool ok = json != NULL;
    proto_json_free(&json);
    memory_exempt_thread(false);
    return ok;
}

static void parsing_reports_lack_of_memory(void **state) {
    (void)state;
    strcpy(text, "{\"camera\":{\"up\":[0,1,0.5]},\"volume\":\"é\",\"filter\":{\"c_max\":null}}");
    assert_compare(fail_each(parse, MEMORY_FAILS_ONCE), >, 10);
    assert_compare(fail_each(parse, MEMORY_STAYS_OUT), >, 10);
}

/* The library's token buffer grows while it reads a long key, string or number. */
static void parsing_long_tokens_reports_lack_of_memory(void **state) {
    (void)state;
    enum { STRING_MAX = 70, NUMBER_MAX = 18 };
    char digits[STRING_MAX];
    memset(digits, '1', sizeof digits);
    for (int length = 10; length <= STRING_MAX; length++) {
        snprintf(text, sizeof text, "{\"%.*s\":\"%.*s\"}", length, digits, length / 2, digits);
        assert_compare(fail_each(parse, MEMORY_FAILS_ONCE), >, 5);
        assert_compare(fail_each(parse, MEMORY_STAYS_OUT), >, 5);
    }
    for (int length = 10; length <= NUMBER_MAX; length++) {
        snprintf(text, sizeof text, "%.*s", length, digits);
        assert_compare(fail_each(parse, MEMORY_FAILS_ONCE), >, 2);
        assert_compare(fail_each(parse, MEMORY_STAYS_OUT), >, 2);
    }
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

static bool encode_joint_histogram(void) {
    struct sp_volume_info info = fixture_info();
    struct sp_joint_histogram joint = { .gradients = { 0, 1 } };
    proto_json *json = proto_histogram_encode(&info, "id", &joint);
    bool ok = json != NULL;
    proto_json_free(&json);
    return ok;
}

static bool encode_visible_part(void) {
    const struct sp_visible_part part = { .radius = 1 };
    proto_json *json = proto_visible_part_encode(&part, "id");
    bool ok = json != NULL;
    proto_json_free(&json);
    return ok;
}

static void encoding_reports_lack_of_memory(void **state) {
    (void)state;
    assert_compare(fail_each(encode_view, MEMORY_FAILS_ONCE), >, 100);
    assert_compare(fail_each(encode_volume, MEMORY_FAILS_ONCE), >, 100);
    assert_compare(fail_each(encode_joint_histogram, MEMORY_FAILS_ONCE), >, 100);
    assert_compare(fail_each(encode_visible_part, MEMORY_FAILS_ONCE), >, 20);
}

static bool answer_result(void) {
    static const char request[] = "{\"jsonrpc\":\"2.0\",\"id\":\"a\",\"method\":\"ping\"}";
    struct proto_rpc_message message;
    enum proto_rpc_code code = PROTO_RPC_PARSE;
    char *answer = NULL;
    if (proto_rpc_decode(request, sizeof request - 1, &message, &code, NULL))
        answer = proto_rpc_result(message.id, proto_json_object(), NULL);
    else
        assert_int_equal(code, PROTO_RPC_INTERNAL);
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

static void answering_reports_lack_of_memory(void **state) {
    (void)state;
    assert_compare(fail_each(answer_result, MEMORY_FAILS_ONCE), >, 10);
    assert_compare(fail_each(answer_error, MEMORY_FAILS_ONCE), >, 10);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(parsing_reports_lack_of_memory),
        cmocka_unit_test(parsing_long_tokens_reports_lack_of_memory),
        cmocka_unit_test(encoding_reports_lack_of_memory),
        cmocka_unit_test(answering_reports_lack_of_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
