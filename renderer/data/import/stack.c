/* SPDX-License-Identifier: Apache-2.0
 *
 * Stacks of images: opening one file opens the numbered files of its folder, each a slice. Their
 * names differ in numbers only, which give the order; numbers of times and channels make steps and
 * fields (numbers.h). Files that differ in size, type or spacing are left out.
 *
 *   file ─► inner format ─► one slice? ─► files of the folder ─► each read by the inner format
 */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "data/import/confine.h"
#include "data/import/format.h"
#include "data/import/meaning.h"
#include "data/import/numbers.h"
#include "data/volume/volume.h"

struct stack {
    const struct import_format *inner;
    const struct import_file *file;
    struct import_file alone; /* the same without what the numbers in the names answer */
    void *single; /* owned: the reader of a file that is a volume of its own; else NULL */
    struct import_names slices; /* in the folder of the file */
    struct import_numbers numbers;
    double *times;              /* the numbers of its times; NULL = none; owned */
    struct import_header slice; /* of the first file */
};

/* A file of the folder. */
struct slice {
    struct import_file file;
    char real[PATH_MAX];
};

static const char *own_name(const struct stack *s) {
    const char *slash = strrchr(s->file->title, '/');
    return slash ? slash + 1 : s->file->title;
}

static bool is_slice_alone(const struct stack *s) {
    return s->file->selection.as == IMPORT_AS_SLICE;
}

/* Lists the numbered files. Some numbers in the names may count times or channels: then they give
 * the steps and their meaning. */
static bool list_files(struct stack *s, struct sp_error *err) {
    const enum import_as as = s->file->selection.as;
    char pattern[NAME_MAX + 1];
    s->alone = *s->file;
    if (is_slice_alone(s) || !sp_numbered_pattern(own_name(s), pattern))
        return true;
    if (!sp_numbered_list(s->file->folder, pattern, SP_DIM_MAX + 1, &s->slices, s->file->title,
                          err))
        return false;
    if (!import_numbers_guess(&s->slices,
                              as == IMPORT_AS_TIME       ? IMPORT_NUMBER_TIME
                              : as == IMPORT_AS_CHANNELS ? IMPORT_NUMBER_CHANNEL
                                                         : IMPORT_NUMBER_SLICE,
                              &s->numbers))
        return sp_fail(err, SP_ERR_MEMORY, s->file->title, "out of memory for the names of files");
    if (import_numbers_count(&s->slices, &s->numbers, IMPORT_NUMBER_TIME, NULL) > 1)
        s->alone.step = 0;
    if (as == IMPORT_AS_TIME || as == IMPORT_AS_CHANNELS)
        s->alone.selection.as = IMPORT_AS_FILE;
    return true;
}

/* Opens slice n and its reader. If `warnings` is NULL, warnings are discarded. Returns
 * NULL with *err set on failure. */
static void *open_slice(const struct stack *s, uint32_t n, struct slice *slice,
                        struct import_header *header, struct import_warnings *warnings,
                        struct sp_error *err) {
    char path[PATH_MAX + NAME_MAX + 2];
    uint64_t size;
    snprintf(path, sizeof path, "%s/%s", s->file->folder, s->slices.names[n]);
    int fd = sp_open_confined(s->file->root, path, s->slices.names[n], slice->real, &size, err);
    if (fd < 0)
        return NULL;
    slice->file = s->alone;
    slice->file.fd = fd;
    slice->file.size = size;
    slice->file.title = s->slices.names[n];
    slice->file.warnings = warnings;
    void *reader = import_format_open(s->inner, &slice->file, header, err);
    if (!reader)
        close(fd);
    return reader;
}

static void close_slice(const struct stack *s, void *reader, const struct slice *slice) {
    import_format_close(s->inner, reader);
    close(slice->file.fd);
}

