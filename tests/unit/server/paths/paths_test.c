/* SPDX-License-Identifier: Apache-2.0
 *
 * Camera paths: what is on the disk at each moment, and what the next daemon makes of it; a disk
 * that is full; and the end of one that comes from two sides.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <sched.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "paths/paths_private.h"
#include "support/metric_value.h"
#include "support/render_fixture.h"

enum { FRAMES = 3, MEMORY = 8000 };
#define SMALL "demo:phantom?size=8" /* 2048 bytes of MEMORY */
#define OTHER "demo:phantom?size=9"
#define LARGE "demo:phantom?size=12" /* 6912 */

static const char removed_record[] = "{\"removed\":true}"; /* before its files go */

/* The store's answers that come when the test says so, and what is removed from it. */

static struct {
    atomic_bool hold;
    unsigned count;
    struct {
        void (*done)(void *user, bool durable);
        void *user;
    } held[8];
    char folder[128]; /* that must not be there when its record goes */
    atomic_int removed, too_early, unsaid;
    atomic_bool hold_loads; /* the load thread */
} gate;

void __real_srv_store_flush(struct srv_store *store, void (*done)(void *user, bool durable),
                            void *user);
void __wrap_srv_store_flush(struct srv_store *store, void (*done)(void *user, bool durable),
                            void *user);
void __wrap_srv_store_flush(struct srv_store *store, void (*done)(void *user, bool durable),
                            void *user) {
    if (!atomic_load(&gate.hold)) {
        __real_srv_store_flush(store, done, user);
        return;
    }
    assert_true(gate.count < sizeof gate.held / sizeof *gate.held);
    gate.held[gate.count].done = done;
    gate.held[gate.count++].user = user;
}

static void release(struct srv_store *store) {
    atomic_store(&gate.hold, false);
    for (unsigned i = 0; i < gate.count; i++)
        __real_srv_store_flush(store, gate.held[i].done, gate.held[i].user);
    gate.count = 0;
}

bool __real_srv_store_remove(struct srv_store *store, enum srv_kind kind, const char *id);
bool __wrap_srv_store_remove(struct srv_store *store, enum srv_kind kind, const char *id);
bool __wrap_srv_store_remove(struct srv_store *store, enum srv_kind kind, const char *id) {
    char *record = srv_store_get(store, kind, id, NULL, NULL);
    atomic_fetch_add(&gate.too_early, access(gate.folder, F_OK) == 0);
    atomic_fetch_add(&gate.unsaid, !record || strcmp(record, removed_record) != 0);
    free(record);
    bool was_there = __real_srv_store_remove(store, kind, id);
    atomic_fetch_add(&gate.removed, 1);
    return was_there;
}

/* A disk that is full: so many bytes still fit, < 0 = all; and whether what was written stays. */

static atomic_llong disk_left;
static atomic_bool disk_syncs;

ssize_t __real_write(int fd, const void *bytes, size_t size);
ssize_t __wrap_write(int fd, const void *bytes, size_t size);
ssize_t __wrap_write(int fd, const void *bytes, size_t size) {
    long long left = atomic_load(&disk_left);
    errno = ENOSPC;
    if (left == 0)
        return -1;
    ssize_t n = __real_write(fd, bytes, left > 0 && size > (size_t)left ? (size_t)left : size);
    if (left > 0 && n > 0)
        atomic_fetch_sub(&disk_left, n);
    return n;
}

int __real_fsync(int fd);
int __wrap_fsync(int fd);
int __wrap_fsync(int fd) {
    errno = ENOSPC;
    return atomic_load(&disk_syncs) ? __real_fsync(fd) : -1;
}

/* The daemon's parts that draw paths. */

static struct fixture {
    char state[32];
    struct srv_store *store;
    struct srv_tokens *tokens;
    struct render_fixture render;
    struct srv_paths *paths;
    _Atomic(struct srv_paths *) told; /* of volumes */
} f;

/* A path that fails while somebody deletes it: each of the two comes as far as it can while the
 * other is about to change the record. */

enum order { NONE, FAILS_FIRST, IS_DELETED_FIRST };
static struct {
    _Atomic(enum order) order;
    atomic_bool has_no_volume, is_failing, is_at_records, is_deleted;
} race;
static _Thread_local bool deletes;

