/* SPDX-License-Identifier: Apache-2.0
 *
 * Lines as they are written, and how many: by a clock that is played.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "log.h"

#define STAMP "2026-01-31T12:00:00.123Z"

static const char *line_of(enum srv_log_format format, const struct sp_log_field *fields,
                           const char *text) {
    static char out[SRV_LOG_LINE];
    unsigned size = srv_log_line(format, STAMP, SP_LOG_WARN, fields, text, out);
    assert_int_equal(size, strlen(out));
    return out;
}

static void the_forms_of_a_line(void **state) {
    (void)state;
    const struct sp_log_field *none = &(struct sp_log_field){ NULL, NULL };
    const struct sp_log_field *two = SP_LOG_FIELDS({ "session", "s" }, { "peer", "a\"b\\\xff" });
    assert_string_equal(line_of(SRV_LOG_TEXT, two, "it is"), STAMP " warn it is\n");
    assert_string_equal(line_of(SRV_LOG_LOGFMT, none, "a \"b\" é\n\xc3"),
                        "time=" STAMP " level=warn msg=\"a \\\"b\\\" é??\"\n");
    assert_string_equal(line_of(SRV_LOG_LOGFMT, two, "it is"),
                        "time=" STAMP
                        " level=warn session=\"s\" peer=\"a\\\"b\\\\?\" msg=\"it is\"\n");
    assert_string_equal(line_of(SRV_LOG_JSON, two, "it is"),
                        "{\"time\":\"" STAMP "\",\"level\":\"warn\",\"session\":\"s\","
                        "\"peer\":\"a\\\"b\\\\?\",\"msg\":\"it is\"}\n");
}

static void lines_of_a_kind_have_a_bound(void **state) {
    (void)state;
    static struct srv_log_bound b;
    unsigned left_out, written = 0;
    srv_log_bound_init(&b);
    for (int i = 0; i < 1000; i++) /* half a second */
        written += srv_log_bound_take(&b, "a", 5000 + i * 0.5, &left_out);
    assert_int_equal(written, SRV_LOG_AT_ONCE);
    assert_true(srv_log_bound_take(&b, "b", 5500, &left_out) && left_out == 0);
    assert_false(srv_log_bound_take(&b, "a", 5999, &left_out));
    char same[] = { 'a', 0 }; /* lies elsewhere */
    assert_true(srv_log_bound_take(&b, same, 6000, &left_out));
    assert_int_equal(left_out, 1000 - SRV_LOG_AT_ONCE + 1);
    assert_false(srv_log_bound_take(&b, "a", 6000, &left_out));
    assert_true(srv_log_bound_take(&b, "a", 7000, &left_out) && left_out == 1);
    /* Who is quiet for a while may say as much again. */
    double later_ms = 7000 + SRV_LOG_AT_ONCE * 1000.0;
    for (written = 0; srv_log_bound_take(&b, "a", later_ms, &left_out); written++)
        assert_int_equal(left_out, 0);
    assert_int_equal(written, SRV_LOG_AT_ONCE);
}

static void what_was_left_out_is_told_if_nothing_follows(void **state) {
    (void)state;
    static struct srv_log_bound b;
    unsigned left_out = 0;
    srv_log_bound_init(&b);
    for (int i = 0; i < SRV_LOG_AT_ONCE; i++)
        assert_true(srv_log_bound_take(&b, "a", 1000, &left_out));
    assert_null(srv_log_bound_next(&b, 9000, &left_out));
    for (int i = 0; i < SRV_LOG_AT_ONCE + 5; i++)
        srv_log_bound_take(&b, "b", 1000, &left_out);
    assert_null(srv_log_bound_next(&b, 1999, &left_out));
    assert_string_equal(srv_log_bound_next(&b, 2000, &left_out), "b");
    assert_int_equal(left_out, 5);
    assert_null(srv_log_bound_next(&b, 9000, &left_out));
    for (int i = 0; i < 3 * SRV_LOG_AT_ONCE; i++)
        srv_log_bound_take(&b, "b", 9000, &left_out);
    assert_string_equal(srv_log_bound_next(&b, INFINITY, &left_out), "b"); /* the last time */
    assert_null(srv_log_bound_next(&b, INFINITY, &left_out));
}

static void more_kinds_than_there_are_share_one_bound(void **state) {
    (void)state;
    static struct srv_log_bound b;
    static char names[2 * SRV_LOG_KINDS][8];
    unsigned left_out, written = 0;
    srv_log_bound_init(&b);
    for (int i = 0; i < 2 * SRV_LOG_KINDS; i++) {
        snprintf(names[i], sizeof names[i], "%d", i);
        written += srv_log_bound_take(&b, names[i], 1000, &left_out);
    }
    assert_int_equal(written, SRV_LOG_KINDS - 1 + SRV_LOG_AT_ONCE);
}

/* All lines on standard error until now, which are then gone. */
static unsigned lines_written(FILE *file, char *last, size_t size) {
    char line[SRV_LOG_LINE];
    unsigned count = 0;
    fflush(stderr);
    rewind(file);
    for (; fgets(line, sizeof line, file); count++)
        snprintf(last, size, "%s", line);
    assert_int_equal(ftruncate(fileno(file), 0), 0);
    rewind(file);
    return count;
}

static void the_log_leaves_out_and_says_so(void **state) {
    (void)state;
    static struct srv_log log;
    char last[SRV_LOG_LINE] = "";
    FILE *file = tmpfile();
    int old = dup(2);
    assert_true(file && old >= 0 && dup2(fileno(file), 2) == 2);
    srv_log_init(&log, SP_LOG_DEBUG, SRV_LOG_TEXT);
    for (int i = 0; i < SRV_LOG_AT_ONCE + 7; i++)
        sp_log(SP_LOG_WARN, "peer %d", i);
    unsigned bounded = lines_written(file, last, sizeof last);
    srv_log_tick(&log, INFINITY);
    unsigned told = lines_written(file, last, sizeof last);
    for (int i = 0; i < 2 * SRV_LOG_AT_ONCE; i++)
        sp_log(SP_LOG_DEBUG, "frame %d", i);
    char debug[SRV_LOG_LINE];
    unsigned all = lines_written(file, debug, sizeof debug);
    sp_log_init(NULL, NULL, SP_LOG_INFO);
    dup2(old, 2);
    close(old);
    fclose(file);
    assert_int_equal(bounded, SRV_LOG_AT_ONCE);
    assert_int_equal(told, 1);
    assert_non_null(strstr(last, " warn 7 lines like this were left out: peer %d\n"));
    assert_int_equal(all, 2 * SRV_LOG_AT_ONCE);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_forms_of_a_line),
        cmocka_unit_test(lines_of_a_kind_have_a_bound),
        cmocka_unit_test(what_was_left_out_is_told_if_nothing_follows),
        cmocka_unit_test(more_kinds_than_there_are_share_one_bound),
        cmocka_unit_test(the_log_leaves_out_and_says_so),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
