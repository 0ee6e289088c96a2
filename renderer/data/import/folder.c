/* SPDX-License-Identifier: Apache-2.0
 *
 * A folder stands for one volume:
 *
 *   files of the folder ─► DICOM? ─► the series of the folder (dicom.c)
 *                      └─► first file of a known format ─► its stack, its time series, or itself
 *   sub-folders ─► DICOM (dicom.c)
 *
 * Names that begin with a dot and files of no known format, such as a text beside images, are
 * passed over. The contents of a file count more than its name.
 */
#include "data/import/folder.h"

#include <dirent.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "data/import/confine.h"
#include "data/import/foreign.h"
#include "data/import/format.h"
#include "data/import/numbered.h"

static bool add_name(struct import_names *list, const char *prefix, const char *name) {
    char path[PATH_MAX + NAME_MAX + 2];
    snprintf(path, sizeof path, "%s%s%s", prefix, prefix[0] ? "/" : "", name);
    return import_names_append(list, path);
}

/* True for a folder, or else for a regular file or a link to one. Links to folders could lead in a
 * circle, so they are neither. */
static bool is_wanted(int folder, const char *name, bool is_folder) {
    struct stat st;
    if (name[0] == '.' || fstatat(folder, name, &st, is_folder ? AT_SYMLINK_NOFOLLOW : 0) != 0)
        return false;
    return is_folder ? S_ISDIR(st.st_mode) : S_ISREG(st.st_mode);
}

bool import_names_add(struct import_names *list, const char *folder, const char *prefix,
                      bool are_folders, uint32_t most) {
    DIR *listed = opendir(folder);
    bool ok = true;
    for (const struct dirent *entry;
         listed && ok && list->count < most && (entry = readdir(listed));)
        if (is_wanted(dirfd(listed), entry->d_name, are_folders))
            ok = add_name(list, prefix, entry->d_name);
    if (listed)
        closedir(listed);
    return ok;
}

static int by_number(const void *a, const void *b) {
    return strverscmp(*(const char *const *)a, *(const char *const *)b);
}

void import_names_sort(struct import_names *list, uint32_t first) {
    if (list->count > first + 1)
        qsort(list->names + first, list->count - first, sizeof *list->names, by_number);
}

/* The format of a folder: it opens the file that stands for the folder. */

struct folder {
    struct import_file file; /* that one, or the folder itself */
    char title[PATH_MAX], real[PATH_MAX], pattern[NAME_MAX + 1];
    bool is_volume; /* and no image */
    const struct import_format *inner;
    void *reader; /* of `inner`; owned */
};

static void close_folder(void *reader) {
    struct folder *f = reader;
    import_format_close(f->inner, f->reader);
    if (!f->file.is_folder && f->file.fd >= 0)
        close(f->file.fd);
}

/* Opens a file of the folder. -1 = it cannot be read. */
static int open_file(const struct import_file *folder, const char *name, char real[PATH_MAX],
                     uint64_t *size) {
    char path[2 * PATH_MAX];
    snprintf(path, sizeof path, "%s/%s", folder->folder, name);
    return sp_open_confined(folder->root, path, name, real, size, NULL);
}

/* Reads the beginning of a file. Returns the number of bytes; 0 if there are none. */
static size_t read_start(const struct import_file *folder, const char *name,
                         uint8_t start[static IMPORT_START_BYTES]) {
    char real[PATH_MAX];
    uint64_t size;
    const int fd = open_file(folder, name, real, &size);
    const ssize_t got = fd >= 0 ? pread(fd, start, IMPORT_START_BYTES, 0) : -1;
    if (fd >= 0)
        close(fd);
    return got > 0 ? (size_t)got : 0;
}

/* The first file that has the bytes of a format, or else the first one that has the name of one;
 * DICOM before all others. NULL = there is none. */