void *__real_srv_catalog_acquire(void *catalog, const char *id, struct sp_error *err);
void *__wrap_srv_catalog_acquire(void *catalog, const char *id, struct sp_error *err);
void *__wrap_srv_catalog_acquire(void *catalog, const char *id, struct sp_error *err) {
    void *volume = __real_srv_catalog_acquire(catalog, id, err);
    atomic_store(&race.has_no_volume, volume == NULL);
    return volume;
}

bool __real_srv_store_put(struct srv_store *store, enum srv_kind kind, const char *id,
                          const char *text, size_t size, struct sp_error *err);
bool __wrap_srv_store_put(struct srv_store *store, enum srv_kind kind, const char *id,
                          const char *text, size_t size, struct sp_error *err);
bool __wrap_srv_store_put(struct srv_store *store, enum srv_kind kind, const char *id,
                          const char *text, size_t size, struct sp_error *err) {
    if (race.order == FAILS_FIRST && !deletes) {
        atomic_store(&race.is_failing, true);
        while (!atomic_load(&race.is_at_records) && !atomic_load(&race.is_deleted))
            sched_yield();
    }
    return __real_srv_store_put(store, kind, id, text, size, err);
}

int __real_pthread_mutex_lock(pthread_mutex_t *mutex);
int __wrap_pthread_mutex_lock(pthread_mutex_t *mutex);
int __wrap_pthread_mutex_lock(pthread_mutex_t *mutex) {
    bool is_records = race.order != NONE && f.paths && mutex == &f.paths->records;
    if (is_records && deletes)
        atomic_store(&race.is_at_records, true);
    if (is_records && !deletes && race.order == IS_DELETED_FIRST &&
        atomic_load(&race.has_no_volume)) {
        atomic_store(&race.is_failing, true);
        while (!atomic_load(&race.is_deleted))
            sched_yield();
    }
    return __real_pthread_mutex_lock(mutex);
}

static void *delete (void *id) {
    deletes = true;
    assert_true(srv_paths_remove(f.paths, id, NULL));
    atomic_store(&race.is_deleted, true);
    return NULL;
}

static void on_volume(const char *id, const char *state) {
    struct srv_paths *paths = atomic_load(&f.told);
    while (strcmp(state, "loading") == 0 && atomic_load(&gate.hold_loads))
        sched_yield();
    if (paths && strcmp(state, SRV_VOLUME_UNLOADED) == 0)
        srv_paths_unloaded(paths, id);
    else if (paths)
        srv_paths_wake(paths);
}

static enum srv_volume_state load(const char *id, const char *source) {
    return render_fixture_try(&f.render, id, source);
}

static void unload(const char *id) {
    bool conflict;
    while (!srv_catalog_remove(f.render.catalog, id, &conflict, NULL)) { /* between two frames */
        assert_true(conflict);
        sched_yield();
    }
}

/* One run after the other over the same folder. */

static struct srv_store *open_store(void) {
    struct srv_store_options options = { .folder = f.state, .pause_ms = 1, .retry_ms = 1 };
    struct srv_store *store = srv_store_create(&options, NULL);
    assert_non_null(store);
    assert_true(srv_store_start(store, NULL, NULL, NULL));
    return store;
}

/* No volume is there. */
static void begin_lanes(void) {
    struct render_fixture_options options = {
        .queue_max = 4, .memory_bytes = MEMORY, .is_empty = true, .volume = on_volume
    };
    f.store = open_store();
    f.tokens = srv_tokens_create(NULL);
    assert_non_null(f.tokens);
    render_fixture_begin(&f.render, &options);
}

static void begin_jobs(void) {
    struct srv_paths_options paths = { .catalog = f.render.catalog,
                                       .render_pool = f.render.render_pool,
                                       .store = f.store,
                                       .metrics = f.render.metrics,
                                       .tokens = f.tokens,
                                       .state = f.state,
                                       .paths_max = 8,
                                       .frames_max = FRAMES,
                                       .bytes_max = 1 << 20,
                                       .video_px = 1 << 20 };
    f.paths = srv_paths_create(&paths, NULL);
    assert_non_null(f.paths);
    atomic_store(&f.told, f.paths);
    assert_true(srv_paths_start(f.paths, NULL));
}

static void begin_empty(void) {
    begin_lanes();
    begin_jobs();
}

static void begin(void) {
    begin_empty();
    assert_int_equal(load("v", SMALL), SRV_VOLUME_READY);
}

