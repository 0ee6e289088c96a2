/* SPDX-License-Identifier: Apache-2.0
 *
 * Where the frames of jobs lie: ROOT/ID/NAME, one folder a job. A file is there whole or not at
 * all: it is written beside itself, synchronised and then renamed, so that what is found after a
 * crash can be used. Functions without a lock; one thread writes.
 */
#ifndef SRV_PATHS_FOLDER_H
#define SRV_PATHS_FOLDER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sp/status.h"

enum { SRV_FOLDER_BYTES = 512, SRV_FILE_BYTES = 640 };

struct srv_folder {
    char root[SRV_FOLDER_BYTES];
    bool is_private; /* a new one in $TMPDIR, which goes with the daemon */
    int lock;        /* on a private one, while there is the process; −1 = none */
};

/* `state`/paths, made with mode 0700 if it is not there; state NULL = a private one, before which
 * those of processes that were killed are removed. SP_ERR_IO. */
bool srv_folder_open(struct srv_folder *folder, const char *state, struct sp_error *err);
/* Removes it, if it is private. */
void srv_folder_close(struct srv_folder *folder);

void srv_folder_path(const struct srv_folder *folder, const char *id, const char *name,
                     char path[SRV_FILE_BYTES]);
/* SP_ERR_IO with the reason: a full disk … Nothing is left behind then. */
bool srv_folder_write(const struct srv_folder *folder, const char *id, const char *name,
                      const void *head, size_t head_size, const void *bytes, size_t size,
                      struct sp_error *err);
/* Makes what another program has written to `part` the file `name`. */
bool srv_folder_take(const struct srv_folder *folder, const char *id, const char *part,
                     const char *name, struct sp_error *err);
/* Bytes of a file; false: there is none. */
bool srv_folder_size(const struct srv_folder *folder, const char *id, const char *name,
                     uint64_t *size);
void srv_folder_remove_file(const struct srv_folder *folder, const char *id, const char *name);
/* Removes the files of a job that are not known. */
void srv_folder_clean(const struct srv_folder *folder, const char *id,
                      bool (*known)(void *user, const char *name), void *user);
/* Removes a job's folder with all that is in it, for good; there may be none. SP_ERR_IO. */
bool srv_folder_remove(const struct srv_folder *folder, const char *id, struct sp_error *err);
/* The folders of ids that are not known: how many, and the bytes of their files. */
unsigned srv_folder_strays(const struct srv_folder *folder,
                           bool (*known)(void *user, const char *id), void *user, uint64_t *bytes);

#endif
