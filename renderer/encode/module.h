/* SPDX-License-Identifier: Apache-2.0
 *
 * Modules: shared libraries in the folder of the program, loaded on demand.
 */
#ifndef ENCODE_MODULE_H
#define ENCODE_MODULE_H

#include "sp/status.h"

/* Returns a symbol of a module, which is never unloaded. `what` names the module in errors ("image
 * library"). On failure returns NULL and sets *err: SP_ERR_NOT_FOUND if there is no such file,
 * SP_ERR_IO if it cannot be used; the place is the module's path. Thread-safe. */
void *sp_module_symbol(const char *file, const char *symbol, const char *what,
                       struct sp_error *err);

#endif