static void end(void) {
    srv_paths_close(f.paths);
    render_fixture_stop(&f.render);
    srv_store_stop(f.store);
    atomic_store(&f.told, NULL);
    srv_paths_destroy(&f.paths);
    srv_tokens_destroy(&f.tokens);
    render_fixture_end(&f.render);
    srv_store_destroy(&f.store);
}

static int set_up(void **state) {
    (void)state;
    memset(&gate, 0, sizeof gate);
    memset(&race, 0, sizeof race);
    atomic_store(&disk_left, -1);
    atomic_store(&disk_syncs, true);
    strcpy(f.state, "/tmp/splatd-jobs-XXXXXX");
    if (!mkdtemp(f.state))
        return -1;
    begin();
    return 0;
}

static int tear_down(void **state) {
    (void)state;
    char command[64];
    atomic_store(&gate.hold_loads, false);
    if (f.paths)
        end();
    snprintf(command, sizeof command, "rm -rf '%s'", f.state);
    return system(command);
}

/* Paths. */

static void add(char id[SRV_PATH_ID_BYTES]) {
    static const char text[] = "{\"frames\": 3, \"format\": \"jpeg\","
                               " \"keyframes\": [{\"frame\": 2, \"view\": {}}]}";
    struct sp_error err;
    struct srv_path_request view;
    bool is_full;
    proto_json *body = proto_json_parse(text, sizeof text - 1, &err);
    view.volume = srv_catalog_acquire(f.render.catalog, "v", &err);
    assert_true(body && view.volume);
    srv_catalog_default_view(f.render.catalog, view.volume, &view.view);
    view.view.size[0] = view.view.size[1] = 16;
    view.defaults = view.view;
    proto_json *json = srv_paths_add(f.paths, body, &view, "ann", id, &is_full, &err);
    if (!json)
        fail_msg("%s: %s", err.place, err.text);
    srv_catalog_release(f.render.catalog, view.volume);
    proto_json_free(&json);
    proto_json_free(&body);
}

/* False: there is none. */
static bool look_at(const char *id, struct srv_path_info *note) {
    struct srv_path_info notes[8];
    struct srv_page page = { .items = notes, .item_bytes = sizeof *notes, .max = 8, .after = "" };
    srv_paths_list(f.paths, NULL, &page);
    for (unsigned i = 0; i < page.count; i++)
        if (strcmp(notes[i].id, id) == 0) {
            *note = notes[i];
            return true;
        }
    return false;
}

/* Until it is in this state, for this reason. */
static struct srv_path_info wait_for(const char *id, const char *state, const char *reason) {
    struct srv_path_info note;
    for (;; sched_yield()) {
        assert_true(look_at(id, &note));
        bool is_over = strcmp(note.state, "done") == 0 || strcmp(note.state, "failed") == 0;
        if (strcmp(note.state, state) == 0 && strstr(note.reason, reason))
            return note;
        if (is_over)
            fail_msg("it is %s: %s", note.state, note.reason);
    }
}

static struct srv_path_info wait_until(const char *id, const char *state) {
    return wait_for(id, state, "");
}

static void add_and_draw(char id[SRV_PATH_ID_BYTES]) {
    add(id);
    assert_int_equal(wait_until(id, "done").done, FRAMES);
}

static const char *folder_of(const char *id) {
    static char keyframes[128];
    snprintf(keyframes, sizeof keyframes, "%s/paths/%s", f.state, id);
    return keyframes;
}

static bool has_folder(const char *id) {
    return access(folder_of(id), F_OK) == 0;
}

static void write_file(const char *id, const char *name, const char *bytes) {
    char keyframes[192];
    snprintf(keyframes, sizeof keyframes, "%s/%s", folder_of(id), name);
    FILE *file = fopen(keyframes, "w");
    assert_non_null(file);
    fputs(bytes, file);
    fclose(file);
}

/* What the store has of a path, malloc'ed; NULL = nothing. */
static char *record_of(const char *id) {
    return srv_store_get(f.store, SRV_KIND_PATH, id, NULL, NULL);
}

/* Between two runs. */
static void put_record(const char *id, const char *text) {
    struct srv_store *store = open_store();
    if (text)
        assert_true(srv_store_put(store, SRV_KIND_PATH, id, text, strlen(text), NULL));
    else
        assert_true(__real_srv_store_remove(store, SRV_KIND_PATH, id));
    srv_store_stop(store);
    srv_store_destroy(&store);
}

