/* SPDX-License-Identifier: Apache-2.0 */
#include "paths/folder.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static bool fail(const char *path, const char *what, struct sp_error *err) {
    return sp_fail(err, SP_ERR_IO, path, "cannot %s: %s", what, strerror(errno));
}

static bool make_folder(const char *path, struct sp_error *err) {
    return mkdir(path, 0700) == 0 || errno == EEXIST || fail(path, "create this folder", err);
}

bool srv_folder_open(struct srv_folder *folder, const char *state, struct sp_error *err) {
    folder->is_private = state == NULL;
    folder->lock = -1;
    if (!state)
        return srv_private_folder_open("splatd-frames-", folder->root, &folder->lock, err);
    int n = snprintf(folder->root, sizeof folder->root, "%s/paths", state);
    if (n < 0 || (size_t)n >= sizeof folder->root)
        return sp_fail(err, SP_ERR_INVALID, state, "the path of this folder is too long");
    return make_folder(folder->root, err);
}

void srv_folder_close(struct srv_folder *folder) {
    if (folder->is_private && folder->root[0])
        srv_private_folder_close(folder->root, folder->lock); /* the paths have been removed */
    folder->root[0] = 0;
}

void srv_folder_path(const struct srv_folder *folder, const char *id, const char *name,
                     char path[SRV_FILE_BYTES]) {
    snprintf(path, SRV_FILE_BYTES, "%s/%.64s%s%.32s", folder->root, id, *name ? "/" : "", name);
}

/* Syncs a folder, so that its new names survive a crash of the machine. */
static bool sync_folder(const char *path) {
    int fd = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    bool ok = fd >= 0 && fsync(fd) == 0;
    if (fd >= 0)
        close(fd);
    return ok;
}

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

static const char seal_magic[8] = { 'S', 'P', 'L', 'T', 'S', 'E', 'A', 'L' };

static bool append_seal(const char *path) {
    struct stat st;
    uint8_t seal[SRV_SEAL_BYTES];
    int fd = open(path, O_WRONLY | O_APPEND | O_CLOEXEC);
    bool ok = fd >= 0 && fstat(fd, &st) == 0;
    if (ok) {
        memcpy(seal, seal_magic, sizeof seal_magic);
        for (int i = 0; i < 8; i++)
            seal[sizeof seal_magic + i] = (uint8_t)((uint64_t)st.st_size >> 8 * i);
        ok = write_all(fd, (const char *)seal, sizeof seal);
    }
    return (fd < 0 || close(fd) == 0) && ok;
}

/* Reads the seal of a file of `all` bytes. False: it has none, or one for another size. */
static bool has_seal(int fd, uint64_t all, uint64_t *size) {
    uint8_t seal[SRV_SEAL_BYTES];
    *size = 0;
    if (all < sizeof seal ||
        pread(fd, seal, sizeof seal, (off_t)(all - sizeof seal)) != (ssize_t)sizeof seal ||
        memcmp(seal, seal_magic, sizeof seal_magic) != 0)
        return false;
    for (int i = 0; i < 8; i++)
        *size |= (uint64_t)seal[sizeof seal_magic + i] << 8 * i;
    return *size == all - sizeof seal;
}

