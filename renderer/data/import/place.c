/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/place.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

#include "data/import/address.h"
#include "data/import/confine.h"
#include "data/import/numbered.h"

/* A folder outside of the root is not listed; opening it says so. `name`: the part of the path
 * after the folder; NULL = the path is a folder. */
static bool may_list(const struct sp_import_place *p, const char *name) {
    char path[PATH_MAX], real[PATH_MAX];
    snprintf(path, sizeof path, "%.*s", name ? (int)(name - p->path) : (int)strlen(p->path),
             p->path);
    return !p->given_root || (realpath(path[0] ? path : ".", real) &&
                              (strcmp(real, p->root) == 0 || sp_is_below(p->root, real)));
}

static const char *const metadata_names[] = { "zarr.json", ".zarray", ".zgroup", ".zattrs" };
enum { METADATA_NAMES = sizeof metadata_names / sizeof *metadata_names };

/* Finds the metadata of a Zarr hierarchy, which is a folder. */
static bool find_metadata(int folder, char name[NAME_MAX + 1]) {
    for (size_t i = 0; i < METADATA_NAMES && !*name; i++)
        if (faccessat(folder, metadata_names[i], R_OK, 0) == 0)
            strcpy(name, metadata_names[i]);
    return *name;
}

/* Cuts a resolved path to the folder around it. Returns the name of its metadata; "" = none. */
static const char *go_up(char path[PATH_MAX], char metadata[NAME_MAX + 1]) {
    char *slash = strrchr(path, '/');
    metadata[0] = 0;
    if (!slash || slash == path)
        return metadata;
    *slash = 0;
    const int folder = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (folder >= 0) {
        find_metadata(folder, metadata);
        close(folder);
    }
    return metadata;
}

/* A folder of chunks has no metadata: the array is around it. Other folders pass. */
static bool refuse_chunks(const struct sp_import_place *p, struct sp_error *err) {
    enum { DEPTH_MAX = 8 };
    char path[PATH_MAX], metadata[NAME_MAX + 1];
    if (!realpath(p->path, path))
        return true;
    for (int depth = 0; depth < DEPTH_MAX; depth++) {
        go_up(path, metadata);
        if (p->given_root && strcmp(path, p->root) != 0 && !sp_is_below(p->root, path))
            return true;
        if (strcmp(metadata, ".zarray") == 0 || strcmp(metadata, "zarr.json") == 0) {
            const char *name = strrchr(path, '/'), *around = name;
            while (around > path && *--around != '/')
                continue;
            return sp_fail(err, SP_ERR_UNSUPPORTED, p->path,
                           "this folder is a part of a Zarr array or group; open the folder "
                           "%.100s, or the image around it",
                           around + 1);
        }
        if (*metadata)
            return true;
    }
    return true;
}

