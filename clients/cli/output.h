/* SPDX-License-Identifier: Apache-2.0 */
#ifndef CLI_OUTPUT_H
#define CLI_OUTPUT_H

#include <signal.h>
#include <stdbool.h>
#include <stddef.h>

#include "sp/status.h"

/* A file that is written whole or not at all: into a new file beside it, which is renamed when all
 * of it, and then its name, is on the disk. Signals that would end the program wait meanwhile. What
 * exists and is no regular file (a device, a pipe) is written as it is; "-" is standard output. */
struct output {
    const char *path; /* the caller's; NULL = not open */
    char *target;     /* where links lead to; NULL = written as it is */
    char *temporary;
    int fd;
    sigset_t signals; /* that were held before */
};

/* One after the other; a failure of any leaves nothing, and *output closed. */
bool output_open(struct output *output, const char *path, struct sp_error *err);
bool output_add(struct output *output, const void *bytes, size_t size, struct sp_error *err);
bool output_close(struct output *output, struct sp_error *err);
/* Before it is closed: takes back what was added; false, and nothing else: that cannot be. */
bool output_restart(struct output *output);
/* Leaves nothing; accepts one that is not open. */
void output_drop(struct output *output);
/* All of these at once. */
bool output_write(const char *path, const void *bytes, size_t size, struct sp_error *err);

/* Makes this folder, in one that is there, unless it is there. *is_new: it was not. */
bool output_make_folder(const char *path, bool *is_new, struct sp_error *err);
/* Could it be made or, if not `is_folder`, written? As far as can be told without doing it. */
bool output_check(const char *path, bool is_folder, struct sp_error *err);

/* All of a file, or of standard input for "-", at most `limit` bytes. Allocated, NUL-terminated;
 * NULL with *err set. */
char *input_read(const char *path, size_t limit, size_t *size, struct sp_error *err);

#endif
