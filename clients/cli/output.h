/* SPDX-License-Identifier: Apache-2.0 */
#ifndef CLI_OUTPUT_H
#define CLI_OUTPUT_H

#include <stdbool.h>
#include <stddef.h>

#include "sp/status.h"

/* Writes a file whole or not at all: into a new file beside it, which is then renamed. What exists
 * and is no regular file (a device, a pipe) is written as it is; "-" is standard output. */
bool output_write(const char *path, const void *bytes, size_t size, struct sp_error *err);

/* All of a file, or of standard input for "-", at most `limit` bytes. Allocated, NUL-terminated;
 * NULL with *err set. */
char *input_read(const char *path, size_t limit, size_t *size, struct sp_error *err);

#endif