/* Of this run. */
static unsigned long long metric(const char *name) {
    return metric_value(f.render.metrics, name);
}
#define WAITS(reason) metric("splatd_path_waits_total{reason=\"" reason "\"}")
static unsigned long long waits(void) {
    return WAITS("volume") + WAITS("disk") + WAITS("limit") + WAITS("memory") + WAITS("backend");
}

static unsigned waiting(void) {
    struct srv_paths_stats numbers;
    srv_paths_stats(f.paths, &numbers);
    return numbers.waiting;
}

static void no_file_comes_before_its_record(void **state) {
    (void)state;
    char id[SRV_PATH_ID_BYTES], next[SRV_PATH_ID_BYTES];
    struct srv_path_info note;
    atomic_store(&gate.hold, true);
    add(id);
    assert_int_equal(gate.count, 1);
    atomic_store(&gate.hold, false);
    add_and_draw(next); /* it was the first one's turn */
    assert_true(look_at(id, &note) && note.done == 0);
    assert_string_equal(note.state, "waiting");
    assert_false(has_folder(id));
    release(f.store);
    wait_until(id, "done");
}

static void no_file_goes_before_its_record_says_so(void **state) {
    (void)state;
    char id[SRV_PATH_ID_BYTES], next[SRV_PATH_ID_BYTES];
    struct srv_path_info note;
    add_and_draw(id);
    strcpy(gate.folder, folder_of(id));
    atomic_store(&gate.hold, true);
    assert_true(srv_paths_remove(f.paths, id, NULL));
    atomic_store(&gate.hold, false);
    assert_false(look_at(id, &note));
    char *record = record_of(id);
    assert_string_equal(record, removed_record);
    free(record);
    add_and_draw(next); /* the thread was there meanwhile */
    assert_true(has_folder(id));
    release(f.store);
    while (atomic_load(&gate.removed) == 0)
        sched_yield();
    assert_false(has_folder(id));
    assert_int_equal(atomic_load(&gate.too_early), 0);
    assert_null(record_of(id));
    assert_true(has_folder(next));
    struct sp_error err;
    assert_false(srv_paths_remove(f.paths, id, &err));
    assert_int_equal(err.code, SP_ERR_NOT_FOUND);
}

/* The daemon is killed while it removes a path: before, in, and behind the removal of the files. */
static void a_removal_that_was_begun_is_finished(void **state) {
    (void)state;
    char command[160];
    for (int moment = 0; moment < 3; moment++) {
        char id[SRV_PATH_ID_BYTES];
        struct srv_path_info note;
        add_and_draw(id);
        end();
        put_record(id, removed_record);
        snprintf(command, sizeof command, "rm -r %s%s", folder_of(id),
                 moment == 1 ? "/000000.jpg" : "");
        assert_int_equal(moment > 0 ? system(command) : 0, 0);
        atomic_store(&gate.removed, 0);
        begin();
        assert_false(look_at(id, &note));
        while (atomic_load(&gate.removed) == 0)
            sched_yield();
        assert_false(has_folder(id));
        assert_null(record_of(id));
    }
}

static void what_cannot_be_removed_is_tried_again_by_the_next_run(void **state) {
    (void)state;
    char id[SRV_PATH_ID_BYTES], next[SRV_PATH_ID_BYTES], inner[160];
    add_and_draw(id);
    snprintf(inner, sizeof inner, "%s/folder", folder_of(id));
    assert_int_equal(mkdir(inner, 0700), 0);
    assert_true(srv_paths_remove(f.paths, id, NULL));
    add_and_draw(next);
    end();
    assert_true(has_folder(id));
    assert_int_equal(rmdir(inner), 0);
    atomic_store(&gate.removed, 0);
    begin();
    while (atomic_load(&gate.removed) == 0)
        sched_yield();
    assert_false(has_folder(id));
}

static void files_without_a_record_stay_and_count(void **state) {
    (void)state;
    char id[SRV_PATH_ID_BYTES];
    struct srv_paths_stats numbers;
    struct srv_path_info note;
    add_and_draw(id);
    srv_paths_stats(f.paths, &numbers);
    uint64_t bytes = numbers.bytes;
    assert_true(bytes > 0);
    for (int run = 0; run < 2; run++) {
        end();
        if (run == 0) {
            put_record(id, NULL);
            write_file(id, "000007.jpg.part", "12345");
        }
        begin();
        assert_false(look_at(id, &note));
        srv_paths_stats(f.paths, &numbers);
        assert_true(numbers.paths == 0 && numbers.bytes == bytes + 5);
        assert_true(has_folder(id));
    }
}

