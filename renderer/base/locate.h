/* SPDX-License-Identifier: Apache-2.0
 *
 * Finds the programs and modules that are installed with the library, so that an installation can
 * be moved as a whole.
 *
 *   build tree     bin/PROGRAM           bin/FILE, also for PROGRAM in tests/
 *   installation   PREFIX/bin/PROGRAM    PREFIX/lib/splatd/FILE
 *                  PREFIX/lib/libsplat.so, and PROGRAM anywhere
 */
#ifndef SP_BASE_LOCATE_H
#define SP_BASE_LOCATE_H

#include <limits.h>
#include <stdbool.h>

#include "sp/status.h"

/* Writes the path of `file` and returns true if it exists. Otherwise *path is its path in the
 * folder of the running program, and *err has SP_ERR_NOT_FOUND, or SP_ERR_IO if the program's own
 * path is not known. Thread-safe. */
bool sp_locate(const char *file, char path[PATH_MAX], struct sp_error *err);

#endif
