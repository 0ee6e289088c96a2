/* SPDX-License-Identifier: Apache-2.0
 *
 * Stacks of images: opening one file opens the numbered files of its folder, each a slice. Their
 * names differ in numbers only, which give the order. Files that differ in size, type or spacing
 * are left out.
 *
 *   file ─► inner format ─► one slice? ─► files of the folder ─► each read by the inner format
 */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "import/confine.h"
#include "import/format.h"
#include "import/numbered.h"
#include "volume/volume.h"

struct stack {
    const struct import_format *inner;
    const struct import_file *file;
    void *single; /* owned: the reader of a file that is a volume of its own; else NULL */
    struct sp_numbered slices;  /* in the folder of the file */
    struct import_header slice; /* of the first file */
};

/* A file of the folder. */
struct slice {
    struct import_file file;
    char real[PATH_MAX];
};

static bool find_files(struct stack *s, struct sp_error *err) {
    const char *slash = strrchr(s->file->shown, '/'), *own = slash ? slash + 1 : s->file->shown;
    char pattern[NAME_MAX + 1];
    if (!sp_numbered_pattern(own, pattern))
        return true;
    return sp_numbered_list(s->file->folder, pattern, SP_DIM_MAX + 1, &s->slices, s->file->shown,
                            err) &&
           (s->slices.count <= SP_DIM_MAX ||
            sp_fail(
                err, SP_ERR_UNSUPPORTED, s->file->shown,
                "more than %u files of the folder have such a name, the limit for a stack; move "
                "some of them, or open this one alone with ?as=slice",
                SP_DIM_MAX));
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
    slice->file = *s->file;
    slice->file.fd = fd;
    slice->file.size = size;
    slice->file.shown = s->slices.names[n];
    slice->file.warnings = warnings;
    *header = (struct import_header){ .bytes = 0 };
    void *reader = s->inner->open(&slice->file, header, err);
    if (!reader)
        close(fd);
    return reader;
}

static void close_slice(const struct stack *s, void *reader, const struct slice *slice) {
    s->inner->close(reader);
    close(slice->file.fd);
}

static bool is_same(const struct import_header *a, const struct import_header *b) {
    bool is_even = strcmp(a->unit, b->unit) == 0 && strcmp(a->value_unit, b->value_unit) == 0;
    for (int axis = 0; axis < 3; axis++)
        is_even &= fabs(a->grid.spacing[axis] / b->grid.spacing[axis] - 1) < 1e-3;
    return is_even && memcmp(a->grid.dims, b->grid.dims, sizeof a->grid.dims) == 0 &&
           a->type == b->type && a->bits == b->bits && strcmp(a->value_name, b->value_name) == 0;
}

/* Writes "30 x 20 px of 4 bits, spacing 1 x 1 mm". */
static void describe(const struct import_header *header, char *out, size_t size) {
    char bits[24];
    snprintf(bits, sizeof bits, "%u bits", header->bits);
    snprintf(out, size, "%" PRIu32 " x %" PRIu32 " px of %s, spacing %.4g x %.4g %s",
             header->grid.dims[0], header->grid.dims[1],
             header->bits ? bits : sp_type_name(header->type), header->grid.spacing[0],
             header->grid.spacing[1], header->unit);
}

/* A file beside the one that was asked for is damaged. */
static bool offer_slice(const struct stack *s, struct sp_error *err) {
    const size_t used = err ? strlen(err->text) : 0;
    const char *slash = strrchr(s->file->shown, '/');
    if (err)
        snprintf(err->text + used, sizeof err->text - used,
                 "; %.60s?as=slice opens that file alone", slash ? slash + 1 : s->file->shown);
    return false;
}

/* Leaves out the files that differ from the one that was asked for, with a warning. */
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
    if (s->single)
        s->inner->close(s->single);
    sp_numbered_finish(&s->slices);
    free(s);
}

/* Looks for other files if this one has a single slice. */
static bool take(struct stack *s, struct import_header *header, struct sp_error *err) {
    s->single = s->inner->open(s->file, header, err);
    if (!s->single)
        return false;
    if (header->grid.dims[2] > 1)
        return true;
    header->used_as |= s->file->selection.as == IMPORT_AS_SLICE;
    s->slice = *header;
    if (s->file->selection.as == IMPORT_AS_SLICE)
        return true;
    if (!find_files(s, err))
        return false;
    if (s->slices.count > 1 && !keep_alike(s, err))
        return false;
    if (s->slices.count < 2)
        return true;
    s->inner->close(s->single);
    s->single = NULL;
    header->grid.dims[2] = s->slices.count;
    header->took_folder = true;
    return sp_grid_check(&header->grid, header->type, s->file->shown, &header->bytes, err);
}

static void *open_stack(const struct import_format *inner, const struct import_file *file,
                        struct import_header *header, struct sp_error *err) {
    struct stack *s = calloc(1, sizeof *s);
    if (!s) {
        sp_fail(err, SP_ERR_MEMORY, file->shown, "out of memory");
        return NULL;
    }
    s->inner = inner;
    s->file = file;
    if (take(s, header, err))
        return s;
    close_stack(s);
    return NULL;
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

static void *open_tiffs(const struct import_file *file, struct import_header *header,
                        struct sp_error *err) {
    return open_stack(&import_tiff, file, header, err);
}

static void *open_images(const struct import_file *file, struct import_header *header,
                         struct sp_error *err) {
    return open_stack(&import_image, file, header, err);
}

static bool probe_tiffs(const uint8_t *start, size_t size, const char *shown) {
    return import_tiff.probe(start, size, shown);
}

static bool probe_images(const uint8_t *start, size_t size, const char *shown) {
    return import_image.probe(start, size, shown);
}

const struct import_format import_tiff_stack = { .name = "TIFF",
                                                 .needs_module = true,
                                                 .probe = probe_tiffs,
                                                 .open = open_tiffs,
                                                 .read = read_stack,
                                                 .close = close_stack };
const struct import_format import_image_stack = { .name = "image",
                                                  .needs_module = true,
                                                  .probe = probe_images,
                                                  .open = open_images,
                                                  .read = read_stack,
                                                  .close = close_stack };
