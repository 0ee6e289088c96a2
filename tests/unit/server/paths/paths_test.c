/* SPDX-License-Identifier: Apache-2.0
 *
 * Camera paths and their files: what is on the disk at each moment, what the next run makes of it,
 * and a path that fails while it is deleted.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <limits.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "unit/server/paths/paths_fixture.h"

static void no_file_is_written_before_its_record(void **state) {
    (void)state;
    char id[SRV_PATH_ID_BYTES], next[SRV_PATH_ID_BYTES];
    struct srv_path_info info;
    atomic_store(&paths_gate.hold, true);
    path_add(id);
    assert_int_equal(paths_gate.count, 1);
    atomic_store(&paths_gate.hold, false);
    path_add_and_render(next); /* the first path had its turn in between */
    assert_true(path_look_up(id, &info));
    assert_int_equal(info.done, 0);
    assert_string_equal(info.state, "waiting");
    assert_false(path_has_folder(id));
    paths_fixture_release(paths_fixture.store);
    path_wait_until(id, "done");
}

static void no_file_is_deleted_before_its_record_is_marked(void **state) {
    (void)state;
    char id[SRV_PATH_ID_BYTES], next[SRV_PATH_ID_BYTES];
    struct srv_path_info info;
    path_add_and_render(id);
    strcpy(paths_gate.folder, path_folder(id));
    atomic_store(&paths_gate.hold, true);
    assert_true(srv_paths_remove(paths_fixture.paths, id, NULL));
    atomic_store(&paths_gate.hold, false);
    assert_false(path_look_up(id, &info));
    char *record = path_record(id);
    assert_string_equal(record, REMOVED_RECORD);
    free(record);
    path_add_and_render(next); /* the thread has run in between */
    assert_true(path_has_folder(id));
    paths_fixture_release(paths_fixture.store);
    while (atomic_load(&paths_gate.removed) == 0)
        sched_yield();
    assert_false(path_has_folder(id));
    assert_int_equal(atomic_load(&paths_gate.files_left), 0);
    assert_null(path_record(id));
    assert_true(path_has_folder(next));
    struct sp_error err;
    assert_false(srv_paths_remove(paths_fixture.paths, id, &err));
    assert_int_equal(err.code, SP_ERR_NOT_FOUND);
}

/* The daemon is killed while it removes a path: before, during and after deleting its files. */
static void an_interrupted_removal_is_finished(void **state) {
    (void)state;
    char command[160];
    for (int moment = 0; moment < 3; moment++) {
        char id[SRV_PATH_ID_BYTES];
        struct srv_path_info info;
        path_add_and_render(id);
        paths_fixture_end();
        path_put_record(id, REMOVED_RECORD);
        snprintf(command, sizeof command, "rm -r %s%s", path_folder(id),
                 moment == 1 ? "/000000.jpg" : "");
        assert_int_equal(moment > 0 ? system(command) : 0, 0);
        atomic_store(&paths_gate.removed, 0);
        paths_fixture_begin();
        assert_false(path_look_up(id, &info));
        while (atomic_load(&paths_gate.removed) == 0)
            sched_yield();
        assert_false(path_has_folder(id));
        assert_null(path_record(id));
    }
}

static void a_failed_removal_is_retried_at_the_next_start(void **state) {
    (void)state;
    char id[SRV_PATH_ID_BYTES], next[SRV_PATH_ID_BYTES], inner[160];
    path_add_and_render(id);
    snprintf(inner, sizeof inner, "%s/folder", path_folder(id));
    assert_int_equal(mkdir(inner, 0700), 0);
    assert_true(srv_paths_remove(paths_fixture.paths, id, NULL));
    path_add_and_render(next);
    paths_fixture_end();
    assert_true(path_has_folder(id));
    assert_int_equal(rmdir(inner), 0);
    atomic_store(&paths_gate.removed, 0);
    paths_fixture_begin();
    while (atomic_load(&paths_gate.removed) == 0)
        sched_yield();
    assert_false(path_has_folder(id));
}

