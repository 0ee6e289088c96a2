/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "support/metric_value.h"
#include "unit/server/paths/paths_fixture.h"

/* Delays the answers of srv_store_flush() until the test releases them, and watches removals. */

struct paths_gate paths_gate;

void __real_srv_store_flush(struct srv_store *store, void (*done)(void *user, bool durable),
                            void *user);
void __wrap_srv_store_flush(struct srv_store *store, void (*done)(void *user, bool durable),
                            void *user);
void __wrap_srv_store_flush(struct srv_store *store, void (*done)(void *user, bool durable),
                            void *user) {
    if (!atomic_load(&paths_gate.hold)) {
        __real_srv_store_flush(store, done, user);
        return;
    }
    assert_in_range(paths_gate.count, 0, sizeof paths_gate.held / sizeof *paths_gate.held - 1);
    paths_gate.held[paths_gate.count].done = done;
    paths_gate.held[paths_gate.count++].user = user;
}

void paths_fixture_release(struct srv_store *store) {
    atomic_store(&paths_gate.hold, false);
    for (unsigned i = 0; i < paths_gate.count; i++)
        __real_srv_store_flush(store, paths_gate.held[i].done, paths_gate.held[i].user);
    paths_gate.count = 0;
}

bool __real_srv_store_remove(struct srv_store *store, enum srv_kind kind, const char *id);
bool __wrap_srv_store_remove(struct srv_store *store, enum srv_kind kind, const char *id);
bool __wrap_srv_store_remove(struct srv_store *store, enum srv_kind kind, const char *id) {
    char *record = srv_store_get(store, kind, id, NULL, NULL);
    atomic_fetch_add(&paths_gate.files_left, access(paths_gate.folder, F_OK) == 0);
    atomic_fetch_add(&paths_gate.not_marked, !record || strcmp(record, REMOVED_RECORD) != 0);
    free(record);
    bool was_there = __real_srv_store_remove(store, kind, id);
    atomic_fetch_add(&paths_gate.removed, 1);
    return was_there;
}

/* A fake disk: the bytes that still fit (< 0 = unlimited), and whether fsync() works. */

atomic_llong disk_capacity;
atomic_bool disk_syncs;

ssize_t __real_write(int fd, const void *bytes, size_t size);
ssize_t __wrap_write(int fd, const void *bytes, size_t size);
ssize_t __wrap_write(int fd, const void *bytes, size_t size) {
    long long left = atomic_load(&disk_capacity);
    errno = ENOSPC;
    if (left == 0)
        return -1;
    ssize_t n = __real_write(fd, bytes, left > 0 && size > (size_t)left ? (size_t)left : size);
    if (left > 0 && n > 0)
        atomic_fetch_sub(&disk_capacity, n);
    return n;
}

int __real_fsync(int fd);
int __wrap_fsync(int fd);
int __wrap_fsync(int fd) {
    errno = ENOSPC;
    return atomic_load(&disk_syncs) ? __real_fsync(fd) : -1;
}

/* The parts of the daemon that render paths. */

struct paths_fixture paths_fixture;

/* A path that fails while another thread deletes it: each of the two runs as far as it can while
 * the other is about to change the record. */

struct paths_race paths_race;
static _Thread_local bool deletes;

struct srv_volume *__real_srv_catalog_acquire(void *catalog, const char *id, struct sp_error *err);
struct srv_volume *__wrap_srv_catalog_acquire(void *catalog, const char *id, struct sp_error *err);
struct srv_volume *__wrap_srv_catalog_acquire(void *catalog, const char *id, struct sp_error *err) {
    struct srv_volume *volume = __real_srv_catalog_acquire(catalog, id, err);
    atomic_store(&paths_race.has_no_volume, volume == NULL);
    return volume;
}

bool __real_srv_store_put(struct srv_store *store, enum srv_kind kind, const char *id,
                          const char *text, size_t size, struct sp_error *err);
bool __wrap_srv_store_put(struct srv_store *store, enum srv_kind kind, const char *id,
                          const char *text, size_t size, struct sp_error *err);
bool __wrap_srv_store_put(struct srv_store *store, enum srv_kind kind, const char *id,
                          const char *text, size_t size, struct sp_error *err) {
    if (paths_race.order == FAILS_FIRST && !deletes) {
        atomic_store(&paths_race.is_failing, true);
        while (!atomic_load(&paths_race.is_at_records) && !atomic_load(&paths_race.is_deleted))
            sched_yield();
    }
    return __real_srv_store_put(store, kind, id, text, size, err);
}

