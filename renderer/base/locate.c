/* SPDX-License-Identifier: Apache-2.0 */
#include "base/locate.h"

#include <dlfcn.h>
#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

/* Writes the path of `file` in `below` in the first `length` bytes of `folder`. True if it exists.
 */
static bool is_there(const char *folder, int length, const char *below, const char *file,
                     char path[PATH_MAX]) {
    int n = snprintf(path, PATH_MAX, "%.*s%s%s", length, folder, below, file);
    return n < PATH_MAX && access(path, F_OK) == 0;
}

/* Returns the length of the path up to its last slash, which is included. */
static int folder_length(const char *path) {
    const char *slash = strrchr(path, '/');
    return slash ? (int)(slash + 1 - path) : 0;
}

bool sp_locate(const char *file, char path[PATH_MAX], struct sp_error *err) {
    static const char *const beside_program[] = { "", SP_PRIVATE_FROM_PROGRAM, "../bin/" };
    char program[PATH_MAX];
    ssize_t n = readlink("/proc/self/exe", program, sizeof program - 1);
    if (n < 0) {
        snprintf(path, PATH_MAX, "%s", file);
        return sp_fail(err, SP_ERR_IO, "/proc/self/exe", "cannot find %s: %s", file,
                       strerror(errno));
    }
    program[n] = 0;
    int length = folder_length(program);
    for (size_t i = 0; i < sizeof beside_program / sizeof beside_program[0]; i++)
        if (is_there(program, length, beside_program[i], file, path))
            return true;
    Dl_info library;
    if (dladdr((void *)sp_locate, &library) && library.dli_fname &&
        is_there(library.dli_fname, folder_length(library.dli_fname), SP_PRIVATE_FROM_LIBRARY, file,
                 path))
        return true;
    snprintf(path, PATH_MAX, "%.*s%s", length, program, file);
    return sp_fail(err, SP_ERR_NOT_FOUND, path, "%s is not installed", file);
}
