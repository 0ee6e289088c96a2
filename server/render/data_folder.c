/* SPDX-License-Identifier: Apache-2.0 */
#include "render/data_folder.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "render/formats.h"
#include "sp/utf8.h"

static bool is_in(const char *path, const char *folder) {
    size_t length = strlen(folder);
    return strncmp(path, folder, length) == 0 &&
           (!path[length] || path[length] == '/' || folder[length - 1] == '/');
}

/* What a client asks for. */
struct wanted {
    const char *pointer; /* the place of errors */
    const char *kind;    /* "file" or "folder" */
};

static bool fail_missing(struct wanted wanted, struct sp_error *err) {
    return sp_fail(err, SP_ERR_NOT_FOUND, wanted.pointer,
                   "there is no such %s below the data folder", wanted.kind);
}

/* Appends "/name" to a resolved path. */
static bool join(const char *real, const char *name, size_t length, char joined[PATH_MAX]) {
    int n = snprintf(joined, PATH_MAX, "%s/%.*s", strcmp(real, "/") == 0 ? "" : real, (int)length,
                     name);
    if (n >= 0 && n < PATH_MAX)
        return true;
    errno = ENAMETOOLONG;
    return false;
}

/* The same, and resolves the result. */
static bool follow(char real[PATH_MAX], const char *name, size_t length) {
    char joined[PATH_MAX];
    if (!join(real, name, length, joined))
        return false;
    char *resolved = realpath(joined, NULL);
    if (!resolved)
        return false;
    bool fits = strlen(resolved) < PATH_MAX;
    if (fits)
        strcpy(real, resolved);
    free(resolved);
    errno = ENAMETOOLONG;
    return fits;
}

enum { QUOTED_MAX = 100 }; /* bytes of a name in an error */

static bool is_link(const char *real, const char *name, size_t length) {
    char joined[PATH_MAX];
    struct stat st;
    return join(real, name, length, joined) && lstat(joined, &st) == 0 && S_ISLNK(st.st_mode);
}

/* The same for every link that cannot be followed: no client learns what exists outside. */
static bool fail_link(struct wanted wanted, const char *name, size_t length, struct sp_error *err) {
    return sp_fail(err, SP_ERR_NOT_FOUND, wanted.pointer,
                   "'%.*s' is a symbolic link that leads out of the data folder or to nothing; "
                   "only what lies below the data folder can be opened",
                   length < QUOTED_MAX ? (int)length : QUOTED_MAX, name);
}

/* Explains, by errno, why the name of `length` bytes below `real` cannot be followed. */
static bool fail_to_follow(struct wanted wanted, const char *real, const char *name, size_t length,
                           struct sp_error *err) {
    const int error = errno;
    if (error == ENOMEM)
        return sp_fail(err, SP_ERR_MEMORY, wanted.pointer, "out of memory for a path");
    if (is_link(real, name, length))
        return fail_link(wanted, name, length, err);
    if (error == ENAMETOOLONG)
        return sp_fail(err, SP_ERR_INVALID, wanted.pointer,
                       "the path has more than %d bytes, or a name of it more than %d",
                       PATH_MAX - 1, NAME_MAX);
    if (error == EACCES)
        return sp_fail(err, SP_ERR_DENIED, wanted.pointer, "the daemon's user may not read '%.*s'",
                       length < QUOTED_MAX ? (int)length : QUOTED_MAX, name);
    return fail_missing(wanted, err);
}

