/* SPDX-License-Identifier: Apache-2.0
 *
 * A child process that reads for this process: functions to start it, to exchange messages, and to
 * end it. Safe in a process with many threads: only system calls run between fork and exec,
 * descriptors close on exec, and the parent waits for the child by its process id.
 */
#ifndef SP_IMPORT_CHILD_H
#define SP_IMPORT_CHILD_H

#include <limits.h>
#include <sys/types.h>

#include "data/import/handover.h"

/* The open descriptors of the child, in addition to the standard ones. The input comes last. */
enum { SP_IMPORT_SOCKET = 3, SP_IMPORT_MEMORY = 4, SP_IMPORT_FILE = 5 };

/* The arguments of splat-import. MODE is one of those below, or "" to read all samples. */
enum sp_import_argument {
    SP_ARGUMENT_PROGRAM,
    SP_ARGUMENT_PATH,
    SP_ARGUMENT_ROOT,
    SP_ARGUMENT_FOLDER,
    SP_ARGUMENT_CPU_SECONDS,
    SP_ARGUMENT_MODE,
    SP_ARGUMENT_PATTERN,
    SP_ARGUMENT_STEP,
    SP_ARGUMENT_LEVEL,
    SP_ARGUMENT_SERIES,
    SP_ARGUMENT_AS,
    SP_ARGUMENT_UNIT,
    SP_ARGUMENT_VECTORS,
    SP_ARGUMENT_FIELD,
    SP_ARGUMENT_COUNT
};
#define SP_IMPORT_CHUNKS "chunks" /* reads chunks, as they are asked for */
#define SP_IMPORT_LIST "list"     /* lists series (sp/series.h) */

/* What splat-import reads. All strings are borrowed and not NULL; "" = the reader chooses. */
struct sp_import_request {
    const char *path, *root, *folder;
    const char *pattern; /* of a time series of files (numbered.h); "" = one file */
    const struct sp_source_parts *parts;
    uint32_t step;
    bool has_step;
    const char *mode; /* "", SP_IMPORT_CHUNKS or SP_IMPORT_LIST */
};

struct sp_import_child {
    const char *title;  /* the name in errors, owned by the caller */
    int timeout_ms;     /* its limit of CPU time, for errors */
    pid_t pid;          /* 0 = none */
    int socket, memory; /* this end; −1 = not open */
    bool is_sparse;     /* its memory is a file that was not allocated */
};

/* Finds a program: `given`, or else the program `name` beside this program, beside the library, or
 * in the installation. SP_ERR_IO. */
bool sp_import_find_program(const char *name, const char *given, char path[PATH_MAX],
                            struct sp_error *err);

/* Starts the program with a memory file, a socket, and the `count` descriptors fds[], at most 2,
 * which the child has from SP_IMPORT_FILE on. The memory file is an unnamed file in the folder
 * `scratch` (NULL = a memfd). Replaces fds[] by other descriptors, which the caller closes.
 * SP_ERR_IO. */
bool sp_import_child_start(struct sp_import_child *child, const char *program, char *const argv[],
                           const char *scratch, int fds[], unsigned count, struct sp_error *err);

/* Starts splat-import with these arguments; child->timeout_ms limits its CPU time. Otherwise as
 * sp_import_child_start(). */
bool sp_import_child_start_reader(struct sp_import_child *child, const char *program,
                                  const struct sp_import_request *request, const char *scratch,
                                  int fds[], unsigned count, struct sp_error *err);

/* Receives and checks the next message. Calls check() every 50 ms; check() returns false with *err
 * set to give up. False with *err set, or with *ended if the child closed its end. */
bool sp_import_child_receive(struct sp_import_child *child, struct sp_handover *message,
                             bool (*check)(void *user, struct sp_error *err), void *user,
                             bool *ended, struct sp_error *err);

/* Sends a message; false if the child is gone. */
bool sp_import_child_send(struct sp_import_child *child, const struct sp_handover *message);

/* Gives the memory its size and sends GO. SEALED memory and a SCRATCH file are allocated now, so
 * that a lack of space is an error here. A SPARSE file is not: if the disk fills up, a read into it
 * fails with EFAULT, and a write kills the child by SIGBUS, which sp_import_child_fail_ended()
 * explains. */
enum sp_import_memory { SP_IMPORT_SEALED, SP_IMPORT_SCRATCH, SP_IMPORT_SPARSE };
bool sp_import_child_provide(struct sp_import_child *child, uint64_t bytes,
                             enum sp_import_memory kind, struct sp_error *err);

/* Fails with the error of an ERROR message, or because any other message came out of order. */
bool sp_import_child_refuse(const struct sp_import_child *child, const struct sp_handover *message,
                            struct sp_error *err);

/* Kills the child if it still runs, and returns its exit status. */
int sp_import_child_reap(struct sp_import_child *child);
/* Like sp_import_child_reap(), and fails with an error that tells how the child ended. */
bool sp_import_child_fail_ended(struct sp_import_child *child, struct sp_error *err);
/* Kills the child and closes all descriptors. May be called twice. */
void sp_import_child_close(struct sp_import_child *child);

#endif
