/* SPDX-License-Identifier: Apache-2.0
 *
 * Camera paths that are drawn: paths.
 *
 *   POST ─► record in the store ─► waiting ─► running ─► done      a frame after the other, in the
 *                                     ▲          │                 scheduler's lowest class: one
 *                                     └──────────┴──► failed       thread, which encodes and
 *                                  its volume loads                writes, too
 *
 * Those who made paths have a frame each in turn, of the oldest of their paths that can go on.
 *
 * What is known of a path's progress are its files (folder.h): after a restart of the daemon it
 * goes on behind the last frame that is there. Its record, kept by the store, holds what to draw,
 * and how it ended.
 *
 *   record ─► on the disk ─► first file ─► … ─► "removed" ─► on the disk ─► no file ─► no record
 *
 * So wherever a crash comes, files have a record, and one that says so if they are to go. Files
 * without a record are those of a database that is not there: they stay.
 *
 * All frames of a path show one volume, told by its fingerprint, which the record holds. While
 * there is none of that name the path waits, whether it loads, could not, or is not known: it may
 * come. It fails when the volume is unloaded on request, or when another has its name.
 *
 * All functions are thread-safe. The mutex is never held while the catalog, the scheduler or the
 * store is called.
 */
#ifndef SRV_PATHS_PATHS_H
#define SRV_PATHS_PATHS_H

#include "common/pagination.h"
#include "config/tokens.h"
#include "ops/metrics.h"
#include "paths/archive.h"
#include "paths/keyframes.h"
#include "protocol/json.h"
#include "render/catalog.h"
#include "render/render_pool.h"
#include "store/store.h"

struct srv_paths;

enum { SRV_PATH_ID_BYTES = 33 };

struct srv_paths_options {
    struct srv_catalog *catalog;
    struct srv_render_pool *render_pool;
    struct srv_store *store;
    struct srv_metrics *metrics;
    struct srv_tokens *tokens; /* whose quotas hold; asked whenever room is taken */
    const char *state;         /* folder; NULL = a private one, and nothing outlives the daemon */
    unsigned paths_max;        /* that are not removed */
    uint32_t frames_max;       /* of a path */
    uint64_t bytes_max;        /* of all files of all paths */
    uint64_t video_px;         /* of the encoders of all movies, of one movie */
};

/* Takes up the paths of an earlier run. SP_ERR_IO (folder), SP_ERR_MEMORY. */
struct srv_paths *srv_paths_create(const struct srv_paths_options *options, struct sp_error *err);
bool srv_paths_start(struct srv_paths *paths, struct sp_error *err);
/* Begins no further frame, gives up the one at hand, and ends all watches. */
void srv_paths_close(struct srv_paths *paths);
/* After the scheduler was stopped and the last watch ended. Accepts NULL. */
void srv_paths_destroy(struct srv_paths **paths);

/* Some volume's state has changed, or the tokens' quotas. */
void srv_paths_wake(struct srv_paths *paths);
/* A volume is gone because somebody wanted that: paths that need it fail. From the catalog's own
 * callback, so before another has its id. */
void srv_paths_unloaded(struct srv_paths *paths, const char *volume);

struct srv_path_request { /* what the "view" of a request was resolved to */
    struct sp_view view, defaults;
    struct srv_volume *volume; /* a use of the caller's, so that it is not unloaded meanwhile */
};
/* Keeps a path for `body`, the document of POST /paths, whose "view" is *view. `owner` is a token's
 * name. NULL with *err set: SP_ERR_INVALID with a pointer into the body, SP_ERR_UNSUPPORTED,
 * SP_ERR_MEMORY, SP_ERR_BUDGET (too many paths; at SRV_PLACE_QUOTA, too many or too many bytes of
 * this owner), or, with *is_full, the bytes of all files. Answers are JSON as of GET /paths/{id}.
 */
proto_json *srv_paths_add(struct srv_paths *paths, const proto_json *body,
                          const struct srv_path_request *view, const char *owner,
                          char id[SRV_PATH_ID_BYTES], bool *is_full, struct sp_error *err);
proto_json *srv_paths_get(struct srv_paths *paths, const char *id, struct sp_error *err);

struct srv_path_info { /* what is told of a path */
    char id[SRV_PATH_ID_BYTES];
    char owner[SRV_TOKEN_NAME_BYTES]; /* name of the token that made it; empty = not known */
    const char *state;                /* constant */
    char reason[SP_ERROR_TEXT];       /* empty = none */
    char volume[SP_NAME_BYTES];
    uint32_t size[2];
    struct srv_path_output output;
    uint32_t done;
    uint64_t bytes;
};
/* Notes of all paths, or of one owner's, into the page. */
void srv_paths_list(struct srv_paths *paths, const char *owner, struct srv_page *page);
proto_json *srv_path_info_encode(const struct srv_path_info *note); /* NULL when out of memory */
/* Gives up what is drawn of it and removes all of it. SP_ERR_NOT_FOUND, SP_ERR_MEMORY. */
bool srv_paths_remove(struct srv_paths *paths, const char *id, struct sp_error *err);

/* Results. SP_ERR_NOT_FOUND; SP_ERR_TIMEOUT: there is none yet. */
struct srv_path_file {
    int fd; /* the caller's */
    uint64_t size;
    const char *mime; /* constant */
};
bool srv_paths_open_frame(struct srv_paths *paths, const char *id, uint32_t frame,
                          struct srv_path_file *file, struct sp_error *err);
bool srv_paths_open_movie(struct srv_paths *paths, const char *id, struct srv_path_file *file,
                          struct sp_error *err);
struct srv_archive *srv_paths_open_archive(struct srv_paths *paths, const char *id,
                                           struct sp_error *err);

/* Watching a path's progress: events are of the state then, so that none queue up. */
struct srv_path_watch;
struct srv_path_watcher {
    void *user;
    /* With the paths' mutex held, in turns, sleep() first: nothing is to be told now; there is. */
    void (*sleep)(void *user);
    void (*wake)(void *user);
    bool (*is_gone)(void *user); /* asked while it sleeps */
};
/* after: the id of the last event that the watcher has; NULL = none. *is_over: it has the last one
 * that there will be, and NULL is returned without an error. */
struct srv_path_watch *srv_paths_watch(struct srv_paths *paths, const char *id, const char *after,
                                       const struct srv_path_watcher *watcher, bool *is_over,
                                       struct sp_error *err);
void srv_path_watch_end(struct srv_path_watch **watch); /* accepts NULL */
enum srv_path_watch_result { SRV_WATCH_EVENT, SRV_WATCH_WAITING, SRV_WATCH_OVER, SRV_WATCH_FAILED };
/* The next event as text/event-stream has it, or a comment if nothing was told for long: malloc'ed,
 * the caller's. SRV_WATCH_FAILED: there is no memory to tell what is new. */
enum srv_path_watch_result srv_path_watch_next(struct srv_path_watch *watch, char **text,
                                               size_t *size);
/* Wakes those who are gone or have heard nothing for long; about ten times a second. */
void srv_paths_tick(struct srv_paths *paths, double now_ms);

struct srv_paths_stats {
    unsigned paths, unfinished, waiting; /* waiting: for what is missing, of the unfinished */
    uint64_t bytes;
};
void srv_paths_stats(struct srv_paths *paths, struct srv_paths_stats *numbers);

#endif
