/* SPDX-License-Identifier: Apache-2.0 */
#ifndef CLI_OUTPUT_H
#define CLI_OUTPUT_H

#include <signal.h>
#include <stdbool.h>
#include <stddef.h>

#include "sp/status.h"

/* A file that is written completely or not at all: the bytes go into a temporary file beside it,
 * which is synchronized and renamed at the end. Signals that would end the program are blocked
 * meanwhile. A device or pipe is written directly; "-" is standard output. */
struct output {
    const char *path; /* owned by the caller; NULL = not open */
    char *target;     /* the path after links; NULL = written directly */
    char *temporary;
    int fd;
    sigset_t signals; /* the signal mask before */
};

/* Call these in order. A failure removes the file and closes *output. */
bool output_open(struct output *output, const char *path, struct sp_error *err);
bool output_add(struct output *output, const void *bytes, size_t size, struct sp_error *err);
bool output_close(struct output *output, struct sp_error *err);
/* Removes the added bytes; call it before output_close(). False if that is impossible, as for a
 * pipe. */
bool output_restart(struct output *output);
/* Removes the file. Accepts an output that is not open. */
void output_drop(struct output *output);
/* Opens, writes and closes a file in one call. */
bool output_write(const char *path, const void *bytes, size_t size, struct sp_error *err);

/* Creates a folder in an existing one. Succeeds if it exists; *is_new tells whether it was created.
 */
bool output_make_folder(const char *path, bool *is_new, struct sp_error *err);
/* Checks, without changing anything, whether the folder can be created or the file can be written.
 */
bool output_check(const char *path, bool is_folder, struct sp_error *err);

/* Reads a file, or standard input for "-", of at most `limit` bytes. Returns allocated bytes with a
 * terminating 0; NULL with *err set on failure. */
char *input_read(const char *path, size_t limit, size_t *size, struct sp_error *err);

#endif
