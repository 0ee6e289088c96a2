/* SPDX-License-Identifier: Apache-2.0
 *
 * What the files of the paths share: records (record.c), requests (paths.c), the thread that draws
 * (draw.c), what they may take (room.c) and the watches (watch.c). Guarded by the mutex, besides
 * what says otherwise.
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

struct srv_path_owner { /* a token's name, while there are paths of it, or files of some */
    struct srv_path_owner *next;
    char name[SRV_TOKEN_NAME_BYTES]; /* empty = nobody's */
    unsigned count;                  /* of paths, and of those that are being made */
    unsigned holders;                /* these, and the removed ones whose files are there */
    uint64_t bytes;                  /* of all their files */
    uint64_t turn;                   /* of its last frame; the least goes first */
};

struct srv_path {
    struct srv_path *next;
    struct srv_paths *paths;
    char id[SRV_PATH_ID_BYTES]; /* constant, as are the next five */
    char owner[SRV_TOKEN_NAME_BYTES];
    struct srv_path_output output; /* what it makes */
    uint32_t size[2];              /* px */
    char volume[SP_NAME_BYTES];
    struct srv_fingerprint content; /* of the volume */
    struct srv_path_owner *by; /* until its files are removed; NULL = of an earlier run, removed */
    unsigned refs;             /* the list, the thread, watches, `unwritten` */
    unsigned unwritten; /* changes of its record on their way to the disk: no file before that */
    enum srv_path_state state;
    char reason[SP_ERROR_TEXT]; /* why it failed, or what it waits for */
    uint32_t done;              /* frames that are on the disk */
    uint64_t bytes;             /* of its files, and of what is being written */
    double blocked_ms;          /* until then, or what it waits for may have changed; 0 = not */
    double pause_ms;            /* before it is tried again, the last time; 0 = all goes well */
    uint64_t wants;             /* bytes that its next frame has, if they were too many */
    double frame_ms;            /* the thread's: what drawing its last frame took; 0 = not known */
    bool is_unloaded;           /* its volume was, since the path is there */
    atomic_bool is_removed;
};

struct srv_path_watch {
    struct srv_path_watch *next;
    struct srv_paths *paths;
    struct srv_path *path;
    struct srv_path_watcher watcher;
    char last[32];  /* id of the event that it has */
    double told_ms; /* when it was told anything */
    bool is_asleep;
};

struct srv_paths {
    struct srv_paths_options options;
    struct srv_folder folder;
    pthread_mutex_t records; /* of changes to records; held before the mutex, and with the store */
    pthread_mutex_t mutex;
    pthread_cond_t wake;   /* the thread: something to do, an answer, stop */
    struct srv_path *list; /* oldest first */
    struct srv_path *gone; /* their records say so: to be removed from the disk */
    struct srv_path_owner *owners;
    uint64_t turn;       /* rises with each that is given */
    unsigned count;      /* of paths, and of those that are being made */
    uint64_t bytes;      /* of all files */
    uint64_t generation; /* of what paths wait for: the volumes' states, bytes */
    struct srv_path_watch *watches;
    atomic_bool stop;
    bool is_running;
    pthread_t thread;
    struct sp_encoder *encoder; /* the thread's */
};

/* With the mutex held: what paths wait for may have changed. */
void srv_paths_unblock(struct srv_paths *paths);
/* With the mutex held: an event for all who watch the path, and one reference less. */
void srv_paths_tell(struct srv_paths *paths, const struct srv_path *path);
void srv_path_unref(struct srv_path *path);
/* Where it hangs in the list; on NULL if it is not there. */
struct srv_path **srv_paths_find(struct srv_paths *paths, const char *id);
bool srv_path_not_found(const char *id, struct sp_error *err); /* false */
const char *srv_path_state_name(const struct srv_path *path);
void srv_path_describe(const struct srv_path *path, struct srv_path_info *note);

/* Room (room.c). With the mutex held, besides request, has and take. */

/* One more path of this owner, who may be new. NULL: SP_ERR_MEMORY. */
struct srv_path_owner *srv_path_quota_add_path(struct srv_paths *paths, const char *name,
                                               struct sp_error *err);
/* The same if there may be one more: SP_ERR_BUDGET, as srv_paths_add() tells it. */
struct srv_path_owner *srv_path_quota_request_path(struct srv_paths *paths, const char *name,
                                                   bool *is_full, struct sp_error *err);
/* A path of this owner less; the owner stays until its files are gone, too. */
void srv_path_quota_remove_path(struct srv_paths *paths, struct srv_path_owner *owner);
void srv_path_quota_release_owner(struct srv_paths *paths, struct srv_path_owner *owner);
/* Is there room for so many bytes more of a path in the list? SP_ERR_BUDGET, with `what`, say
 * "frame 7 has", in front of the bytes. take() takes it, until give(). */
bool srv_path_quota_has(struct srv_paths *paths, struct srv_path *path, uint64_t bytes,
                        const char *what, struct sp_error *err);
bool srv_path_quota_take(struct srv_paths *paths, struct srv_path *path, uint64_t bytes,
                         const char *what, struct sp_error *err);
void srv_path_quota_give_back(struct srv_paths *paths, struct srv_path *path, uint64_t bytes);
/* For files that are there already. */
void srv_path_quota_add(struct srv_paths *paths, struct srv_path *path, uint64_t bytes);

/* Records, without the mutex. Fail and remove: with that of records, for paths that are not
 * removed.
 */
proto_json *srv_path_record_read(struct srv_paths *paths, const char *id, struct sp_error *err);
struct srv_keyframes *srv_path_record_keyframes(const proto_json *record, struct sp_error *err);
bool srv_path_record_put(struct srv_paths *paths, const struct srv_path *path,
                         const struct srv_keyframes *keyframes, const proto_json *body,
                         const struct sp_view *defaults, struct sp_error *err);
void srv_path_record_fail(struct srv_paths *paths, const char *id, const char *reason);
bool srv_path_record_remove(struct srv_paths *paths, const char *id, struct sp_error *err);
bool srv_path_record_is_removed(const proto_json *record);
/* "000012.png". */
void srv_path_file_name(const struct srv_path_output *output, uint32_t frame, char name[32]);
#define SRV_PATH_MOVIE_NAME "movie.webm"

/* The thread; `user` is the paths. */
void *srv_paths_main(void *user);

#endif
