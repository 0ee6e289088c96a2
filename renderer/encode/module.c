/* SPDX-License-Identifier: Apache-2.0 */
#include "encode/module.h"

#include <dlfcn.h>
#include <stddef.h>

#include "base/locate.h"

void *sp_module_symbol(const char *file, const char *symbol, const char *what,
                       struct sp_error *err) {
    char path[PATH_MAX];
    struct sp_error why;
    if (!sp_locate(file, path, &why)) {
        if (why.code == SP_ERR_NOT_FOUND)
            sp_fail(err, SP_ERR_NOT_FOUND, path, "the %s is not installed", what);
        else if (err)
            *err = why;
        return NULL;
    }
    /* RTLD_NODELETE: libraries register destructors, which must stay mapped until exit. */
    void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
    if (!library) {
        sp_fail(err, SP_ERR_IO, path, "cannot load the %s: %s", what, dlerror());
        return NULL;
    }
    void *found = dlsym(library, symbol);
    dlclose(library);
    if (!found)
        sp_fail(err, SP_ERR_IO, path, "this file is not the %s of this version", what);
    return found;
}
