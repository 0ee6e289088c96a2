/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/format.h"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#include "data/volume/anatomy.h"
#include "data/volume/unit.h"

void import_place(char place[SP_ERROR_PLACE], const char *title, uint64_t byte, const char *field) {
    snprintf(place, SP_ERROR_PLACE, "%.180s: byte %" PRIu64 "%s%s", title, byte, field ? ": " : "",
             field ? field : "");
}

bool import_fail(struct sp_error *err, enum sp_code code, const char *title, uint64_t byte,
                 const char *field, const char *format, ...) {
    char place[SP_ERROR_PLACE], text[SP_ERROR_TEXT];
    va_list args;
    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    import_place(place, title, byte, field);
    return sp_fail(err, code, place, "%s", text);
}

bool import_read(const struct import_file *file, void *out, size_t size, uint64_t at, size_t *got,
                 struct sp_error *err) {
    for (*got = 0; *got < size;) {
        const ssize_t n =
            pread(file->fd, (char *)out + *got, size - *got, (off_t)(at + (uint64_t)*got));
        if (n < 0 && errno == EINTR)
            continue;
        if (n < 0)
            return import_fail(err, SP_ERR_IO, file->title, at + *got, NULL,
                               "cannot read the file: %s", strerror(errno));
        if (n == 0)
            break;
        *got += (size_t)n;
    }
    return true;
}

void import_header_init(struct import_header *header) {
    struct sp_grid *grid = &header->grid;
    for (int axis = 0; axis < 3; axis++) {
        grid->spacing[axis] = 1;
        grid->origin[axis] = 0;
        grid->coordinates[axis] = NULL;
        for (int row = 0; row < 3; row++)
            grid->direction[row][axis] = header->frame[row][axis] = row == axis;
    }
}

void *import_format_open(const struct import_format *format, const struct import_file *file,
                         struct import_header *header, struct sp_error *err) {
    void *reader = calloc(1, format->reader_size);
    *header = (struct import_header){ .bytes = 0 };
    import_header_init(header);
    if (!reader) {
        sp_fail(err, SP_ERR_MEMORY, file->title, "out of memory");
        return NULL;
    }
    if (format->open(reader, file, header, err))
        return reader;
    import_format_close(format, reader);
    return NULL;
}

void import_format_close(const struct import_format *format, void *reader) {
    if (reader)
        format->close(reader);
    free(reader);
}

bool import_header_use_steps(struct import_header *header, const struct import_file *file,
                             uint64_t count, struct sp_error *err) {
    if (count > SP_STEPS_MAX)
        return sp_fail(err, SP_ERR_UNSUPPORTED, file->title,
                       "the file has %" PRIu64 " time steps; the limit is %u", count, SP_STEPS_MAX);
    header->steps.count = (uint32_t)count;
    header->steps.index = file->step;
    return file->step < count ||
           sp_fail(err, SP_ERR_NOT_FOUND, file->title,
                   "there is no time step %" PRIu32 "; the last one is %" PRIu64, file->step,
                   count - 1);
}

void import_header_use_interval(struct import_header *header, double first, double interval,
                                const char *unit) {
    if (!isfinite(first) || !isfinite(interval) || !(interval > 0))
        return;
    header->steps.first = first;
    header->steps.interval = interval;
    snprintf(header->steps.unit, sizeof header->steps.unit, "%.*s", SP_UNIT_BYTES - 1, unit);
}

void import_warn_distance(const struct import_header *header, struct import_warnings *warnings) {
    if (header->lacks_distance)
        import_warn(warnings,
                    "The file does not give the distance of its slices; that of columns was taken, "
                    "%g %s.",
                    header->grid.spacing[2], header->unit);
}

void import_header_use_elements(struct import_header *header,
                                const struct sp_elements_shape *shape) {
    import_header_init(header);
    for (int axis = 0; axis < 3; axis++)
        header->grid.dims[axis] = 1;
    header->elements = *shape;
    header->has_vectors = shape->has_vectors;
    header->type = SP_FLOAT32;
    header->bytes = sizeof(float);
}

bool import_ends_with(const char *name, const char *ending) {
    const size_t n = strlen(name), m = strlen(ending);
    return n > m && strcasecmp(name + n - m, ending) == 0;
}

void import_name(char out[SP_FIELD_BYTES], const char *name) {
    size_t n = strlen(name);
    if (n >= SP_FIELD_BYTES)
        for (n = SP_FIELD_BYTES - 1; n > 0 && ((unsigned char)name[n] & 0xc0) == 0x80;)
            n--;
    memcpy(out, name, n);
    out[n] = 0;
}

void import_header_add_vectors(struct import_header *header, const char *name) {
    header->has_vectors = true;
    import_name(header->vector_name, name);
}

/* False if the list is full. */
static bool add_name(char (*list)[SP_FIELD_BYTES], int capacity, const char *name) {
    char own[SP_FIELD_BYTES] = "";
    import_name(own, name);
    for (int i = 0; i < capacity && own[0]; i++) {
        if (strcmp(list[i], own) == 0)
            return true;
        if (!list[i][0]) {
            memcpy(list[i], own, sizeof own);
            return true;
        }
    }
    return !own[0];
}

void import_header_add_other(struct import_header *header, const char *name) {
    header->has_more |= !add_name(header->others, SP_OTHER_FIELDS_MAX, name);
}

void import_header_add_other_vectors(struct import_header *header, const char *name) {
    header->has_more |= !add_name(header->other_vectors, SP_OTHER_VECTORS_MAX, name);
}

