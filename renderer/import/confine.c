/* SPDX-License-Identifier: Apache-2.0 */
#include "import/confine.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

bool sp_is_below(const char *root, const char *real) {
    size_t n = strlen(root);
    if (n == 1) /* "/" */
        return real[0] == '/' && real[1];
    return strncmp(root, real, n) == 0 && real[n] == '/' && real[n + 1];
}

bool sp_fail_missing(struct sp_error *err, const char *shown) {
    const char *query = strrchr(shown, '?');
    if (query && strchr(query, '=') && strncmp(query, "?field=", 7) != 0)
        return sp_fail(err, SP_ERR_NOT_FOUND, shown,
                       "there is no such file, and \"%.60s\" are no choices: known are level, "
                       "series, as, unit, vectors and field, each once, with a value, the last two "
                       "at the end: FILE?as=time&field=NAME",
                       query);
    return sp_fail(
        err, SP_ERR_NOT_FOUND, shown,
        strstr(shown, ":/") || strstr(shown, "?field=")
            ? "there is no such file; in a source with choices the array comes last, such "
              "as FILE.h5?as=time&field=/NAME"
            : "there is no such file");
}

static bool fail_errno(struct sp_error *err, int error, const char *shown, const char *what) {
    if (error == ENOENT || error == ENOTDIR)
        return sp_fail_missing(err, shown);
    if (error == ELOOP)
        return sp_fail(err, SP_ERR_INVALID, shown, "is a symbolic link that leads in a circle");
    if (error == ENAMETOOLONG)
        return sp_fail(err, SP_ERR_INVALID, shown,
                       "the path has more than %d bytes, or a name of it more than %d",
                       PATH_MAX - 1, NAME_MAX);
    return sp_fail(err, SP_ERR_IO, shown, "cannot %s: %s", what, strerror(error));
}

/* Opens `real` folder by folder. A resolved path contains no links; a link found now was created in
 * the meantime and fails with ELOOP. openat2() would need one call, but the seccomp filter cannot
 * check its arguments. */
static int open_path(const char *root, const char *real) {
    int fd = open(root, O_PATH | O_DIRECTORY | O_CLOEXEC);
    const char *name = real + strlen(root);
    while (fd >= 0 && *name) {
        char part[NAME_MAX + 1];
        name += strspn(name, "/");
        size_t size = strcspn(name, "/");
        bool is_last = !name[size];
        int folder = fd;
        snprintf(part, sizeof part, "%.*s", (int)size, name);
        fd = openat(folder, part, O_PATH | O_NOFOLLOW | O_CLOEXEC | (is_last ? 0 : O_DIRECTORY));
        int error = errno == ENOTDIR ? ELOOP : errno;
        close(folder);
        errno = error;
        name += size;
    }
    return fd;
}

static const char *kind_name(mode_t mode) {
    return S_ISDIR(mode)    ? "a folder"
           : S_ISLNK(mode)  ? "now a symbolic link"
           : S_ISFIFO(mode) ? "a pipe"
           : S_ISSOCK(mode) ? "a socket"
           : S_ISCHR(mode)  ? "a character device"
           : S_ISBLK(mode)  ? "a block device"
                            : "not a regular file";
}

/* A path that names a place below the root, but ends elsewhere, holds a symbolic link. */
static bool fail_outside(struct sp_error *err, const char *root, const char *path, const char *real,
                         const char *shown) {
    if (strcmp(root, real) == 0)
        return sp_fail(err, SP_ERR_DENIED, shown, "is a folder, not a regular file");
    bool is_link = sp_is_below(root, path) && !strstr(path, "/../");
    return sp_fail(err, SP_ERR_DENIED, shown,
                   is_link ? "is a symbolic link that leads out of %s" : "lies outside of %s",
                   root);
}

/* Resolves a path and opens what it names without reading it. -1 with *err set. */
static int open_unread(const char *root, const char *path, const char *shown, char real[PATH_MAX],
                       bool may_be_root, struct stat *st, struct sp_error *err) {
    if (!realpath(path, real)) {
        fail_errno(err, errno, shown, "resolve the path");
        return -1;
    }
    if (!sp_is_below(root, real) && !(may_be_root && strcmp(root, real) == 0)) {
        fail_outside(err, root, path, real, shown);
        return -1;
    }
    int fd = open_path(root, real);
    if (fd < 0) {
        if (errno == ELOOP)
            sp_fail(err, SP_ERR_DENIED, shown, "became a symbolic link while it was opened");
        else
            fail_errno(err, errno, shown, "open");
        return -1;
    }
    if (fstat(fd, st) == 0)
        return fd;
    fail_errno(err, errno, shown, "look at the file");
    close(fd);
    return -1;
}

/* Opens for reading what `unread` refers to, which is closed. */
static int open_read(int unread, int flags, const char *shown, struct sp_error *err) {
    char self[40];
    snprintf(self, sizeof self, "/proc/self/fd/%d", unread);
    const int fd = open(self, O_RDONLY | O_CLOEXEC | flags);
    if (fd < 0)
        sp_fail(err, SP_ERR_IO, shown, "cannot open the folder: %s", strerror(errno));
    close(unread);
    return fd;
}

int sp_open_confined(const char *root, const char *path, const char *shown, char real[PATH_MAX],
                     uint64_t *size, struct sp_error *err) {
    struct stat st;
    const int unread = open_unread(root, path, shown, real, false, &st, err);
    if (unread < 0)
        return -1;
    if (!S_ISREG(st.st_mode)) {
        sp_fail(err, SP_ERR_INVALID, shown, "is %s, not a regular file", kind_name(st.st_mode));
        close(unread);
        return -1;
    }
    *size = (uint64_t)st.st_size;
    return open_read(unread, O_NONBLOCK | O_NOCTTY, shown, err);
}

int sp_open_confined_folder(const char *root, const char *path, const char *shown,
                            char real[PATH_MAX], struct sp_error *err) {
    struct stat st;
    const int unread = open_unread(root, path, shown, real, true, &st, err);
    if (unread < 0)
        return -1;
    if (!S_ISDIR(st.st_mode)) {
        sp_fail(err, SP_ERR_INVALID, shown, "is not a folder");
        close(unread);
        return -1;
    }
    return open_read(unread, O_DIRECTORY, shown, err);
}
