/* SPDX-License-Identifier: Apache-2.0
 *
 * How many bytes the clients of streams may send per tick.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include <cmocka.h>

#include "http/ingress_quota.h"

enum { HALF = SRV_INGRESS_TICK_BYTES / 2, MESSAGE = 4 * SRV_INGRESS_STREAM_BYTES, PIECE = 512 };

/* Takes pieces until the quota is used up. Returns their sum in bytes. */
static size_t drain(struct srv_ingress_stream *stream) {
    size_t all = 0;
    for (; srv_ingress_has(stream, SRV_INGRESS_READ); all += PIECE)
        srv_ingress_charge(stream, SRV_INGRESS_READ, PIECE);
    return all;
}

/* One stream may send a long message at once, then a fixed number of bytes per tick, and saves up
 * no more. */
static void a_stream_has_a_limit_of_its_own(void **state) {
    (void)state;
    struct srv_ingress *ingress = srv_ingress_create(MESSAGE);
    struct srv_ingress_stream stream;
    assert_true(srv_ingress_open(ingress, "ann", "s", &stream));
    assert_int_equal(drain(&stream), MESSAGE);
    for (int i = 0; i < 3; i++) {
        srv_ingress_tick(ingress);
        assert_int_equal(drain(&stream), SRV_INGRESS_STREAM_BYTES);
    }
    srv_ingress_tick(ingress);
    srv_ingress_tick(ingress);
    assert_int_equal(drain(&stream), 2 * SRV_INGRESS_STREAM_BYTES);
    for (int i = 0; i < 1000; i++)
        srv_ingress_tick(ingress);
    assert_int_equal(drain(&stream), MESSAGE);
    srv_ingress_tick(ingress);
    srv_ingress_charge(&stream, SRV_INGRESS_READ,
                       2 * SRV_INGRESS_STREAM_BYTES); /* the excess is deducted from later ticks */
    assert_false(srv_ingress_has(&stream, SRV_INGRESS_READ));
    srv_ingress_tick(ingress);
    assert_false(srv_ingress_has(&stream, SRV_INGRESS_READ));
    srv_ingress_tick(ingress);
    assert_int_equal(drain(&stream), SRV_INGRESS_STREAM_BYTES);
    srv_ingress_close(&stream);
    srv_ingress_destroy(&ingress);
}

static void the_sum_is_limited_for_any_number_of_streams(void **state) {
    enum { STREAMS = 256 };
    (void)state;
    struct srv_ingress *ingress = srv_ingress_create(SRV_INGRESS_TICK_BYTES);
    struct srv_ingress_stream streams[STREAMS];
    for (int i = 0; i < STREAMS; i++) {
        char owner[8], session[8];
        snprintf(owner, sizeof owner, "%d", i % 3);
        snprintf(session, sizeof session, "%d", i % 21);
        assert_true(srv_ingress_open(ingress, owner, session, &streams[i]));
    }
    for (int tick = 0; tick < 20; tick++) {
        size_t all = 0;
        for (int i = 0; i < STREAMS; i++)
            all += drain(&streams[i]);
        /* Each stream takes whole pieces, and its last piece may exceed the quota. */
        assert_in_range(all, SRV_INGRESS_TICK_BYTES - 2 * PIECE,
                        SRV_INGRESS_TICK_BYTES + STREAMS * PIECE);
        srv_ingress_tick(ingress);
    }
    for (int i = 0; i < STREAMS; i++)
        srv_ingress_close(&streams[i]);
    srv_ingress_destroy(&ingress);
}

/* Ann has one session with one stream. Bob has three sessions, one of them with many streams. All
 * streams but one have used up the parts of all: the last stream still gets its own part. */
static void no_stream_uses_up_the_part_of_another(void **state) {
    enum { CROWD = 50, LAST = CROWD + 2 };
    static const struct {
        int last;
        size_t part;
    } cases[] = {
        { CROWD, HALF / 2 },         /* ann */
        { CROWD + 1, HALF / 2 / 3 }, /* bob's session with one stream */
        { 0, HALF / 2 / 3 / CROWD }, /* one stream of the crowd */
    };
    (void)state;
    for (size_t c = 0; c < sizeof cases / sizeof *cases; c++) {
        struct srv_ingress *ingress = srv_ingress_create(SRV_INGRESS_TICK_BYTES);
        struct srv_ingress_stream streams[LAST + 1];
        for (int i = 0; i < CROWD; i++)
            assert_true(srv_ingress_open(ingress, "bob", "a", &streams[i]));
        assert_true(srv_ingress_open(ingress, "ann", "d", &streams[CROWD]));
        assert_true(srv_ingress_open(ingress, "bob", "b", &streams[CROWD + 1]));
        assert_true(srv_ingress_open(ingress, "bob", "c", &streams[LAST]));
        for (int i = 0; i <= LAST; i++)
            if (i != cases[c].last)
                drain(&streams[i]);
        size_t got = drain(&streams[cases[c].last]);
        assert_in_range(got, cases[c].part, cases[c].part + PIECE);
        for (int i = 0; i <= LAST; i++)
            srv_ingress_close(&streams[i]);
        srv_ingress_destroy(&ingress);
    }
}

/* A stream that is alone again gets the whole quota again. */
static void parts_are_returned_when_streams_close(void **state) {
    enum { OTHERS = 40 };
    (void)state;
    struct srv_ingress *ingress = srv_ingress_create(2 * SRV_INGRESS_TICK_BYTES);
    struct srv_ingress_stream stream, others[OTHERS];
    assert_true(srv_ingress_open(ingress, "", "1", &stream));
    for (int i = 0; i < OTHERS; i++) {
        char name[8];
        snprintf(name, sizeof name, "%d", i / 2);
        assert_true(srv_ingress_open(ingress, name, "2", &others[i]));
        if (i % 3 == 0) {
            srv_ingress_close(&others[i]);
            assert_true(srv_ingress_open(ingress, name, "3", &others[i]));
        }
    }
    size_t beside = drain(&stream);
    assert_in_range(beside, HALF + HALF / 21, HALF + HALF / 21 + PIECE);
    for (int i = 0; i < OTHERS; i++)
        srv_ingress_close(&others[i]);
    srv_ingress_tick(ingress);
    assert_int_equal(drain(&stream), SRV_INGRESS_TICK_BYTES);
    srv_ingress_close(&stream);
    srv_ingress_destroy(&ingress);
}

/* Bytes that are made for a stream leave it all that it may send. */
static void notifications_have_a_quota_of_their_own(void **state) {
    (void)state;
    struct srv_ingress *ingress = srv_ingress_create(MESSAGE);
    struct srv_ingress_stream stream;
    assert_true(srv_ingress_open(ingress, "ann", "s", &stream));
    for (int i = 0; i < 3; i++) {
        srv_ingress_charge(&stream, SRV_INGRESS_NOTIFY, 2 * SRV_INGRESS_TICK_BYTES);
        assert_false(srv_ingress_has(&stream, SRV_INGRESS_NOTIFY));
        assert_int_equal(drain(&stream), i == 0 ? MESSAGE : SRV_INGRESS_STREAM_BYTES);
        srv_ingress_tick(ingress);
    }
    srv_ingress_close(&stream);
    srv_ingress_destroy(&ingress);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_stream_has_a_limit_of_its_own),
        cmocka_unit_test(notifications_have_a_quota_of_their_own),
        cmocka_unit_test(the_sum_is_limited_for_any_number_of_streams),
        cmocka_unit_test(no_stream_uses_up_the_part_of_another),
        cmocka_unit_test(parts_are_returned_when_streams_close),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
