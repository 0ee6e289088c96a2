/* SPDX-License-Identifier: Apache-2.0
 *
 * Camera paths that wait: for a disk that is full, and for volumes.
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

/* Asserts that the files of a path equal the first frames of `whole`, and that there are no others.
 */
static void has_frames_of(const char *id, const char *whole, unsigned count) {
    char command[512];
    int n = snprintf(command, sizeof command, "cd %s", path_folder(id));
    snprintf(command + n, sizeof command - (size_t)n,
             " && set -- * && test $# -eq %u && for f; do cmp $f ../%s/$f || exit 1; done", count,
             whole);
    assert_int_equal(system(command), 0);
}

static struct srv_path_info wait_for_reason(const char *id) {
    struct srv_path_info info;
    do {
        sched_yield();
        assert_true(path_look_up(id, &info));
    } while (!info.reason[0]);
    assert_string_equal(info.state, "waiting");
    assert_non_null(strstr(info.reason, "No space left on device"));
    assert_null(strchr(info.reason, '/')); /* clients do not learn the folder */
    return info;
}

static void a_path_waits_for_a_full_disk(void **state) {
    (void)state;
    char whole[SRV_PATH_ID_BYTES], id[SRV_PATH_ID_BYTES], other[SRV_PATH_ID_BYTES];
    path_add_and_render(whole);
    struct srv_path_info info = path_wait_until(whole, "done");
    uint64_t frame = info.bytes / FRAMES; /* all frames are equal */
    const uint64_t capacities[] = { 0, 1, frame - 1, frame, frame + 1, 3 * frame - 1 };
    for (size_t i = 0; i < sizeof capacities / sizeof *capacities; i++) {
        struct srv_paths_stats stats;
        path_add_and_render(other);
        unsigned long long waits_before = WAITS("disk"),
                           drawn = paths_metric("splatd_path_frames_total");
        atomic_store(&disk_capacity, (long long)capacities[i]);
        path_add(id);
        info = wait_for_reason(id);
        assert_int_equal(info.done, capacities[i] / frame);
        assert_in_range(WAITS("disk"), waits_before + 1, ULLONG_MAX);
        assert_int_equal(paths_waits(), WAITS("disk"));
        assert_int_equal(paths_metric("splatd_path_frames_total"), drawn + info.done);
        assert_int_equal(paths_waiting(), 1);
        assert_int_equal(info.bytes, info.done * frame);
        srv_paths_stats(paths_fixture.paths, &stats);
        assert_int_equal(stats.bytes, (6 + info.done) * frame);
        if (info.done)
            has_frames_of(id, whole, info.done);
        atomic_store(&disk_capacity, -1);
        assert_true(
            srv_paths_remove(paths_fixture.paths, other, NULL)); /* this makes it try again */
        assert_int_equal(path_wait_until(id, "done").done, FRAMES);
        assert_int_equal(paths_metric("splatd_path_frames_total"), drawn + FRAMES);
        assert_int_equal(paths_waiting(), 0);
        has_frames_of(id, whole, FRAMES);
        assert_true(srv_paths_remove(paths_fixture.paths, id, NULL));
        while (atomic_load(&paths_gate.removed) < 2 * (int)(i + 1))
            sched_yield();
    }
}

static void ignore(void *user) {
    (void)user;
}

static bool stays(void *user) {
    (void)user;
    return false;
}

/* Asserts that the next event contains this text. */
static void is_told(struct srv_path_watch *watch, const char *what) {
    char *text;
    size_t size;
    assert_int_equal(srv_path_watch_next(watch, &text, &size), SRV_WATCH_EVENT);
    if (!strstr(text, what))
        fail_msg("\"%s\" is missing: %s", what, text);
    free(text);
}

