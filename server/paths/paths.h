/* SPDX-License-Identifier: Apache-2.0
 *
 * The camera paths of the daemon: stores them, renders their frames one after the other, and serves
 * the results.
 *
 *   POST ─► record in the store ─► waiting ─► running ─► done      one thread asks for a frame with
 *                                     ▲          │                 the lowest priority, encodes it
 *                                     └──────────┴──► failed       and writes its file
 *                                  what is missing
 *                                  may have come
 *
 * The owners of paths take turns: each gets one frame, of its oldest path that can continue.
 *
 * The files of a path are its progress (folder.h): after a restart, the path continues after the
 * last frame on the disk. Its record in the store holds the request and, if it failed, the reason.
 *
 *   record ─► on the disk ─► first file ─► … ─► "removed" ─► on the disk ─► no file ─► no record
 *
 * So after a crash at any time, files have a record that says whether they must be removed. Files
 * without a record belong to a missing database: they stay.
 *
 * All frames of a path show one volume, identified by the fingerprint in the record. While no
 * volume of that name is ready (it loads, failed to load or is unknown), the path waits. It fails
 * if the volume is unloaded on request or if another volume has its name.
 *
 * All functions are thread-safe. The mutex is never held during calls to the catalog, the render
 * pool or the store.
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

enum { SRV_PATH_ID_BYTES = 33 }; /* 32 hexadecimal digits and a NUL */

struct srv_paths_options {
    struct srv_catalog *catalog;
    struct srv_render_pool *render_pool;
    struct srv_store *store;
    struct srv_metrics *metrics;
    struct srv_tokens *tokens; /* give the quotas, which are read before every frame */
    const char *state;         /* --state; NULL = a private folder that is removed at the end */
    unsigned paths_max;        /* camera paths that are not removed */
    uint32_t frames_max;       /* per path */
    uint64_t bytes_max;        /* of all files of all paths */
    struct sp_budget *budget;  /* of the memory of movies' encoders; NULL = no limit */
    uint64_t video_px; /* limit for the encoders of all movies together, px, and so for one movie */
};

/* Restores the paths of earlier runs. NULL: SP_ERR_IO (folder), SP_ERR_MEMORY. */
struct srv_paths *srv_paths_create(const struct srv_paths_options *options, struct sp_error *err);
bool srv_paths_start(struct srv_paths *paths, struct sp_error *err);
/* Starts no further frame, cancels the current one and ends all watches. */
void srv_paths_close(struct srv_paths *paths);
/* Call it after the render pool has stopped and the last watch has ended. */
void srv_paths_destroy(struct srv_paths **paths);

/* Tries waiting paths again: the state of a volume or the quotas of tokens have changed. */
void srv_paths_wake(struct srv_paths *paths);
/* Fails the paths of a volume that was unloaded on request. Call it from the catalog's callback,
 * before another volume can have the id. */
void srv_paths_unloaded(struct srv_paths *paths, const char *volume);

struct srv_path_request { /* the resolved "view" of a request */
    struct sp_view view, defaults;
    struct srv_volume *volume; /* a reference of the caller's, so that it stays loaded */
};
/* Creates a path from `body`, the document of POST /paths, whose "view" has been resolved to *view.
 * `owner` is the name of a token. Returns JSON as GET /paths/{id} does. NULL: SP_ERR_INVALID with a
 * pointer into the body, SP_ERR_UNSUPPORTED, SP_ERR_MEMORY, SP_ERR_QUOTA (of this owner),
 * SP_ERR_BUDGET: too many paths, or with *is_full, the total size of all files.
 */
proto_json *srv_paths_add(struct srv_paths *paths, const proto_json *body,
                          const struct srv_path_request *view, const char *owner,
                          char id[SRV_PATH_ID_BYTES], bool *is_full, struct sp_error *err);
proto_json *srv_paths_get(struct srv_paths *paths, const char *id, struct sp_error *err);

struct srv_path_info { /* what clients learn about a path */
    char id[SRV_PATH_ID_BYTES];
    char owner[SRV_TOKEN_NAME_BYTES]; /* name of the token that created it; empty = unknown */
    const char *state;                /* a constant */
    char reason[SP_ERROR_TEXT];       /* empty = none */
    char volume[SP_NAME_BYTES];
    uint32_t size[2];
    struct srv_path_output output;
    uint32_t done;
    uint64_t bytes;
};
/* Offers all paths of an owner (NULL = of all owners) to the page. Its items are struct
 * srv_path_info. */
void srv_paths_list(struct srv_paths *paths, const char *owner, struct srv_page *page);
proto_json *srv_path_info_encode(const struct srv_path_info *info); /* NULL = out of memory */
/* Cancels and removes a path with its files. False: SP_ERR_NOT_FOUND, SP_ERR_MEMORY. */
bool srv_paths_remove(struct srv_paths *paths, const char *id, struct sp_error *err);

/* Results. On failure: SP_ERR_NOT_FOUND, or SP_ERR_NOT_READY if the result is not there yet. */
struct srv_path_file {
    int fd; /* the caller closes it */
    uint64_t size;
    const char *mime; /* a constant */
};
bool srv_paths_open_frame(struct srv_paths *paths, const char *id, uint32_t frame,
                          struct srv_path_file *file, struct sp_error *err);
bool srv_paths_open_movie(struct srv_paths *paths, const char *id, struct srv_path_file *file,
                          struct sp_error *err);
struct srv_archive *srv_paths_open_archive(struct srv_paths *paths, const char *id,
                                           struct sp_error *err);

/* Watches a path's progress. An event describes the current state, so events never queue up. */
struct srv_path_watch;
struct srv_path_watcher {
    void *user;
    /* Called with the mutex held, alternately, pause() first: pause() when there is no event to
     * send, resume() when there is one. */
    void (*pause)(void *user);
    void (*resume)(void *user);
    bool (*is_gone)(
        void *user); /* true if the client has left; called between pause() and resume() */
};
/* Begins to watch a path. after: the id of the last event that the client has received; NULL =
 * none. *is_over = true: that event was the last event of the path, and the function returns NULL
 * without an error. */
struct srv_path_watch *srv_paths_watch(struct srv_paths *paths, const char *id, const char *after,
                                       const struct srv_path_watcher *watcher, bool *is_over,
                                       struct sp_error *err);
void srv_path_watch_end(struct srv_path_watch **watch); /* accepts NULL */
enum srv_path_watch_result { SRV_WATCH_EVENT, SRV_WATCH_WAITING, SRV_WATCH_OVER, SRV_WATCH_FAILED };
/* Returns the next event in the format of text/event-stream, or a comment after 15 s of silence, in
 * *text: malloc'ed, the caller's. SRV_WATCH_FAILED = out of memory. */
enum srv_path_watch_result srv_path_watch_next(struct srv_path_watch *watch, char **text,
                                               size_t *size);
/* Wakes watches whose clients have left or need a comment. Call it about ten times per second. */
void srv_paths_tick(struct srv_paths *paths, double now_ms);

struct srv_paths_stats {
    unsigned paths, unfinished, waiting; /* waiting: unfinished paths that lack something */
    uint64_t bytes;
};
void srv_paths_stats(struct srv_paths *paths, struct srv_paths_stats *numbers);

#endif
