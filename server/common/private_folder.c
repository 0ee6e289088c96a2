/* SPDX-License-Identifier: Apache-2.0 */
#include "common/private_folder.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

/* mkdtemp replaces these characters; only folders with names of this form are ours. */
#define RANDOM_SUFFIX "XXXXXX"

enum { ID_CHARACTERS = 32, TRIES = 100 };

bool srv_folder_is_id(const char *name) {
    return strlen(name) == ID_CHARACTERS && strspn(name, "0123456789abcdef") == ID_CHARACTERS;
}

static const char *temporary(void) {
    const char *folder = getenv("TMPDIR");
    return folder && *folder ? folder : "/tmp";
}

/* Removes the files in a folder, and its folders with their files down to `depth` levels below.
 * Takes over the descriptor. */
static void remove_files(int folder, int depth) {
    DIR *files = folder >= 0 ? fdopendir(folder) : NULL;
    for (struct dirent *file; files && (file = readdir(files));) {
        const char *name = file->d_name;
        if (strcmp(name, ".") == 0 || strcmp(name, "..") == 0 || unlinkat(folder, name, 0) == 0 ||
            depth == 0)
            continue;
        remove_files(openat(folder, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC),
                     depth - 1);
        unlinkat(folder, name, AT_REMOVEDIR);
    }
    if (files)
        closedir(files);
    else if (folder >= 0)
        close(folder);
}

bool srv_folder_remove_id(const char *root, const char *id) {
    char path[SRV_FILE_BYTES];
    snprintf(path, sizeof path, "%s/%s", root, id);
    remove_files(open(path, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC), 1);
    return rmdir(path) == 0 || errno == ENOENT;
}

/* Removes only folders of objects; anything else is not ours. */
static void remove_objects(const char *root) {
    DIR *objects = opendir(root);
    for (struct dirent *entry; objects && (entry = readdir(objects));)
        if (srv_folder_is_id(entry->d_name))
            srv_folder_remove_id(root, entry->d_name);
    if (objects)
        closedir(objects);
}

/* Removes the folder of a killed process: it belongs to our user, and no process holds its lock. */
static void remove_left(int parent, const char *name, const char *parent_path) {
    char root[SRV_FOLDER_BYTES];
    struct stat st;
    int fd = openat(parent, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
    int n = snprintf(root, sizeof root, "%s/%s", parent_path, name);
    if (fd >= 0 && n > 0 && (size_t)n < sizeof root && fstat(fd, &st) == 0 &&
        st.st_uid == geteuid() && flock(fd, LOCK_EX | LOCK_NB) == 0) {
        remove_objects(root);
        rmdir(root);
    }
    if (fd >= 0)
        close(fd);
}

static void remove_all_left(const char *prefix) {
    const size_t prefix_length = strlen(prefix), length = prefix_length + strlen(RANDOM_SUFFIX);
    DIR *folders = opendir(temporary());
    for (struct dirent *folder; folders && (folder = readdir(folders));)
        if (strlen(folder->d_name) == length && strncmp(folder->d_name, prefix, prefix_length) == 0)
            remove_left(dirfd(folders), folder->d_name, temporary());
    if (folders)
        closedir(folders);
}

static bool fail(const char *path, struct sp_error *err) {
    return sp_fail(err, SP_ERR_IO, path, "cannot create this folder: %s", strerror(errno));
}

bool srv_private_folder_open(const char *prefix, char path[SRV_FOLDER_BYTES], int *lock,
                             struct sp_error *err) {
    struct stat st;
    remove_all_left(prefix);
    for (int i = 0; i < TRIES; i++) {
        int n = snprintf(path, SRV_FOLDER_BYTES, "%s/%s" RANDOM_SUFFIX, temporary(), prefix);
        if (n < 0 || n >= SRV_FOLDER_BYTES)
            return sp_fail(err, SP_ERR_INVALID, NULL, "the path of $TMPDIR is too long");
        if (!mkdtemp(path))
            return fail(path, err);
        *lock = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
        if (*lock < 0)
            continue;
        /* A file system without locks: no process removes the folder either. Another process may
         * have removed it before the lock was taken. */
        flock(*lock, LOCK_EX);
        if (fstat(*lock, &st) == 0 && st.st_nlink > 0)
            return true;
        close(*lock);
    }
    *lock = -1;
    return fail(path, err);
}

void srv_private_folder_close(const char *path, int lock) {
    rmdir(path);
    if (lock >= 0)
        close(lock);
}
