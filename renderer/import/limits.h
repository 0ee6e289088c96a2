/* SPDX-License-Identifier: Apache-2.0
 *
 * What the child process gives up before it looks at a file: memory beyond a margin, CPU time
 * beyond the timeout, writing files, reading those outside some folders (Landlock, from Linux 5.13
 * on), core dumps, new privileges, descriptors that it did not ask for, and the system calls that
 * reach other processes, the network or the file tree for writing.
 */
#ifndef SP_IMPORT_LIMITS_H
#define SP_IMPORT_LIMITS_H

#include <stdbool.h>
#include <stdint.h>

#include "sp/status.h"

/* Address space for programs, libraries and buffers, besides the samples. [bytes] */
#define IMPORT_MARGIN_BYTES (UINT64_C(1) << 30)

/* Call before anything of the file is read but what tells its format, and while there is one
 * thread. Closes all descriptors from `first_fd` on; from then on files are opened in and below
 * `readable` alone, if the kernel can do that: folders and files, up to a NULL. The first must be
 * there. */
bool import_limits_set(int cpu_seconds, int first_fd, const char *const *readable,
                       const char *shown, struct sp_error *err);

/* Can it? */
bool import_limits_confine_reading(void);

/* Makes room for the samples, once and for all. */
bool import_limits_for_samples(uint64_t bytes, const char *shown, struct sp_error *err);

/* False in a build with a sanitizer, which bears neither the memory limit nor the filter. */
bool import_limits_complete(void);

#endif