static bool is_same(const struct import_header *a, const struct import_header *b) {
    bool is_even = strcmp(a->unit, b->unit) == 0 && strcmp(a->value_unit, b->value_unit) == 0;
    for (int axis = 0; axis < 3; axis++)
        is_even &= fabs(a->grid.spacing[axis] / b->grid.spacing[axis] - 1) < 1e-3;
    return is_even && memcmp(a->grid.dims, b->grid.dims, sizeof a->grid.dims) == 0 &&
           a->type == b->type && a->bits == b->bits && strcmp(a->value_name, b->value_name) == 0;
}

/* Writes "30 × 20 px of 4 bits, spacing 1 × 1 mm". */
static void describe(const struct import_header *header, char *out, size_t size) {
    char bits[24];
    snprintf(bits, sizeof bits, "%u bits", header->bits);
    snprintf(out, size, "%" PRIu32 " × %" PRIu32 " px of %s, spacing %.4g × %.4g%s%s",
             header->grid.dims[0], header->grid.dims[1],
             header->bits ? bits : sp_type_name(header->type), header->grid.spacing[0],
             header->grid.spacing[1], header->unit[0] ? " " : "", header->unit);
}

/* Adds to the error about another file of the stack how to open the requested file alone. Returns
 * false. */
static bool offer_slice(const struct stack *s, struct sp_error *err) {
    const size_t used = err ? strlen(err->text) : 0;
    if (err)
        snprintf(err->text + used, sizeof err->text - used,
                 "; %.60s?as=slice opens that file alone", own_name(s));
    return false;
}

/* Keeps the files whose images are like the requested one; warns about the others. */
static bool keep_alike(struct stack *s, struct sp_error *err) {
    struct slice slice;
    struct import_header header;
    char first[NAME_MAX + 1] = "", theirs[120], ours[120];
    const uint32_t all = s->slices.count;
    uint32_t kept = 0;
    for (uint32_t n = 0; n < all; n++) {
        void *reader = open_slice(s, n, &slice, &header, NULL, err);
        if (!reader)
            return offer_slice(s, err);
        close_slice(s, reader, &slice);
        if (is_same(&header, &s->slice)) {
            char *name = s->slices.names[n];
            s->slices.names[n] = s->slices.names[kept];
            s->slices.names[kept++] = name;
        } else if (!first[0]) {
            snprintf(first, sizeof first, "%s", s->slices.names[n]);
            describe(&header, theirs, sizeof theirs);
        }
    }
    for (uint32_t n = kept; n < all; n++)
        free(s->slices.names[n]);
    s->slices.count = kept;
    describe(&s->slice, ours, sizeof ours);
    if (kept < all)
        import_warn(s->file->warnings,
                    "%" PRIu32 " of %" PRIu32 " numbered files were left out, such as %.60s (%s): "
                    "they differ from the file that was opened (%s).",
                    all - kept, all, first, theirs, ours);
    return true;
}

static void close_stack(void *reader) {
    struct stack *s = reader;
    import_format_close(s->inner, s->single);
    import_names_finish(&s->slices);
    free(s->times);
}

/* The first one for a value that is not there. */
static uint32_t index_of(const uint64_t *values, uint32_t count, uint64_t value) {
    uint32_t i = 0;
    while (i < count && values[i] != value)
        i++;
    return i < count ? i : 0;
}

/* Keeps the names of the value number `chosen` of this meaning. */
static void keep_value(struct stack *s, enum import_number_kind meaning, const uint64_t *values,
                       uint32_t chosen) {
    for (uint32_t i = 0; i < s->slices.count; i++)
        if (import_numbers_value(&s->numbers, meaning, s->slices.names[i]) == values[chosen]) {
            import_numbers_hold(&s->slices, &s->numbers, meaning, s->slices.names[i], NULL);
            return;
        }
}

