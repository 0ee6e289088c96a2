/* SPDX-License-Identifier: Apache-2.0
 *
 * GIPL (Guys Image Processing Lab), plain or packed with gzip: a header of 256 bytes, big endian,
 * then the samples. Its matrix, flags, limits, offset and scale of the values are not applied, as
 * in ITK, which alone reads the format in Debian.
 */
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "data/import/samples.h"

enum { HEADER = 256 };
enum place { DIMS = 0, TYPE = 8, SPACING = 10, ORIGIN = 204, MAGIC = 252 }; /* bytes */

static const uint8_t magics[2][4] = { { 0xef, 0xff, 0xe9, 0xb0 }, { 0x2a, 0xe3, 0x89, 0xb8 } };

static bool has_magic(const uint8_t *start, size_t size) {
    return size >= HEADER &&
           (memcmp(start + MAGIC, magics[0], 4) == 0 || memcmp(start + MAGIC, magics[1], 4) == 0);
}

static bool probe(const uint8_t *start, size_t size, const char *title) {
    return has_magic(start, size) || import_ends_with(title, ".gipl") ||
           import_ends_with(title, ".gipl.gz");
}

static bool read_number(const struct import_file *file, const uint8_t *bytes,
                        struct import_number *number, struct sp_error *err) {
    static const struct import_number_entry known[] = {
        { NULL, 7, { IMPORT_SIGNED, 1 } },           { NULL, 8, { IMPORT_UNSIGNED, 1 } },
        { NULL, 15, { IMPORT_SIGNED, 2 } },          { NULL, 16, { IMPORT_UNSIGNED, 2 } },
        { NULL, 31, { IMPORT_UNSIGNED, 4 } },        { NULL, 32, { IMPORT_SIGNED, 4 } },
        { NULL, 64, { IMPORT_FLOAT, 4 } },           { NULL, 65, { IMPORT_FLOAT, 8 } },
        { NULL, 144, { IMPORT_COMPLEX_SIGNED, 4 } }, { NULL, 160, { IMPORT_COMPLEX_SIGNED, 8 } },
        { NULL, 192, { IMPORT_COMPLEX, 8 } },        { NULL, 193, { IMPORT_COMPLEX, 16 } },
    };
    const int code =
        (int)import_widen_big(bytes + TYPE, (struct import_number){ IMPORT_UNSIGNED, 2 });
    return import_number_by_code(known, sizeof known / sizeof *known, code, number) ||
           import_fail(
               err, SP_ERR_UNSUPPORTED, file->title, TYPE, "image type",
               "samples of type %d are not supported%s; save the image with 8, 16 or 32 bits", code,
               code == 1 ? "; these are bits" : "");
}

static bool read_grid(const struct import_file *file, const uint8_t *bytes,
                      struct import_header *header, struct sp_error *err) {
    const struct import_number count = { IMPORT_UNSIGNED, 2 }, real = { IMPORT_FLOAT, 4 },
                               large = { IMPORT_FLOAT, 8 };
    struct sp_grid *grid = &header->grid;
    for (size_t axis = 0; axis < 3; axis++) {
        const double spacing = import_widen_big(bytes + SPACING + 4 * axis, real);
        const uint32_t dim = (uint32_t)import_widen_big(bytes + DIMS + 2 * axis, count);
        const double origin = import_widen_big(bytes + ORIGIN + 8 * axis, large);
        grid->dims[axis] = dim == 0 && axis == 2 ? 1 : dim;
        grid->spacing[axis] = spacing > 0 && isfinite(spacing) ? spacing : 1;
        grid->origin[axis] = isfinite(origin) ? origin : 0;
        if (grid->dims[axis] == 0)
            return import_fail(err, SP_ERR_FORMAT, file->title, DIMS + 2 * axis, "dim",
                               "axis %zu has no samples", axis + 1);
        if (!(spacing > 0) || !isfinite(spacing))
            import_warn(file->warnings, "The spacing of axis %zu is unknown; it is taken as 1.",
                        axis + 1);
    }
    memcpy(header->unit, "mm", sizeof "mm");
    const double steps = import_widen_big(bytes + DIMS + 6, count);
    return import_header_use_steps(header, file, steps > 1 ? (uint64_t)steps : 1, err);
}

static bool open_gipl(void *reader, const struct import_file *file, struct import_header *header,
                      struct sp_error *err) {
    struct import_sampled *g = reader;
    uint8_t bytes[HEADER];
    bool is_packed;
    struct import_samples *s = &g->samples;
    if (import_stream_head(file, bytes, HEADER, &is_packed) < HEADER || !has_magic(bytes, HEADER))
        return import_fail(err, SP_ERR_FORMAT, file->title, MAGIC, "magic number",
                           "this is no GIPL file: it does not begin with a header of 256 bytes");
    if (!read_number(file, bytes, &s->number, err) || !read_grid(file, bytes, header, err))
        return false;
    g->conversion = import_conversion_of(s->number, file->warnings);
    s->field = "dim";
    s->big_endian = true;
    s->rest = IMPORT_REST_WARNED;
    return import_sampled_use(g, file, HEADER, is_packed, header, err);
}

const struct import_format import_gipl = { .name = "GIPL",
                                           .probe = probe,
                                           .reader_size = sizeof(struct import_sampled),
                                           .open = open_gipl,
                                           .read = import_sampled_read,
                                           .close = import_sampled_close };
