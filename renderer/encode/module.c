/* SPDX-License-Identifier: Apache-2.0 */
#include "encode/module.h"

#include <dlfcn.h>
#include <errno.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

/* Where a module may lie, seen from the folder of the running program: beside it, in the library
 * folder of an installation, beside the programs of a build tree whose tests are elsewhere. */
static const char *const folders[] = { "", "../lib/splatd/", "../bin/" };

static bool program_folder(const char *file, char *folder, size_t size, struct sp_error *err) {
    ssize_t n = readlink("/proc/self/exe", folder, size - 1);
    if (n < 0)
        return sp_fail(err, SP_ERR_IO, "/proc/self/exe", "cannot find %s: %s", file,
                       strerror(errno));
    folder[n] = 0;
    char *slash = strrchr(folder, '/');
    slash[1] = 0; /* the kernel gives an absolute path */
    return true;
}

void *sp_module_symbol(const char *file, const char *symbol, const char *what,
                       struct sp_error *err) {
    char folder[3840], path[4096], first[4096] = "";
    if (!program_folder(file, folder, sizeof folder, err))
        return NULL;
    for (size_t i = 0; i < sizeof folders / sizeof *folders; i++) {
        snprintf(path, sizeof path, "%s%s%s", folder, folders[i], file);
        if (i == 0)
            memcpy(first, path, sizeof first);
        if (access(path, F_OK) != 0)
            continue;
        /* RTLD_NODELETE: libraries register destructors that must find them mapped. */
        void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
        if (!library) {
            sp_fail(err, SP_ERR_IO, path, "cannot load the %s: %s", what, dlerror());
            return NULL;
        }
        void *found = dlsym(library, symbol);
        dlclose(library);
        if (!found)
            sp_fail(err, SP_ERR_IO, path, "is not the %s of this program", what);
        return found;
    }
    sp_fail(err, SP_ERR_NOT_FOUND, first, "the %s is not there", what);
    return NULL;
}