/* Keeps the files of the wanted step, or else of the step that has the opened file. */
static bool use_times(struct stack *s, const uint64_t *values, uint32_t count,
                      struct import_header *header, struct sp_error *err) {
    header->used_as |= s->file->selection.as == IMPORT_AS_TIME;
    if (count < 2)
        return true;
    if (!import_header_use_steps(header, s->file, count, err))
        return false;
    s->times = calloc(count, sizeof *s->times);
    for (uint32_t i = 0; s->times && i < count; i++)
        s->times[i] = (double)values[i];
    header->steps.times = s->times;
    if (!s->file->has_step)
        header->steps.index = index_of(
            values, count, import_numbers_value(&s->numbers, IMPORT_NUMBER_TIME, own_name(s)));
    keep_value(s, IMPORT_NUMBER_TIME, values, header->steps.index);
    return true;
}

/* The files of the channel: of the field, or else of the file that was asked for. Images in colour
 * have their own fields. */
static void use_channels(struct stack *s, const uint64_t *values, uint32_t count,
                         struct import_header *header) {
    header->used_as |= s->file->selection.as == IMPORT_AS_CHANNELS;
    char example[NAME_MAX + 1] = "";
    if (count < 2)
        return;
    if (header->others[0][0]) {
        const uint32_t left_out = import_numbers_hold(&s->slices, &s->numbers,
                                                      IMPORT_NUMBER_CHANNEL, own_name(s), example);
        import_numbers_warn_left_out(left_out, example, own_name(s), s->file->warnings);
        return;
    }
    const uint64_t own = import_numbers_value(&s->numbers, IMPORT_NUMBER_CHANNEL, own_name(s));
    uint32_t chosen = s->file->field[0] ? 0 : index_of(values, count, own);
    char name[SP_FIELD_BYTES];
    for (uint32_t i = 0; i < count; i++) {
        snprintf(name, sizeof name, "channel %" PRIu64, values[i]);
        chosen = strcmp(name, s->file->field) == 0 ? i : chosen;
    }
    for (uint32_t i = 0; i < count; i++) {
        snprintf(name, sizeof name, "channel %" PRIu64, values[i]);
        if (i == chosen)
            import_name(header->value_name, name);
        else
            import_header_add_other(header, name);
    }
    keep_value(s, IMPORT_NUMBER_CHANNEL, values, chosen);
}

/* Chooses the files of one volume: subject, time and channel. */
static bool choose_files(struct stack *s, struct import_header *header, struct sp_error *err) {
    char example[NAME_MAX + 1] = "";
    const uint32_t left_out =
        import_numbers_hold(&s->slices, &s->numbers, IMPORT_NUMBER_OTHER, own_name(s), example);
    uint64_t *values = malloc((s->slices.count + 1) * sizeof *values);
    if (!values)
        return sp_fail(err, SP_ERR_MEMORY, s->file->title, "out of memory");
    uint32_t count = import_numbers_count(&s->slices, &s->numbers, IMPORT_NUMBER_TIME, values);
    bool ok = use_times(s, values, count, header, err);
    count = import_numbers_count(&s->slices, &s->numbers, IMPORT_NUMBER_CHANNEL, values);
    if (ok)
        use_channels(s, values, count, header);
    free(values);
    import_numbers_warn_left_out(left_out, example, own_name(s), s->file->warnings);
    return ok;
}

/* Warns if the names suggest that the files are not slices. */
static void warn_doubtful(const struct stack *s) {
    if (s->numbers.is_doubtful && !import_as_is_axis(s->file->selection.as))
        import_warn(s->file->warnings,
                    "The numbered files are slices, although their names may tell times or "
                    "channels. ?as=time and ?as=channels make steps and fields of them.");
}

/* Opens the file that was asked for. It is a volume of its own, or the first slice. */
static bool open_single(struct stack *s, struct import_header *header, struct sp_error *err) {
    s->single = import_format_open(s->inner, &s->alone, header, err);
    if (!s->single)
        return false;
    const bool is_slice = header->grid.dims[2] == 1 && header->steps.count < 2;
    if (is_slice && s->slices.count > 1)
        return true;
    if (s->alone.step == s->file->step && s->alone.selection.as == s->file->selection.as)
        return true;
    import_format_close(s->inner, s->single);
    s->single = import_format_open(s->inner, s->file, header, err);
    return s->single != NULL;
}

