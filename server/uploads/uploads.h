/* SPDX-License-Identifier: Apache-2.0
 *
 * Uploads: files that clients send in parts, to be loaded as volumes.
 *
 *   add ─► receiving ─► complete ─► loaded by the catalog ─► gone
 *              └── no byte for a time, or removed ─────────► gone
 *
 * An upload is a folder ROOT/ID. Its file "info" has its description and the number of valid bytes.
 * Its folder "files" has the data: under the name "data" and the extension of the format, or under
 * its own name if the reader finds other files by that name. A header (.nhdr, .json) whose samples
 * are in other files has companions: separate uploads whose data lies beside the header, under the
 * names that the client gave. The folder contains nothing else, and the importer opens nothing
 * outside of it. The declared size counts against the limits from the beginning.
 *
 * An upload belongs to the token that began it. `by` is the name of the requesting token, NULL = an
 * admin. For other tokens the upload does not exist.
 *
 * All functions are thread-safe. The comment of a function says if it waits for the disk; HTTP
 * threads let the disk thread call such functions.
 */
#ifndef SRV_UPLOADS_UPLOADS_H
#define SRV_UPLOADS_UPLOADS_H

#include <limits.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "common/private_folder.h"
#include "common/work_queue.h"
#include "config/tokens.h"
#include "ops/metrics.h"
#include "sp/volume.h"

struct srv_uploads;

enum { SRV_UPLOAD_ID_BYTES = 33, SRV_UPLOAD_NAME_BYTES = NAME_MAX + 1 };

struct srv_uploads_options {
    const char *folder; /* keeps unfinished uploads across restarts; NULL = a private folder that is
                           removed at the end */
    bool keeps_loaded;  /* the file of a loaded volume stays, because a restart loads it again */
    uint64_t bytes_max; /* declared sizes of all uploads together, and of one; at least 1 */
    unsigned count_max;
    double expiry_ms; /* an upload ends this long after its last byte */
    double begin_ms;  /* an upload without any byte ends this long after its beginning; at most
                         expiry_ms */
    struct srv_tokens *tokens;   /* give the quotas; NULL = no quotas */
    struct srv_metrics *metrics; /* NULL = nothing is counted */
    struct srv_work_queue *disk;
};

struct srv_upload_info {
    char id[SRV_UPLOAD_ID_BYTES];
    /* companion: the upload of its header; "" = not a companion */
    char header[SRV_UPLOAD_ID_BYTES];
    char name[SRV_UPLOAD_NAME_BYTES]; /* name that the client gave, made safe to show */
    char owner[SRV_TOKEN_NAME_BYTES]; /* name of the token that added it */
    uint64_t bytes, offset;           /* declared; received so far */
    int64_t modified_ms; /* when the client's file changed last, since 1970; 0 = not known */
    double expires_ms;   /* from now; INFINITY = it belongs to a volume */
    bool is_private;     /* its folder is removed when the daemon ends */
};

/* Opens the folder, removes what cannot be continued there, and finds the uploads of an earlier
 * run. Waits for the disk. NULL with *err set: SP_ERR_IO, SP_ERR_INVALID, SP_ERR_MEMORY. */
struct srv_uploads *srv_uploads_create(const struct srv_uploads_options *options, double now_ms,
                                       struct sp_error *err);
/* Call it after the disk thread ended. Accepts NULL; nulls *uploads. */
void srv_uploads_destroy(struct srv_uploads **uploads);

/* Makes the name of a client safe to show, and safe as the name of a file: its last component,
 * without hidden characters (protocol/text.h), cut to fit. SP_ERR_INVALID at "/name": nothing is
 * left, or "." or "..". */
bool srv_upload_name(const char *given, size_t length, char name[SRV_UPLOAD_NAME_BYTES],
                     struct sp_error *err);

struct srv_upload_request {
    const char *owner;     /* name of the token */
    const char *name;      /* of srv_upload_name() */
    const char *extension; /* of the format, a constant (".nrrd"); NULL = a companion */
    const char *header;    /* of a companion: the id of its header's upload; NULL = none */
    bool is_admin;         /* `header` may be any token's */
    uint64_t bytes;
    int64_t modified_ms; /* 0 = not known */
};
/* Begins an upload. Writes two small files. SP_ERR_TOO_LARGE (for the daemon or the token),
 * SP_ERR_QUOTA (of the token), SP_ERR_BUDGET (all uploads together, or the disk), SP_ERR_INVALID
 * ("/header", "/name"), SP_ERR_NOT_FOUND ("/header"), SP_ERR_NOT_READY (the header belongs to a
 * volume), SP_ERR_IO, SP_ERR_MEMORY. */
