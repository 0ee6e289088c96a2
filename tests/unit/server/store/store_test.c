/* SPDX-License-Identifier: Apache-2.0
 *
 * The store: what was flushed is there after any end; a disk that is full, broken or gone, and
 * memory that runs out, cost nothing but time.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <pthread.h>
#include <sqlite3.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "store/database.h"
#include "store/store.h"
#include "support/fake_memory.h"
#include "unit/server/store/bad_disk.h"

static struct bad_disk *disk;

/* Folders that this program's own code brought to the disk; SQLite does that for its files. */
static ino_t synced[8];
static unsigned sync_count;
static bool sync_fails;

int __real_fsync(int fd);
int __wrap_fsync(int fd);

int __wrap_fsync(int fd) {
    struct stat found;
    if (sync_fails) {
        errno = EIO;
        return -1;
    }
    if (fstat(fd, &found) == 0 && S_ISDIR(found.st_mode))
        synced[sync_count++ % 8] = found.st_ino;
    return __real_fsync(fd);
}

/* Fixtures. */

static int set_up(void **state) {
    char *folder = strdup("/tmp/splatd-store-XXXXXX");
    if (!folder || !mkdtemp(folder))
        return -1;
    *state = folder;
    atomic_store(&disk->left, -1);
    disk->end = BAD_DISK_FULL;
    disk->has_no_shared_memory = sync_fails = false;
    sync_count = 0;
    return 0;
}

static int tear_down(void **state) {
    char command[128];
    snprintf(command, sizeof command, "rm -rf '%s'", (char *)*state);
    free(*state);
    return system(command);
}

static struct srv_store_options options(const char *folder) {
    return (struct srv_store_options){
        .folder = folder, .vfs = "bad-disk", .pause_ms = 1, .retry_ms = 1
    };
}

static struct srv_store *create(const char *folder) {
    struct srv_store_options o = options(folder);
    struct sp_error err;
    struct srv_store *store = srv_store_create(&o, &err);
    if (!store)
        fail_msg("%s: %s", err.place, err.text);
    return store;
}

static struct srv_store *started(const char *folder) {
    struct srv_store *store = create(folder);
    assert_true(srv_store_start(store, NULL, NULL, NULL));
    return store;
}

struct flushed {
    pthread_mutex_t mutex;
    pthread_cond_t cond;
    int called;
    bool durable;
};

static void on_flushed(void *user, bool durable) {
    struct flushed *f = user;
    pthread_mutex_lock(&f->mutex);
    f->called++;
    f->durable = durable;
    pthread_cond_signal(&f->cond);
    pthread_mutex_unlock(&f->mutex);
}

static bool flush(struct srv_store *store) {
    struct flushed f = { .mutex = PTHREAD_MUTEX_INITIALIZER, .cond = PTHREAD_COND_INITIALIZER };
    srv_store_flush(store, on_flushed, &f);
    pthread_mutex_lock(&f.mutex);
    while (!f.called)
        pthread_cond_wait(&f.cond, &f.mutex);
    pthread_mutex_unlock(&f.mutex);
    assert_int_equal(f.called, 1);
    return f.durable;
}

static bool put(struct srv_store *store, enum srv_kind kind, const char *id, const char *text) {
    return srv_store_put(store, kind, id, text, strlen(text), NULL);
}

static void holds(struct srv_store *store, enum srv_kind kind, const char *id, const char *text) {
    size_t size = 0;
    struct sp_error err;
    char *got = srv_store_get(store, kind, id, &size, &err);
    if (!text) {
        assert_null(got);
        assert_int_equal(err.code, SP_ERR_NOT_FOUND);
        return;
    }
    assert_non_null(got);
    assert_string_equal(got, text);
    assert_int_equal(size, strlen(text));
    free(got);
}

static void refused(const char *folder, enum sp_code code, const char *text) {
    struct srv_store_options o = options(folder);
    struct sp_error err = { .code = SP_OK };
    struct srv_store *store = srv_store_create(&o, &err);
    assert_null(store);
    if (err.code != code || !strstr(err.text, text))
        fail_msg("'%s: %s' (code %d) does not say '%s'", err.place, err.text, err.code, text);
    assert_non_null(strstr(err.place, folder));
}

