/* SPDX-License-Identifier: Apache-2.0
 *
 * Finds the programs and modules that are installed with the library. The search starts at the
 * running program or at the library, so that an installation can be moved as a whole.
 *
 *   build tree     bin/PROGRAM           bin/FILE, also for PROGRAM in tests/
 *   installation   PREFIX/bin/PROGRAM    PREFIX/lib/splatd/FILE
 *                  PREFIX/LIBDIR/libsplat.so, and PROGRAM anywhere
 *
 * LIBDIR may be lib/x86_64-linux-gnu or lib64; the build knows the way from it to lib/splatd.
 */
#ifndef SP_BASE_LOCATE_H
#define SP_BASE_LOCATE_H

#include <limits.h>
#include <stdbool.h>

#include "sp/status.h"

/* Writes the path of `file` to `path` and returns true if the file exists. Otherwise returns false
 * with *err set: SP_ERR_NOT_FOUND, with the path in the folder of the running program in `path`, or
 * SP_ERR_IO if the path of the running program is not known. Thread-safe. */
bool sp_locate(const char *file, char path[PATH_MAX], struct sp_error *err);

#endif