static void files_without_a_record_stay_and_count(void **state) {
    (void)state;
    char id[SRV_PATH_ID_BYTES];
    struct srv_paths_stats stats;
    struct srv_path_info info;
    path_add_and_render(id);
    srv_paths_stats(paths_fixture.paths, &stats);
    uint64_t bytes = stats.bytes;
    assert_int_not_equal(bytes, 0);
    for (int run = 0; run < 2; run++) {
        paths_fixture_end();
        if (run == 0) {
            path_put_record(id, NULL);
            path_write_file(id, "000007.jpg.part", "12345");
        }
        paths_fixture_begin();
        assert_false(path_look_up(id, &info));
        srv_paths_stats(paths_fixture.paths, &stats);
        assert_int_equal(stats.paths, 0);
        assert_int_equal(stats.bytes, bytes + 5);
        assert_true(path_has_folder(id));
    }
}

static void files_of_an_unreadable_record_stay(void **state) {
    (void)state;
    char id[SRV_PATH_ID_BYTES];
    struct srv_paths_stats stats;
    path_add_and_render(id);
    char *record = path_record(id);
    paths_fixture_end();
    path_put_record(id, "{}");
    paths_fixture_begin();
    srv_paths_stats(paths_fixture.paths, &stats);
    assert_int_equal(stats.paths, 0);
    assert_true(path_has_folder(id));
    paths_fixture_end();
    path_put_record(id, record);
    free(record);
    paths_fixture_begin();
    assert_int_equal(path_wait_until(id, "done").done, FRAMES);
}

static void a_path_without_files_is_rendered_again(void **state) {
    (void)state;
    char id[SRV_PATH_ID_BYTES], command[160];
    path_add_and_render(id);
    paths_fixture_end();
    snprintf(command, sizeof command, "rm -r %s", path_folder(id));
    assert_int_equal(system(command), 0);
    paths_fixture_begin();
    assert_int_equal(path_wait_until(id, "done").done, FRAMES);
    assert_true(path_has_folder(id));
}

static void a_path_may_fail_while_it_is_deleted(void **state) {
    (void)state;
    for (int order = FAILS_FIRST; order <= IS_DELETED_FIRST; order++) {
        char id[SRV_PATH_ID_BYTES];
        struct srv_path_info info;
        pthread_t deleter;
        atomic_store(&paths_gate.hold, true);
        path_add(id);
        paths_fixture_unload("v");
        paths_race.order = order;
        paths_fixture_release(paths_fixture.store); /* its volume is missing: it fails */
        while (!atomic_load(&paths_race.is_failing))
            sched_yield();
        assert_int_equal(pthread_create(&deleter, NULL, paths_fixture_delete, id), 0);
        while (atomic_load(&paths_gate.removed) == 0)
            sched_yield();
        pthread_join(deleter, NULL);
        assert_true(atomic_load(&paths_race.has_no_volume));
        assert_int_equal(atomic_load(&paths_gate.not_marked), 0);
        assert_null(path_record(id));
        assert_false(path_look_up(id, &info));
        paths_fixture_end();
        memset(&paths_race, 0, sizeof paths_race);
        atomic_store(&paths_gate.removed, 0);
        paths_fixture_begin();
        assert_false(path_look_up(id, &info));
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
#define TEST(name)                                                                                 \
    cmocka_unit_test_setup_teardown(name, paths_fixture_set_up, paths_fixture_tear_down)
        TEST(no_file_is_written_before_its_record),
        TEST(no_file_is_deleted_before_its_record_is_marked),
        TEST(an_interrupted_removal_is_finished),
        TEST(a_failed_removal_is_retried_at_the_next_start),
        TEST(files_without_a_record_stay_and_count),
        TEST(files_of_an_unreadable_record_stay),
        TEST(a_path_without_files_is_rendered_again),
        TEST(a_path_may_fail_while_it_is_deleted),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
