/* SPDX-License-Identifier: Apache-2.0
 *
 * The files of camera paths: ROOT/ID/NAME, one folder per path. A file is complete or absent: it is
 * written under another name, synced and then renamed, so that files found after a crash can be
 * used. A seal of SRV_SEAL_BYTES behind its bytes, "SPLTSEAL" and their number (little-endian),
 * tells a file that was cut off later. The
 * functions take no lock; only one thread writes.
 */
#ifndef SRV_PATHS_FOLDER_H
#define SRV_PATHS_FOLDER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "common/private_folder.h"
#include "sp/status.h"

enum { SRV_SEAL_BYTES = 16 };

struct srv_folder {
    char root[SRV_FOLDER_BYTES];
    bool is_private; /* a new folder in $TMPDIR, removed when the daemon ends */
    int lock;        /* held on a private folder while the process lives; −1 = none */
};

/* Opens `state`/paths, created with mode 0700 if missing. state NULL = a new private folder;
 * private folders of killed processes are removed first. False: SP_ERR_IO, SP_ERR_INVALID. */
bool srv_folder_open(struct srv_folder *folder, const char *state, struct sp_error *err);
/* Removes the folder if it is private. */
void srv_folder_close(struct srv_folder *folder);

void srv_folder_path(const struct srv_folder *folder, const char *id, const char *name,
                     char path[SRV_FILE_BYTES]);
/* Writes `head`, then `bytes` and a seal as one file. False: SP_ERR_IO (for example a full disk),
 * and no file is left. */
bool srv_folder_write(const struct srv_folder *folder, const char *id, const char *name,
                      const void *head, size_t head_size, const void *bytes, size_t size,
                      struct sp_error *err);
/* Appends a seal to the file `part`, syncs it and renames it to `name`. False: SP_ERR_IO, and
 * neither file is left. */
bool srv_folder_publish(const struct srv_folder *folder, const char *id, const char *part,
                        const char *name, struct sp_error *err);
/* Opens a file for reading; the caller closes the descriptor. −1: SP_ERR_NOT_FOUND, SP_ERR_BUDGET
 * (too many open files, or the disk cannot be read), SP_ERR_IO: it is damaged; its seal is missing
 * or tells another size. *size counts the bytes before the seal. `must_have_seal` false: files of
 * earlier versions have none. */
int srv_folder_open_file(const struct srv_folder *folder, const char *id, const char *name,
                         bool must_have_seal, uint64_t *size, struct sp_error *err);
/* Reads the size of a file with its seal. False: there is no such file. */
bool srv_folder_size(const struct srv_folder *folder, const char *id, const char *name,
                     uint64_t *size);
void srv_folder_remove_file(const struct srv_folder *folder, const char *id, const char *name);
/* Removes the files of a path for which known() is false. */
void srv_folder_clean(const struct srv_folder *folder, const char *id,
                      bool (*known)(void *user, const char *name), void *user);
/* Removes a path's folder with its files, and syncs. A missing folder is success. False: SP_ERR_IO.
 */
bool srv_folder_remove(const struct srv_folder *folder, const char *id, struct sp_error *err);
/* Returns the number of folders for which known() is false, and the bytes of their files. */
unsigned srv_folder_strays(const struct srv_folder *folder,
                           bool (*known)(void *user, const char *id), void *user, uint64_t *bytes);

#endif