bool srv_uploads_add(struct srv_uploads *uploads, const struct srv_upload_request *request,
                     double now_ms, struct srv_upload_info *info, struct sp_error *err);
/* SP_ERR_NOT_FOUND. */
bool srv_uploads_get(struct srv_uploads *uploads, const char *id, const char *by, double now_ms,
                     struct srv_upload_info *info, struct sp_error *err);
/* Gets upload i of the uploads that `by` may see, in the order of adding; false past the end. */
bool srv_uploads_at(struct srv_uploads *uploads, unsigned i, const char *by, double now_ms,
                    struct srv_upload_info *info);
/* Removes an upload, a header with its companions; the disk thread removes the files.
 * SP_ERR_NOT_FOUND, SP_ERR_NOT_READY (it belongs to a volume). */
bool srv_uploads_remove(struct srv_uploads *uploads, const char *id, const char *by,
                        struct sp_error *err);
/* Waits until an upload that srv_uploads_add() began is on the disk, so that it survives a crash of
 * the machine. False for a private folder, or if the disk fails. Waits for the disk. */
bool srv_uploads_sync(struct srv_uploads *uploads, const struct srv_upload_info *info);
/* The same for the removal of an upload. Call it on the disk thread, after the removal. Waits for
 * the disk. */
bool srv_uploads_sync_removal(struct srv_uploads *uploads, const char *id);
/* Removes expired uploads. */
void srv_uploads_tick(struct srv_uploads *uploads, double now_ms);

struct srv_uploads_numbers {
    unsigned count;
    uint64_t declared_bytes, received_bytes, bytes_max;
    unsigned own_count;                /* uploads of one token */
    uint64_t own_bytes, own_bytes_max; /* own_bytes_max: the limit if no other token had uploads */
    uint64_t free_bytes; /* bytes that the token can declare now, also within bytes_max and the free
                            space of the disk */
    unsigned free_count;
};
/* `owner` = the name of the token whose own numbers are wanted. */
void srv_uploads_numbers(struct srv_uploads *uploads, const char *owner,
                         struct srv_uploads_numbers *numbers);

/* Receiving. One writer at a time: a new one, from a client that lost its connection, replaces an
 * older one, whose next write fails. */

struct srv_upload_writer {
    struct srv_uploads *uploads;
    char id[SRV_UPLOAD_ID_BYTES];
    uint64_t number, start, position; /* number: of the writer; start: the offset at its begin */
    bool is_atomic; /* the bytes count only at the end, when their checksum is known */
    int fd;         /* -1 = not open yet */
};

/* Begins to write at `offset`, which must be the current offset of the upload. `size` is the number
 * of bytes that will follow, 0 = unknown. SP_ERR_NOT_FOUND, SP_ERR_INVALID (offset; *at is the
 * right one), SP_ERR_TOO_LARGE (more bytes than are missing). */
bool srv_upload_begin(struct srv_uploads *uploads, const char *id, const char *by, uint64_t offset,
                      uint64_t size, bool is_atomic, struct srv_upload_writer *writer, uint64_t *at,
                      struct sp_error *err);
/* Writes bytes. Waits for the disk. SP_ERR_NOT_FOUND (removed meanwhile), SP_ERR_CANCELLED (another
 * writer continues), SP_ERR_TOO_LARGE (more than was declared), SP_ERR_BUDGET (the disk is full),
 * SP_ERR_IO. */
bool srv_upload_write(struct srv_upload_writer *writer, const void *bytes, size_t size,
                      double now_ms, struct sp_error *err);
/* Ends writing, also after an error. keeps false: the bytes of an atomic writer do not count. Waits
 * for the disk: afterwards the valid bytes and their number are on the disk, unless the folder is
 * private. Writes the state of the upload to *info. Errors as above. */
bool srv_upload_end(struct srv_upload_writer *writer, bool keeps, double now_ms,
                    struct srv_upload_info *info, struct sp_error *err);

/* For the catalog (struct srv_catalog_options). `user` is the uploads. Opens a header with its
 * companions. SP_ERR_NOT_FOUND, SP_ERR_NOT_READY (bytes are missing), SP_ERR_INVALID (a companion).
 */
bool srv_upload_open(void *user, const char *id, char path[PATH_MAX],
                     char name[SRV_UPLOAD_NAME_BYTES], struct sp_error *err);
enum srv_upload_end {
    SRV_UPLOAD_LOADED,  /* the volume has its own copy of the data */
    SRV_UPLOAD_UNUSED,  /* the volume failed or was removed: the upload is removed */
    SRV_UPLOAD_RETURNED /* the volume was not loaded after all: the upload stays */
};
void srv_upload_close(void *user, const char *id, enum srv_upload_end end);

#endif