static void files_of_a_record_that_cannot_be_read_stay(void **state) {
    (void)state;
    char id[SRV_PATH_ID_BYTES];
    struct srv_paths_stats numbers;
    add_and_draw(id);
    char *record = record_of(id);
    end();
    put_record(id, "{}");
    begin();
    srv_paths_stats(f.paths, &numbers);
    assert_true(numbers.paths == 0 && has_folder(id));
    end();
    put_record(id, record);
    free(record);
    begin();
    assert_int_equal(wait_until(id, "done").done, FRAMES);
}

static void a_record_without_files_is_drawn(void **state) {
    (void)state;
    char id[SRV_PATH_ID_BYTES], command[160];
    add_and_draw(id);
    end();
    snprintf(command, sizeof command, "rm -r %s", folder_of(id));
    assert_int_equal(system(command), 0);
    begin();
    assert_int_equal(wait_until(id, "done").done, FRAMES);
    assert_true(has_folder(id));
}

static void it_fails_while_it_is_deleted(void **state) {
    (void)state;
    for (int order = FAILS_FIRST; order <= IS_DELETED_FIRST; order++) {
        char id[SRV_PATH_ID_BYTES];
        struct srv_path_info note;
        pthread_t deleter;
        atomic_store(&gate.hold, true);
        add(id);
        unload("v");
        race.order = order;
        release(f.store); /* its volume is not there: it fails */
        while (!atomic_load(&race.is_failing))
            sched_yield();
        assert_int_equal(pthread_create(&deleter, NULL, delete, id), 0);
        while (atomic_load(&gate.removed) == 0)
            sched_yield();
        pthread_join(deleter, NULL);
        assert_true(atomic_load(&race.has_no_volume));
        assert_int_equal(atomic_load(&gate.unsaid), 0);
        assert_null(record_of(id));
        assert_false(look_at(id, &note));
        end();
        memset(&race, 0, sizeof race);
        atomic_store(&gate.removed, 0);
        begin();
        assert_false(look_at(id, &note));
    }
}

/* Are its files the first frames of `whole`, and nothing else? */
static void has_frames_of(const char *id, const char *whole, unsigned count) {
    char command[512];
    int n = snprintf(command, sizeof command, "cd %s", folder_of(id));
    snprintf(command + n, sizeof command - (size_t)n,
             " && set -- * && test $# -eq %u && for f; do cmp $f ../%s/$f || exit 1; done", count,
             whole);
    assert_int_equal(system(command), 0);
}

static struct srv_path_info wait_for_reason(const char *id) {
    struct srv_path_info note;
    do {
        sched_yield();
        assert_true(look_at(id, &note));
    } while (!note.reason[0]);
    assert_string_equal(note.state, "waiting");
    assert_non_null(strstr(note.reason, "No space left on device"));
    assert_null(strchr(note.reason, '/')); /* where the files lie is not told */
    return note;
}

