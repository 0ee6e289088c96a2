/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/module.h"

#include <dlfcn.h>
#include <errno.h>
#include <stdio.h>
#include <string.h>

const void *import_module_load(const struct import_file *file, const char *module,
                               const char *symbol, const char *library, const char *package,
                               struct sp_error *err) {
    char folder[PATH_MAX], path[PATH_MAX + 64];
    snprintf(path, sizeof path, "%s/%s", import_program_folder(folder), module);
    void *handle = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    const void *table = handle ? dlsym(handle, symbol) : NULL;
    if (table)
        return table;
    const char *why = dlerror();
    sp_fail(
        err, SP_ERR_UNSUPPORTED, file->title,
        "the reader of this format cannot be loaded: %.200s; it needs %s, on Debian the package "
        "%s",
        why ? why : strerror(errno), library, package);
    return NULL;
}
