/* SPDX-License-Identifier: Apache-2.0
 *
 * Why this parser is our own: parsers.md.
 */
#include "data/import/zarr_store.h"

#include <dirent.h>
#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "data/import/confine.h"

struct folder {
    struct zarr_store store;
    const struct import_file *file;
    int fd; /* of the last object; −1 = none */
    uint64_t size;
    char key[ZARR_KEY_BYTES]; /* of the last object */
    char title[PATH_MAX];     /* the folder */
};

bool zarr_fail(const struct zarr_store *store, struct sp_error *err, enum sp_code code,
               const char *key, const char *pointer, const char *format, ...) {
    char place[SP_ERROR_PLACE], text[SP_ERROR_TEXT];
    va_list args;
    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    snprintf(place, sizeof place, "%.120s: %.80s%s%.50s", store->title, key, *pointer ? ": " : "",
             pointer);
    return sp_fail(err, code, place, "%s", text);
}

bool zarr_key(char key[ZARR_KEY_BYTES], const char *path, const char *name) {
    const int n = snprintf(key, ZARR_KEY_BYTES, "%s%s%s", path, *path ? "/" : "", name);
    return n >= 0 && n < ZARR_KEY_BYTES;
}

static void forget(struct folder *f) {
    if (f->fd >= 0)
        close(f->fd);
    f->fd = -1;
    f->key[0] = 0;
}

/* Opens the file of a key unless it is the last one. */
static enum zarr_found open_key(struct folder *f, const char *key, struct sp_error *err) {
    char path[PATH_MAX + ZARR_KEY_BYTES], real[PATH_MAX];
    struct sp_error why;
    if (f->fd >= 0 && strcmp(f->key, key) == 0)
        return ZARR_FOUND;
    forget(f);
    snprintf(path, sizeof path, "%s/%s", f->file->folder, key);
    f->fd = sp_open_confined(f->file->root, path, key, real, &f->size, &why);
    if (f->fd >= 0) {
        snprintf(f->key, sizeof f->key, "%s", key);
        return ZARR_FOUND;
    }
    /* A folder of this name is no object. */
    if (why.code == SP_ERR_NOT_FOUND || why.code == SP_ERR_INVALID)
        return ZARR_MISSING;
    zarr_fail(&f->store, err, why.code, key, "", "%s", why.text);
    return ZARR_FAILED;
}

static enum zarr_found size_of(void *user, const char *key, uint64_t *size, struct sp_error *err) {
    struct folder *f = user;
    const enum zarr_found found = open_key(f, key, err);
    *size = f->size;
    return found;
}

static enum zarr_found read_from(void *user, const char *key, uint64_t offset, void *out,
                                 size_t size, size_t *got, struct sp_error *err) {
    struct folder *f = user;
    const enum zarr_found found = open_key(f, key, err);
    *got = 0;
    while (found == ZARR_FOUND && *got < size) {
        const ssize_t n =
            pread(f->fd, (char *)out + *got, size - *got, (off_t)(offset + (uint64_t)*got));
        if (n < 0 && errno == EINTR)
            continue;
        if (n < 0) {
            zarr_fail(&f->store, err, SP_ERR_IO, key, "", "cannot read the file: %s",
                      strerror(errno));
            return ZARR_FAILED;
        }
        if (n == 0)
            break;
        *got += (size_t)n;
    }
    return found;
}

static void list(void *user, const char *key, bool (*visit)(void *to, const char *name), void *to) {
    const struct folder *f = user;
    char path[PATH_MAX + ZARR_KEY_BYTES];
    snprintf(path, sizeof path, "%s/%s", f->file->folder, key);
    DIR *folder = strstr(key, "..") ? NULL : opendir(path);
    if (!folder)
        return;
    for (const struct dirent *entry; (entry = readdir(folder));)
        if (entry->d_name[0] != '.' && !visit(to, entry->d_name))
            break;
    closedir(folder);
}

struct zarr_store *zarr_folder_open(const struct import_file *file) {
    struct folder *f = calloc(1, sizeof *f);
    if (!f)
        return NULL;
    f->store = (struct zarr_store){
        .user = f, .title = f->title, .size = size_of, .read = read_from, .list = list
    };
    const char *slash = strrchr(file->title, '/');
    snprintf(f->title, sizeof f->title, "%.*s",
             slash ? (int)(slash - file->title) : (int)strlen(file->title), file->title);
    f->file = file;
    f->fd = -1;
    return &f->store;
}

void zarr_folder_close(struct zarr_store **store) {
    if (!*store)
        return;
    struct folder *f = (*store)->user;
    forget(f);
    free(f);
    *store = NULL;
}
