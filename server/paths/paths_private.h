/* SPDX-License-Identifier: Apache-2.0
 *
 * What the files of the jobs share: records (record.c), requests (jobs.c), the thread that draws
 * (draw.c), what they may take (room.c) and the watches (watch.c). Guarded by the mutex, besides
 * what says otherwise.
 */
#ifndef SRV_JOBS_JOBS_PRIVATE_H
#define SRV_JOBS_JOBS_PRIVATE_H

#include <pthread.h>
#include <stdatomic.h>

#include "paths/folder.h"
#include "paths/path.h"
#include "paths/paths.h"
#include "sp/video.h"

enum srv_job_state { SRV_JOB_WAITING, SRV_JOB_RUNNING, SRV_JOB_DONE, SRV_JOB_FAILED };

struct srv_path_owner { /* a token's name, while there are paths of it, or files of some */
    struct srv_path_owner *next;
    char name[SRV_TOKEN_NAME_BYTES]; /* empty = nobody's */
    unsigned count;                  /* of paths, and of those that are being made */
    unsigned holders;                /* these, and the removed ones whose files are there */
    uint64_t bytes;                  /* of all their files */
    uint64_t turn;                   /* of its last frame; the least goes first */
};

struct srv_path_job {
    struct srv_path_job *next;
    struct srv_jobs *jobs;
    char id[SRV_JOB_ID_BYTES]; /* constant, as are the next five */
    char owner[SRV_TOKEN_NAME_BYTES];
    struct srv_path_output output; /* what it makes */
    uint32_t size[2];              /* px */
    char volume[SP_NAME_BYTES];
    struct srv_fingerprint content; /* of the volume */
    struct srv_path_owner *by; /* until its files are removed; NULL = of an earlier run, removed */
    unsigned refs;             /* the list, the thread, watches, `unwritten` */
    unsigned unwritten; /* changes of its record on their way to the disk: no file before that */
    enum srv_job_state state;
    char reason[SP_ERROR_TEXT]; /* why it failed, or what it waits for */
    uint32_t done;              /* frames that are on the disk */
    uint64_t bytes;             /* of its files, and of what is being written */
    double blocked_ms;          /* until then, or what it waits for may have changed; 0 = not */
    double pause_ms;            /* before it is tried again, the last time; 0 = all goes well */
    uint64_t wants;             /* bytes that its next frame has, if they were too many */
    double frame_ms;            /* the thread's: what drawing its last frame took; 0 = not known */
    bool is_unloaded;           /* its volume was, since the job is there */
    atomic_bool is_removed;
};

struct srv_watch {
    struct srv_watch *next;
    struct srv_jobs *jobs;
    struct srv_path_job *job;
    struct srv_watcher watcher;
    char last[32];  /* id of the event that it has */
    double told_ms; /* when it was told anything */
    bool is_asleep;
};

struct srv_jobs {
    struct srv_jobs_options options;
    struct srv_folder folder;
    pthread_mutex_t records; /* of changes to records; held before the mutex, and with the store */
    pthread_mutex_t mutex;
    pthread_cond_t wake;       /* the thread: something to do, an answer, stop */
    struct srv_path_job *list; /* oldest first */
    struct srv_path_job *gone; /* their records say so: to be removed from the disk */
    struct srv_path_owner *owners;
    uint64_t turn;       /* rises with each that is given */
    unsigned count;      /* of paths, and of those that are being made */
    uint64_t bytes;      /* of all files */
    uint64_t generation; /* of what jobs wait for: the volumes' states, bytes */
    struct srv_watch *watches;
    atomic_bool stop;
    bool is_running;
    pthread_t thread;
    struct sp_encoder *encoder; /* the thread's */
};

/* With the mutex held: what jobs wait for may have changed. */
void srv_jobs_unblock(struct srv_jobs *jobs);
/* With the mutex held: an event for all who watch the job, and one reference less. */
void srv_jobs_tell(struct srv_jobs *jobs, const struct srv_path_job *job);
void srv_job_unref(struct srv_path_job *job);
/* Where it hangs in the list; on NULL if it is not there. */
struct srv_path_job **srv_job_find(struct srv_jobs *jobs, const char *id);
bool srv_job_missing(const char *id, struct sp_error *err); /* false */
const char *srv_job_state_name(const struct srv_path_job *job);
void srv_job_note(const struct srv_path_job *job, struct srv_job_note *note);

/* Room (room.c). With the mutex held, besides request, has and take. */

/* One more path of this owner, who may be new. NULL: SP_ERR_MEMORY. */
struct srv_path_owner *srv_room_enter(struct srv_jobs *jobs, const char *name,
                                      struct sp_error *err);
/* The same if there may be one more: SP_ERR_BUDGET, as srv_jobs_add() tells it. */
struct srv_path_owner *srv_room_request(struct srv_jobs *jobs, const char *name, bool *is_full,
                                        struct sp_error *err);
/* A path of this owner less; the owner stays until its files are gone, too. */
void srv_room_leave(struct srv_jobs *jobs, struct srv_path_owner *owner);
void srv_room_release(struct srv_jobs *jobs, struct srv_path_owner *owner);
/* Is there room for so many bytes more of a job in the list? SP_ERR_BUDGET, with `what`, say
 * "frame 7 has", in front of the bytes. take() takes it, until give(). */
bool srv_room_has(struct srv_jobs *jobs, struct srv_path_job *job, uint64_t bytes, const char *what,
                  struct sp_error *err);
bool srv_room_take(struct srv_jobs *jobs, struct srv_path_job *job, uint64_t bytes,
                   const char *what, struct sp_error *err);
void srv_room_give(struct srv_jobs *jobs, struct srv_path_job *job, uint64_t bytes);
/* For files that are there already. */
void srv_room_add(struct srv_jobs *jobs, struct srv_path_job *job, uint64_t bytes);

/* Records, without the mutex. Fail and remove: with that of records, for jobs that are not removed.
 */
proto_json *srv_record_read(struct srv_jobs *jobs, const char *id, struct sp_error *err);
struct srv_path *srv_record_path(const proto_json *record, struct sp_error *err);
bool srv_record_put(struct srv_jobs *jobs, const struct srv_path_job *job,
                    const struct srv_path *path, const proto_json *body,
                    const struct sp_view *defaults, struct sp_error *err);
void srv_record_fail(struct srv_jobs *jobs, const char *id, const char *reason);
bool srv_record_remove(struct srv_jobs *jobs, const char *id, struct sp_error *err);
bool srv_record_is_removed(const proto_json *record);
/* "000012.png". */
void srv_job_file_name(const struct srv_path_output *output, uint32_t frame, char name[32]);
#define SRV_JOB_MOVIE "movie.webm"

/* The thread; `user` is the jobs. */
void *srv_jobs_main(void *user);

#endif
