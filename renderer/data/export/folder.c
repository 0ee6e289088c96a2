/* SPDX-License-Identifier: Apache-2.0 */
#include "data/export/folder.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <ftw.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "data/export/zarr.h"

enum { FOLDERS_OPEN = 8 };

/* True if the folder has the beginning of .zattrs that convert writes, and nothing but levels. */
static bool is_own(const char *path) {
    char start[sizeof ZARR_ATTRIBUTES_START] = "";
    DIR *folder = opendir(path);
    if (!folder)
        return false;
    const int fd = openat(dirfd(folder), ".zattrs", O_RDONLY | O_CLOEXEC);
    bool ok = fd >= 0 && read(fd, start, sizeof start - 1) == (ssize_t)sizeof start - 1 &&
              strcmp(start, ZARR_ATTRIBUTES_START) == 0;
    if (fd >= 0)
        close(fd);
    for (const struct dirent *entry; ok && (entry = readdir(folder));) {
        const char *name = entry->d_name;
        ok = strspn(name, "0123456789") == strlen(name) || strcmp(name, ".") == 0 ||
             strcmp(name, "..") == 0 || strcmp(name, ".zattrs") == 0 ||
             strcmp(name, ".zgroup") == 0;
    }
    closedir(folder);
    return ok;
}

bool sp_export_check_folder(const char *out, struct sp_error *err) {
    struct stat st;
    if (lstat(out, &st) != 0)
        return errno == ENOENT ||
               sp_fail(err, SP_ERR_IO, out, "cannot be looked at: %s", strerror(errno));
    return (S_ISDIR(st.st_mode) && is_own(out)) ||
           sp_fail(err, SP_ERR_INVALID, out,
                   "is there already, and splatctl convert did not write it as it is; remove it, "
                   "or choose another name");
}

static int remove_entry(const char *path, const struct stat *st, int type, struct FTW *at) {
    (void)st;
    (void)type;
    (void)at;
    return remove(path);
}

static void remove_folder(const char *path) {
    nftw(path, remove_entry, FOLDERS_OPEN, FTW_DEPTH | FTW_PHYS);
}

/* Gives the folder its name. An older folder exchanges its name with the new folder and is then
 * removed. */
static bool name_folder(const char *part, const char *out, struct sp_error *err) {
    if (!sp_export_check_folder(out, err)) /* it may have changed meanwhile */
        return false;
    if (renameat2(AT_FDCWD, part, AT_FDCWD, out, RENAME_EXCHANGE) == 0) {
        remove_folder(part);
        return true;
    }
    if (errno == EINVAL || errno == ENOSYS) /* the file system cannot exchange */
        remove_folder(out);
    return rename(part, out) == 0 ||
           sp_fail(err, SP_ERR_IO, out, "cannot name the folder: %s", strerror(errno));
}

bool sp_export_folder(struct sp_export_job *job, sp_export_fn *write, struct sp_error *err) {
    char *part;
    if (asprintf(&part, "%s.%ld.part", job->title, (long)getpid()) < 0)
        return sp_fail(err, SP_ERR_MEMORY, job->title, "out of memory for a path");
    const bool is_made = mkdir(part, 0777) == 0;
    job->out = is_made ? open(part, O_RDONLY | O_DIRECTORY | O_CLOEXEC) : -1;
    bool ok = job->out >= 0 ||
              sp_fail(err, SP_ERR_IO, job->folder, "cannot create a folder: %s", strerror(errno));
    ok = ok && write(job, err) && name_folder(part, job->title, err);
    if (job->out >= 0)
        close(job->out);
    if (!ok && is_made)
        remove_folder(part);
    free(part);
    return ok;
}