static void a_full_disk_is_waited_for(void **state) {
    (void)state;
    char whole[SRV_PATH_ID_BYTES], id[SRV_PATH_ID_BYTES], other[SRV_PATH_ID_BYTES];
    add_and_draw(whole);
    struct srv_path_info note = wait_until(whole, "done");
    uint64_t frame = note.bytes / FRAMES; /* they are all the same */
    const uint64_t rooms[] = { 0, 1, frame - 1, frame, frame + 1, 3 * frame - 1 };
    for (size_t i = 0; i < sizeof rooms / sizeof *rooms; i++) {
        struct srv_paths_stats numbers;
        add_and_draw(other);
        unsigned long long put_off = WAITS("disk"), drawn = metric("splatd_path_frames_total");
        atomic_store(&disk_left, (long long)rooms[i]);
        add(id);
        note = wait_for_reason(id);
        assert_int_equal(note.done, rooms[i] / frame);
        assert_true(WAITS("disk") > put_off && waits() == WAITS("disk"));
        assert_int_equal(metric("splatd_path_frames_total"), drawn + note.done);
        assert_int_equal(waiting(), 1);
        assert_int_equal(note.bytes, note.done * frame);
        srv_paths_stats(f.paths, &numbers);
        assert_int_equal(numbers.bytes, (6 + note.done) * frame);
        if (note.done)
            has_frames_of(id, whole, note.done);
        atomic_store(&disk_left, -1);
        assert_true(srv_paths_remove(f.paths, other, NULL)); /* which is when it is tried again */
        assert_int_equal(wait_until(id, "done").done, FRAMES);
        assert_int_equal(metric("splatd_path_frames_total"), drawn + FRAMES);
        assert_int_equal(waiting(), 0);
        has_frames_of(id, whole, FRAMES);
        assert_true(srv_paths_remove(f.paths, id, NULL));
        while (atomic_load(&gate.removed) < 2 * (int)(i + 1))
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

/* The next event has this text. */
static void is_told(struct srv_path_watch *watch, const char *what) {
    char *text;
    size_t size;
    assert_int_equal(srv_path_watch_next(watch, &text, &size), SRV_WATCH_EVENT);
    if (!strstr(text, what))
        fail_msg("no %s: %s", what, text);
    free(text);
}

static void why_it_waits_is_told_and_why_it_waits_then(void **state) {
    (void)state;
    char id[SRV_PATH_ID_BYTES], other[SRV_PATH_ID_BYTES];
    bool is_over;
    struct srv_path_info note;
    const struct srv_path_watcher watcher = { NULL, ignore, ignore, stays };
    add_and_draw(other);
    atomic_store(&gate.hold, true);
    add(id);
    struct srv_path_watch *watch = srv_paths_watch(f.paths, id, NULL, &watcher, &is_over, NULL);
    assert_non_null(watch);
    is_told(watch, "\"done\":0,\"bytes\":0}");
    atomic_store(&disk_left, 0);
    release(f.store);
    wait_for_reason(id);
    is_told(watch, "000000.jpg.part: cannot write: No space left on device");
    atomic_store(&disk_syncs, false);
    atomic_store(&disk_left, -1);
    assert_true(srv_paths_remove(f.paths, other, NULL));
    do
        assert_true(look_at(id, &note));
    while (!strstr(note.reason, "000000.jpg: "));
    is_told(watch, "000000.jpg: cannot write: No space left on device");
    srv_path_watch_end(&watch);
}

static void what_the_disk_does_not_keep_is_no_frame(void **state) {
    (void)state;
    char whole[SRV_PATH_ID_BYTES], other[SRV_PATH_ID_BYTES], id[SRV_PATH_ID_BYTES];
    add_and_draw(whole);
    add_and_draw(other);
    atomic_store(&disk_syncs, false);
    add(id);
    assert_int_equal(wait_for_reason(id).done, 0);
    char file[192];
    snprintf(file, sizeof file, "%s/000000.jpg", folder_of(id));
    assert_int_equal(access(file, F_OK), -1);
    atomic_store(&disk_syncs, true);
    assert_true(srv_paths_remove(f.paths, other, NULL));
    wait_until(id, "done");
    has_frames_of(id, whole, FRAMES);
}

/* Volumes. */

/* A path of v's first frame, and the daemon's end. */
static void draw_one_frame(char id[SRV_PATH_ID_BYTES]) {
    char keyframes[192];
    add_and_draw(id);
    end();
    for (int i = 1; i < FRAMES; i++) { /* as if it had been killed then */
        snprintf(keyframes, sizeof keyframes, "%s/00000%d.jpg", folder_of(id), i);
        assert_int_equal(unlink(keyframes), 0);
    }
}

static void a_volume_that_is_not_back_is_waited_for(void **state) {
    (void)state;
    char id[SRV_PATH_ID_BYTES];
    draw_one_frame(id);
    begin_empty();
    struct srv_path_info note = wait_for(id, "waiting", "there is no volume 'v'; load it");
    assert_int_equal(note.done, 1);
    assert_int_equal(waits(), 1);
    assert_int_equal(WAITS("volume"), 1);
    assert_int_equal(waiting(), 1);
    assert_int_equal(load("another", OTHER), SRV_VOLUME_READY);
    assert_int_equal(load("v", SMALL), SRV_VOLUME_READY);
    assert_int_equal(wait_until(id, "done").done, FRAMES);
}

static void a_volume_that_loads_is_waited_for(void **state) {
    (void)state;
    char id[SRV_PATH_ID_BYTES];
    draw_one_frame(id);
    atomic_store(&gate.hold_loads, true);
    begin_lanes();
    render_fixture_queue(&f.render, "v", SMALL);
    begin_jobs();
    assert_int_equal(wait_for(id, "waiting", "the volume 'v' is still loading").done, 1);
    atomic_store(&gate.hold_loads, false);
    assert_int_equal(wait_until(id, "done").done, FRAMES);
}

static void a_volume_that_could_not_be_loaded_is_waited_for(void **state) {
    (void)state;
    char id[SRV_PATH_ID_BYTES];
    draw_one_frame(id);
    begin_empty();
    assert_int_equal(load("large", LARGE), SRV_VOLUME_READY);
    assert_int_equal(load("v", SMALL), SRV_VOLUME_FAILED);
    wait_for(id, "waiting", "the volume 'v' failed to load");
    unload("large");
    assert_int_equal(load("v", SMALL), SRV_VOLUME_READY);
    assert_int_equal(wait_until(id, "done").done, FRAMES);
}

static void another_volume_of_the_name_ends_it(void **state) {
    (void)state;
    char id[SRV_PATH_ID_BYTES];
    draw_one_frame(id);
    begin_empty();
    assert_int_equal(load("v", OTHER), SRV_VOLUME_READY);
    static const char reason[] = "the volume 'v' is not the one that the path was created for";
    assert_int_equal(wait_for(id, "failed", reason).done, 1);
    assert_int_equal(metric("splatd_path_failures_total"), 1);
    assert_int_equal(waiting(), 0);
    assert_true(has_folder(id));
    end();
    begin(); /* for good, also when the right one is there */
    assert_int_equal(wait_for(id, "failed", reason).done, 1);
    assert_int_equal(metric("splatd_path_failures_total"), 0); /* in this run */
}

static void unloading_a_volume_ends_its_paths_for_good(void **state) {
    (void)state;
    char id[SRV_PATH_ID_BYTES], next[SRV_PATH_ID_BYTES];
    struct srv_path_info note;
    for (int is_back = 0; is_back < 2; is_back++) { /* before the path's turn comes */
        atomic_store(&gate.hold, true);
        add(id);
        unload("v");
        if (is_back)
            assert_int_equal(load("v", SMALL), SRV_VOLUME_READY);
        release(f.store);
        wait_for(id, "failed", "the volume 'v' was unloaded");
        if (!is_back)
            assert_int_equal(load("v", SMALL), SRV_VOLUME_READY);
        add_and_draw(next);
        assert_true(look_at(id, &note));
        assert_string_equal(note.state, "failed");
    }
    end();
    begin();
    add_and_draw(next);
    assert_true(look_at(id, &note));
    assert_string_equal(note.state, "failed");
}

static void a_path_that_is_done_needs_no_volume(void **state) {
    (void)state;
    char id[SRV_PATH_ID_BYTES];
    add_and_draw(id);
    unload("v");
    end();
    begin_empty();
    assert_int_equal(load("v", OTHER), SRV_VOLUME_READY);
    assert_int_equal(wait_until(id, "done").done, FRAMES);
}

int main(void) {
    const struct CMUnitTest tests[] = {
#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
        TEST(no_file_comes_before_its_record),
        TEST(no_file_goes_before_its_record_says_so),
        TEST(a_removal_that_was_begun_is_finished),
        TEST(what_cannot_be_removed_is_tried_again_by_the_next_run),
        TEST(files_without_a_record_stay_and_count),
        TEST(files_of_a_record_that_cannot_be_read_stay),
        TEST(a_record_without_files_is_drawn),
        TEST(it_fails_while_it_is_deleted),
        TEST(a_full_disk_is_waited_for),
        TEST(what_the_disk_does_not_keep_is_no_frame),
        TEST(a_volume_that_is_not_back_is_waited_for),
        TEST(a_volume_that_loads_is_waited_for),
        TEST(a_volume_that_could_not_be_loaded_is_waited_for),
        TEST(another_volume_of_the_name_ends_it),
        TEST(unloading_a_volume_ends_its_paths_for_good),
        TEST(a_path_that_is_done_needs_no_volume),
        TEST(why_it_waits_is_told_and_why_it_waits_then),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
