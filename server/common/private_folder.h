/* SPDX-License-Identifier: Apache-2.0
 *
 * Folders of objects, ROOT/ID/NAME, where ID has 32 hexadecimal digits; and private roots in
 * $TMPDIR, which the daemon removes when it ends. A process holds the lock of its private root
 * until it has removed the root. The next process removes the roots of killed processes.
 */
#ifndef SRV_COMMON_PRIVATE_FOLDER_H
#define SRV_COMMON_PRIVATE_FOLDER_H

#include <stdbool.h>

#include "sp/status.h"

enum { SRV_FOLDER_BYTES = 512, SRV_FILE_BYTES = 640 };

/* True for 32 hexadecimal digits. */
bool srv_folder_is_id(const char *name);

/* Removes the roots of killed processes with this prefix, then creates and locks a new one. *lock
 * is the descriptor that holds the lock. False: SP_ERR_IO, SP_ERR_INVALID ($TMPDIR is too long). */
bool srv_private_folder_open(const char *prefix, char path[SRV_FOLDER_BYTES], int *lock,
                             struct sp_error *err);
/* Removes the root, which must be empty, and its lock. */
void srv_private_folder_close(const char *path, int lock);

/* Removes ROOT/ID with its files and folders of files. False: something is left; errno says why. */
bool srv_folder_remove_id(const char *root, const char *id);

#endif
