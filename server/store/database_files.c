/* SPDX-License-Identifier: Apache-2.0 */
#include "store/database_files.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/private_folder.h"

enum { KEPT_MAX = 9 }; /* files that were found in the place of the database */

static bool is_long(int size) {
    return size < 0 || size >= PATH_MAX;
}

/* Writes "FOLDER/NAME". The paths of an open database fit. */
static bool name_path(const char *folder, const char *name, char path[PATH_MAX]) {
    return !is_long(snprintf(path, PATH_MAX, "%s/%s", folder, name));
}

static bool suffix_path(const char *path, const char *suffix, char out[PATH_MAX]) {
    return !is_long(snprintf(out, PATH_MAX, "%s%s", path, suffix));
}

static struct srv_file_mark mark_of(const struct stat *st) {
    return (struct srv_file_mark){
        .dev = st->st_dev, .ino = st->st_ino, .size = st->st_size, .modified = st->st_mtim
    };
}

static struct srv_file_mark mark(const char *path) {
    struct stat st;
    return lstat(path, &st) == 0 ? mark_of(&st) : (struct srv_file_mark){ .ino = 0 };
}

static bool is_same(const struct srv_file_mark *a, const struct srv_file_mark *b) {
    return a->ino == b->ino && a->dev == b->dev;
}

static bool is_same_content(const struct srv_file_mark *a, const struct srv_file_mark *b) {
    return a->size == b->size && a->modified.tv_sec == b->modified.tv_sec &&
           a->modified.tv_nsec == b->modified.tv_nsec;
}

