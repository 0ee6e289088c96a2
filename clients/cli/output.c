/* SPDX-License-Identifier: Apache-2.0 */
#include "output.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static bool write_all(int fd, const char *bytes, size_t size) {
    while (size > 0) {
        ssize_t n = write(fd, bytes, size);
        if (n < 0 && errno == EINTR)
            continue;
        if (n < 0)
            return false;
        bytes += n;
        size -= (size_t)n;
    }
    return true;
}

static bool fail_io(struct sp_error *err, const char *path, const char *what) {
    return sp_fail(err, SP_ERR_IO, path, "%s: %s", what, strerror(errno));
}

static bool write_in_place(const char *path, const void *bytes, size_t size, struct sp_error *err) {
    int fd = open(path, O_WRONLY | O_CLOEXEC);
    if (fd < 0)
        return fail_io(err, path, "cannot open");
    bool ok = write_all(fd, bytes, size) || fail_io(err, path, "cannot write");
    return (close(fd) == 0 || !ok || fail_io(err, path, "cannot write")) && ok;
}

static bool write_and_rename(const char *path, const void *bytes, size_t size,
                             struct sp_error *err) {
    char *temporary = malloc(strlen(path) + 8);
    if (!temporary)
        return sp_fail(err, SP_ERR_MEMORY, path, "out of memory");
    sprintf(temporary, "%s.XXXXXX", path);
    int fd = mkstemp(temporary);
    if (fd < 0) {
        free(temporary);
        return fail_io(err, path, "cannot create");
    }
    mode_t mask = umask(0); /* one thread alone writes files here */
    umask(mask);
    fchmod(fd, 0666 & ~mask);
    /* Before it has its name it is on the disk: who fetches a path deletes the daemon's copy. */
    bool ok = (write_all(fd, bytes, size) && fsync(fd) == 0) || fail_io(err, path, "cannot write");
    ok = (close(fd) == 0 || !ok || fail_io(err, path, "cannot write")) && ok;
    ok = ok && (rename(temporary, path) == 0 || fail_io(err, path, "cannot rename to it"));
    if (!ok)
        unlink(temporary);
    free(temporary);
    return ok;
}

bool output_write(const char *path, const void *bytes, size_t size, struct sp_error *err) {
    if (strcmp(path, "-") == 0)
        return write_all(STDOUT_FILENO, bytes, size) ||
               fail_io(err, "standard output", "cannot write");
    struct stat status;
    if (stat(path, &status) != 0)
        return write_and_rename(path, bytes, size, err);
    if (S_ISDIR(status.st_mode))
        return sp_fail(err, SP_ERR_IO, path, "is a folder; name a file in it");
    if (!S_ISREG(status.st_mode))
        return write_in_place(path, bytes, size, err);
    char *target = realpath(path, NULL); /* a link keeps pointing where it did */
    bool ok =
        target ? write_and_rename(target, bytes, size, err) : fail_io(err, path, "cannot resolve");
    free(target);
    return ok;
}

char *input_read(const char *path, size_t limit, size_t *size, struct sp_error *err) {
    bool standard = strcmp(path, "-") == 0;
    FILE *file = standard ? stdin : fopen(path, "rb");
    if (standard)
        path = "standard input";
    if (!file) {
        fail_io(err, path, "cannot open");
        return NULL;
    }
    char *bytes = malloc(limit + 2);
    *size = bytes ? fread(bytes, 1, limit + 1, file) : 0;
    bool failed = ferror(file);
    if (failed)
        fail_io(err, path, "cannot read");
    else if (!bytes)
        sp_fail(err, SP_ERR_MEMORY, path, "out of memory");
    else if (*size > limit)
        failed = !sp_fail(err, SP_ERR_INVALID, path, "is larger than %zu bytes", limit);
    else
        bytes[*size] = 0;
    if (!standard)
        fclose(file);
    if (failed) {
        free(bytes);
        return NULL;
    }
    return bytes;
}
