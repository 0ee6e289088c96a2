/* SPDX-License-Identifier: Apache-2.0 */
#include "jobs/folder.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static bool fail(const char *path, const char *what, struct sp_error *err) {
    return sp_fail(err, SP_ERR_IO, path, "cannot %s: %s", what, strerror(errno));
}

static bool make_folder(const char *path, struct sp_error *err) {
    return mkdir(path, 0700) == 0 || errno == EEXIST || fail(path, "make this folder", err);
}

bool srv_folder_open(struct srv_folder *folder, const char *state, struct sp_error *err) {
    const char *temporary = getenv("TMPDIR");
    folder->is_private = state == NULL;
    int n = state ? snprintf(folder->root, sizeof folder->root, "%s/paths", state)
                  : snprintf(folder->root, sizeof folder->root, "%s/splatd-XXXXXX",
                             temporary && *temporary ? temporary : "/tmp");
    if (n < 0 || (size_t)n >= sizeof folder->root)
        return sp_fail(err, SP_ERR_INVALID, state, "the folder's name is too long");
    if (state)
        return make_folder(folder->root, err);
    return mkdtemp(folder->root) || fail(folder->root, "make a folder for frames", err);
}

void srv_folder_close(struct srv_folder *folder) {
    if (folder->is_private && folder->root[0])
        rmdir(folder->root); /* the jobs' folders are gone by now */
    folder->root[0] = 0;
}

void srv_folder_path(const struct srv_folder *folder, const char *id, const char *name,
                     char path[SRV_FILE_BYTES]) {
    snprintf(path, SRV_FILE_BYTES, "%s/%.64s%s%.32s", folder->root, id, *name ? "/" : "", name);
}

/* Renames and file names outlive a crash of the machine from here on. */
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

bool srv_folder_take(const struct srv_folder *folder, const char *id, const char *part,
                     const char *name, struct sp_error *err) {
    char from[SRV_FILE_BYTES], to[SRV_FILE_BYTES], job[SRV_FILE_BYTES];
    srv_folder_path(folder, id, part, from);
    srv_folder_path(folder, id, name, to);
    srv_folder_path(folder, id, "", job);
    int fd = open(from, O_RDONLY | O_CLOEXEC);
    bool ok = fd >= 0 && fsync(fd) == 0;
    ok = ok && rename(from, to) == 0 && sync_folder(job);
    if (!ok)
        fail(to, "write", err);
    if (fd >= 0)
        close(fd);
    if (!ok)
        unlink(from);
    return ok;
}

bool srv_folder_write(const struct srv_folder *folder, const char *id, const char *name,
                      const void *head, size_t head_size, const void *bytes, size_t size,
                      struct sp_error *err) {
    char path[SRV_FILE_BYTES], part[32];
    srv_folder_path(folder, id, "", path);
    if (mkdir(path, 0700) == 0)
        sync_folder(folder->root);
    else if (errno != EEXIST)
        return fail(path, "make this folder", err);
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
    return ok && srv_folder_take(folder, id, part, name, err);
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

void srv_folder_remove(const struct srv_folder *folder, const char *id) {
    char path[SRV_FILE_BYTES];
    srv_folder_path(folder, id, "", path);
    DIR *files = opendir(path);
    for (struct dirent *file; files && (file = readdir(files));)
        if (strcmp(file->d_name, ".") != 0 && strcmp(file->d_name, "..") != 0)
            unlinkat(dirfd(files), file->d_name, 0);
    if (files)
        closedir(files);
    rmdir(path);
}

void srv_folder_sweep(const struct srv_folder *folder, bool (*known)(void *user, const char *id),
                      void *user) {
    DIR *jobs = opendir(folder->root);
    for (struct dirent *job; jobs && (job = readdir(jobs));)
        if (job->d_name[0] != '.' && !known(user, job->d_name))
            srv_folder_remove(folder, job->d_name);
    if (jobs)
        closedir(jobs);
}
