/* SPDX-License-Identifier: Apache-2.0
 *
 * The format of log lines, their rate limit (in virtual time), and the ring to the writer thread.
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
#include "support/compare.h"

#define STAMP "2026-01-31T12:00:00.123Z"

static const char *line_of(enum srv_log_format format, const struct sp_log_field *fields,
                           const char *text) {
    static char out[SRV_LOG_LINE];
    unsigned size = srv_log_line(format, STAMP, SP_LOG_WARN, fields, text, out);
    assert_int_equal(size, strlen(out));
    return out;
}

static void lines_have_three_formats(void **state) {
    (void)state;
    const struct sp_log_field *none = &(struct sp_log_field){ NULL, NULL };
    const struct sp_log_field *two = SP_LOG_FIELDS({ "session", "s" }, { "peer", "a\"b\\\xff" });
    assert_string_equal(line_of(SRV_LOG_TEXT, two, "it is"), STAMP " warn it is\n");
    /* Control characters (U+0085, CSI, DEL) and invalid UTF-8 are replaced in every format. */
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

static void lines_of_one_kind_are_limited(void **state) {
    (void)state;
    static struct srv_log_limit limit;
    unsigned suppressed, written = 0;
    srv_log_limit_init(&limit);
    for (int i = 0; i < 1000; i++) /* half a second */
        written += srv_log_limit_allow(&limit, "a", 5000 + i * 0.5, &suppressed);
    assert_int_equal(written, SRV_LOG_BURST);
    assert_true(srv_log_limit_allow(&limit, "b", 5500, &suppressed));
    assert_int_equal(suppressed, 0);
    assert_false(srv_log_limit_allow(&limit, "a", 5999, &suppressed));
    char same[] = { 'a', 0 }; /* equal text at another address */
    assert_true(srv_log_limit_allow(&limit, same, 6000, &suppressed));
    assert_int_equal(suppressed, 1000 - SRV_LOG_BURST + 1);
    assert_false(srv_log_limit_allow(&limit, "a", 6000, &suppressed));
    assert_true(srv_log_limit_allow(&limit, "a", 7000, &suppressed));
    assert_int_equal(suppressed, 1);
    /* After a quiet time the full burst is available again. */
    double later_ms = 7000 + SRV_LOG_BURST * 1000.0;
    for (written = 0; srv_log_limit_allow(&limit, "a", later_ms, &suppressed); written++)
        assert_int_equal(suppressed, 0);
    assert_int_equal(written, SRV_LOG_BURST);
}

static void suppressed_lines_are_reported_without_a_later_line(void **state) {
    (void)state;
    static struct srv_log_limit limit;
    unsigned suppressed = 0;
    srv_log_limit_init(&limit);
    for (int i = 0; i < SRV_LOG_BURST; i++)
        assert_true(srv_log_limit_allow(&limit, "a", 1000, &suppressed));
    assert_null(srv_log_limit_next(&limit, 9000, &suppressed));
    for (int i = 0; i < SRV_LOG_BURST + 5; i++)
        srv_log_limit_allow(&limit, "b", 1000, &suppressed);
    assert_null(srv_log_limit_next(&limit, 1999, &suppressed));
    assert_string_equal(srv_log_limit_next(&limit, 2000, &suppressed), "b");
    assert_int_equal(suppressed, 5);
    assert_null(srv_log_limit_next(&limit, 9000, &suppressed));
    for (int i = 0; i < 3 * SRV_LOG_BURST; i++)
        srv_log_limit_allow(&limit, "b", 9000, &suppressed);
    assert_string_equal(srv_log_limit_next(&limit, INFINITY, &suppressed), "b"); /* as at the end */
    assert_null(srv_log_limit_next(&limit, INFINITY, &suppressed));
}

static void kinds_beyond_the_table_share_one_limit(void **state) {
    (void)state;
    static struct srv_log_limit limit;
    static char names[2 * SRV_LOG_KINDS][8];
    unsigned suppressed, written = 0;
    srv_log_limit_init(&limit);
    for (int i = 0; i < 2 * SRV_LOG_KINDS; i++) {
        snprintf(names[i], sizeof names[i], "%d", i);
        written += srv_log_limit_allow(&limit, names[i], 1000, &suppressed);
    }
    assert_int_equal(written, SRV_LOG_KINDS - 1 + SRV_LOG_BURST);
}

