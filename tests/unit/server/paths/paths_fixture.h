/* SPDX-License-Identifier: Apache-2.0
 *
 * The parts of the daemon that render camera paths, with a store and a disk that the test controls.
 */
#ifndef TESTS_UNIT_SERVER_PATHS_PATHS_FIXTURE_H
#define TESTS_UNIT_SERVER_PATHS_PATHS_FIXTURE_H

#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>

#include "paths/paths_private.h"
#include "support/render_fixture.h"

enum { FRAMES = 3, MEMORY = 8000 };
#define SMALL "demo:phantom?size=8" /* 2048 bytes of MEMORY */
#define OTHER "demo:phantom?size=9"
#define LARGE "demo:phantom?size=12" /* 6912 bytes */

/* The record of a removed path. It is written before the files are deleted. */
#define REMOVED_RECORD "{\"removed\":true}"

/* Delays the answers of srv_store_flush() until the test releases them, and watches removals. */
extern struct paths_gate {
    atomic_bool hold;
    unsigned count;
    struct {
        void (*done)(void *user, bool durable);
        void *user;
    } held[8];
    char folder[128]; /* must not exist when its record is removed */
    atomic_int removed, files_left, not_marked;
    atomic_bool hold_loads; /* blocks the load thread */
} paths_gate;

/* The fake disk: the bytes that still fit (< 0 = unlimited), and whether fsync() works. */
extern atomic_llong disk_capacity;
extern atomic_bool disk_syncs;

extern struct paths_fixture {
    char state[32];
    struct srv_store *store;
    struct srv_tokens *tokens;
    struct render_fixture render;
    struct srv_paths *paths;
    _Atomic(struct srv_paths *) told; /* receives changes of volumes */
} paths_fixture;

/* A path that fails while another thread deletes it. FAILS_FIRST: the thread that fails is about to
 * write the record, and the deletion waits for its lock. IS_DELETED_FIRST: the thread that fails is
 * about to lock the records, and the deletion runs to its end. */
enum order { NONE, FAILS_FIRST, IS_DELETED_FIRST };
extern struct paths_race {
    _Atomic(enum order) order;
    atomic_bool has_no_volume, is_failing, is_at_records, is_deleted;
} paths_race;

void paths_fixture_release(struct srv_store *store);
void *paths_fixture_delete(void *id);
enum srv_volume_state paths_fixture_load(const char *id, const char *source);
void paths_fixture_unload(const char *id);
/* No volume is loaded. */
void paths_fixture_begin_render_pool(void);
void paths_fixture_begin_paths(void);
void paths_fixture_begin_empty(void);
void paths_fixture_begin(void);
void paths_fixture_end(void);
int paths_fixture_set_up(void **state);
int paths_fixture_tear_down(void **state);
void path_add(char id[SRV_PATH_ID_BYTES]);
/* Adds a path whose view has a layer with the points of another volume. */
void path_add_with_points(const char *volume, char id[SRV_PATH_ID_BYTES]);
/* Reads what the daemon says about a path. False: there is no such path. */
bool path_look_up(const char *id, struct srv_path_info *info);
/* Waits until the path has this state, with a reason that contains this text. */
struct srv_path_info path_wait_for(const char *id, const char *state, const char *reason);
struct srv_path_info path_wait_until(const char *id, const char *state);
void path_add_and_render(char id[SRV_PATH_ID_BYTES]);
const char *path_folder(const char *id);
bool path_has_folder(const char *id);
void path_write_file(const char *id, const char *name, const char *bytes);
/* Returns the record of a path, malloc'ed; NULL = there is none. */
char *path_record(const char *id);
/* Changes a record between two runs; text NULL removes it. */
void path_put_record(const char *id, const char *text);
/* Returns the value of a metric in this run. */
unsigned long long paths_metric(const char *name);
unsigned long long paths_waits(void);
unsigned paths_waiting(void);

#define WAITS(reason) paths_metric("splatd_path_waits_total{reason=\"" reason "\"}")

#endif