static const char *pick_file(const struct import_file *folder, const struct import_names *files,
                             bool *is_dicom) {
    const char *known = NULL, *named = NULL;
    uint8_t start[IMPORT_START_BYTES];
    *is_dicom = false;
    for (uint32_t i = 0; i < files->count; i++) {
        const char *name = files->names[i];
        const size_t size = read_start(folder, name, start);
        *is_dicom = size > 0 && import_dicom.probe(start, size, "");
        if (*is_dicom)
            return name;
        if (!known && size > 0 && import_format_is_known(start, size, ""))
            known = name;
        if (!named && size > 0 && import_format_is_known(start, size, name))
            named = name;
    }
    return known ? known : named;
}

static bool open_as_dicom(struct folder *f, struct import_header *header, struct sp_error *err) {
    f->inner = &import_dicom;
    f->is_volume = true;
    f->reader = import_format_open(f->inner, &f->file, header, err);
    return f->reader != NULL;
}

/* Opens a file, together with the files that are numbered like it. */
static bool open_as_file(struct folder *f, const struct import_file *folder, const char *name,
                         struct import_header *header, struct sp_error *err) {
    uint8_t start[IMPORT_START_BYTES];
    snprintf(f->title, sizeof f->title, "%s/%s", folder->title, name);
    f->file.is_folder = false;
    f->file.title = f->title;
    f->file.fd = open_file(folder, name, f->real, &f->file.size);
    const ssize_t got = f->file.fd >= 0 ? pread(f->file.fd, start, sizeof start, 0) : -1;
    if (got < 0)
        return sp_fail(
            err, SP_ERR_IO, f->title,
            "cannot read the file: the file became shorter, or its disk or network fails");
    f->is_volume = !import_image.probe(start, (size_t)got, "");
    if (sp_numbered_pattern(name, f->pattern)) {
        f->file.pattern = f->pattern;
        f->file.is_guess = true;
        f->inner = &import_series;
    } else {
        f->pattern[0] = 0;
        f->inner = import_format_find(start, (size_t)got, f->title, err);
    }
    f->reader = f->inner ? import_format_open(f->inner, &f->file, header, err) : NULL;
    return f->reader != NULL;
}

/* True for a file that could stand for the folder instead. Pictures beside volumes, tables and
 * sidecars do not count, nor do the pieces of a file, which have its name. */
static bool is_other(const struct folder *f, const struct import_file *folder, const char *name,
                     const char *taken) {
    uint8_t start[IMPORT_START_BYTES] = { 0 };
    const size_t stem = strcspn(taken, ".");
    const bool is_dicom = f->inner == &import_dicom; /* the folder may have very many of these */
    if ((is_dicom && !import_format_is_known(start, 0, name)) ||
        import_dicom.probe(start, 0, name) || strncmp(name, taken, stem) == 0 ||
        sp_numbered_matches(f->pattern, name))
        return false;
    const size_t size = read_start(folder, name, start);
    const bool is_gzip = size >= 2 && start[0] == 0x1f && start[1] == 0x8b;
    if (size == 0 || (f->is_volume && import_image.probe(start, size, "")))
        return false;
    return import_format_is_known(start, size, "") ||
           (is_gzip && import_format_is_known(start, size, name));
}

/* Names what the folder has beside what is shown. `taken`: the file that stands for the folder. */
static void warn_others(const struct folder *f, const struct import_file *folder,
                        const struct import_names *files, const char *taken) {
    const char *example = NULL;
    uint32_t count = 0, numbered = 0;
    for (uint32_t i = 0; i < files->count; i++) {
        numbered += sp_numbered_matches(f->pattern, files->names[i]);
        if (is_other(f, folder, files->names[i], taken)) {
            example = example ? example : files->names[i];
            count++;
        }
    }
    if (count > 0)
        import_warn(folder->warnings,
                    "The folder has %u other %s, such as %.60s; %.60s%s shown. Open %s by name.",
                    count, count == 1 ? "file that can be opened" : "files that can be opened",
                    example, taken,
                    f->inner == &import_dicom ? " and its series are"
                    : numbered > 1            ? " and the files numbered like it are"
                                              : " is",
                    count == 1 ? "it" : "them");
}