int srv_folder_open_file(const struct srv_folder *folder, const char *id, const char *name,
                         bool must_have_seal, uint64_t *size, struct sp_error *err) {
    char path[SRV_FILE_BYTES];
    struct stat st;
    srv_folder_path(folder, id, name, path);
    int fd = open(path, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
    if (fd < 0 || fstat(fd, &st) != 0) {
        sp_fail(err, errno == ENOENT ? SP_ERR_NOT_FOUND : SP_ERR_BUDGET, path,
                "cannot read the file: %s", strerror(errno));
    } else if (!S_ISREG(st.st_mode)) {
        sp_fail(err, SP_ERR_IO, path, "it is no file");
    } else if (has_seal(fd, (uint64_t)st.st_size, size)) {
        return fd;
    } else if (!must_have_seal && st.st_size > 0) {
        *size = (uint64_t)st.st_size;
        return fd;
    } else {
        sp_fail(err, SP_ERR_IO, path, "it was cut off or changed: it has %lld bytes and no end",
                (long long)st.st_size);
    }
    if (fd >= 0)
        close(fd);
    return -1;
}

bool srv_folder_publish(const struct srv_folder *folder, const char *id, const char *part,
                        const char *name, struct sp_error *err) {
    char from[SRV_FILE_BYTES], to[SRV_FILE_BYTES], parent[SRV_FILE_BYTES];
    srv_folder_path(folder, id, part, from);
    srv_folder_path(folder, id, name, to);
    srv_folder_path(folder, id, "", parent);
    bool is_sealed = append_seal(from);
    int fd = is_sealed ? open(from, O_RDONLY | O_CLOEXEC) : -1;
    bool is_renamed = fd >= 0 && fsync(fd) == 0 && rename(from, to) == 0;
    bool ok = is_renamed && sync_folder(parent);
    if (!ok)
        fail(to, "write", err);
    if (fd >= 0)
        close(fd);
    if (!ok)
        unlink(is_renamed ? to : from);
    return ok;
}

bool srv_folder_write(const struct srv_folder *folder, const char *id, const char *name,
                      const void *head, size_t head_size, const void *bytes, size_t size,
                      struct sp_error *err) {
    char path[SRV_FILE_BYTES], part[32];
    srv_folder_path(folder, id, "", path);
    bool is_new = mkdir(path, 0700) == 0;
    if (is_new ? !sync_folder(folder->root) : errno != EEXIST) {
        fail(path, "create this folder", err);
        if (is_new)
            rmdir(path);
        return false;
    }
    snprintf(part, sizeof part, "%.24s.part", name);
    srv_folder_path(folder, id, part, path);
    int fd = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    if (fd < 0)
        return fail(path, "write", err);
    bool ok = write_all(fd, head, head_size) && write_all(fd, bytes, size);
    if (!ok)
        fail(path, "write", err);
    if (close(fd) != 0 && ok)
        ok = fail(path, "write", err);
    if (!ok)
        unlink(path);
    return ok && srv_folder_publish(folder, id, part, name, err);
}

bool srv_folder_size(const struct srv_folder *folder, const char *id, const char *name,
                     uint64_t *size) {
    char path[SRV_FILE_BYTES];
    struct stat st;
    srv_folder_path(folder, id, name, path);
    if (stat(path, &st) != 0 || !S_ISREG(st.st_mode))
        return false;
    *size = (uint64_t)st.st_size;
    return true;
}

void srv_folder_remove_file(const struct srv_folder *folder, const char *id, const char *name) {
    char path[SRV_FILE_BYTES];
    srv_folder_path(folder, id, name, path);
    unlink(path);
}

void srv_folder_clean(const struct srv_folder *folder, const char *id,
                      bool (*known)(void *user, const char *name), void *user) {
    char path[SRV_FILE_BYTES];
    srv_folder_path(folder, id, "", path);
    DIR *files = opendir(path);
    for (struct dirent *file; files && (file = readdir(files));)
        if (strcmp(file->d_name, ".") != 0 && strcmp(file->d_name, "..") != 0 &&
            !known(user, file->d_name))
            unlinkat(dirfd(files), file->d_name, 0);
    if (files)
        closedir(files);
}

static bool is_none(void *user, const char *name) {
    (void)user, (void)name;
    return false;
}

bool srv_folder_remove(const struct srv_folder *folder, const char *id, struct sp_error *err) {
    char path[SRV_FILE_BYTES];
    srv_folder_clean(folder, id, is_none, NULL);
    srv_folder_path(folder, id, "", path);
    if (rmdir(path) != 0)
        return errno == ENOENT || fail(path, "remove", err);
    return sync_folder(folder->root) || fail(folder->root, "write", err);
}

/* Adds the sizes of the regular files in a folder. False: it is not a folder. */
static bool add_bytes(int parent, const char *name, uint64_t *bytes) {
    struct stat st;
    int fd = openat(parent, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
    DIR *files = fd >= 0 ? fdopendir(fd) : NULL;
    if (!files && fd >= 0)
        close(fd);
    for (struct dirent *file; files && (file = readdir(files));)
        if (fstatat(fd, file->d_name, &st, AT_SYMLINK_NOFOLLOW) == 0 && S_ISREG(st.st_mode))
            *bytes += (uint64_t)st.st_size;
    if (files)
        closedir(files);
    return fd >= 0;
}

unsigned srv_folder_strays(const struct srv_folder *folder,
                           bool (*known)(void *user, const char *id), void *user, uint64_t *bytes) {
    unsigned count = 0;
    DIR *paths = opendir(folder->root);
    *bytes = 0;
    for (struct dirent *entry; paths && (entry = readdir(paths));)
        if (srv_folder_is_id(entry->d_name) && !known(user, entry->d_name))
            count += add_bytes(dirfd(paths), entry->d_name, bytes);
    if (paths)
        closedir(paths);
    return count;
}
