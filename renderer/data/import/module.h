/* SPDX-License-Identifier: Apache-2.0
 *
 * Modules of the import process: shared objects beside the program, each with one format library,
 * which is loaded only when a file needs it.
 */
#ifndef SP_IMPORT_MODULE_H
#define SP_IMPORT_MODULE_H

#include "data/import/format.h"

/* Loads a module and returns its table of functions, which stays valid until the process ends. NULL
 * with SP_ERR_UNSUPPORTED; the text names the library that it needs and its Debian package. */
const void *import_module_load(const struct import_file *file, const char *module,
                               const char *symbol, const char *library, const char *package,
                               struct sp_error *err);

#endif