static bool resolve(const char *data, const char *path, struct wanted wanted, char real[PATH_MAX],
                    struct sp_error *err) {
    if (!data)
        return sp_fail(err, SP_ERR_DENIED, wanted.pointer,
                       "this daemon loads no files by request; start it with --data DIR");
    if (strlen(data) + 1 + strlen(path) >= PATH_MAX) {
        errno = ENAMETOOLONG;
        return fail_to_follow(wanted, data, path, strlen(path), err);
    }
    snprintf(real, PATH_MAX, "%s", data);
    if (path[0] == '/') {
        if (!is_in(path, data))
            return fail_missing(wanted, err);
        path += strlen(data);
    }
    for (;;) {
        path += strspn(path, "/");
        size_t length = strcspn(path, "/");
        if (length == 0)
            return true;
        if (!follow(real, path, length))
            return fail_to_follow(wanted, real, path, length, err);
        if (!is_in(real, data)) {
            if (length == 2 && strncmp(path, "..", 2) == 0)
                return fail_missing(wanted, err);
            return fail_link(wanted, path, length, err);
        }
        path += length;
    }
}

bool srv_data_resolve(const char *data, const char *path, const char *pointer, char real[PATH_MAX],
                      struct sp_error *err) {
    return resolve(data, path, (struct wanted){ pointer, "file" }, real, err);
}

bool srv_data_check_relative(const char *path, const char *pointer, struct sp_error *err) {
    return path[0] != '/' ||
           sp_fail(err, SP_ERR_INVALID, pointer,
                   "must be relative to the data folder, without a slash at its beginning");
}

