/* SPDX-License-Identifier: Apache-2.0
 *
 * The list of uploads (uploads.c), their limits (limits.c), files (files.c) and writers (writer.c).
 */
#ifndef SRV_UPLOADS_UPLOADS_PRIVATE_H
#define SRV_UPLOADS_UPLOADS_PRIVATE_H

#include <pthread.h>

#include "uploads/uploads.h"

enum { SRV_EXTENSION_BYTES = 16, SRV_UPLOAD_PATH_BYTES = SRV_FOLDER_BYTES + NAME_MAX + 64 };

struct srv_upload {
    struct srv_upload *next;
    char id[SRV_UPLOAD_ID_BYTES], header[SRV_UPLOAD_ID_BYTES]; /* header: "" = no companion */
    char name[SRV_UPLOAD_NAME_BYTES], owner[SRV_TOKEN_NAME_BYTES];
    char extension[SRV_EXTENSION_BYTES]; /* ".nrrd"; "" = a companion */
    bool keeps_name; /* the file keeps its own name instead of "data", because the reader finds
                        other files of the set by it */
    uint64_t bytes, offset;
    int64_t modified_ms; /* 0 = not known */
    uint64_t writer;     /* number of the newest writer */
    double used_ms; /* when its last byte came; for a header, also the last byte of a companion */
    bool is_begun;  /* a byte came in this run */
    bool is_of_volume; /* the catalog has opened it */
};

struct srv_uploads {
    struct srv_uploads_options options;
    char root[SRV_FOLDER_BYTES];
    bool is_private;
    int lock;
    pthread_mutex_t mutex; /* guards what follows */
    struct srv_upload *first, **last;
    unsigned count;
    uint64_t declared_bytes, next_writer;
};

/* Returns the link in the list that points to the upload, or the last link if there is none. With
 * the mutex held. */
struct srv_upload **srv_uploads_find(struct srv_uploads *uploads, const char *id);
/* Returns the upload. NULL if there is none, or if it belongs to a token other than `by`; by NULL =
 * any token. With the mutex held. */
struct srv_upload *srv_uploads_find_by(struct srv_uploads *uploads, const char *id, const char *by);
bool srv_upload_not_found(const char *id, struct sp_error *err);
void srv_upload_describe(const struct srv_uploads *uploads, const struct srv_upload *upload,
                         double now_ms, struct srv_upload_info *info);

/* Limits. */
/* With the mutex held: false if an upload of `bytes` is over a limit. `quota` is the owner's. */
bool srv_uploads_may_add(const struct srv_uploads *uploads, const char *owner,
                         const struct srv_quota *quota, uint64_t bytes, struct sp_error *err);
/* Without the mutex; all zero without --token-file. */
struct srv_quota srv_uploads_quota_of(const struct srv_uploads *uploads, const char *owner);

/* Files. The path of the data. */
void srv_upload_path(const struct srv_uploads *uploads, const struct srv_upload *upload,
                     char path[SRV_UPLOAD_PATH_BYTES]);
/* Creates the folder with an empty data file and the info. False: nothing is left. */
bool srv_upload_files_create(const struct srv_uploads *uploads, const struct srv_upload *upload,
                             struct sp_error *err);
/* Replaces the file "info". syncs: the file is on the disk afterwards, otherwise only in the cache
 * of the system. */
bool srv_upload_files_save(const struct srv_uploads *uploads, const struct srv_upload *upload,
                           bool syncs, struct sp_error *err);
/* Reads the info of a folder. False: it cannot be continued. */
bool srv_upload_files_read(const struct srv_uploads *uploads, const char *id,
                           struct srv_upload *upload);
/* Makes an upload invisible to the next run and to its header. Fast; srv_folder_remove_id() removes
 * the rest later. */
void srv_upload_files_forget(const struct srv_uploads *uploads, const struct srv_upload *upload);
/* Returns the free bytes of the disk. */
uint64_t srv_upload_files_free(const struct srv_uploads *uploads);
/* The error of a call that failed with errno: SP_ERR_BUDGET if the disk is full. */
bool srv_upload_disk_error(const char *what, struct sp_error *err);

#endif
