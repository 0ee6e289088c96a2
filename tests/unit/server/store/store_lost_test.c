/* SPDX-License-Identifier: Apache-2.0
 *
 * The database is deleted, replaced, truncated or written by another program while the store uses
 * it. Nothing is confirmed as durable that a copy of the folder does not hold, and a file that is
 * not the store's is kept.
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
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "store/database.h"
#include "support/compare.h"
#include "unit/server/store/store_fixture.h"

/* Runs a shell command with the folder as $D. */
static void shell(const char *folder, const char *command) {
    char text[1024];
    snprintf(text, sizeof text, "D='%s'; %s", folder, command);
    assert_int_equal(system(text), 0);
}

/* Asserts that a store that opens a copy of the folder, as after a kill, has these records. */
static void copy_holds(const char *folder, const char *const *ids, const char *text) {
    char copy[128];
    snprintf(copy, sizeof copy, "%s-copy", folder);
    shell(folder, "rm -rf \"$D-copy\" && cp -r \"$D\" \"$D-copy\"");
    struct srv_store *store = store_create(copy);
    for (; *ids; ids++)
        store_holds(store, SRV_KIND_VIEW, *ids, text);
    srv_store_destroy(&store);
    shell(folder, "rm -rf \"$D-copy\"");
}

static const struct {
    const char *name, *command;
    const char *kept; /* true if a file is kept, whose content this command compares */
} losses[] = {
    { "deleted", "rm \"$D/splatd.db\"", NULL },
    { "all deleted", "rm -rf \"$D\"/*", NULL },
    { "log deleted", "rm \"$D/splatd.db-wal\"", NULL },
    { "emptied", ": > \"$D/splatd.db\"", NULL },
    { "truncated", "truncate -s 4096 \"$D/splatd.db\"; cp \"$D/splatd.db\" \"$D.other\"",
      "cmp \"$D.other\" \"$D/splatd.db.found\"" },
    { "replaced",
      "echo other > \"$D.other\"; cp \"$D.other\" \"$D/x\"; mv \"$D/x\" \"$D/splatd.db\"",
      "cmp \"$D.other\" \"$D/splatd.db.found\"" },
    { "replaced with a log",
      "echo other > \"$D.other\"; cp \"$D.other\" \"$D/x\"; mv \"$D/x\" \"$D/splatd.db\"; "
      "cp \"$D.other\" \"$D/x\"; mv \"$D/x\" \"$D/splatd.db-wal\"",
      "cmp \"$D.other\" \"$D/splatd.db.found\" && cmp \"$D.other\" \"$D/splatd.db.found-wal\"" },
    { "overwritten", "head -c 99999 /dev/zero > \"$D.other\"; cp \"$D.other\" \"$D/splatd.db\"",
      "cmp \"$D.other\" \"$D/splatd.db.found\"" },
    { "moved away and copied back",
      "rm \"$D/splatd.db-wal\"; mv \"$D/splatd.db\" \"$D.other\"; cp \"$D.other\" \"$D/splatd.db\"",
      "cmp \"$D.other\" \"$D/splatd.db.found\"" },
    { "log emptied", ": > \"$D/splatd.db-wal\"", "[ -e \"$D/splatd.db.found-wal\" ]" },
    { "log truncated", "truncate -s 5000 \"$D/splatd.db-wal\"",
      "[ -e \"$D/splatd.db.found-wal\" ]" },
    /* Until the clock of the file system has a new tick. */
    { "log overwritten",
      "cp -p \"$D/splatd.db-wal\" \"$D.other\"; "
      "until [ \"$D/splatd.db-wal\" -nt \"$D.other\" ]; do "
      "dd if=/dev/zero of=\"$D/splatd.db-wal\" bs=64 count=1 conv=notrunc status=none; done",
      "[ -e \"$D/splatd.db.found-wal\" ]" },
};
enum { LOSSES = sizeof losses / sizeof *losses };