static void database_path(const char *folder, char path[128]) {
    snprintf(path, 128, "%s/" SRV_DATABASE_NAME, folder);
}

static void by_hand(const char *folder, const char *sql) {
    char path[128];
    sqlite3 *db;
    database_path(folder, path);
    assert_int_equal(sqlite3_open(path, &db), SQLITE_OK);
    assert_int_equal(sqlite3_exec(db, sql, NULL, NULL, NULL), SQLITE_OK);
    sqlite3_close(db);
}

/* The tests. */

static void records_are_kept_in_memory(void **state) {
    (void)state;
    struct srv_store_options o = { .max = { [SRV_KIND_VIEW] = 2 } };
    struct sp_error err;
    struct srv_store_status status;
    struct srv_store *store = srv_store_create(&o, &err);
    assert_true(srv_store_start(store, NULL, NULL, &err));
    assert_true(put(store, SRV_KIND_VIEW, "b", "1"));
    assert_true(put(store, SRV_KIND_VIEW, "a", "2"));
    assert_false(srv_store_put(store, SRV_KIND_VIEW, "c", "3", 1, &err));
    assert_int_equal(err.code, SP_ERR_BUDGET);
    assert_true(put(store, SRV_KIND_VIEW, "a", "22")); /* is there already */
    assert_true(put(store, SRV_KIND_SESSION, "a", "session"));
    holds(store, SRV_KIND_VIEW, "a", "22");
    const struct srv_store_share share = { "2", 1, "ann" }, other = { "3", 1, "bob" };
    assert_true(srv_store_add(store, SRV_KIND_VIEW, "a", "23", 2, &share, &err)); /* as it is */
    holds(store, SRV_KIND_VIEW, "a", "22");
    assert_false(srv_store_add(store, SRV_KIND_VIEW, "c", "23", 2, &share, &err));
    assert_int_equal(err.code, SP_ERR_QUOTA);
    assert_string_equal(err.text, "ann has 1 views and its token allows 1; delete some");
    assert_false(srv_store_add(store, SRV_KIND_VIEW, "c", "3", 1, &other, &err));
    assert_non_null(strstr(err.text, "--views allows 2"));
    holds(store, SRV_KIND_SESSION, "a", "session");
    holds(store, SRV_KIND_PRESET, "a", NULL);
    assert_false(flush(store));
    char *ids = srv_store_ids(store, SRV_KIND_VIEW);
    assert_memory_equal(ids, "b\0a\0", 5);
    free(ids);
    assert_true(srv_store_remove(store, SRV_KIND_VIEW, "b"));
    assert_false(srv_store_remove(store, SRV_KIND_VIEW, "b"));
    srv_store_status(store, &status);
    assert_int_equal(status.records[SRV_KIND_VIEW], 1);
    assert_int_equal(status.bytes, 3 + 8);
    assert_int_equal(status.waiting, 0);
    assert_false(status.has_folder);
    srv_store_destroy(&store);
}

/* More records than the first buckets hold, put, changed and removed in an order of chance. */
static void the_table_holds_many_records(void **state) {
    struct srv_store *store = started(*state);
    char id[16], text[32];
    uint32_t chance = 1;
    static int expected[1000];
    memset(expected, 0, sizeof expected);
    for (int i = 1; i < 20000; i++) {
        chance = chance * 1664525 + 1013904223;
        unsigned which = (chance >> 8) % 1000;
        snprintf(id, sizeof id, "%u", which);
        snprintf(text, sizeof text, "%d", i);
        if (chance >> 30 == 0)
            assert_int_equal(srv_store_remove(store, SRV_KIND_VIEW, id), expected[which] != 0);
        else
            assert_true(put(store, SRV_KIND_VIEW, id, text));
        expected[which] = chance >> 30 == 0 ? 0 : i;
    }
    for (int again = 0; again < 2; again++) {
        for (unsigned which = 0; which < 1000; which++) {
            snprintf(id, sizeof id, "%u", which);
            snprintf(text, sizeof text, "%d", expected[which]);
            holds(store, SRV_KIND_VIEW, id, expected[which] ? text : NULL);
        }
        srv_store_destroy(&store); /* writes what is left */
        store = create(*state);
    }
    srv_store_destroy(&store);
}

