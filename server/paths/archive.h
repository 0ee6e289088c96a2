/* SPDX-License-Identifier: Apache-2.0
 *
 * All frames of a path as one tar file, generated while it is read: only the current file is open.
 * Only archive.c uses libarchive.
 */
#ifndef SRV_PATHS_ARCHIVE_H
#define SRV_PATHS_ARCHIVE_H

#include <stdint.h>
#include <sys/types.h>

#include "paths/folder.h"

struct srv_archive;

/* Opens an archive of the files 000000.EXT and so on, `count` files; `sealed`: each must have a
 * seal. NULL: SP_ERR_MEMORY. */
struct srv_archive *srv_archive_create(const struct srv_folder *folder, const char *id,
                                       const char *extension, uint32_t count, bool sealed,
                                       struct sp_error *err);
void srv_archive_destroy(struct srv_archive **archive);
/* Reads the next bytes, at most `size`. 0 = the end, −1 = a file is missing, damaged or cannot be
 * read. */
ssize_t srv_archive_read(void *archive, char *bytes, size_t size);

#endif