static void each_new_reason_for_waiting_is_an_event(void **state) {
    (void)state;
    char id[SRV_PATH_ID_BYTES], other[SRV_PATH_ID_BYTES];
    bool is_over;
    struct srv_path_info info;
    const struct srv_path_watcher watcher = { NULL, ignore, ignore, stays };
    path_add_and_render(other);
    atomic_store(&paths_gate.hold, true);
    path_add(id);
    struct srv_path_watch *watch =
        srv_paths_watch(paths_fixture.paths, id, NULL, &watcher, &is_over, NULL);
    assert_non_null(watch);
    is_told(watch, "\"done\":0,\"bytes\":0}");
    atomic_store(&disk_capacity, 0);
    paths_fixture_release(paths_fixture.store);
    wait_for_reason(id);
    is_told(watch, "000000.jpg.part: cannot write: No space left on device");
    atomic_store(&disk_syncs, false);
    atomic_store(&disk_capacity, -1);
    assert_true(srv_paths_remove(paths_fixture.paths, other, NULL));
    do
        assert_true(path_look_up(id, &info));
    while (!strstr(info.reason, "000000.jpg: "));
    is_told(watch, "000000.jpg: cannot write: No space left on device");
    srv_path_watch_end(&watch);
}

static void a_frame_that_cannot_be_synced_does_not_count(void **state) {
    (void)state;
    char whole[SRV_PATH_ID_BYTES], other[SRV_PATH_ID_BYTES], id[SRV_PATH_ID_BYTES];
    path_add_and_render(whole);
    path_add_and_render(other);
    atomic_store(&disk_syncs, false);
    path_add(id);
    assert_int_equal(wait_for_reason(id).done, 0);
    char file[192];
    snprintf(file, sizeof file, "%s/000000.jpg", path_folder(id));
    assert_int_equal(access(file, F_OK), -1);
    atomic_store(&disk_syncs, true);
    assert_true(srv_paths_remove(paths_fixture.paths, other, NULL));
    path_wait_until(id, "done");
    has_frames_of(id, whole, FRAMES);
}

/* Volumes. */

/* Creates a path of v with one frame, as if the daemon had been killed then, and ends the daemon.
 */
static void draw_one_frame(char id[SRV_PATH_ID_BYTES]) {
    char path[192];
    path_add_and_render(id);
    paths_fixture_end();
    for (int i = 1; i < FRAMES; i++) { /* delete all other frames */
        snprintf(path, sizeof path, "%s/00000%d.jpg", path_folder(id), i);
        assert_int_equal(unlink(path), 0);
    }
}

static void a_path_waits_for_an_unknown_volume(void **state) {
    (void)state;
    char id[SRV_PATH_ID_BYTES];
    draw_one_frame(id);
    paths_fixture_begin_empty();
    struct srv_path_info info = path_wait_for(id, "waiting", "there is no volume 'v'; load it");
    assert_int_equal(info.done, 1);
    assert_int_equal(paths_waits(), 1);
    assert_int_equal(WAITS("volume"), 1);
    assert_int_equal(paths_waiting(), 1);
    assert_int_equal(paths_fixture_load("another", OTHER), SRV_VOLUME_READY);
    assert_int_equal(paths_fixture_load("v", SMALL), SRV_VOLUME_READY);
    assert_int_equal(path_wait_until(id, "done").done, FRAMES);
}

static void a_path_waits_for_the_volumes_of_layers(void **state) {
    (void)state;
    char id[SRV_PATH_ID_BYTES];
    path_add_with_points("stars", id);
    path_wait_for(id, "waiting", "no volume \"stars\" is loaded");
    assert_int_equal(WAITS("volume"), 1);
    /* It continues with a volume of the wrong kind: points would not fit into MEMORY. */
    assert_int_equal(paths_fixture_load("stars", OTHER), SRV_VOLUME_READY);
    path_wait_for(id, "failed", "/layers/1/id: this volume has no points");
}

static void a_path_waits_for_a_loading_volume(void **state) {
    (void)state;
    char id[SRV_PATH_ID_BYTES];
    draw_one_frame(id);
    atomic_store(&paths_gate.hold_loads, true);
    paths_fixture_begin_render_pool();
    render_fixture_queue(&paths_fixture.render, "v", SMALL);
    paths_fixture_begin_paths();
    assert_int_equal(path_wait_for(id, "waiting", "the volume 'v' is still loading").done, 1);
    atomic_store(&paths_gate.hold_loads, false);
    assert_int_equal(path_wait_until(id, "done").done, FRAMES);
}