/* No file has a known format: the first one that another program reads is named. */
static bool refuse_files(const struct import_file *folder, const struct import_names *files,
                         struct sp_error *err) {
    uint8_t start[IMPORT_START_BYTES];
    for (uint32_t i = 0; i < files->count; i++) {
        const size_t size = read_start(folder, files->names[i], start);
        if (!import_foreign_check(start, size, files->names[i], err))
            return false;
    }
    return sp_fail(err, files->count ? SP_ERR_UNSUPPORTED : SP_ERR_NOT_FOUND, folder->title,
                   files->count ? "no file in this folder has a known format"
                                : "there is no file in this folder");
}

/* Data sets of N5, and groups of them, have attributes.json. Its first bytes are enough. */
static bool refuse_n5(const struct import_file *folder, struct sp_error *err) {
    char text[IMPORT_START_BYTES + 1];
    const size_t size = read_start(folder, "attributes.json", (uint8_t *)text);
    const char *title = folder->title, *at = strstr(title, ".n5");
    text[size] = 0;
    const bool is_named = at && (at[3] == 0 || at[3] == '/'); /* or inside of one */
    return !(is_named || strstr(text, "\"blockSize\"") || strstr(text, "\"n5\"")) ||
           sp_fail(err, SP_ERR_UNSUPPORTED, title,
                   "this is a folder of N5, which is not read; convert it to OME-Zarr or TIFF, "
                   "for example in Fiji: open it with the N5 plugin and save it as TIFF");
}

static bool open_folder(void *reader, const struct import_file *folder,
                        struct import_header *header, struct sp_error *err) {
    struct folder *f = reader;
    f->file = *folder;
    struct import_names files = { .count = 0 }, folders = { .count = 0 };
    if (!refuse_n5(folder, err))
        return false;
    bool is_dicom, ok = import_names_add(&files, folder->folder, "", false, IMPORT_FILES_MAX) &&
                        import_names_add(&folders, folder->folder, "", true, 1);
    if (!ok) {
        sp_fail(err, SP_ERR_MEMORY, folder->title, "out of memory for the names of files");
    } else {
        import_names_sort(&files, 0);
        const char *name = pick_file(folder, &files, &is_dicom);
        if (is_dicom || (!name && folders.count > 0))
            ok = open_as_dicom(f, header, err);
        else if (name)
            ok = open_as_file(f, folder, name, header, err);
        else
            ok = refuse_files(folder, &files, err);
        if (ok && name && f->inner != &import_collection)
            warn_others(f, folder, &files, name);
    }
    import_names_finish(&files);
    import_names_finish(&folders);
    return ok;
}

static bool read_grid(void *reader, void *voxels, float (*vectors)[3],
                      const struct import_progress *progress, struct sp_error *err) {
    const struct folder *f = reader;
    return f->inner->read(f->reader, voxels, vectors, progress, err);
}

static bool read_elements(void *reader, const struct sp_elements *elements,
                          const struct import_progress *progress, struct sp_error *err) {
    const struct folder *f = reader;
    return f->inner->read_elements(f->reader, elements, progress, err);
}

/* The series of a folder of DICOM files; of another folder none. */
static bool list_series(const struct import_file *folder, struct import_series_list *list,
                        struct sp_error *err) {
    struct import_names files = { .count = 0 };
    bool is_dicom = false,
         ok = import_names_add(&files, folder->folder, "", false, IMPORT_FILES_MAX);
    const char *name = ok ? pick_file(folder, &files, &is_dicom) : NULL;
    if (!ok)
        sp_fail(err, SP_ERR_MEMORY, folder->title, "out of memory for the names of files");
    else if (is_dicom || !name)
        ok = import_dicom.list(folder, list, err);
    import_names_finish(&files);
    return ok;
}

const struct import_format import_folder = { .name = "folder",
                                             .needs_module = true,
                                             .reader_size = sizeof(struct folder),
                                             .open = open_folder,
                                             .read = read_grid,
                                             .read_elements = read_elements,
                                             .close = close_folder,
                                             .list = list_series };
