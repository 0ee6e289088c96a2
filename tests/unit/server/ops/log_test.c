/* SPDX-License-Identifier: Apache-2.0
 *
 * Lines as they are written, and how many: by a clock that is played.
 */
#include <fcntl.h>
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

#include "ops/log.h"

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
    /* What controls a terminal (U+0085, CSI, DEL), and what is no UTF-8, in no form. */
    assert_string_equal(line_of(SRV_LOG_TEXT, none, "a\xc2\x85\xc2\x9b\x7f\xff\"é"),
                        STAMP " warn a??????\"é\n");
    assert_string_equal(line_of(SRV_LOG_JSON, none, "a\xc2\x9b\x7f"),
                        "{\"time\":\"" STAMP "\",\"level\":\"warn\",\"msg\":\"a???\"}\n");
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

static void the_log_leaves_out_and_says_so(void **state) {
    (void)state;
    static struct srv_log log;
    char line[SRV_LOG_LINE];
    unsigned peers = 0, told = 0, frames = 0;
    FILE *file = tmpfile();
    int old = dup(2);
    assert_true(file && old >= 0 && dup2(fileno(file), 2) == 2);
    assert_true(srv_log_start(&log, SP_LOG_DEBUG, SRV_LOG_TEXT, NULL));
    for (int i = 0; i < SRV_LOG_AT_ONCE + 7; i++)
        sp_log(SP_LOG_WARN, "peer %d", i);
    srv_log_tick(&log, INFINITY);
    for (int i = 0; i < 2 * SRV_LOG_AT_ONCE; i++)
        sp_log(SP_LOG_DEBUG, "frame %d", i);
    srv_log_end(&log);
    sp_log_init(NULL, NULL, SP_LOG_INFO);
    dup2(old, 2);
    close(old);
    for (rewind(file); fgets(line, sizeof line, file);) {
        peers += strstr(line, " warn peer ") != NULL;
        told += strstr(line, " warn 7 lines like this were left out: peer %d\n") != NULL;
        frames += strstr(line, " debug frame ") != NULL;
    }
    fclose(file);
    assert_int_equal(peers, SRV_LOG_AT_ONCE);
    assert_int_equal(told, 1);
    assert_int_equal(frames, 2 * SRV_LOG_AT_ONCE);
}

/* A pipe that takes no byte more: its reader stands still. */
static void open_full_pipe(int pipes[2]) {
    static const char page[4096];
    assert_int_equal(pipe(pipes), 0);
    assert_int_equal(fcntl(pipes[1], F_SETFL, O_NONBLOCK), 0);
    while (write(pipes[1], page, sizeof page) > 0)
        ;
    assert_int_equal(fcntl(pipes[1], F_SETFL, 0), 0);
}

static void drain_page(int fd) {
    char page[4096];
    for (size_t got = 0; got < sizeof page;) {
        ssize_t count = read(fd, page + got, sizeof page - got);
        assert_true(count > 0);
        got += (size_t)count;
    }
}

/* Nobody who logs waits for it: this test would not end. Lines come in order, and where some are
 * missing stands how many. */
static void a_reader_that_stands_still_stops_nobody(void **state) {
    (void)state;
    enum { LINES = 1000 };
    static struct srv_log log;
    char line[SRV_LOG_LINE];
    int pipes[2], old = dup(2), capacity;
    open_full_pipe(pipes);
    capacity = fcntl(pipes[1], F_GETPIPE_SZ);
    assert_true(old >= 0 && dup2(pipes[1], 2) == 2);
    close(pipes[1]);
    assert_true(srv_log_start(&log, SP_LOG_DEBUG, SRV_LOG_TEXT, NULL));
    for (int i = 0; i < LINES; i++)
        sp_log(SP_LOG_DEBUG, "line %05d %500d", i, 0);
    sp_log(SP_LOG_DEBUG, "short"); /* fits, but what is missing is told first */
    /* The reader goes on; what was lost is told as soon as there is room. */
    for (int i = 0; i < capacity / 4096; i++)
        drain_page(pipes[0]);
    FILE *file = fdopen(pipes[0], "r");
    int next = 0, lost = 0, told = 0, number;
    while (file && told == 0 && fgets(line, sizeof line, file)) {
        const char *text = strchr(line, ' ') + 1;
        srv_log_tick(&log, 0);
        if (sscanf(text, "debug line %d", &number) == 1)
            assert_int_equal(number, next++);
        else if (sscanf(text, "warn %d lines were lost: who reads the log stood still", &lost) == 1)
            told++;
        else
            fail_msg("%s", line);
    }
    sp_log(SP_LOG_DEBUG, "last");
    srv_log_end(&log);
    sp_log_init(NULL, NULL, SP_LOG_INFO);
    dup2(old, 2);
    close(old);
    assert_non_null(fgets(line, sizeof line, file));
    assert_non_null(strstr(line, " debug last\n"));
    assert_null(fgets(line, sizeof line, file));
    fclose(file);
    assert_true(next > 0);
    assert_int_equal(next + lost, LINES + 1);
}

static void the_last_lines_are_not_waited_for_for_ever(void **state) {
    (void)state;
    static struct srv_log_ring ring;
    int pipes[2];
    char page[4096];
    open_full_pipe(pipes);
    assert_true(srv_log_ring_start(&ring, pipes[1], NULL));
    srv_log_ring_put(&ring, "one\n", 4, 1);
    assert_false(srv_log_ring_end(&ring, 1));
    assert_true(read(pipes[0], page, sizeof page) > 0); /* its thread ends by itself */
}

static void what_cannot_be_written_is_counted(void **state) {
    (void)state;
    static struct srv_log_ring ring;
    int fd = open("/dev/full", O_WRONLY);
    assert_true(fd >= 0 && srv_log_ring_start(&ring, fd, NULL));
    srv_log_ring_put(&ring, "one\n", 4, 1);
    srv_log_ring_put(&ring, "seven\n", 6, 7);
    assert_true(srv_log_ring_end(&ring, 60000));
    close(fd);
    assert_int_equal(srv_log_ring_take_lost(&ring), 8);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_forms_of_a_line),
        cmocka_unit_test(lines_of_a_kind_have_a_bound),
        cmocka_unit_test(what_was_left_out_is_told_if_nothing_follows),
        cmocka_unit_test(more_kinds_than_there_are_share_one_bound),
        cmocka_unit_test(the_log_leaves_out_and_says_so),
        cmocka_unit_test(a_reader_that_stands_still_stops_nobody),
        cmocka_unit_test(the_last_lines_are_not_waited_for_for_ever),
        cmocka_unit_test(what_cannot_be_written_is_counted),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
