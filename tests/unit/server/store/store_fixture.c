/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <pthread.h>
#include <sqlite3.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "store/database_files.h"
#include "support/fake_memory.h"
#include "unit/server/store/store_fixture.h"

struct bad_disk *store_disk;

int store_main_set_up(void) {
    memory_fake_sqlite();
    store_disk = bad_disk_register();
    return store_disk != NULL ? 0 : -1;
}

int store_set_up(void **state) {
    /* In memory, where it can be: these tests sync thousands of times. */
    char *folder = strdup(access("/dev/shm", W_OK) == 0 ? "/dev/shm/splatd-store-XXXXXX"
                                                        : "/tmp/splatd-store-XXXXXX");
    if (!folder || !mkdtemp(folder))
        return -1;
    *state = folder;
    atomic_store(&store_disk->left, -1);
    store_disk->end = BAD_DISK_FULL;
    store_disk->has_no_shared_memory = false;
    return 0;
}

int store_tear_down(void **state) {
    char command[128];
    snprintf(command, sizeof command, "rm -rf '%s'", (char *)*state);
    free(*state);
    return system(command);
}

struct srv_store_options store_options(const char *folder) {
    return (struct srv_store_options){
        .folder = folder, .vfs = "bad-disk", .pause_ms = 1, .retry_ms = 1, .check_ms = 1
    };
}

struct srv_store *store_create(const char *folder) {
    struct srv_store_options o = store_options(folder);
    struct sp_error err;
    struct srv_store *store = srv_store_create(&o, &err);
    if (!store)
        fail_msg("%s: %s", err.place, err.text);
    return store;
}

struct srv_store *store_started(const char *folder) {
    struct srv_store *store = store_create(folder);
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

bool store_flush(struct srv_store *store) {
    struct flushed f = { .mutex = PTHREAD_MUTEX_INITIALIZER, .cond = PTHREAD_COND_INITIALIZER };
    srv_store_flush(store, on_flushed, &f);
    pthread_mutex_lock(&f.mutex);
    while (!f.called)
        pthread_cond_wait(&f.cond, &f.mutex);
    pthread_mutex_unlock(&f.mutex);
    assert_int_equal(f.called, 1);
    return f.durable;
}

bool store_put(struct srv_store *store, enum srv_kind kind, const char *id, const char *text) {
    return srv_store_put(store, kind, id, text, strlen(text), NULL);
}

void store_holds(struct srv_store *store, enum srv_kind kind, const char *id, const char *text) {
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

void store_is_refused(const char *folder, enum sp_code code, const char *text) {
    struct srv_store_options o = store_options(folder);
    struct sp_error err = { .code = SP_OK };
    struct srv_store *store = srv_store_create(&o, &err);
    assert_null(store);
    if (err.code != code || !strstr(err.text, text))
        fail_msg("'%s: %s' (code %d) does not say '%s'", err.place, err.text, err.code, text);
    assert_non_null(strstr(err.place, folder));
}

void store_database_path(const char *folder, char path[128]) {
    snprintf(path, 128, "%s/" SRV_DATABASE_NAME, folder);
}

void store_sql(const char *folder, const char *sql) {
    char path[128];
    sqlite3 *db;
    store_database_path(folder, path);
    assert_int_equal(sqlite3_open(path, &db), SQLITE_OK);
    assert_int_equal(sqlite3_exec(db, sql, NULL, NULL, NULL), SQLITE_OK);
    sqlite3_close(db);
}
