/* SPDX-License-Identifier: Apache-2.0
 *
 * MGH of FreeSurfer, plain (.mgh) or packed with gzip (.mgz): a header of 284 bytes, big endian,
 * then the samples. ITK does not read the format without a module that Debian does not have.
 */
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "data/import/samples.h"

enum { HEADER = 284, TIME_BYTES = 4 };
/* Bytes. The version is the last byte of its number; FreeSurfer 7 has an intent before it. */
enum place {
    VERSION = 3,
    DIMS = 4,
    FRAMES = 16,
    TYPE = 20,
    IS_PLACED = 28,
    SPACING = 30,
    DIRECTION = 42,
    CENTRE = 78
};

static bool probe(const uint8_t *start, size_t size, const char *title) {
    (void)start;
    (void)size;
    return import_ends_with(title, ".mgh") || import_ends_with(title, ".mgz") ||
           import_ends_with(title, ".mgh.gz");
}

static const struct import_number whole = { IMPORT_SIGNED, 4 }, real = { IMPORT_FLOAT, 4 };

static bool read_number(const struct import_file *file, const uint8_t *bytes,
                        struct import_number *number, struct sp_error *err) {
    static const struct import_number_entry known[] = {
        { NULL, 0, { IMPORT_UNSIGNED, 1 } },  { NULL, 1, { IMPORT_SIGNED, 4 } },
        { NULL, 3, { IMPORT_FLOAT, 4 } },     { NULL, 4, { IMPORT_SIGNED, 2 } },
        { NULL, 10, { IMPORT_UNSIGNED, 2 } },
    };
    const int code = (int)import_widen_big(bytes + TYPE, whole);
    return import_number_by_code(known, sizeof known / sizeof *known, code, number) ||
           import_fail(
               err, SP_ERR_UNSUPPORTED, file->title, TYPE, "type",
               "samples of type %d are not supported; supported are 0 (uint8), 1 (int32), 3 "
               "(float32), 4 (int16) and 10 (uint16); convert with mri_convert -odt float",
               code);
}

static bool read_dims(const struct import_file *file, const uint8_t *bytes,
                      struct import_header *header, struct sp_error *err) {
    uint32_t *dims = header->grid.dims;
    for (size_t axis = 0; axis < 3; axis++) {
        const double count = import_widen_big(bytes + DIMS + 4 * axis, whole);
        if (!(count >= 1))
            return import_fail(err, SP_ERR_FORMAT, file->title, DIMS + 4 * axis, "dim",
                               "axis %zu has %.0f samples, fewer than 1", axis + 1, count);
        dims[axis] = (uint32_t)count;
    }
    if (dims[0] > 1 && dims[1] == 1 && dims[2] == 1)
        return import_fail(err, SP_ERR_UNSUPPORTED, file->title, DIMS, "dim",
                           "the file holds %" PRIu32 " values of the nodes of a surface, which is "
                           "no volume; open the surface as VTK, PLY or OBJ (mris_convert)",
                           dims[0]);
    const double frames = import_widen_big(bytes + FRAMES, whole);
    return import_header_use_steps(header, file, frames > 1 ? (uint64_t)frames : 1, err);
}

/* The centre of the volume is known, and lies at half of the dims, as FreeSurfer defines it. A file
 * without a place is coronal, of 1 mm. */