static void records_survive_in_order(void **state) {
    struct srv_store *store = started(*state);
    struct stat found;
    char path[128];
    assert_true(put(store, SRV_KIND_VOLUME, "z", "first"));
    assert_true(put(store, SRV_KIND_VOLUME, "a", "x"));
    assert_true(put(store, SRV_KIND_VOLUME, "gone", "x"));
    assert_true(flush(store));
    assert_true(put(store, SRV_KIND_VOLUME, "z", "changed é"));
    assert_true(srv_store_remove(store, SRV_KIND_VOLUME, "gone"));
    assert_true(flush(store));
    srv_store_destroy(&store);
    database_path(*state, path);
    assert_int_equal(stat(path, &found), 0);
    assert_int_equal(found.st_mode & 0777, 0600);
    store = create(*state);
    holds(store, SRV_KIND_VOLUME, "z", "changed é");
    holds(store, SRV_KIND_VOLUME, "gone", NULL);
    char *ids = srv_store_ids(store, SRV_KIND_VOLUME);
    assert_memory_equal(ids, "z\0a\0", 5);
    free(ids);
    srv_store_destroy(&store);
}

static void one_daemon_uses_a_folder(void **state) {
    struct srv_store *store = create(*state);
    refused(*state, SP_ERR_IO, "another splatd");
    srv_store_destroy(&store);
    store = create(*state);
    srv_store_destroy(&store);
}

static void an_unusable_folder_is_refused(void **state) {
    char path[128], folder[128], text[8192];
    database_path(*state, path);
    refused("/dev/null", SP_ERR_IO, "folder");
    snprintf(folder, sizeof folder, "%s/none/deeper", (char *)*state);
    refused(folder, SP_ERR_IO, "cannot create this folder");

    FILE *file = fopen(path, "w"); /* no database */
    memset(text, 'x', sizeof text);
    fwrite(text, 1, sizeof text, file);
    fclose(file);
    refused(*state, SP_ERR_FORMAT, "damaged");
    remove(path);

    by_hand(*state, "CREATE TABLE bookmarks(url)");
    refused(*state, SP_ERR_FORMAT, "another program");
    remove(path);

    struct srv_store *store = started(*state);
    for (int i = 0; i < 300; i++) {
        snprintf(folder, sizeof folder, "%d", i);
        assert_true(srv_store_put(store, SRV_KIND_VIEW, folder, text, 200, NULL));
    }
    srv_store_destroy(&store);
    by_hand(*state, "PRAGMA user_version=99");
    refused(*state, SP_ERR_UNSUPPORTED, "newer splatd");
    by_hand(*state, "PRAGMA user_version=1");

    file = fopen(path, "r+"); /* damaged in the middle */
    fseek(file, 4096 * 5, SEEK_SET);
    fwrite(text, 1, sizeof text, file);
    fclose(file);
    refused(*state, SP_ERR_FORMAT, "damaged");
    remove(path);
    mkdir(path, 0700);
    refused(*state, SP_ERR_IO, "cannot open the database");
    rmdir(path);
}

static bool is_synced(const char *folder) {
    struct stat found;
    bool is = false;
    assert_int_equal(stat(folder, &found), 0);
    for (unsigned i = 0; i < sync_count; i++)
        is = is || synced[i] == found.st_ino;
    return is;
}

/* A new folder is a change of the one above it, and a new database one of the folder. */
static void new_names_are_synced(void **state) {
    char folder[128];
    snprintf(folder, sizeof folder, "%s/new", (char *)*state);
    struct srv_store *store = create(folder);
    assert_true(is_synced(*state));
    assert_true(is_synced(folder));
    srv_store_destroy(&store);
    sync_fails = true;
    refused(folder, SP_ERR_IO, "to the disk");
    snprintf(folder, sizeof folder, "%s/newer", (char *)*state);
    refused(folder, SP_ERR_IO, "to the disk");
}

