/* SPDX-License-Identifier: Apache-2.0
 *
 * The sandbox of the import process, which reads untrusted files, and of splat-fetch, which talks
 * to hosts.
 *
 *   rlimits     memory, CPU time, 64 descriptors, no written bytes, no core dump
 *   Landlock    reads files in some folders only (Linux 5.13 or later); no TCP servers (6.7), and
 *               without the network no TCP clients
 *   seccomp     refuses calls that reach other processes, the network, or the file tree for writing
 *   prctl       no new privileges; the process ends with its parent
 */
#ifndef SP_IMPORT_SANDBOX_H
#define SP_IMPORT_SANDBOX_H

#include <stdbool.h>
#include <stdint.h>

#include "sp/status.h"

/* Address space for the program, its libraries and their buffers, beside the samples. [bytes] */
#define IMPORT_MARGIN_BYTES (UINT64_C(1) << 30)

struct import_sandbox {
    int cpu_seconds;             /* limit of CPU time; 0 = none */
    int first_fd;                /* this descriptor and all above it are closed */
    const char *const *readable; /* folders and files that stay readable, up to a NULL; the first
                                    must exist, missing others are skipped. Without Landlock all
                                    files stay readable */
    bool has_network;            /* may connect to other hosts, but not listen */
};

/* Enters the sandbox for good. Call it while the process has one thread, and before it reads more
 * of the file than the first bytes, which tell the format. `title`: the path that errors name.
 * False with SP_ERR_IO on failure; the process must then exit. */
bool import_sandbox_enter(const struct import_sandbox *sandbox, const char *title,
                          struct sp_error *err);

/* Raises the memory limit once to the margin and `bytes` of samples; it cannot rise again. */
bool import_sandbox_allow_samples(uint64_t bytes, const char *title, struct sp_error *err);

/* True if the kernel can confine reading to folders. */
bool import_sandbox_confines_reading(void);

/* False in a sanitizer build, which works neither with the memory limit nor with seccomp. */
bool import_sandbox_is_complete(void);

#endif