static void read_place(const struct import_file *file, const uint8_t *bytes,
                       struct import_header *header) {
    static const double coronal[3][3] = { { -1, 0, 0 }, { 0, 0, 1 }, { 0, -1, 0 } };
    struct sp_grid *grid = &header->grid;
    const bool is_placed =
        import_widen_big(bytes + IS_PLACED, (struct import_number){ IMPORT_SIGNED, 2 }) > 0;
    bool is_sound = true;
    for (size_t axis = 0; axis < 3; axis++) {
        grid->spacing[axis] = is_placed ? import_widen_big(bytes + SPACING + 4 * axis, real) : 1;
        if (!(grid->spacing[axis] > 0) || !isfinite(grid->spacing[axis])) {
            grid->spacing[axis] = 1;
            is_sound = false;
        }
    }
    for (size_t row = 0; row < 3; row++) {
        grid->origin[row] = is_placed ? import_widen_big(bytes + CENTRE + 4 * row, real) : 0;
        for (size_t axis = 0; axis < 3; axis++) {
            grid->direction[row][axis] =
                is_placed ? import_widen_big(bytes + DIRECTION + 4 * (3 * axis + row), real)
                          : coronal[row][axis];
            grid->origin[row] -=
                grid->direction[row][axis] * grid->spacing[axis] * grid->dims[axis] / 2;
        }
    }
    import_grid_normalize(grid);
    if (!is_placed)
        import_warn(file->warnings,
                    "The header gives no place (goodRASFlag 0); the volume is taken "
                    "as coronal, with a spacing of 1 mm.");
    if (!is_sound)
        import_warn(file->warnings, "The spacing of an axis is unknown; it is taken as 1.");
    memcpy(header->unit, "mm", sizeof "mm");
    import_header_set_anatomy(header, "RAS");
}

/* Reads what follows the samples, by unpacking them. */
static bool read_after(const struct import_file *file, uint64_t at, uint8_t bytes[TIME_BYTES]) {
    struct import_stream *s = malloc(sizeof *s);
    uint8_t *skipped = malloc(IMPORT_STREAM_CHUNK);
    bool ok = s && skipped;
    size_t got = 0;
    if (ok) {
        import_stream_open(s, file->fd, false, file->title, file->size);
        ok = import_stream_seek(s, 0, NULL) && import_stream_begin(s, IMPORT_GZIP, real, NULL);
        for (; ok && at > 0; at -= got) {
            const size_t n = at < IMPORT_STREAM_CHUNK ? (size_t)at : IMPORT_STREAM_CHUNK;
            ok = import_stream_read(s, skipped, n, &got, NULL) && got == n;
        }
        ok = ok && import_stream_read(s, bytes, TIME_BYTES, &got, NULL) && got == TIME_BYTES;
        import_stream_close(s);
    }
    free(s);
    free(skipped);
    return ok;
}

/* The time between two steps, TR [ms], may follow the samples. */
static void read_interval(const struct import_file *file, uint64_t at, bool is_packed,
                          struct import_header *header) {
    uint8_t bytes[TIME_BYTES];
    if (header->steps.count < 2)
        return;
    if (is_packed ? read_after(file, at, bytes)
                  : pread(file->fd, bytes, TIME_BYTES, (off_t)at) == TIME_BYTES)
        import_header_use_interval(header, 0, import_widen_big(bytes, real), "ms");
}

static bool open_mgh(void *reader, const struct import_file *file, struct import_header *header,
                     struct sp_error *err) {
    struct import_sampled *m = reader;
    uint8_t bytes[HEADER];
    bool is_packed;
    struct import_samples *s = &m->samples;
    if (import_stream_head(file, bytes, HEADER, &is_packed) < HEADER || bytes[VERSION] != 1)
        return import_fail(err, SP_ERR_FORMAT, file->title, 0, "version",
                           "this is no MGH file: it does not begin with a header of 284 bytes of "
                           "version 1");
    if (!read_number(file, bytes, &s->number, err) || !read_dims(file, bytes, header, err))
        return false;
    read_place(file, bytes, header);
    m->conversion = import_conversion_of(s->number, file->warnings);
    s->field = "dim";
    s->big_endian = true;
    s->rest = IMPORT_REST_IGNORED; /* tags of FreeSurfer */
    if (!import_sampled_use(m, file, HEADER, is_packed, header, err))
        return false;
    read_interval(file, HEADER + s->bytes * header->steps.count, is_packed, header);
    return true;
}

const struct import_format import_mgh = { .name = "MGH",
                                          .probe = probe,
                                          .reader_size = sizeof(struct import_sampled),
                                          .open = open_mgh,
                                          .read = import_sampled_read,
                                          .close = import_sampled_close };