static void a_file_system_without_wal_is_refused(void **state) {
    disk->has_no_shared_memory = true;
    refused(*state, SP_ERR_UNSUPPORTED, "local disk");
}

static void an_unwritable_database_is_refused(void **state) {
    char path[128];
    struct srv_store *store = create(*state);
    srv_store_destroy(&store);
    if (geteuid() == 0) { /* who may write everything is stopped by the disk */
        atomic_store(&disk->left, 0);
        refused(*state, SP_ERR_IO, "full");
        disk->end = BAD_DISK_BROKEN;
        refused(*state, SP_ERR_IO, "error");
        return;
    }
    database_path(*state, path);
    chmod(path, 0400);
    refused(*state, SP_ERR_IO, "allowed");
}

/* The disk fills up at every moment in turn; when there is room again nothing is missing. */
static void a_full_disk_delays_writes(void **state) {
    bool was_durable = false;
    int failures = 0;
    for (int end = BAD_DISK_FULL; end <= BAD_DISK_BROKEN; end++) {
        disk->end = (enum bad_disk_end)end;
        for (long n = 0; !was_durable; n++) {
            struct srv_store_status status;
            char text[32];
            struct srv_store *store = started(*state);
            atomic_store(&disk->left, n);
            snprintf(text, sizeof text, "%d-%ld", end, n);
            assert_true(put(store, SRV_KIND_SESSION, "s", text));
            assert_true(put(store, SRV_KIND_VIEW, text, text));
            was_durable = flush(store);
            srv_store_status(store, &status);
            assert_int_equal(status.is_failing, !was_durable);
            assert_int_equal(status.reason[0] != 0, !was_durable);
            holds(store, SRV_KIND_SESSION, "s", text); /* goes on in memory */
            atomic_store(&disk->left, -1);
            failures += !was_durable;
            assert_true(flush(store)); /* and catches up */
            srv_store_status(store, &status);
            assert_false(status.is_failing);
            assert_int_equal(status.waiting, 0);
            srv_store_destroy(&store);
            store = create(*state);
            holds(store, SRV_KIND_SESSION, "s", text);
            holds(store, SRV_KIND_VIEW, text, text);
            srv_store_destroy(&store);
        }
        was_durable = false;
    }
    assert_true(failures > 8);
}

/* Nobody asks any more: the writer tries again by itself. */
static void the_writer_retries_by_itself(void **state) {
    struct srv_store *store = started(*state);
    struct srv_store_status status;
    atomic_store(&disk->left, 0);
    assert_true(put(store, SRV_KIND_PRESET, "p", "{}"));
    do
        srv_store_status(store, &status);
    while (status.failures < 3);
    assert_true(status.is_failing);
    atomic_store(&disk->left, -1);
    do
        srv_store_status(store, &status);
    while (status.waiting > 0);
    assert_false(status.is_failing);
    srv_store_destroy(&store);
}

struct source {
    struct srv_store *store;
    int calls;
    atomic_bool is_short; /* of memory: puts one thing, and not the other */
};

static bool collect(void *user) {
    struct source *source = user;
    char text[16];
    snprintf(text, sizeof text, "%d", ++source->calls);
    put(source->store, SRV_KIND_SESSION, "s", text);
    return !atomic_load(&source->is_short);
}

static void the_writer_collects_before_it_writes(void **state) {
    struct srv_store_options o = options(*state);
    o.pause_ms = 1e9;
    struct source source = { .store = srv_store_create(&o, NULL) };
    struct srv_store *store = source.store;
    assert_true(srv_store_start(store, collect, &source, NULL));
    assert_true(flush(store));
    for (int i = 0; i < 1000; i++)
        srv_store_nudge(store);
    assert_true(flush(store)); /* does not wait for the pause */
    srv_store_destroy(&store);
    assert_int_equal(source.calls, 3); /* two flushes and the end: the nudges made none of their own
                                        */
    store = create(*state);
    holds(store, SRV_KIND_SESSION, "s", "3");
    srv_store_destroy(&store);
}

static bool collect_nothing(void *user) {
    return !atomic_load(&((struct source *)user)->is_short);
}