static void a_lost_database_is_written_again(void **state) {
    static const char *const before[] = { "a", "b", NULL }, *const all[] = { "a", "b", "c", NULL };
    for (int i = 0; i < LOSSES; i++)
        for (int with_change = i > 0; with_change < 2; with_change++) {
            print_message("%s, %d\n", losses[i].name, with_change);
            struct srv_store_options o = store_options(*state);
            o.pause_ms = o.check_ms = 1e9; /* only the flush looks */
            struct srv_store *store = srv_store_create(&o, NULL);
            assert_true(srv_store_start(store, NULL, NULL, NULL));
            assert_true(store_put(store, SRV_KIND_VIEW, "a", "{}"));
            assert_true(store_put(store, SRV_KIND_VIEW, "b", "{}"));
            assert_true(store_flush(store));
            shell(*state, losses[i].command);
            if (with_change)
                assert_true(store_put(store, SRV_KIND_VIEW, "c", "{}"));
            assert_true(store_flush(store));
            copy_holds(*state, with_change ? all : before, "{}");
            if (losses[i].kept)
                shell(*state, losses[i].kept);
            assert_true(store_put(store, SRV_KIND_VIEW, "c", "{}"));
            assert_true(store_flush(store)); /* into the new one */
            copy_holds(*state, all, "{}");
            srv_store_destroy(&store);
            shell(*state, "rm -rf \"$D\"/* \"$D.other\"");
        }
}

/* The other program writes with SQLite, so the files are sound. */
static void what_another_program_wrote_is_kept_apart(void **state) {
    static const char *const ids[] = { "a", "b", NULL }, *const statements[] = {
        "UPDATE record SET body = '{\"x\":1}'",
        "DELETE FROM record",
        "DROP TABLE record",
        "DELETE FROM record; PRAGMA wal_checkpoint(TRUNCATE)",
    };
    for (int i = 0; i < 4; i++)
        for (int with_change = 0; with_change < 2; with_change++) {
            print_message("%s, %d\n", statements[i], with_change);
            struct srv_store_options o = store_options(*state);
            o.pause_ms = o.check_ms = 1e9; /* only the flush looks */
            struct srv_store *store = srv_store_create(&o, NULL);
            assert_true(srv_store_start(store, NULL, NULL, NULL));
            assert_true(store_put(store, SRV_KIND_VIEW, "a", "{}"));
            if (!with_change)
                assert_true(store_put(store, SRV_KIND_VIEW, "b", "{}"));
            assert_true(store_flush(store));
            store_sql(*state, statements[i]);
            if (with_change)
                assert_true(store_put(store, SRV_KIND_VIEW, "b", "{}"));
            assert_true(store_flush(store));
            copy_holds(*state, ids, "{}");
            shell(*state, "[ -s \"$D/splatd.db.found\" ]");
            srv_store_destroy(&store);
            shell(*state, "rm -rf \"$D\"/*");
        }
}

static struct srv_database *open_database(const char *folder) {
    struct sp_error err;
    struct srv_database *d = srv_database_open(folder, "bad-disk", &err);
    if (!d)
        fail_msg("%s: %s", err.place, err.text);
    return d;
}

/* Waits for the next tick of the clock that the times of files come from. */
static void wait_for_tick(void) {
    struct timespec start, now;
    clock_gettime(CLOCK_REALTIME_COARSE, &start);
    do
        clock_gettime(CLOCK_REALTIME_COARSE, &now);
    while (now.tv_sec == start.tv_sec && now.tv_nsec == start.tv_nsec);
}

/* The store does not mistake its own writes for writes of another program, even if they fail or
 * SQLite moves them from the log into the file. */
static void own_writes_are_not_those_of_another_program(void **state) {
    static char text[30000]; /* more than a thousand pages in all: SQLite moves the log */
    const struct srv_change change = {
        .kind = SRV_KIND_VIEW, .id = "a", .text = text, .size = sizeof text
    };
    struct srv_database *d = open_database(*state);
    struct sp_error err;
    for (int i = 0; i < 300; i++) {
        memset(text, 'a' + i % 2, sizeof text);
        assert_true(srv_database_write(d, &change, &err));
        assert_true(srv_database_is_intact(d));
    }
    bool ok = false;
    for (long n = 0; !ok; n++) {
        store_disk->end = n % 2 ? BAD_DISK_FULL : BAD_DISK_IO_ERROR;
        wait_for_tick();
        memset(text, 'x', sizeof text);
        atomic_store(&store_disk->left, n);
        ok = srv_database_write(d, &change, &err);
        atomic_store(&store_disk->left, -1);
        assert_true(srv_database_is_intact(d));
        assert_compare(n, <, 100);
    }
    srv_database_close(&d);
}

