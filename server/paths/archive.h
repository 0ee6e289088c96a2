/* SPDX-License-Identifier: Apache-2.0
 *
 * All frames of a job as one tar, made while it is read: nothing is held but the file at hand. The
 * only file that knows libarchive is archive.c.
 */
#ifndef SRV_PATHS_ARCHIVE_H
#define SRV_PATHS_ARCHIVE_H

#include <stdint.h>
#include <sys/types.h>

#include "paths/folder.h"

struct srv_archive;

/* Files 000000.EXT to the count-th of a job's folder. NULL with *err set when out of memory. */
struct srv_archive *srv_archive_create(const struct srv_folder *folder, const char *id,
                                       const char *extension, uint32_t count, struct sp_error *err);
void srv_archive_destroy(struct srv_archive **archive);
/* The next bytes, at most `size`; 0 = that was all, −1 = a file is gone or cannot be read. */
ssize_t srv_archive_read(struct srv_archive *archive, char *bytes, size_t size);

#endif
