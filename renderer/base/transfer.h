/* SPDX-License-Identifier: Apache-2.0
 *
 * Whole blocks of bytes from and to a place of a file, and files without a name.
 */
#ifndef SP_BASE_TRANSFER_H
#define SP_BASE_TRANSFER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sp/status.h"

/* False with errno set; ENODATA = the file ends before. */
bool sp_read_at(int fd, void *out, size_t size, uint64_t at);
bool sp_write_at(int fd, const void *bytes, size_t size, uint64_t at);

/* The first data of a file in [at, end), behind holes: [*from, *to). Both are `end` if only holes
 * follow. On a file system without holes all is data. Moves the position of the descriptor. */
void sp_skip_holes(int fd, uint64_t at, uint64_t end, uint64_t *from, uint64_t *to);

/* True if all bytes are 0. size > 0. */
bool sp_is_zero(const char *bytes, size_t size);

/* As sp_read_at(). Holes are not read, so that they take no place in the page cache. */
bool sp_read_sparse(int fd, void *out, size_t size, uint64_t at);

/* As sp_write_at(), into a file that reads as zeros there: blocks of zeros stay holes. */
bool sp_write_sparse(int fd, const char *bytes, size_t size, uint64_t at);

/* True if the file has no data there, so that it reads as zeros. */
bool sp_is_hole(int fd, size_t size, uint64_t at);

/* A file without a name in that folder, which vanishes when it is closed; −1 with *err set. */
int sp_temporary_file(const char *folder, struct sp_error *err);

#endif