static void a_path_waits_for_a_volume_that_failed_to_load(void **state) {
    (void)state;
    char id[SRV_PATH_ID_BYTES];
    draw_one_frame(id);
    paths_fixture_begin_empty();
    assert_int_equal(paths_fixture_load("large", LARGE), SRV_VOLUME_READY);
    assert_int_equal(paths_fixture_load("v", SMALL), SRV_VOLUME_FAILED);
    path_wait_for(id, "waiting", "the volume 'v' failed to load");
    paths_fixture_unload("large");
    assert_int_equal(paths_fixture_load("v", SMALL), SRV_VOLUME_READY);
    assert_int_equal(path_wait_until(id, "done").done, FRAMES);
}

static void another_volume_of_the_same_name_fails_the_path(void **state) {
    (void)state;
    char id[SRV_PATH_ID_BYTES];
    draw_one_frame(id);
    paths_fixture_begin_empty();
    assert_int_equal(paths_fixture_load("v", OTHER), SRV_VOLUME_READY);
    static const char reason[] = "the volume 'v' is not the one that the path was created for";
    assert_int_equal(path_wait_for(id, "failed", reason).done, 1);
    assert_int_equal(paths_metric("splatd_path_failures_total"), 1);
    assert_int_equal(paths_waiting(), 0);
    assert_true(path_has_folder(id));
    paths_fixture_end();
    paths_fixture_begin(); /* the failure is permanent, also with the right volume */
    assert_int_equal(path_wait_for(id, "failed", reason).done, 1);
    assert_int_equal(paths_metric("splatd_path_failures_total"), 0); /* in this run */
}

static void unloading_a_volume_fails_its_paths_permanently(void **state) {
    (void)state;
    char id[SRV_PATH_ID_BYTES], next[SRV_PATH_ID_BYTES];
    struct srv_path_info info;
    for (int is_back = 0; is_back < 2; is_back++) { /* before the path has its turn */
        atomic_store(&paths_gate.hold, true);
        path_add(id);
        paths_fixture_unload("v");
        if (is_back)
            assert_int_equal(paths_fixture_load("v", SMALL), SRV_VOLUME_READY);
        paths_fixture_release(paths_fixture.store);
        path_wait_for(id, "failed", "the volume 'v' was unloaded");
        if (!is_back)
            assert_int_equal(paths_fixture_load("v", SMALL), SRV_VOLUME_READY);
        path_add_and_render(next);
        assert_true(path_look_up(id, &info));
        assert_string_equal(info.state, "failed");
    }
    paths_fixture_end();
    paths_fixture_begin();
    path_add_and_render(next);
    assert_true(path_look_up(id, &info));
    assert_string_equal(info.state, "failed");
}

static void a_finished_path_needs_no_volume(void **state) {
    (void)state;
    char id[SRV_PATH_ID_BYTES];
    path_add_and_render(id);
    paths_fixture_unload("v");
    paths_fixture_end();
    paths_fixture_begin_empty();
    assert_int_equal(paths_fixture_load("v", OTHER), SRV_VOLUME_READY);
    assert_int_equal(path_wait_until(id, "done").done, FRAMES);
}

int main(void) {
    const struct CMUnitTest tests[] = {
#define TEST(name)                                                                                 \
    cmocka_unit_test_setup_teardown(name, paths_fixture_set_up, paths_fixture_tear_down)
        TEST(a_path_waits_for_a_full_disk),
        TEST(each_new_reason_for_waiting_is_an_event),
        TEST(a_frame_that_cannot_be_synced_does_not_count),
        TEST(a_path_waits_for_an_unknown_volume),
        TEST(a_path_waits_for_the_volumes_of_layers),
        TEST(a_path_waits_for_a_loading_volume),
        TEST(a_path_waits_for_a_volume_that_failed_to_load),
        TEST(another_volume_of_the_same_name_fails_the_path),
        TEST(unloading_a_volume_fails_its_paths_permanently),
        TEST(a_finished_path_needs_no_volume),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