/* A hierarchy of Zarr is opened by its metadata; other folders are opened themselves. */
static bool resolve_folder(struct sp_import_place *p, struct sp_error *err) {
    char metadata[NAME_MAX + 1] = "";
    const int folder = open(p->path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (folder < 0)
        return sp_fail(err, SP_ERR_IO, p->path, "cannot list the folder: %s", strerror(errno));
    p->is_folder = !find_metadata(folder, metadata);
    close(folder);
    if (p->is_folder && !refuse_chunks(p, err))
        return false;
    const size_t length = strlen(p->path);
    if (length + strlen(metadata) + 2 > sizeof p->path)
        return sp_fail(err, SP_ERR_INVALID, p->path, "the path has more than %d bytes, the limit",
                       PATH_MAX - 1);
    if (!p->is_folder)
        snprintf(p->path + length, sizeof p->path - length, "/%s", metadata);
    return true;
}

/* Replaces a path whose name has a '*' for each number by the path of the first such file. */
static bool pick_numbered(struct sp_import_place *p, char *name, struct sp_error *err) {
    struct import_names files = { .count = 0 };
    char source[PATH_MAX];
    snprintf(source, sizeof source, "%s", p->path);
    snprintf(p->series, sizeof p->series, "%s", name);
    *name = 0; /* leaves the folder and its slash */
    const char *folder = p->path[0] ? p->path : ".";
    bool ok = sp_numbered_list(folder, p->series, SP_STEPS_MAX + 1, &files, source, err);
    if (ok && files.count == 0)
        ok = sp_fail(err, SP_ERR_NOT_FOUND, source,
                     "there is no such file with a number in place of '*'");
    if (ok) {
        const size_t left = sizeof p->path - (size_t)(name - p->path);
        ok = (size_t)snprintf(name, left, "%s", files.names[0]) < left ||
             sp_fail(err, SP_ERR_INVALID, source, "the path has more than %d bytes, the limit",
                     PATH_MAX - 1);
    }
    import_names_finish(&files);
    return ok;
}

/* Names the volume after its file, without the extensions, or after its folder. */
static bool resolve_file(struct sp_import_place *p, struct sp_error *err) {
    struct stat st;
    size_t length = strlen(p->path);
    while (length > 1 && p->path[length - 1] == '/')
        p->path[--length] = 0;
    char *slash = strrchr(p->path, '/'), *base = slash ? slash + 1 : p->path;
    const bool is_there = stat(p->path, &st) == 0, is_folder = is_there && S_ISDIR(st.st_mode);
    const char *dot = strrchr(base, '.'), *end = base + strlen(base);
    const bool is_zarr = dot && strcasecmp(dot, ".zarr") == 0;
    if ((!is_folder || is_zarr) && dot && dot > base) {
        const char *before = is_zarr ? ".ome" : ".nii";
        end = dot;
        if (end - base > 4 && (is_zarr || strcasecmp(dot, ".gz") == 0) &&
            strncasecmp(end - 4, before, 4) == 0)
            end -= 4;
    }
    snprintf(p->name, sizeof p->name, "%.*s", (int)(end - base), base);
    if (!is_there && strchr(base, '*') && strlen(base) <= NAME_MAX && may_list(p, base))
        return pick_numbered(p, base, err);
    return !is_folder || !may_list(p, NULL) || resolve_folder(p, err);
}

/* The place of a level is in the metadata of the image around it. */
static void widen_root(struct sp_import_place *p) {
    char path[PATH_MAX], metadata[NAME_MAX + 1];
    memcpy(path, p->root, sizeof path);
    while (*go_up(path, metadata))
        memcpy(p->root, path, sizeof path);
}

static bool resolve_root(struct sp_import_place *p, struct sp_error *err) {
    const char *root = p->given_root;
    if (root)
        return realpath(root, p->root) ||
               sp_fail(err, SP_ERR_IO, root, "cannot resolve this folder: %s", strerror(errno));
    /* The folder, or the folder of the file, after links are resolved. */
    if (!realpath(p->path, p->root)) {
        if (errno == ENOENT || errno == ENOTDIR)
            return sp_fail_missing(err, p->path);
        return sp_fail(err, SP_ERR_IO, p->path, "cannot resolve the path: %s", strerror(errno));
    }
    memcpy(p->file, p->root, sizeof p->file);
    if (p->is_folder)
        return true;
    char *slash = strrchr(p->root, '/');
    bool is_zarr = false;
    for (size_t i = 0; i < METADATA_NAMES; i++)
        is_zarr |= strcmp(slash + 1, metadata_names[i]) == 0;
    slash[slash == p->root] = 0;
    if (is_zarr)
        widen_root(p);
    return true;
}

/* Names the volume after the last part of its address. Nothing is read below its root. */
static void resolve_remote(struct sp_import_place *p) {
    size_t length = strlen(p->path);
    while (length > 0 && p->path[length - 1] == '/')
        p->path[--length] = 0;
    const char *base = strrchr(p->path, '/') + 1, *end = p->path + length;
    static const char *const endings[] = { ".zarr", ".ome" };
    for (int i = 0; i < 2; i++) {
        const size_t n = strlen(endings[i]);
        if ((size_t)(end - base) > n && strncasecmp(end - n, endings[i], n) == 0)
            end -= n;
    }
    snprintf(p->name, sizeof p->name, "%.*s", (int)(end - base), base);
    snprintf(p->root, sizeof p->root, "/dev/null");
    p->is_remote = true;
}

/* The root may be given by a name with links, and the path by the same name. */
static bool resolve_path(struct sp_import_place *p, struct sp_error *err) {
    const size_t given = strlen(p->given_root);
    const bool is_same =
        strncmp(p->path, p->given_root, given) == 0 && (p->path[given] == '/' || !p->path[given]);
    const int n = snprintf(p->file, sizeof p->file, "%s%s", is_same ? p->root : "",
                           p->path + (is_same ? given : 0));
    return n < (int)sizeof p->file ||
           sp_fail(err, SP_ERR_INVALID, p->path, "the path has more than %d bytes, the limit",
                   PATH_MAX - 1);
}

bool sp_import_place_resolve(struct sp_import_place *p, const char *root, struct sp_error *err) {
    if (sp_address_is_remote(p->path)) {
        resolve_remote(p);
        return true;
    }
    p->given_root = root;
    if (root)
        return resolve_root(p, err) && resolve_file(p, err) && resolve_path(p, err);
    return resolve_file(p, err) && resolve_root(p, err);
}