static void name_component(char out[SP_FIELD_BYTES], unsigned number, bool is_color) {
    static const char *const colors[] = { "red", "green", "blue", "alpha" };
    if (is_color && number < 4)
        snprintf(out, SP_FIELD_BYTES, "%s", colors[number]);
    else
        snprintf(out, SP_FIELD_BYTES, "component %u", number + 1);
}

unsigned import_header_choose_component(struct import_header *header, const char *wanted,
                                        unsigned count, bool are_colors) {
    unsigned chosen = 0;
    char name[SP_FIELD_BYTES];
    for (unsigned i = 0; i < count; i++) {
        name_component(name, i, are_colors);
        if (strcmp(name, wanted) == 0)
            chosen = i;
    }
    name_component(header->value_name, chosen, are_colors);
    for (unsigned i = 0; i < count; i++) {
        name_component(name, i, are_colors);
        if (i != chosen)
            import_header_add_other(header, name);
    }
    return chosen;
}

void import_report(const struct import_progress *progress, uint64_t bytes) {
    if (progress)
        progress->report(progress->user, progress->before + bytes);
}

void import_grid_normalize(struct sp_grid *grid) {
    const double rounding = 1e-5;
    for (int axis = 0; axis < 3; axis++) {
        const double length = hypot(hypot(grid->direction[0][axis], grid->direction[1][axis]),
                                    grid->direction[2][axis]);
        for (int row = 0; row < 3 && length > 0; row++)
            grid->direction[row][axis] /= length;
        if (length > 0 && fabs(length - 1) > rounding)
            grid->spacing[axis] *= length;
    }
}

void import_grid_set_positions(struct sp_grid *grid, unsigned axis, double *positions) {
    uint32_t last = grid->dims[axis] - 1;
    double first = positions[0], sign = positions[last] < first ? -1 : 1;
    for (int row = 0; row < 3; row++) {
        if (grid->direction[row][axis] != 0) /* whatever `first` is */
            grid->origin[row] += grid->direction[row][axis] * first;
        if (sign < 0)
            grid->direction[row][axis] = 0 - grid->direction[row][axis]; /* never -0 */
    }
    if (last == 0)
        return;
    for (uint32_t i = 0; i <= last; i++)
        positions[i] = sign * (positions[i] - first);
    positions[0] = 0; /* not -0 */
    grid->spacing[axis] = positions[last] / last;
    grid->coordinates[axis] = positions;
}

const char *import_program_folder(char folder[PATH_MAX]) {
    ssize_t n = readlink("/proc/self/exe", folder, PATH_MAX - 1);
    folder[n > 0 ? n : 0] = 0;
    char *slash = strrchr(folder, '/');
    if (slash)
        *slash = 0;
    return folder;
}

void import_header_set_anatomy(struct import_header *header, const char letters[4]) {
    memcpy(header->anatomy, letters, sizeof header->anatomy);
    if (!sp_anatomy_is_left_handed(letters))
        return;
    for (int row = 0; row < 3; row++) {
        char *letter = &header->anatomy[row];
        if (*letter != 'A' && *letter != 'P')
            continue;
        *letter = *letter == 'A' ? 'P' : 'A';
        header->grid.origin[row] = 0 - header->grid.origin[row]; /* not -0 */
        for (int axis = 0; axis < 3; axis++) {
            header->grid.direction[row][axis] = 0 - header->grid.direction[row][axis];
            header->frame[row][axis] = 0 - header->frame[row][axis];
        }
    }
}

bool import_header_use_selection(struct import_header *header, const struct import_file *file,
                                 struct sp_error *err) {
    const struct import_selection *selection = &file->selection;
    if (selection->as == IMPORT_AS_LABELS && header->elements.kind == SP_KIND_GRID &&
        !header->has_vectors) {
        header->meaning = SP_MEANING_LABELS;
        header->used_as = true;
    }
    if (selection->as == IMPORT_AS_SLICE && !header->used_as)
        return sp_fail(err, SP_ERR_UNSUPPORTED, file->title,
                       "?as=slice: the file is not a single slice, such as an image or a file of a "
                       "DICOM series; open it without ?as=slice");
    if (selection->as != IMPORT_AS_FILE && !header->used_as)
        return sp_fail(err, SP_ERR_UNSUPPORTED, file->title,
                       "?as=%s: the file has no axis or components that can be read so; open it "
                       "without ?as=%s",
                       import_as_name(selection->as),
                       header->elements.kind == SP_KIND_GRID && !header->has_vectors
                           ? ", or with ?as=labels"
                           : "");
    if (selection->series[0] && !header->used_series)
        return sp_fail(err, SP_ERR_UNSUPPORTED, file->title,
                       "?series=%.60s: only DICOM files have series; open it without ?series=",
                       selection->series);
    const struct sp_unit *unit = sp_unit_find(selection->unit);
    if (file->level >= 0 && header->level_count == 0)
        return sp_fail(
            err, SP_ERR_UNSUPPORTED, file->title,
            "?level=%d: the file has no levels of detail; open it without ?level=", file->level);
    if (selection->unit[0] && !unit)
        import_warn(file->warnings,
                    "?unit=%s: this is no unit of length that is known, such as nm, um, mm, m or "
                    "km. It is shown as it is.",
                    selection->unit);
    if (selection->unit[0])
        snprintf(header->unit, sizeof header->unit, "%s", unit ? unit->symbol : selection->unit);
    return true;
}
