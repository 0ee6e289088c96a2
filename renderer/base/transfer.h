/* SPDX-License-Identifier: Apache-2.0
 *
 * Reads and writes whole blocks of bytes at a byte offset of a file, skips holes, and creates
 * temporary files. All functions are thread-safe.
 */
#ifndef SP_BASE_TRANSFER_H
#define SP_BASE_TRANSFER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sp/status.h"

/* Read or write all `size` bytes at offset `at`. On failure return false with errno set; ENODATA =
 * the file ends before at + size. */
bool sp_read_at(int fd, void *out, size_t size, uint64_t at);
bool sp_write_at(int fd, const void *bytes, size_t size, uint64_t at);

/* Skips the holes at the start of [at, end): the first data of the range lies in [*from, *to). Both
 * are `end` if the range has only holes. On a file system without holes everything is data. Moves
 * the file position of the descriptor. */
void sp_skip_holes(int fd, uint64_t at, uint64_t end, uint64_t *from, uint64_t *to);

/* True if all bytes are 0. size > 0. */
bool sp_is_zero(const char *bytes, size_t size);

/* Like sp_read_at(), but does not read holes, so that they occupy no memory in the page cache. */
bool sp_read_sparse(int fd, void *out, size_t size, uint64_t at);

/* Like sp_write_at(), for a range that reads as zeros so far: blocks of zeros stay holes. */
bool sp_write_sparse(int fd, const char *bytes, size_t size, uint64_t at);

/* True if the range [at, at + size) of the file is a hole, which reads as zeros. */
bool sp_is_hole(int fd, size_t size, uint64_t at);

/* Opens a file without a name in `folder` and returns its descriptor. The system deletes the file
 * when it is closed. Returns −1 with *err set on failure. */
int sp_temporary_file(const char *folder, struct sp_error *err);

#endif
