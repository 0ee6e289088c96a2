/* SPDX-License-Identifier: Apache-2.0
 *
 * Opens files and folders below one folder only. The parent uses it for the requested file, the
 * readers for files that a header names.
 */
#ifndef SP_IMPORT_CONFINE_H
#define SP_IMPORT_CONFINE_H

#include <limits.h>
#include <stdbool.h>
#include <stdint.h>

#include "sp/status.h"

/* Opens the regular file `path` for reading if it lies below `root` after every symbolic link is
 * resolved. `root` is absolute and resolved. Nothing outside of `root` is looked at: links there
 * are not followed, and no answer tells what exists there. Never blocks on a FIFO and never opens a
 * device.
 * Returns a descriptor that closes on exec, or -1 with *err set: SP_ERR_NOT_FOUND, SP_ERR_DENIED
 * (outside the root), SP_ERR_INVALID (not a regular file), SP_ERR_IO. err->place is `title`. `real`
 * receives the resolved path, *size the file's size in bytes. */
int sp_open_confined(const char *root, const char *path, const char *title, char real[PATH_MAX],
                     uint64_t *size, struct sp_error *err);

/* The same for a folder, which may be the root itself. SP_ERR_INVALID: not a folder. */
int sp_open_confined_folder(const char *root, const char *path, const char *title,
                            char real[PATH_MAX], struct sp_error *err);

/* Fails with SP_ERR_NOT_FOUND, and says how a source is written where the name looks like one.
 * Returns false. */
bool sp_fail_missing(struct sp_error *err, const char *title);

/* After an error SP_ERR_NOT_FOUND of a file that another one names: adds the remedy. */
void sp_tell_namer(struct sp_error *err, const char *namer);

/* True if `real` lies below `root`; both are resolved. */
bool sp_is_below(const char *root, const char *real);

#endif