/* The other program writes between the store's check and its write. */
static void nothing_is_added_to_what_another_program_wrote(void **state) {
    const struct srv_change change = { .kind = SRV_KIND_VIEW, .id = "b", .text = "{}", .size = 2 };
    struct srv_database *d = open_database(*state);
    struct sp_error err;
    assert_true(srv_database_is_intact(d));
    store_sql(*state, "INSERT INTO record VALUES('view', 'a', '{}')");
    assert_false(srv_database_write(d, &change, &err));
    assert_int_equal(err.code, SP_ERR_IO);
    assert_non_null(strstr(err.text, "written by another program"));
    assert_false(srv_database_is_intact(d));
    assert_true(srv_database_rewrite(d, &change, &err));
    assert_true(srv_database_is_intact(d));
    srv_database_close(&d);
    static const char *const ids[] = { "b", NULL };
    copy_holds(*state, ids, "{}");
}

/* No request follows the loss. */
static void the_writer_notices_a_loss_by_itself(void **state) {
    struct srv_store *store = store_started(*state);
    static const char *const ids[] = { "a", NULL };
    char path[128];
    struct stat st;
    assert_true(store_put(store, SRV_KIND_VIEW, "a", "{}"));
    assert_true(store_flush(store));
    store_database_path(*state, path);
    shell(*state, "rm \"$D/splatd.db\" \"$D/splatd.db-wal\"");
    while (stat(path, &st) != 0) /* the test's time limit ends it */
        continue;
    assert_true(store_flush(store));
    copy_holds(*state, ids, "{}");
    srv_store_destroy(&store);
}

/* The folder may be on a disk that was unmounted: the store writes nothing into the folder that is
 * now in its place. */
static void a_moved_folder_is_reported(void **state) {
    static const char *const ids[] = { "a", "b", NULL };
    struct srv_store *store = store_started(*state);
    struct srv_store_status status;
    assert_true(store_put(store, SRV_KIND_VIEW, "a", "{}"));
    assert_true(store_flush(store));
    shell(*state, "mv \"$D\" \"$D.away\" && mkdir \"$D\"");
    assert_true(store_put(store, SRV_KIND_VIEW, "b", "{}"));
    assert_false(store_flush(store));
    srv_store_status(store, &status);
    assert_true(status.is_failing);
    assert_non_null(strstr(status.reason, "put it back, or restart the daemon"));
    shell(*state, "rmdir \"$D\" && mv \"$D.away\" \"$D\""); /* it is empty */
    assert_true(store_flush(store));
    srv_store_status(store, &status);
    assert_false(status.is_failing);
    copy_holds(*state, ids, "{}");
    srv_store_destroy(&store);
}

/* Another daemon may have begun to use the folder, whose lock was deleted. */
static void a_folder_that_another_daemon_took_is_left_alone(void **state) {
    struct srv_store *store = store_started(*state);
    struct srv_store_status status;
    assert_true(store_put(store, SRV_KIND_VIEW, "a", "{}"));
    assert_true(store_flush(store));
    struct srv_store_options o = store_options(*state);
    o.check_ms = 1e9;
    srv_store_destroy(&store);
    store = srv_store_create(&o, NULL);
    assert_true(srv_store_start(store, NULL, NULL, NULL));
    assert_true(store_flush(store));
    shell(*state, "rm -rf \"$D\"/*");
    struct srv_store *other = store_started(*state);
    assert_true(store_put(other, SRV_KIND_VIEW, "theirs", "{}"));
    assert_true(store_flush(other));
    assert_true(store_put(store, SRV_KIND_VIEW, "b", "{}"));
    assert_false(store_flush(store));
    srv_store_status(store, &status);
    assert_non_null(strstr(status.reason, "another splatd uses this folder"));
    srv_store_destroy(&other);
    srv_store_destroy(&store); /* the folder is free: all is written, and theirs is kept */
    static const char *const ids[] = { "a", "b", NULL };
    copy_holds(*state, ids, "{}");
    shell(*state, "[ -s \"$D/splatd.db.found\" ]");
}