static void the_log_suppresses_lines_and_reports_their_number(void **state) {
    (void)state;
    static struct srv_log log;
    char line[SRV_LOG_LINE];
    unsigned peers = 0, reports = 0, frames = 0;
    FILE *file = tmpfile();
    int old = dup(2);
    assert_non_null(file);
    assert_compare(old, >=, 0);
    assert_int_equal(dup2(fileno(file), 2), 2);
    assert_true(srv_log_start(&log, SP_LOG_DEBUG, SRV_LOG_TEXT, NULL));
    for (int i = 0; i < SRV_LOG_BURST + 7; i++)
        sp_log(SP_LOG_WARN, "peer %d", i);
    srv_log_tick(&log, INFINITY);
    for (int i = 0; i < 2 * SRV_LOG_BURST; i++)
        sp_log(SP_LOG_DEBUG, "frame %d", i);
    srv_log_end(&log);
    sp_log_init(NULL, NULL, SP_LOG_INFO);
    dup2(old, 2);
    close(old);
    for (rewind(file); fgets(line, sizeof line, file);) {
        peers += strstr(line, " warn peer ") != NULL;
        reports += strstr(line, " warn 7 similar lines suppressed: peer %d\n") != NULL;
        frames += strstr(line, " debug frame ") != NULL;
    }
    fclose(file);
    assert_int_equal(peers, SRV_LOG_BURST);
    assert_int_equal(reports, 1);
    assert_int_equal(frames, 2 * SRV_LOG_BURST);
}

/* Opens a pipe and fills it, as if its reader had stopped. */
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
        assert_compare(count, >, 0);
        got += (size_t)count;
    }
}

/* If a thread that logs waited for the reader, this test would not end. The lines come in order,
 * and a report stands where lines are missing. */
static void a_blocked_reader_blocks_no_thread(void **state) {
    (void)state;
    enum { LINES = 1000 };
    static struct srv_log log;
    char line[SRV_LOG_LINE];
    int pipes[2], old = dup(2), capacity;
    open_full_pipe(pipes);
    capacity = fcntl(pipes[1], F_GETPIPE_SZ);
    assert_compare(old, >=, 0);
    assert_int_equal(dup2(pipes[1], 2), 2);
    close(pipes[1]);
    assert_true(srv_log_start(&log, SP_LOG_DEBUG, SRV_LOG_TEXT, NULL));
    for (int i = 0; i < LINES; i++)
        sp_log(SP_LOG_DEBUG, "line %05d %500d", i, 0);
    sp_log(SP_LOG_DEBUG, "short"); /* would fit, but the report must come first */
    /* The reader continues; the loss is reported as soon as the ring has space. */
    for (int i = 0; i < capacity / 4096; i++)
        drain_page(pipes[0]);
    FILE *file = fdopen(pipes[0], "r");
    int next = 0, lost = 0, reports = 0, number;
    while (file && reports == 0 && fgets(line, sizeof line, file)) {
        const char *text = strchr(line, ' ') + 1;
        srv_log_tick(&log, 0);
        if (sscanf(text, "debug line %d", &number) == 1)
            assert_int_equal(number, next++);
        else if (sscanf(text, "warn %d log lines were lost: the reader of the log was too slow",
                        &lost) == 1)
            reports++;
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
    assert_compare(next, >, 0);
    assert_int_equal(next + lost, LINES + 1);
}

static void the_end_waits_a_limited_time(void **state) {
    (void)state;
    static struct srv_log_ring ring;
    int pipes[2];
    char page[4096];
    open_full_pipe(pipes);
    assert_true(srv_log_ring_start(&ring, pipes[1], NULL));
    srv_log_ring_put(&ring, "one\n", 4, 1);
    assert_false(srv_log_ring_end(&ring, 1));
    assert_compare(read(pipes[0], page, sizeof page), >, 0); /* lets the writer thread end */
}

static void lines_that_cannot_be_written_count_as_lost(void **state) {
    (void)state;
    static struct srv_log_ring ring;
    int fd = open("/dev/full", O_WRONLY);
    assert_compare(fd, >=, 0);
    assert_true(srv_log_ring_start(&ring, fd, NULL));
    srv_log_ring_put(&ring, "one\n", 4, 1);
    srv_log_ring_put(&ring, "seven\n", 6, 7);
    assert_true(srv_log_ring_end(&ring, 60000));
    close(fd);
    assert_int_equal(srv_log_ring_consume_lost(&ring), 8);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(lines_have_three_formats),
        cmocka_unit_test(lines_of_one_kind_are_limited),
        cmocka_unit_test(suppressed_lines_are_reported_without_a_later_line),
        cmocka_unit_test(kinds_beyond_the_table_share_one_limit),
        cmocka_unit_test(the_log_suppresses_lines_and_reports_their_number),
        cmocka_unit_test(a_blocked_reader_blocks_no_thread),
        cmocka_unit_test(the_end_waits_a_limited_time),
        cmocka_unit_test(lines_that_cannot_be_written_count_as_lost),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
