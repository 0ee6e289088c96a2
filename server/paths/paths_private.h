/* SPDX-License-Identifier: Apache-2.0
 *
 * Shared by the files of this folder: records (record.c), requests (paths.c), the thread that
 * renders (draw.c), quotas (quota.c) and watches (watch.c). The mutex guards everything that does
 * not say otherwise.
 */
#ifndef SRV_PATHS_PATHS_PRIVATE_H
#define SRV_PATHS_PATHS_PRIVATE_H

#include <pthread.h>
#include <stdatomic.h>

#include "paths/folder.h"
#include "paths/keyframes.h"
#include "paths/paths.h"
#include "sp/video.h"

enum srv_path_state { SRV_PATH_WAITING, SRV_PATH_RUNNING, SRV_PATH_DONE, SRV_PATH_FAILED };

struct srv_path_owner { /* a token that has paths, or removed paths whose files remain */
    struct srv_path_owner *next;
    char name[SRV_TOKEN_NAME_BYTES]; /* empty = unknown */
    unsigned count;                  /* paths, including those being created */
    unsigned holders;                /* these, and removed paths whose files remain */
    uint64_t bytes;                  /* of all its files */
    uint64_t last_served;            /* paths->served when it was served last; the lowest is next */
};

struct srv_path {
    struct srv_path *next;
    struct srv_paths *paths;
    char id[SRV_PATH_ID_BYTES]; /* constant, as are the next five members */
    char owner[SRV_TOKEN_NAME_BYTES];
    struct srv_path_output output; /* what it makes */
    uint32_t size[2];              /* pixels */
    char volume[SP_NAME_BYTES];
    struct srv_fingerprint content; /* fingerprint of the volume */
    struct srv_path_owner
        *by;            /* valid until the files are removed; NULL = removed in an earlier run */
    unsigned refs;      /* from the list, the thread, watches and `unwritten` */
    unsigned unwritten; /* changes of the record that are not yet on the disk: no file may be
                           created or removed before that */
    enum srv_path_state state;
    char reason[SP_ERROR_TEXT]; /* why it failed, or what it waits for */
    uint32_t done;              /* frames on the disk */
    uint64_t bytes;             /* of its files, including the one being written */
    double blocked_ms;          /* do not try before this time, unless unblocked; 0 = now */
    double pause_ms;            /* last pause before a retry; 0 = no failure */
    uint64_t wants;             /* size of the next frame if it exceeded a quota; else 0 */
    double frame_ms;  /* time that rendering its last frame took; 0 = unknown. Thread only */
    bool is_unloaded; /* its volume was unloaded since the path was created */
    atomic_bool is_removed;
};

struct srv_path_watch {
    struct srv_path_watch *next;
    struct srv_paths *paths;
    struct srv_path *path;
    struct srv_path_watcher watcher;
    char last[32];  /* id of the last event sent */
    double sent_ms; /* when anything was last sent */
    bool is_paused;
};

struct srv_paths {
    struct srv_paths_options options;
    struct srv_folder folder;
    pthread_mutex_t
        records; /* serialises changes of records; taken before `mutex` and the store's */
    pthread_mutex_t mutex;
    pthread_cond_t wake;   /* wakes the thread: something to do, a frame, stop */
    struct srv_path *list; /* oldest first */
    struct srv_path *gone; /* removed paths whose files are to be deleted */
    struct srv_path_owner *owners;
    uint64_t served;     /* how often an owner was served */
    unsigned count;      /* paths, including those being created */
    uint64_t bytes;      /* of all files */
    uint64_t generation; /* rises when something that paths wait for may have changed */
    struct srv_path_watch *watches;
    atomic_bool stop;
    bool is_running;
    pthread_t thread;
    struct sp_encoder *encoder; /* used by the thread */
};

/* Lets all waiting paths try again. The caller holds the mutex. */
void srv_paths_unblock(struct srv_paths *paths);
/* Wakes all watches of the path. The caller holds the mutex. */
void srv_paths_notify(struct srv_paths *paths, const struct srv_path *path);
/* Drops a reference; the last one frees the path. The caller holds the mutex. */
void srv_path_unref(struct srv_path *path);
/* Returns the link in the list that points to the path; it points to NULL if there is no such path.
 * The caller holds the mutex. */
struct srv_path **srv_paths_find(struct srv_paths *paths, const char *id);
/* Returns false and says that there is no such path, or that its record is damaged (SP_ERR_IO). */
bool srv_path_missing(struct srv_paths *paths, const char *id, struct sp_error *err);
const char *srv_path_state_name(const struct srv_path *path);
void srv_path_describe(const struct srv_path *path, struct srv_path_info *info);

/* Quotas (quota.c). The caller holds the mutex, except for request_path, has and acquire. */

/* Counts one more path of this owner, which may be new. NULL: SP_ERR_MEMORY. */
struct srv_path_owner *srv_path_quota_add_path(struct srv_paths *paths, const char *name,
                                               struct sp_error *err);
/* The same if the limits allow one more path; errors as in srv_paths_add(). */
struct srv_path_owner *srv_path_quota_request_path(struct srv_paths *paths, const char *name,
                                                   bool *is_full, struct sp_error *err);
/* Counts one path less; release_owner() follows when its files are deleted. */
void srv_path_quota_remove_path(struct srv_paths *paths, struct srv_path_owner *owner);
void srv_path_quota_release_owner(struct srv_paths *paths, struct srv_path_owner *owner);
/* Checks (has) or reserves (acquire) bytes for a path in the list, until release(). SP_ERR_BUDGET;
 * its text has `what`, for example "frame 7 has", in front of the bytes. */
bool srv_path_quota_has(struct srv_paths *paths, struct srv_path *path, uint64_t bytes,
                        const char *what, struct sp_error *err);
bool srv_path_quota_acquire(struct srv_paths *paths, struct srv_path *path, uint64_t bytes,
                            const char *what, struct sp_error *err);
void srv_path_quota_release(struct srv_paths *paths, struct srv_path *path, uint64_t bytes);
/* Counts files that exist already. */
void srv_path_quota_add(struct srv_paths *paths, struct srv_path *path, uint64_t bytes);

/* Records (record.c). The caller does not hold `mutex`. For fail and remove it holds `records`, and
 * the path is not removed. */
proto_json *srv_path_record_read(struct srv_paths *paths, const char *id, struct sp_error *err);
struct srv_keyframes *srv_path_record_keyframes(const proto_json *record, struct sp_error *err);
bool srv_path_record_put(struct srv_paths *paths, const struct srv_path *path,
                         const struct srv_keyframes *keyframes, const proto_json *body,
                         const struct sp_view *defaults, struct sp_error *err);
void srv_path_record_fail(struct srv_paths *paths, const char *id, const char *reason);
bool srv_path_record_remove(struct srv_paths *paths, const char *id, struct sp_error *err);
bool srv_path_record_is_removed(const proto_json *record);
bool srv_path_record_is_sealed(const proto_json *record);
/* Writes the name of a frame's file, for example "000012.png". */
void srv_path_file_name(const struct srv_path_output *output, uint32_t frame, char name[32]);
#define SRV_PATH_MOVIE_NAME "movie.webm"

/* The thread (draw.c); `user` is the struct srv_paths. */
void *srv_paths_main(void *user);

#endif
