/* SPDX-License-Identifier: Apache-2.0
 *
 * Which folders and databases a store accepts, and that it syncs the names of new ones.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "unit/server/store/store_fixture.h"

/* Folders that the store has synced itself. SQLite syncs its own files. */
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

static int set_up(void **state) {
    sync_fails = false;
    sync_count = 0;
    return store_set_up(state);
}

static void one_daemon_uses_a_folder(void **state) {
    struct srv_store *store = store_create(*state);
    store_is_refused(*state, SP_ERR_IO, "another splatd");
    srv_store_destroy(&store);
    store = store_create(*state);
    srv_store_destroy(&store);
}

static void an_unusable_folder_is_refused(void **state) {
    char path[128], folder[128], text[8192];
    store_database_path(*state, path);
    store_is_refused("/dev/null", SP_ERR_IO, "folder");
    snprintf(folder, sizeof folder, "%s/none/deeper", (char *)*state);
    store_is_refused(folder, SP_ERR_IO, "cannot create this folder");

    FILE *file = fopen(path, "w"); /* not a database */
    memset(text, 'x', sizeof text);
    fwrite(text, 1, sizeof text, file);
    fclose(file);
    store_is_refused(*state, SP_ERR_FORMAT, "damaged");
    remove(path);

    store_sql(*state, "CREATE TABLE bookmarks(url)");
    store_is_refused(*state, SP_ERR_FORMAT, "another program");
    remove(path);

    struct srv_store *store = store_started(*state);
    for (int i = 0; i < 300; i++) {
        snprintf(folder, sizeof folder, "%d", i);
        assert_true(srv_store_put(store, SRV_KIND_VIEW, folder, text, 200, NULL));
    }
    srv_store_destroy(&store);
    store_sql(*state, "PRAGMA user_version=99");
    store_is_refused(*state, SP_ERR_UNSUPPORTED, "newer splatd");
    store_sql(*state, "PRAGMA user_version=1");

    store_sql(*state, "ALTER TABLE record RENAME TO other");
    store_is_refused(*state, SP_ERR_FORMAT, "restore a copy, or move the file away");
    store_sql(*state, "ALTER TABLE other RENAME TO record");

    file = fopen(path, "r+"); /* damaged in the middle */
    fseek(file, 4096 * 5, SEEK_SET);
    fwrite(text, 1, sizeof text, file);
    fclose(file);
    store_is_refused(*state, SP_ERR_FORMAT, "damaged");
    remove(path);
    mkdir(path, 0700);
    store_is_refused(*state, SP_ERR_IO, "cannot open the database");
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

/* A new folder changes its parent folder, and a new database changes its folder. */
static void new_names_are_synced(void **state) {
    char folder[128];
    snprintf(folder, sizeof folder, "%s/new", (char *)*state);
    struct srv_store *store = store_create(folder);
    assert_true(is_synced(*state));
    assert_true(is_synced(folder));
    srv_store_destroy(&store);
    sync_fails = true;
    store_is_refused(folder, SP_ERR_IO, "to the disk");
    snprintf(folder, sizeof folder, "%s/newer", (char *)*state);
    store_is_refused(folder, SP_ERR_IO, "to the disk");
}

static void a_file_system_without_wal_is_refused(void **state) {
    store_disk->has_no_shared_memory = true;
    store_is_refused(*state, SP_ERR_UNSUPPORTED, "local disk");
}

static void an_unwritable_database_is_refused(void **state) {
    char path[128];
    struct srv_store *store = store_create(*state);
    srv_store_destroy(&store);
    if (geteuid() == 0) { /* root may write every file, so the disk refuses instead */
        atomic_store(&store_disk->left, 0);
        store_is_refused(*state, SP_ERR_IO, "full");
        store_disk->end = BAD_DISK_IO_ERROR;
        store_is_refused(*state, SP_ERR_IO, "error");
        return;
    }
    store_database_path(*state, path);
    chmod(path, 0400);
    store_is_refused(*state, SP_ERR_IO, "allowed");
}

int main(void) {
    const struct CMUnitTest tests[] = {
#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, store_tear_down)
        TEST(one_daemon_uses_a_folder),
        TEST(an_unusable_folder_is_refused),
        TEST(new_names_are_synced),
        TEST(a_file_system_without_wal_is_refused),
        TEST(an_unwritable_database_is_refused),
    };
    if (store_main_set_up() != 0)
        return 1;
    return cmocka_run_group_tests(tests, NULL, NULL);
}
