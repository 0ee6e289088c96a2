/* SPDX-License-Identifier: Apache-2.0
 *
 * Time series of files, each a step:
 *
 *   numbered files of a folder ──┐
 *   .pvd, .series ───────────────┴─► the file of the step ─► its format
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "data/import/collection.h"
#include "data/import/confine.h"
#include "data/import/numbers.h"

enum { TIMES_MAX = 4096 }; /* files whose times are read */

struct series {
    struct collection listed;     /* of a .pvd or .series file */
    struct import_names numbered; /* or files of the folder */
    double *times;                /* of these; NULL = unknown; owned */
    const struct import_format *inner;
    struct import_file file; /* of the step; fd -1 = not open */
    char real[PATH_MAX], folder[PATH_MAX];
    char title[NAME_MAX + 1]; /* its name in errors */
    void *reader;             /* of `inner`; owned */
};

static void close_series(void *reader) {
    struct series *s = reader;
    import_format_close(s->inner, s->reader);
    if (s->file.fd >= 0)
        close(s->file.fd);
    collection_finish(&s->listed);
    import_names_finish(&s->numbered);
    free(s->times);
}

/* Opens the file of the step, whose name is relative to the folder of the source. */
static bool open_file(struct series *s, const struct import_file *source, const char *name,
                      struct sp_error *err) {
    char path[2 * PATH_MAX];
    const char *slash = strrchr(name, '/');
    const int n = snprintf(path, sizeof path, "%s/%s", name[0] == '/' ? "" : source->folder, name);
    if (n >= PATH_MAX)
        return sp_fail(err, SP_ERR_INVALID, source->title,
                       "the name of a step and its folder have more than %d bytes, the limit",
                       PATH_MAX - 1);
    snprintf(s->title, sizeof s->title, "%s", slash ? slash + 1 : name);
    s->file = *source;
    s->file.fd = sp_open_confined(source->root, path, s->title, s->real, &s->file.size, err);
    if (s->file.fd < 0)
        return false;
    snprintf(s->folder, sizeof s->folder, "%s", s->real);
    *strrchr(s->folder, '/') = 0;
    s->file.title = s->title;
    s->file.folder = s->folder[0] ? s->folder : "/";
    s->file.pattern = "";
    s->file.step = 0;
    s->file.has_step = true;
    return true;
}

/* Opens the volume of the step. */
static bool open_step(struct series *s, struct import_header *header, struct sp_error *err) {
    uint8_t start[IMPORT_START_BYTES];
    const ssize_t size = pread(s->file.fd, start, sizeof start, 0);
    if (size < 0)
        return sp_fail(
            err, SP_ERR_IO, s->title,
            "cannot read the file: the file became shorter, or its disk or network fails");
    s->inner = import_format_find(start, (size_t)size, s->title, err);
    if (s->inner == &import_collection)
        return sp_fail(
            err, SP_ERR_UNSUPPORTED, s->title,
            "a step cannot be a series of its own; list its files, or open this file alone");
    s->reader = s->inner ? import_format_open(s->inner, &s->file, header, err) : NULL;
    return s->reader != NULL;
}

/* Reads the times of the numbered files, if all give one and they rise. */
static void read_times(struct series *s, const struct import_file *file,
                       struct import_header *header) {
    const uint32_t count = s->numbered.count;
    const struct import_file own = s->file;
    bool ok = header->steps.times && s->inner->read_time && count <= TIMES_MAX &&
              (s->times = calloc(count, sizeof *s->times)) != NULL;
    for (uint32_t i = 0; ok && i < count; i++) {
        char path[2 * PATH_MAX], real[PATH_MAX];
        struct import_file other = own;
        snprintf(path, sizeof path, "%s/%s", file->folder, s->numbered.names[i]);
        other.title = s->numbered.names[i];
        other.warnings = NULL;
        other.fd = sp_open_confined(file->root, path, other.title, real, &other.size, NULL);
        ok = other.fd >= 0 && s->inner->read_time(&other, &s->times[i]) &&
             (i == 0 || s->times[i] > s->times[i - 1]);
        if (other.fd >= 0)
            close(other.fd);
    }
    header->steps.times = ok ? s->times : NULL;
}

/* Opens a numbered file, at a step of its own. */
static bool open_member(struct series *s, const struct import_file *file, uint32_t number,
                        uint32_t step, struct import_header *header, struct sp_error *err) {
    import_format_close(s->inner, s->reader);
    s->reader = NULL;
    if (s->file.fd >= 0)
        close(s->file.fd);
    *header = (struct import_header){ .bytes = 0 };
    if (!open_file(s, file, s->numbered.names[number], err))
        return false;
    s->file.step = step;
    return open_step(s, header, err);
}