/* What could not be collected is no promise kept, whether there is something else to write or not;
 * it is collected later without anybody asking. */
static void a_failed_collection_is_not_durable(void **state) {
    for (int i = 0; i < 2; i++) {
        struct source source = { .store = create(*state) };
        struct srv_store_status status;
        atomic_store(&source.is_short, true);
        assert_true(srv_store_start(source.store, i ? collect_nothing : collect, &source, NULL));
        assert_false(flush(source.store));
        srv_store_status(source.store, &status);
        assert_true(status.is_failing);
        assert_non_null(strstr(status.reason, "sessions"));
        atomic_store(&source.is_short, false);
        do
            srv_store_status(source.store, &status);
        while (status.is_failing);
        assert_true(flush(source.store));
        struct srv_store *store = source.store; /* which collect() still needs */
        srv_store_destroy(&store);
    }
}

/* A process that dies at its n-th write, for every n: what it was told to be durable is there. */
static void dying(const char *folder, int told) {
    struct srv_store_options o = options(folder);
    o.pause_ms = 1e9; /* after the first one it writes when it is asked to */
    struct srv_store *store = srv_store_create(&o, NULL);
    if (!store || !srv_store_start(store, NULL, NULL, NULL))
        _exit(1);
    for (int i = 0; i < 4; i++) {
        char text[16];
        snprintf(text, sizeof text, "%d", i);
        if (!put(store, SRV_KIND_SESSION, "s", text) || !put(store, SRV_KIND_VIEW, text, text) ||
            (i > 0 && !srv_store_remove(store, SRV_KIND_PRESET, "p")) ||
            !put(store, SRV_KIND_PRESET, "p", text) || !flush(store) || write(told, "x", 1) != 1)
            _exit(1);
    }
    srv_store_destroy(&store);
    _exit(0);
}

static void records_survive_a_kill_at_any_write(void **state) {
    int status = -1, most = 0;
    long n = 0;
    for (; status != 0; n++) {
        char folder[96], told[8], text[16];
        int pipes[2];
        snprintf(folder, sizeof folder, "%s/%ld", (char *)*state, n);
        assert_int_equal(pipe(pipes), 0);
        pid_t child = fork();
        if (child == 0) {
            disk->end = BAD_DISK_DEATH;
            atomic_store(&disk->left, n);
            dying(folder, pipes[1]);
        }
        close(pipes[1]);
        int durable = (int)read(pipes[0], told, sizeof told), more;
        while (durable >= 0 && (more = (int)read(pipes[0], told, sizeof told)) > 0)
            durable += more;
        close(pipes[0]);
        assert_int_equal(waitpid(child, &status, 0), child);
        assert_true(WIFEXITED(status));
        assert_true(WEXITSTATUS(status) == 9 || WEXITSTATUS(status) == 0);
        struct srv_store *store = create(folder);
        for (int i = 0; i < durable; i++) {
            snprintf(text, sizeof text, "%d", i);
            holds(store, SRV_KIND_VIEW, text, text);
        }
        char *session = srv_store_get(store, SRV_KIND_SESSION, "s", NULL, NULL);
        char *preset = srv_store_get(store, SRV_KIND_PRESET, "p", NULL, NULL);
        assert_true(durable == 0 || (session && atoi(session) >= durable - 1));
        assert_true(durable == 0 || preset);
        if (preset) /* one transaction: all or nothing */
            assert_string_equal(session, preset);
        free(session);
        free(preset);
        srv_store_destroy(&store);
        most = durable > most ? durable : most;
    }
    assert_int_equal(most, 4);
    assert_true(n > 10);
}

/* Every allocation fails once, in creating, putting, flushing and reading: each says so or works,
 * nothing is lost, and what was durable stays. */
