/* SPDX-License-Identifier: Apache-2.0
 *
 * Modules: what is loaded on demand from beside the program.
 */
#ifndef ENCODE_MODULE_H
#define ENCODE_MODULE_H

#include "sp/status.h"

/* The symbol of a module, which is never unloaded. `what` names it in errors ("image library").
 * NULL with *err set: SP_ERR_NOT_FOUND if there is no such file, SP_ERR_IO if it cannot be used;
 * the place is its path. Thread-safe. */
void *sp_module_symbol(const char *file, const char *symbol, const char *what,
                       struct sp_error *err);

#endif
