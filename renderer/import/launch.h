/* SPDX-License-Identifier: Apache-2.0
 *
 * The parent's side of an import: starts `splat-import` for one file, checks what it says, and
 * turns the memory that it filled into a volume. Safe in a process with many threads: nothing runs
 * between fork and exec but system calls, descriptors close on exec, and the child is waited for by
 * its id alone.
 */
#ifndef SP_IMPORT_LAUNCH_H
#define SP_IMPORT_LAUNCH_H

#include "sp/volume.h"

/* Descriptors that the child finds open, and nothing else but standard error. */
enum { SP_IMPORT_SOCKET = 3, SP_IMPORT_MEMORY = 4, SP_IMPORT_FILE = 5 };

/* sp_volume_load() for a path. */
struct sp_volume *sp_import(const char *path, const struct sp_load_options *options,
                            struct sp_error *err);

#endif