/* Looks for other files if this one has a single slice. */
static bool open_stack(struct stack *s, const struct import_file *file,
                       struct import_header *header, struct sp_error *err) {
    s->file = file;
    if (!list_files(s, err) || !open_single(s, header, err))
        return false;
    if (header->grid.dims[2] > 1)
        return true;
    header->used_as |= is_slice_alone(s);
    s->slice = *header;
    if (s->slices.count < 2)
        return true;
    if (s->slices.count > SP_DIM_MAX)
        return sp_fail(err, SP_ERR_UNSUPPORTED, s->file->title,
                       "more than %u files of the folder have such a name, the limit for a stack; "
                       "move some of them, or open this one alone with ?as=slice",
                       SP_DIM_MAX);
    if (!choose_files(s, header, err) || !keep_alike(s, err))
        return false;
    if (s->slices.count == 0)
        return sp_fail(err, SP_ERR_UNSUPPORTED, s->file->title,
                       "the files of this time step or channel differ from %.60s in size, type or "
                       "spacing; open one of them, or ?as=slice",
                       own_name(s));
    import_numbers_warn(&s->slices, &s->numbers, IMPORT_NUMBER_SLICE, "slices", s->file->warnings);
    warn_doubtful(s);
    if (s->slices.count < 2 && header->steps.count < 2 && !header->others[0][0])
        return true;
    import_format_close(s->inner, s->single);
    s->single = NULL;
    header->grid.dims[2] = s->slices.count;
    header->took_folder = true;
    if (header->grid.dims[2] > 1)
        import_warn_distance(header, s->file->warnings);
    return sp_grid_check(&header->grid, header->type, s->file->title, &header->bytes, err);
}

static bool read_stack(void *reader, void *voxels, float (*vectors)[3],
                       const struct import_progress *progress, struct sp_error *err) {
    const struct stack *s = reader;
    struct import_progress rest = *progress;
    if (s->single)
        return s->inner->read(s->single, voxels, vectors, progress, err);
    for (uint32_t n = 0; n < s->slices.count; n++) {
        struct slice slice;
        struct import_header header;
        void *one = open_slice(s, n, &slice, &header, s->file->warnings, err);
        if (!one)
            return false;
        bool ok = is_same(&header, &s->slice) || /* it was when the header was made */
                  sp_fail(err, SP_ERR_IO, s->slices.names[n],
                          "the file was changed while it was read; load it again");
        ok = ok && s->inner->read(one, (char *)voxels + n * s->slice.bytes, vectors, &rest, err);
        close_slice(s, one, &slice);
        if (!ok)
            return false;
        rest.before += s->slice.bytes;
    }
    return true;
}

static bool open_tiffs(void *reader, const struct import_file *file, struct import_header *header,
                       struct sp_error *err) {
    struct stack *s = reader;
    s->inner = &import_tiff;
    return open_stack(s, file, header, err);
}

static bool open_images(void *reader, const struct import_file *file, struct import_header *header,
                        struct sp_error *err) {
    struct stack *s = reader;
    s->inner = &import_image;
    return open_stack(s, file, header, err);
}

static bool probe_tiffs(const uint8_t *start, size_t size, const char *title) {
    return import_tiff.probe(start, size, title);
}

static bool probe_images(const uint8_t *start, size_t size, const char *title) {
    return import_image.probe(start, size, title);
}

const struct import_format import_tiff_stack = { .name = "TIFF",
                                                 .needs_module = true,
                                                 .probe = probe_tiffs,
                                                 .reader_size = sizeof(struct stack),
                                                 .open = open_tiffs,
                                                 .read = read_stack,
                                                 .close = close_stack };
const struct import_format import_image_stack = { .name = "PNG and JPEG",
                                                  .needs_module = true,
                                                  .probe = probe_images,
                                                  .reader_size = sizeof(struct stack),
                                                  .open = open_images,
                                                  .read = read_stack,
                                                  .close = close_stack };
