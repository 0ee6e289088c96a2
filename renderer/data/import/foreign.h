/* SPDX-License-Identifier: Apache-2.0
 *
 * Files that no reader knows, but whose first bytes tell what they are: packed ones, and formats of
 * other programs.
 */
#ifndef SP_IMPORT_FOREIGN_H
#define SP_IMPORT_FOREIGN_H

#include <stddef.h>
#include <stdint.h>

#include "sp/status.h"

/* Fails with what the file is and what to do with it, if it is known; else returns true. */
bool import_foreign_check(const uint8_t *start, size_t size, const char *title,
                          struct sp_error *err);

/* Fails if a file with this name holds samples whose header is another file; else returns true. */
bool import_foreign_check_name(const char *title, struct sp_error *err);

#endif
