/* SPDX-License-Identifier: Apache-2.0
 *
 * A disk that is full or broken, a process that is killed, and memory that runs out: the store
 * loses no durable record, and works again afterwards.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "support/compare.h"
#include "support/fake_memory.h"
#include "unit/server/store/store_fixture.h"

/* The disk fails at its n-th write, for every n. Once it works again, no record is missing. */
static void a_full_disk_delays_writes(void **state) {
    bool was_durable = false;
    int failures = 0;
    for (int end = BAD_DISK_FULL; end <= BAD_DISK_IO_ERROR; end++) {
        store_disk->end = (enum bad_disk_failure)end;
        for (long n = 0; !was_durable; n++) {
            struct srv_store_status status;
            char text[32];
            struct srv_store *store = store_started(*state);
            atomic_store(&store_disk->left, n);
            snprintf(text, sizeof text, "%d-%ld", end, n);
            assert_true(store_put(store, SRV_KIND_SESSION, "s", text));
            assert_true(store_put(store, SRV_KIND_VIEW, text, text));
            was_durable = store_flush(store);
            srv_store_status(store, &status);
            assert_int_equal(status.is_failing, !was_durable);
            assert_int_equal(status.reason[0] != 0, !was_durable);
            store_holds(store, SRV_KIND_SESSION, "s", text); /* in memory */
            atomic_store(&store_disk->left, -1);
            failures += !was_durable;
            assert_true(store_flush(store)); /* now also on the disk */
            srv_store_status(store, &status);
            assert_false(status.is_failing);
            assert_int_equal(status.waiting, 0);
            srv_store_destroy(&store);
            store = store_create(*state);
            store_holds(store, SRV_KIND_SESSION, "s", text);
            store_holds(store, SRV_KIND_VIEW, text, text);
            srv_store_destroy(&store);
        }
        was_durable = false;
    }
    assert_compare(failures, >, 8);
}

/* The writer tries again although no caller asks for it. */
static void the_writer_retries_by_itself(void **state) {
    struct srv_store *store = store_started(*state);
    struct srv_store_status status;
    atomic_store(&store_disk->left, 0);
    assert_true(store_put(store, SRV_KIND_PRESET, "p", "{}"));
    do
        srv_store_status(store, &status);
    while (status.failures < 3);
    assert_true(status.is_failing);
    atomic_store(&store_disk->left, -1);
    do
        srv_store_status(store, &status);
    while (status.waiting > 0);
    assert_false(status.is_failing);
    srv_store_destroy(&store);
}

/* Runs in a process that dies at its n-th write: reports each durable flush as one byte. */
static void dying(const char *folder, int reports) {
    struct srv_store_options o = store_options(folder);
    o.pause_ms = 1e9; /* after the first write it writes only on request */
    struct srv_store *store = srv_store_create(&o, NULL);
    if (!store || !srv_store_start(store, NULL, NULL, NULL))
        _exit(1);
    for (int i = 0; i < 4; i++) {
        char text[16];
        snprintf(text, sizeof text, "%d", i);
        if (!store_put(store, SRV_KIND_SESSION, "s", text) ||
            !store_put(store, SRV_KIND_VIEW, text, text) ||
            (i > 0 && !srv_store_remove(store, SRV_KIND_PRESET, "p")) ||
            !store_put(store, SRV_KIND_PRESET, "p", text) || !store_flush(store) ||
            write(reports, "x", 1) != 1)
            _exit(1);
    }
    srv_store_destroy(&store);
    _exit(0);
}

static void records_survive_a_kill_at_any_write(void **state) {
    int status = -1, most = 0;
    long n = 0;
    for (; status != 0; n++) {
        char folder[96], bytes[8], text[16];
        int pipes[2];
        snprintf(folder, sizeof folder, "%s/%ld", (char *)*state, n);
        assert_int_equal(pipe(pipes), 0);
        pid_t child = fork();
        if (child == 0) {
            store_disk->end = BAD_DISK_EXIT;
            atomic_store(&store_disk->left, n);
            dying(folder, pipes[1]);
        }
        close(pipes[1]);
        int durable = (int)read(pipes[0], bytes, sizeof bytes), more;
        while (durable >= 0 && (more = (int)read(pipes[0], bytes, sizeof bytes)) > 0)
            durable += more;
        close(pipes[0]);
        assert_int_equal(waitpid(child, &status, 0), child);
        assert_true(WIFEXITED(status));
        if (WEXITSTATUS(status) != 0)
            assert_int_equal(WEXITSTATUS(status), 9);
        struct srv_store *store = store_create(folder);
        for (int i = 0; i < durable; i++) {
            snprintf(text, sizeof text, "%d", i);
            store_holds(store, SRV_KIND_VIEW, text, text);
        }
        char *session = srv_store_get(store, SRV_KIND_SESSION, "s", NULL, NULL);
        char *preset = srv_store_get(store, SRV_KIND_PRESET, "p", NULL, NULL);
        if (durable > 0) {
            assert_non_null(session);
            assert_compare(atoi(session), >=, durable - 1);
            assert_non_null(preset);
        }
        if (preset) /* one transaction: all or nothing */
            assert_string_equal(session, preset);
        free(session);
        free(preset);
        srv_store_destroy(&store);
        most = durable > most ? durable : most;
    }
    assert_int_equal(most, 4);
    assert_compare(n, >, 10);
}

/* Each allocation of creating, putting, flushing and reading fails once. Each call succeeds or
 * reports an error, no record is lost, and durable records stay. */
static void out_of_memory_is_an_error(void **state) {
    bool whole = false;
    int failed_to_open = 0, failed_to_write = 0;
    for (long n = 0; !whole; n++) {
        struct sp_error err = { .code = SP_OK };
        struct srv_store_options o = store_options(*state);
        char text[32];
        snprintf(text, sizeof text, "%ld", n);
        memory_fail_after(n, MEMORY_STAYS_OUT);
        struct srv_store *store = srv_store_create(&o, &err);
        if (!store) {
            memory_restore();
            assert_int_not_equal(err.code, SP_OK);
            assert_string_not_equal(err.text, "");
            failed_to_open++;
            continue;
        }
        assert_true(srv_store_start(store, NULL, NULL, &err));
        bool has_put = store_put(store, SRV_KIND_SESSION, "s", text);
        bool durable = has_put && store_flush(store);
        whole = !memory_restore();
        if (whole)
            assert_true(durable);
        failed_to_write += !durable;
        if (has_put)
            store_holds(store, SRV_KIND_SESSION, "s", text);
        assert_true(store_flush(store));
        srv_store_destroy(&store);
        store = store_create(*state);
        if (has_put)
            store_holds(store, SRV_KIND_SESSION, "s", text);
        srv_store_destroy(&store);
    }
    assert_compare(failed_to_open, >, 20);
    assert_compare(failed_to_write, >, 5);
}

int main(void) {
    const struct CMUnitTest tests[] = {
#define TEST(name) cmocka_unit_test_setup_teardown(name, store_set_up, store_tear_down)
        TEST(a_full_disk_delays_writes),
        TEST(the_writer_retries_by_itself),
        TEST(records_survive_a_kill_at_any_write),
        TEST(out_of_memory_is_an_error),
    };
    if (store_main_set_up() != 0)
        return 1;
    return cmocka_run_group_tests(tests, NULL, NULL);
}