/* The disk fails at its n-th write after the loss, for every n. */
static void a_full_disk_delays_the_new_database(void **state) {
    static const char *const ids[] = { "a", "b", NULL };
    int failures = 0;
    bool is_durable = false;
    for (long n = 0; !is_durable; n++) {
        struct srv_store_options o = store_options(*state);
        o.pause_ms = o.check_ms = o.retry_ms = 1e9; /* only the flush writes */
        struct srv_store *store = srv_store_create(&o, NULL);
        assert_true(srv_store_start(store, NULL, NULL, NULL));
        assert_true(store_put(store, SRV_KIND_VIEW, "a", "{}"));
        assert_true(store_flush(store));
        atomic_store(&store_disk->left, n);
        shell(*state, "rm \"$D/splatd.db\"");
        assert_true(store_put(store, SRV_KIND_VIEW, "b", "{}"));
        is_durable = store_flush(store);
        atomic_store(&store_disk->left, -1); /* also for the store that reads the copy */
        if (is_durable)
            copy_holds(*state, ids, "{}");
        failures += !is_durable;
        assert_true(store_flush(store));
        copy_holds(*state, ids, "{}");
        shell(*state, "[ ! -e \"$D/splatd.db.found\" ]"); /* it was the store's own */
        srv_store_destroy(&store);
        shell(*state, "rm -rf \"$D\"/*");
    }
    assert_compare(failures, >, 8);
}

/* Runs in a process that dies at its n-th write: reports each flush as one byte. */
static void dying(const char *folder, int reports) {
    struct srv_store_options o = store_options(folder);
    o.pause_ms = o.check_ms = 1e9;
    struct srv_store *store = srv_store_create(&o, NULL);
    char path[128];
    store_database_path(folder, path);
    if (!store || !srv_store_start(store, NULL, NULL, NULL))
        _exit(1);
    for (int i = 0; i < 3; i++) {
        char id[2] = { (char)('a' + i), 0 };
        if (i > 0)
            unlink(path);
        if (!store_put(store, SRV_KIND_VIEW, id, "{}") || !store_flush(store) ||
            write(reports, "x", 1) != 1)
            _exit(1);
    }
    _exit(0);
}

/* A killed process has lost at most the records that it had not confirmed since the loss. */
static void a_kill_while_the_database_is_written_again(void **state) {
    static const char *const ids[] = { "a", "b", "c", NULL };
    int status = -1, most = 0;
    for (long n = 0; status != 0; n++) {
        char folder[96], bytes[4];
        int pipes[2], durable = 0, more;
        snprintf(folder, sizeof folder, "%s/%ld", (char *)*state, n);
        assert_int_equal(pipe(pipes), 0);
        pid_t child = fork();
        if (child == 0) {
            store_disk->end = BAD_DISK_EXIT;
            atomic_store(&store_disk->left, n);
            dying(folder, pipes[1]);
        }
        close(pipes[1]);
        while ((more = (int)read(pipes[0], bytes, sizeof bytes)) > 0)
            durable += more;
        close(pipes[0]);
        assert_int_equal(waitpid(child, &status, 0), child);
        assert_true(WIFEXITED(status));
        struct srv_store *store = store_create(folder);
        /* The next loss follows a report at once, so only the last one is certain to be here. */
        unsigned found = 0;
        struct srv_store_status now;
        srv_store_status(store, &now);
        found = now.records[SRV_KIND_VIEW];
        if (WEXITSTATUS(status) == 0)
            for (int i = 0; i < 3; i++)
                store_holds(store, SRV_KIND_VIEW, ids[i], "{}");
        else
            assert_true(found == 0 || found >= (unsigned)durable);
        srv_store_destroy(&store);
        most = durable > most ? durable : most;
    }
    assert_int_equal(most, 3);
}

int main(void) {
    const struct CMUnitTest tests[] = {
#define TEST(name) cmocka_unit_test_setup_teardown(name, store_set_up, store_tear_down)
        TEST(a_lost_database_is_written_again),
        TEST(what_another_program_wrote_is_kept_apart),
        TEST(own_writes_are_not_those_of_another_program),
        TEST(nothing_is_added_to_what_another_program_wrote),
        TEST(the_writer_notices_a_loss_by_itself),
        TEST(a_moved_folder_is_reported),
        TEST(a_folder_that_another_daemon_took_is_left_alone),
        TEST(a_full_disk_delays_the_new_database),
        TEST(a_kill_while_the_database_is_written_again),
    };
    if (store_main_set_up() != 0)
        return 1;
    return cmocka_run_group_tests(tests, NULL, NULL);
}