static bool acquire_lock(struct srv_database_files *files, struct sp_error *err) {
    char path[PATH_MAX];
    if (!name_path(files->folder, SRV_DATABASE_LOCK, path))
        return sp_fail(err, SP_ERR_INVALID, "--state", "the path is longer than %d bytes",
                       PATH_MAX - 1);
    int lock = open(path, O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
    if (lock < 0)
        return sp_fail(err, SP_ERR_IO, path,
                       "cannot write to the folder of --state: %s; the daemon's user needs write "
                       "access",
                       strerror(errno));
    if (flock(lock, LOCK_EX | LOCK_NB) != 0) {
        close(lock);
        return sp_fail(err, SP_ERR_IO, files->folder,
                       "another splatd uses this folder; give each daemon its own --state");
    }
    if (files->lock >= 0)
        close(files->lock);
    files->lock = lock;
    return true;
}

/* True if the folder "FOLDER/NAME" has folders of objects (private_folder.h). */
static bool has_objects(const char *folder, const char *name) {
    char path[PATH_MAX];
    bool found = false;
    DIR *objects = name_path(folder, name, path) ? opendir(path) : NULL;
    for (const struct dirent *entry; objects && !found && (entry = readdir(objects));)
        found = srv_folder_is_id(entry->d_name);
    if (objects)
        closedir(objects);
    return found;
}

static bool was_used(const struct srv_database_files *files) {
    struct stat st;
    return (fstat(files->lock, &st) == 0 && st.st_size > 0) ||
           has_objects(files->folder, "paths") || has_objects(files->folder, "uploads");
}

void srv_database_files_set_used(const struct srv_database_files *files) {
    static const char text[] = "splatd uses " SRV_DATABASE_NAME " in this folder\n";
    struct stat st;
    if (fstat(files->lock, &st) == 0 && st.st_size == 0 &&
        pwrite(files->lock, text, sizeof text - 1, 0) > 0)
        fsync(files->lock);
}

bool srv_database_files_open(struct srv_database_files *files, const char *folder,
                             struct sp_error *err) {
    struct stat st;
    files->lock = -1;
    if (is_long(snprintf(files->folder, sizeof files->folder, "%s", folder)) ||
        !name_path(folder, SRV_DATABASE_NAME, files->path))
        return sp_fail(err, SP_ERR_INVALID, "--state", "the path is longer than %d bytes",
                       PATH_MAX - 1);
    if (!acquire_lock(files, err))
        return false;
    if (stat(folder, &st) != 0)
        return sp_fail(err, SP_ERR_IO, folder, "cannot read this folder: %s", strerror(errno));
    files->root = mark_of(&st);
    files->was_used = was_used(files);
    return true;
}

void srv_database_files_close(struct srv_database_files *files) {
    if (files->lock >= 0)
        close(files->lock);
    files->lock = -1;
}

static struct srv_file_mark mark_log(const struct srv_database_files *files) {
    char log[PATH_MAX];
    return suffix_path(files->path, "-wal", log) ? mark(log) : files->log;
}

void srv_database_files_note(struct srv_database_files *files) {
    files->main = mark(files->path);
    srv_database_files_note_log(files);
}

void srv_database_files_note_log(struct srv_database_files *files) {
    files->log = mark_log(files);
}

const char *srv_database_files_changed(const struct srv_database_files *files, bool written) {
    const struct srv_file_mark main = mark(files->path), log = mark_log(files);
    if (main.ino == 0)
        return "was deleted";
    if (!is_same(&main, &files->main))
        return "was replaced by another file";
    if (!written && main.size < files->main.size)
        return "was truncated";
    if (!written && !is_same_content(&main, &files->main))
        return SRV_DATABASE_FOREIGN;
    if (!is_same(&log, &files->log))
        return "lost its file splatd.db-wal";
    if (!written && !is_same_content(&log, &files->log))
        return SRV_DATABASE_FOREIGN;
    return NULL;
}

bool srv_database_files_hold(struct srv_database_files *files, struct sp_error *err) {
    struct stat st, lock;
    char path[PATH_MAX];
    const bool is_there = stat(files->folder, &st) == 0;
    const struct srv_file_mark root = is_there ? mark_of(&st) : (struct srv_file_mark){ .ino = 0 };
    if (!is_same(&root, &files->root))
        return sp_fail(err, SP_ERR_IO, files->folder,
                       "the folder of --state was moved, deleted or unmounted; put it back, or "
                       "restart the daemon with the folder that it should use");
    if (!name_path(files->folder, SRV_DATABASE_LOCK, path))
        return true;
    const struct srv_file_mark found = mark(path);
    const struct srv_file_mark held =
        fstat(files->lock, &lock) == 0 ? mark_of(&lock) : (struct srv_file_mark){ .ino = 0 };
    return is_same(&found, &held) || acquire_lock(files, err);
}

static bool fail(const char *path, const char *what, struct sp_error *err) {
    return sp_fail(err, SP_ERR_IO, path, "cannot %s: %s", what, strerror(errno));
}

/* Gives a file that is not ours a second name, "splatd.db.found" or with a number behind it. */
static bool keep(const char *path, char kept[PATH_MAX], struct sp_error *err) {
    char suffix[24];
    for (int i = 1; i <= KEPT_MAX; i++) {
        snprintf(suffix, sizeof suffix, i > 1 ? ".found.%d" : ".found", i);
        if (!suffix_path(path, suffix, kept) || mark(kept).ino)
            continue;
        /* A link leaves no moment without a database; a file of another user may have none. */
        if (link(path, kept) == 0 || rename(path, kept) == 0)
            return true;
        return fail(path, "keep the file that is in the place of the database", err);
    }
    return sp_fail(err, SP_ERR_IO, path,
                   "this file is in the place of the database, and %d others were before; delete "
                   "splatd.db.found*",
                   KEPT_MAX);
}

/* True if there is no log that another program wrote. */
static bool has_own_log(const struct srv_database_files *files) {
    const struct srv_file_mark now = mark_log(files);
    return !now.ino || (is_same(&now, &files->log) && is_same_content(&now, &files->log));
}

/* Takes the log away, which would be applied to the new database. One that is not ours belongs to
 * the file that was found. */
static bool clear_log(const struct srv_database_files *files, const char *kept,
                      struct sp_error *err) {
    char log[PATH_MAX], index[PATH_MAX], to[PATH_MAX];
    if (!suffix_path(files->path, "-wal", log) || !suffix_path(files->path, "-shm", index))
        return true;
    const bool is_kept = *kept && !has_own_log(files);
    if (is_kept ? !suffix_path(kept, "-wal", to) || rename(log, to) != 0
                : unlink(log) != 0 && errno != ENOENT)
        return fail(log, "remove this file", err);
    unlink(index); /* SQLite makes it again from the log */
    return srv_database_files_sync(files->folder, err);
}

bool srv_database_files_replace(struct srv_database_files *files, const char *fresh,
                                char kept[PATH_MAX], struct sp_error *err) {
    const struct srv_file_mark now = mark(files->path);
    const bool is_ours =
        is_same(&now, &files->main) && is_same_content(&now, &files->main) && has_own_log(files);
    *kept = 0;
    if (now.ino && now.size > 0 && !is_ours && !keep(files->path, kept, err))
        return false;
    if (!clear_log(files, kept, err))
        return false;
    if (rename(fresh, files->path) != 0)
        return fail(files->path, "write the database", err);
    srv_database_files_note(files);
    return srv_database_files_sync(files->folder, err);
}

bool srv_database_files_sync(const char *folder, struct sp_error *err) {
    int fd = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    bool ok = fd >= 0 && fsync(fd) == 0;
    if (!ok)
        sp_fail(err, SP_ERR_IO, folder, "cannot sync this folder to the disk: %s", strerror(errno));
    if (fd >= 0)
        close(fd);
    return ok;
}