/* The first numbered file is a volume with steps of its own, or has the others as its slices. */
static bool open_alone(struct series *s, const struct import_file *file,
                       struct import_header *header, struct sp_error *err) {
    if (!header->took_folder)
        import_warn(file->warnings,
                    "Each of the %u numbered files has time steps of its own: only %.60s is shown. "
                    "Open the others on their own.",
                    s->numbered.count, s->numbered.names[0]);
    return file->step == 0 || open_member(s, file, 0, file->step, header, err);
}

/* Keeps the files of one subject, channel and so on. Of a folder no path said that they are steps,
 * if their names say something else. */
static uint32_t hold_others(struct series *s, const struct import_file *file,
                            struct import_numbers *numbers, char example[NAME_MAX + 1]) {
    uint32_t left_out = 0;
    for (unsigned k = 0; k < numbers->count && file->is_guess && numbers->is_doubtful; k++)
        if (numbers->meanings[k] == IMPORT_NUMBER_TIME)
            numbers->meanings[k] = IMPORT_NUMBER_OTHER;
    for (int other = IMPORT_NUMBER_SLICE; other <= IMPORT_NUMBER_OTHER; other++)
        if (other != IMPORT_NUMBER_TIME)
            left_out += import_numbers_hold(&s->numbered, numbers, (enum import_number_kind)other,
                                            s->numbered.names[0], example[0] ? NULL : example);
    return left_out;
}

/* The numbered files are the steps, unless the first of them has all of them as its slices, or
 * steps of its own, or is the only one. */
static bool open_numbered(void *reader, const struct import_file *file,
                          struct import_header *header, struct sp_error *err) {
    struct series *s = reader;
    struct import_numbers numbers;
    s->file.fd = -1;
    char example[NAME_MAX + 1] = "";
    if (!sp_numbered_list(file->folder, file->pattern, SP_STEPS_MAX + 1, &s->numbered, file->title,
                          err))
        return false;
    if (s->numbered.count == 0)
        return sp_fail(err, SP_ERR_NOT_FOUND, file->title, "the files of the series are gone");
    if (!import_numbers_guess(&s->numbered, IMPORT_NUMBER_TIME, &numbers))
        return sp_fail(err, SP_ERR_MEMORY, file->title, "out of memory for the names of files");
    const uint32_t left_out = hold_others(s, file, &numbers, example);
    const uint32_t count = s->numbered.count;
    const uint32_t step = count > 1 && file->step < count ? file->step : 0;
    if (!open_member(s, file, step, count > 1 ? 0 : file->step, header, err))
        return false;
    const bool has_steps = header->steps.count > 1;
    if (count > 1 && has_steps && !open_alone(s, file, header, err))
        return false;
    if (!header->took_folder)
        import_numbers_warn_left_out(left_out, example, s->title, file->warnings);
    if (header->took_folder || has_steps || count == 1)
        return has_steps || import_header_use_steps(header, file, 1, err);
    import_numbers_warn(&s->numbered, &numbers, IMPORT_NUMBER_TIME, "time steps", file->warnings);
    if (numbers.is_doubtful)
        import_warn(file->warnings,
                    "The numbered files are time steps, although their names may tell subjects, "
                    "channels or slices. Open one file to see it alone.");
    read_times(s, file, header);
    return import_header_use_steps(header, file, count, err);
}

static bool open_listed(void *reader, const struct import_file *file, struct import_header *header,
                        struct sp_error *err) {
    struct series *s = reader;
    struct import_header own = { .bytes = 0 };
    s->file.fd = -1;
    if (!collection_read(file, &s->listed, err) ||
        !import_header_use_steps(&own, file, s->listed.count, err) ||
        !open_file(s, file, s->listed.files[file->step].name, err) || !open_step(s, header, err))
        return false;
    if (header->steps.count > 1)
        return sp_fail(
            err, SP_ERR_UNSUPPORTED, s->title,
            "a step cannot be a series of its own; list its files, or open this file alone");
    header->steps = own.steps;
    header->steps.times = s->listed.times;
    return true;
}

static bool read_grid(void *reader, void *voxels, float (*vectors)[3],
                      const struct import_progress *progress, struct sp_error *err) {
    const struct series *s = reader;
    return s->inner->read(s->reader, voxels, vectors, progress, err);
}

static bool read_elements(void *reader, const struct sp_elements *elements,
                          const struct import_progress *progress, struct sp_error *err) {
    const struct series *s = reader;
    return s->inner->read_elements(s->reader, elements, progress, err);
}

const struct import_format import_series = { .name = "series",
                                             .reader_size = sizeof(struct series),
                                             .open = open_numbered,
                                             .read = read_grid,
                                             .read_elements = read_elements,
                                             .close = close_series };
const struct import_format import_collection = { .name = "time series (.pvd, .series)",
                                                 .needs_module = true,
                                                 .probe = collection_probe,
                                                 .reader_size = sizeof(struct series),
                                                 .open = open_listed,
                                                 .read = read_grid,
                                                 .read_elements = read_elements,
                                                 .close = close_series };
