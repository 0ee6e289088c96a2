/* SPDX-License-Identifier: Apache-2.0
 *
 * Stacks of images: opening one file opens the numbered files of its folder, each a slice. Their
 * names differ in numbers only, which give the order.
 *
 *   file ─► inner format ─► one slice? ─► files of the folder ─► each read by the inner format
 */
#include <inttypes.h>
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
    return !sp_numbered_pattern(own, pattern) ||
           sp_numbered_list(s->file->folder, pattern, SP_DIM_MAX, &s->slices, s->file->shown, err);
}

/* Opens slice n and its reader. NULL with *err set. */
static void *open_slice(const struct stack *s, uint32_t n, struct slice *slice,
                        struct import_header *header, struct sp_error *err) {
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
    return memcmp(a->grid.dims, b->grid.dims, sizeof a->grid.dims) == 0 && a->type == b->type &&
           strcmp(a->value_name, b->value_name) == 0;
}

static bool check_slices(const struct stack *s, struct sp_error *err) {
    struct slice slice;
    struct import_header header;
    for (uint32_t n = 0; n < s->slices.count; n++) {
        void *reader = open_slice(s, n, &slice, &header, err);
        if (!reader)
            return false;
        close_slice(s, reader, &slice);
        if (!is_same(&header, &s->slice))
            return sp_fail(err, SP_ERR_UNSUPPORTED, s->slices.names[n],
                           "%" PRIu32 " x %" PRIu32 " px of type %s, but %.80s has %" PRIu32
                           " x %" PRIu32 " and %s: slices of a "
                           "stack are alike; move what is no slice to another folder",
                           header.grid.dims[0], header.grid.dims[1], sp_type_name(header.type),
                           s->file->shown, s->slice.grid.dims[0], s->slice.grid.dims[1],
                           sp_type_name(s->slice.type));
    }
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
    s->slice = *header;
    if (!find_files(s, err))
        return false;
    if (s->slices.count < 2)
        return true;
    s->inner->close(s->single);
    s->single = NULL;
    header->grid.dims[2] = s->slices.count;
    header->took_folder = true;
    return check_slices(s, err) &&
           sp_grid_check(&header->grid, header->type, s->file->shown, &header->bytes, err);
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
        void *one = open_slice(s, n, &slice, &header, err);
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