int __real_pthread_mutex_lock(pthread_mutex_t *mutex);
int __wrap_pthread_mutex_lock(pthread_mutex_t *mutex);
int __wrap_pthread_mutex_lock(pthread_mutex_t *mutex) {
    bool is_records =
        paths_race.order != NONE && paths_fixture.paths && mutex == &paths_fixture.paths->records;
    if (is_records && deletes)
        atomic_store(&paths_race.is_at_records, true);
    if (is_records && !deletes && paths_race.order == IS_DELETED_FIRST &&
        atomic_load(&paths_race.has_no_volume)) {
        atomic_store(&paths_race.is_failing, true);
        while (!atomic_load(&paths_race.is_deleted))
            sched_yield();
    }
    return __real_pthread_mutex_lock(mutex);
}

void *paths_fixture_delete(void *id) {
    deletes = true;
    assert_true(srv_paths_remove(paths_fixture.paths, id, NULL));
    atomic_store(&paths_race.is_deleted, true);
    return NULL;
}

static void on_volume(const char *id, enum srv_volume_state state) {
    struct srv_paths *paths = atomic_load(&paths_fixture.told);
    while (state == SRV_VOLUME_LOADING && atomic_load(&paths_gate.hold_loads))
        sched_yield();
    if (paths && state == SRV_VOLUME_UNLOADED)
        srv_paths_unloaded(paths, id);
    else if (paths)
        srv_paths_wake(paths);
}

enum srv_volume_state paths_fixture_load(const char *id, const char *source) {
    return render_fixture_try(&paths_fixture.render, id, source);
}

void paths_fixture_unload(const char *id) {
    assert_true(srv_catalog_remove(paths_fixture.render.catalog, id, NULL, NULL));
}

/* Several runs of the daemon with the same folder. */

static struct srv_store *open_store(void) {
    struct srv_store_options options = { .folder = paths_fixture.state,
                                         .pause_ms = 1,
                                         .retry_ms = 1 };
    struct srv_store *store = srv_store_create(&options, NULL);
    assert_non_null(store);
    assert_true(srv_store_start(store, NULL, NULL, NULL));
    return store;
}

void paths_fixture_begin_render_pool(void) {
    struct render_fixture_options options = {
        .queue_max = 4, .memory_bytes = MEMORY, .is_empty = true, .volume = on_volume
    };
    paths_fixture.store = open_store();
    paths_fixture.tokens = srv_tokens_create(NULL);
    assert_non_null(paths_fixture.tokens);
    render_fixture_begin(&paths_fixture.render, &options);
}

void paths_fixture_begin_paths(void) {
    struct srv_paths_options paths = { .catalog = paths_fixture.render.catalog,
                                       .render_pool = paths_fixture.render.render_pool,
                                       .store = paths_fixture.store,
                                       .metrics = paths_fixture.render.metrics,
                                       .tokens = paths_fixture.tokens,
                                       .state = paths_fixture.state,
                                       .paths_max = 8,
                                       .frames_max = FRAMES,
                                       .bytes_max = 1 << 20,
                                       .video_px = 1 << 20 };
    paths_fixture.paths = srv_paths_create(&paths, NULL);
    assert_non_null(paths_fixture.paths);
    atomic_store(&paths_fixture.told, paths_fixture.paths);
    assert_true(srv_paths_start(paths_fixture.paths, NULL));
}

void paths_fixture_begin_empty(void) {
    paths_fixture_begin_render_pool();
    paths_fixture_begin_paths();
}

void paths_fixture_begin(void) {
    paths_fixture_begin_empty();
    assert_int_equal(paths_fixture_load("v", SMALL), SRV_VOLUME_READY);
}

void paths_fixture_end(void) {
    srv_paths_close(paths_fixture.paths);
    render_fixture_stop(&paths_fixture.render);
    srv_store_stop(paths_fixture.store);
    atomic_store(&paths_fixture.told, NULL);
    srv_paths_destroy(&paths_fixture.paths);
    srv_tokens_destroy(&paths_fixture.tokens);
    render_fixture_end(&paths_fixture.render);
    srv_store_destroy(&paths_fixture.store);
}

int paths_fixture_set_up(void **state) {
    (void)state;
    memset(&paths_gate, 0, sizeof paths_gate);
    memset(&paths_race, 0, sizeof paths_race);
    atomic_store(&disk_capacity, -1);
    atomic_store(&disk_syncs, true);
    strcpy(paths_fixture.state, "/tmp/splatd-paths-XXXXXX");
    if (!mkdtemp(paths_fixture.state))
        return -1;
    paths_fixture_begin();
    return 0;
}