/* Opens a resolved folder, name by name, without following a link that was created meanwhile. */
static int open_folder(const char *real) {
    int fd = open("/", O_PATH | O_DIRECTORY | O_CLOEXEC);
    for (const char *name = real; fd >= 0; name += strcspn(name, "/")) {
        name += strspn(name, "/");
        if (!*name)
            break;
        char part[NAME_MAX + 1];
        snprintf(part, sizeof part, "%.*s", (int)strcspn(name, "/"), name);
        int folder = fd;
        fd = openat(folder, part, O_PATH | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
        int error = errno;
        close(folder);
        errno = error;
    }
    if (fd < 0)
        return -1;
    int readable = openat(fd, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    int error = errno;
    close(fd);
    errno = error;
    return readable;
}

/* JSON cannot carry other names. */
static bool is_utf8(const char *name) {
    size_t n = 1;
    for (; *name && n > 0; name += n)
        n = sp_utf8_length(name);
    return n > 0;
}

/* True if a symbolic link of a folder leads to something in the data folder. */
static bool stays_inside(const char *data, const char *folder, const char *name) {
    char real[PATH_MAX];
    snprintf(real, sizeof real, "%s", folder);
    return follow(real, name, strlen(name)) && is_in(real, data);
}

static bool is_zarr_folder(int parent, const char *name) {
    int fd = openat(parent, name, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    const bool is_zarr = fd >= 0 && srv_format_is_zarr(fd);
    if (fd >= 0)
        close(fd);
    return is_zarr;
}

/* True for a DICOM file whose name has no extension. */
static bool is_bare_dicom(int folder, const char *name) {
    char start[SRV_FORMAT_DICOM];
    if (!srv_format_has_no_extension(name))
        return false;
    const int fd = openat(folder, name, O_RDONLY | O_NONBLOCK | O_NOCTTY | O_CLOEXEC);
    const ssize_t size = fd >= 0 ? read(fd, start, sizeof start) : -1;
    if (fd >= 0)
        close(fd);
    return size > 0 && srv_format_is_dicom(start, (size_t)size);
}

enum srv_data_sight srv_data_look(const char *data, const char *folder, int fd, const char *name,
                                  struct srv_data_entry *entry) {
    struct stat st;
    if (name[0] == '.' || fstatat(fd, name, &st, AT_SYMLINK_NOFOLLOW) != 0)
        return SRV_DATA_NOTHING;
    const bool is_link = S_ISLNK(st.st_mode);
    if (is_link && (!stays_inside(data, folder, name) || fstatat(fd, name, &st, 0) != 0))
        return SRV_DATA_NOTHING;
    const bool is_zarr = S_ISDIR(st.st_mode) && is_zarr_folder(fd, name);
    const bool is_dicom = S_ISREG(st.st_mode) && is_bare_dicom(fd, name);
    const bool is_file = is_dicom || (S_ISREG(st.st_mode) && srv_format_extension(name));
    if (!S_ISDIR(st.st_mode) && !is_file)
        return SRV_DATA_NOTHING;
    if (!is_utf8(name))
        return SRV_DATA_UNLISTABLE;
    *entry = (struct srv_data_entry){ .kind = is_zarr || is_dicom ? SP_KIND_GRID : SP_KIND_COUNT,
                                      .is_folder = S_ISDIR(st.st_mode) && !is_zarr,
                                      .is_zarr = is_zarr,
                                      .size_bytes = is_file ? (uint64_t)st.st_size : 0,
                                      .format = is_zarr    ? "Zarr"
                                                : is_dicom ? "DICOM"
                                                           : srv_format_of(name) };
    snprintf(entry->key, sizeof entry->key, "%c%s", entry->is_folder ? '/' : ':', name);
    return is_link ? SRV_DATA_LINK : SRV_DATA_ENTRY;
}

DIR *srv_data_open(const char *data, const char *path, char real[PATH_MAX], struct sp_error *err) {
    const struct wanted wanted = { "/path", "folder" };
    if (!srv_data_check_relative(path, wanted.pointer, err) ||
        !resolve(data, path, wanted, real, err))
        return NULL;
    int fd = open_folder(real);
    DIR *folder = fd >= 0 ? fdopendir(fd) : NULL;
    if (folder)
        return folder;
    const int error = errno;
    if (fd >= 0)
        close(fd);
    if (error == ENOTDIR)
        sp_fail(err, SP_ERR_INVALID, "/path", "is a file, not a folder");
    else if (error == ENOENT)
        fail_missing(wanted, err);
    else if (error == EACCES)
        sp_fail(err, SP_ERR_DENIED, "/path", "the daemon's user may not read the folder");
    else
        sp_fail(err, error == ENOMEM ? SP_ERR_MEMORY : SP_ERR_IO, "/path",
                "cannot read the folder: %s", strerror(error));
    return NULL;
}

bool srv_data_list(const char *data, const char *path, struct srv_page *page, unsigned *unlisted,
                   struct sp_error *err) {
    char real[PATH_MAX];
    DIR *folder = srv_data_open(data, path, real, err);
    if (!folder)
        return false;
    *unlisted = 0;
    for (struct dirent *item; (item = readdir(folder));) {
        struct srv_data_entry entry;
        const enum srv_data_sight sight =
            srv_data_look(data, real, dirfd(folder), item->d_name, &entry);
        struct srv_data_entry *slot =
            sight >= SRV_DATA_ENTRY ? srv_page_slot(page, entry.key) : NULL;
        if (slot)
            *slot = entry;
        *unlisted += sight == SRV_DATA_UNLISTABLE;
    }
    closedir(folder);
    return true;
}

void srv_data_describe(const char *data, const char *path, struct srv_data_entry *entry) {
    char real[PATH_MAX], bytes[SRV_FORMAT_PEEK];
    struct srv_format_peek peek;
    struct stat st;
    if (entry->is_folder || srv_format_has_no_extension(srv_data_name(entry)) ||
        !srv_data_resolve(data, path, NULL, real, NULL) ||
        !follow(real, srv_data_name(entry), strlen(srv_data_name(entry))) || !is_in(real, data))
        return;
    /* Not blocking: a pipe may have taken the file's place. */
    int fd = open(real, O_RDONLY | O_NONBLOCK | O_NOFOLLOW | O_NOCTTY | O_CLOEXEC);
    if (fd < 0)
        return;
    ssize_t size = fstat(fd, &st) == 0 && S_ISREG(st.st_mode) ? read(fd, bytes, sizeof bytes) : -1;
    close(fd);
    if (size <= 0)
        return;
    srv_format_look(srv_data_name(entry), bytes, (size_t)size, &peek);
    memcpy(entry->dims, peek.dims, sizeof entry->dims);
    memcpy(entry->type, peek.type, sizeof entry->type);
    entry->kind = peek.kind;
}