static void out_of_memory_is_an_error(void **state) {
    bool whole = false;
    int failed_to_open = 0, failed_to_write = 0;
    for (long n = 0; !whole; n++) {
        struct sp_error err = { .code = SP_OK };
        struct srv_store_options o = options(*state);
        char text[32];
        snprintf(text, sizeof text, "%ld", n);
        memory_run_out(n, MEMORY_STAYS_OUT);
        struct srv_store *store = srv_store_create(&o, &err);
        if (!store) {
            memory_come_back();
            assert_int_not_equal(err.code, SP_OK);
            assert_string_not_equal(err.text, "");
            failed_to_open++;
            continue;
        }
        assert_true(srv_store_start(store, NULL, NULL, &err));
        bool has_put = put(store, SRV_KIND_SESSION, "s", text);
        bool durable = has_put && flush(store);
        whole = !memory_come_back();
        assert_true(durable || !whole);
        failed_to_write += !durable;
        if (has_put)
            holds(store, SRV_KIND_SESSION, "s", text);
        assert_true(flush(store));
        srv_store_destroy(&store);
        store = create(*state);
        if (has_put)
            holds(store, SRV_KIND_SESSION, "s", text);
        srv_store_destroy(&store);
    }
    assert_true(failed_to_open > 20);
    assert_true(failed_to_write > 5);
}

/* Threads that put, remove, read, nudge and flush at once. */
struct crowd {
    struct srv_store *store;
    int number;
};

static void *in_the_crowd(void *user) {
    struct crowd *c = user;
    char id[32], text[32];
    for (int i = 0; i < 200; i++) {
        snprintf(id, sizeof id, "%d-%d", c->number, i % 10);
        snprintf(text, sizeof text, "%d", i);
        assert_true(put(c->store, SRV_KIND_VIEW, id, text));
        srv_store_nudge(c->store);
        if (i % 7 == 0)
            srv_store_remove(c->store, SRV_KIND_VIEW, id);
        else
            holds(c->store, SRV_KIND_VIEW, id, text);
        if (i % 20 == 0)
            assert_true(flush(c->store));
    }
    return NULL;
}

static void many_threads_use_the_store(void **state) {
    enum { THREADS = 4 };
    pthread_t threads[THREADS];
    struct crowd crowd[THREADS];
    struct srv_store *store = started(*state);
    for (int t = 0; t < THREADS; t++) {
        crowd[t] = (struct crowd){ store, t };
        assert_int_equal(pthread_create(&threads[t], NULL, in_the_crowd, &crowd[t]), 0);
    }
    for (int t = 0; t < THREADS; t++)
        pthread_join(threads[t], NULL);
    srv_store_stop(store);
    assert_false(flush(store)); /* nothing is written any more, and nobody waits */
    srv_store_destroy(&store);
    store = create(*state);
    holds(store, SRV_KIND_VIEW, "3-9", "199");
    srv_store_destroy(&store);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(records_are_kept_in_memory),
        cmocka_unit_test_setup_teardown(the_table_holds_many_records, set_up, tear_down),
        cmocka_unit_test_setup_teardown(records_survive_in_order, set_up, tear_down),
        cmocka_unit_test_setup_teardown(one_daemon_uses_a_folder, set_up, tear_down),
        cmocka_unit_test_setup_teardown(an_unusable_folder_is_refused, set_up, tear_down),
        cmocka_unit_test_setup_teardown(an_unwritable_database_is_refused, set_up, tear_down),
        cmocka_unit_test_setup_teardown(a_full_disk_delays_writes, set_up, tear_down),
        cmocka_unit_test_setup_teardown(the_writer_retries_by_itself, set_up, tear_down),
        cmocka_unit_test_setup_teardown(the_writer_collects_before_it_writes, set_up, tear_down),
        cmocka_unit_test_setup_teardown(a_failed_collection_is_not_durable, set_up, tear_down),
        cmocka_unit_test_setup_teardown(new_names_are_synced, set_up, tear_down),
        cmocka_unit_test_setup_teardown(a_file_system_without_wal_is_refused, set_up, tear_down),
        cmocka_unit_test_setup_teardown(records_survive_a_kill_at_any_write, set_up, tear_down),
        cmocka_unit_test_setup_teardown(out_of_memory_is_an_error, set_up, tear_down),
        cmocka_unit_test_setup_teardown(many_threads_use_the_store, set_up, tear_down),
    };
    memory_play_sqlite();
    disk = bad_disk_register();
    return cmocka_run_group_tests(tests, NULL, NULL);
}