int paths_fixture_tear_down(void **state) {
    (void)state;
    char command[64];
    atomic_store(&paths_gate.hold_loads, false);
    if (paths_fixture.paths)
        paths_fixture_end();
    snprintf(command, sizeof command, "rm -rf '%s'", paths_fixture.state);
    return system(command);
}

/* Paths. */

void path_add(char id[SRV_PATH_ID_BYTES]) {
    path_add_with_points(NULL, id);
}

void path_add_with_points(const char *volume, char id[SRV_PATH_ID_BYTES]) {
    static const char text[] = "{\"frames\": 3, \"format\": \"jpeg\","
                               " \"keyframes\": [{\"frame\": 2, \"view\": {}}]}";
    struct sp_error err;
    struct srv_path_request view;
    bool is_full;
    proto_json *body = proto_json_parse(text, sizeof text - 1, &err);
    view.volume = srv_catalog_acquire(paths_fixture.render.catalog, "v", &err);
    assert_non_null(body);
    assert_non_null(view.volume);
    srv_catalog_default_view(paths_fixture.render.catalog, view.volume, &view.view);
    view.view.size[0] = view.view.size[1] = 16;
    view.defaults = view.view;
    if (volume) {
        struct sp_layer *layer = &view.view.layers[view.view.layer_count++];
        *layer = sp_layer_default(SP_LAYER_POINTS);
        snprintf(layer->id, sizeof layer->id, "%s", volume);
    }
    proto_json *json = srv_paths_add(paths_fixture.paths, body, &view, "ann", id, &is_full, &err);
    if (!json)
        fail_msg("%s: %s", err.place, err.text);
    srv_catalog_release(paths_fixture.render.catalog, view.volume);
    proto_json_free(&json);
    proto_json_free(&body);
}

bool path_look_up(const char *id, struct srv_path_info *info) {
    struct srv_path_info infos[8];
    struct srv_page page = { .items = infos, .item_bytes = sizeof *infos, .max = 8, .after = "" };
    srv_paths_list(paths_fixture.paths, NULL, &page);
    for (unsigned i = 0; i < page.count; i++)
        if (strcmp(infos[i].id, id) == 0) {
            *info = infos[i];
            return true;
        }
    return false;
}

struct srv_path_info path_wait_for(const char *id, const char *state, const char *reason) {
    struct srv_path_info info;
    for (;; sched_yield()) {
        assert_true(path_look_up(id, &info));
        bool is_over = strcmp(info.state, "done") == 0 || strcmp(info.state, "failed") == 0;
        if (strcmp(info.state, state) == 0 && strstr(info.reason, reason))
            return info;
        if (is_over)
            fail_msg("the path is %s: %s", info.state, info.reason);
    }
}

struct srv_path_info path_wait_until(const char *id, const char *state) {
    return path_wait_for(id, state, "");
}

void path_add_and_render(char id[SRV_PATH_ID_BYTES]) {
    path_add(id);
    assert_int_equal(path_wait_until(id, "done").done, FRAMES);
}

const char *path_folder(const char *id) {
    static char folder[128];
    snprintf(folder, sizeof folder, "%s/paths/%s", paths_fixture.state, id);
    return folder;
}

bool path_has_folder(const char *id) {
    return access(path_folder(id), F_OK) == 0;
}

void path_write_file(const char *id, const char *name, const char *bytes) {
    char path[192];
    snprintf(path, sizeof path, "%s/%s", path_folder(id), name);
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    fputs(bytes, file);
    fclose(file);
}

char *path_record(const char *id) {
    return srv_store_get(paths_fixture.store, SRV_KIND_PATH, id, NULL, NULL);
}

void path_put_record(const char *id, const char *text) {
    struct srv_store *store = open_store();
    if (text)
        assert_true(srv_store_put(store, SRV_KIND_PATH, id, text, strlen(text), NULL));
    else
        assert_true(__real_srv_store_remove(store, SRV_KIND_PATH, id));
    srv_store_stop(store);
    srv_store_destroy(&store);
}

unsigned long long paths_metric(const char *name) {
    return metric_value(paths_fixture.render.metrics, name);
}
unsigned long long paths_waits(void) {
    return WAITS("volume") + WAITS("disk") + WAITS("limit") + WAITS("memory") + WAITS("backend");
}

unsigned paths_waiting(void) {
    struct srv_paths_stats stats;
    srv_paths_stats(paths_fixture.paths, &stats);
    return stats.waiting;
}
