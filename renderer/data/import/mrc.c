/* SPDX-License-Identifier: Apache-2.0
 *
 * MRC2014 and CCP4 maps, plain or packed with gzip: a header of 1024 bytes, an extended header that
 * is skipped, then the samples, columns fastest. MAPC, MAPR and MAPS name the axis of the cell that
 * columns, rows and sections follow, so the samples keep their order and the directions say where
 * they are. ITK's reader takes bytes as unsigned, ignores the order of the axes, and does not know
 * float16.
 */
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "data/import/samples.h"
#include "data/volume/volume.h"

enum {
    HEADER = 1024,
    MODE_RGB = 16,
    MODE_FOUR_BITS = 101,
    VOLUME_STACK = 401,
    IMOD_STAMP = 1146047817,
    MRC_2014 = 20140 /* the least version that is one */
};

/* Flags of IMOD. */
enum { SIGNED_BYTES = 1, ORIGIN_OF_MRC = 4, HALF_BYTES = 16 };

enum place { /* bytes of the header */
             DIMS = 0,
             MODE = 12,
             START = 16,
             INTERVALS = 28,
             CELL = 40,
             ANGLES = 52,
             AXES = 64,
             LOW = 76,
             HIGH = 80,
             SPACE_GROUP = 88,
             EXTENDED = 92,
             VERSION = 108,
             STAMP = 152,
             FLAGS = 156,
             ORIGIN = 196,
             MAGIC = 208,
             MACHINE = 212,
};

struct parsing {
    const struct import_file *file;
    struct import_header *header;
    struct import_sampled *mrc;
    struct sp_error *err;
    uint8_t bytes[HEADER];
    bool is_big, is_packed;
    int axes[3]; /* of the cell, from 0, along columns, rows and sections */
};

static int32_t whole_of(const uint8_t *at, bool is_big) {
    uint32_t value;
    memcpy(&value, at, sizeof value);
    if (is_big != (__BYTE_ORDER__ == __ORDER_BIG_ENDIAN__))
        value = __builtin_bswap32(value);
    return (int32_t)value;
}

static int32_t whole_at(const struct parsing *p, size_t at) {
    return whole_of(p->bytes + at, p->is_big);
}

static double real_at(const struct parsing *p, size_t at) {
    const int32_t bits = whole_at(p, at);
    float value;
    memcpy(&value, &bits, sizeof value);
    return (double)value;
}

/* What the modes store. */
static const struct import_number_entry modes[] = {
    { NULL, 0, { IMPORT_SIGNED, 1 } },  { NULL, 1, { IMPORT_SIGNED, 2 } },
    { NULL, 2, { IMPORT_FLOAT, 4 } },   { NULL, 3, { IMPORT_COMPLEX_SIGNED, 4 } },
    { NULL, 4, { IMPORT_COMPLEX, 8 } }, { NULL, 6, { IMPORT_UNSIGNED, 2 } },
    { NULL, 12, { IMPORT_FLOAT, 2 } },  { NULL, MODE_RGB, { IMPORT_UNSIGNED, 1 } },
};

static bool has_magic(const uint8_t *start, size_t size) {
    return size >= MACHINE + 4 && memcmp(start + MAGIC, "MAP", 3) == 0 &&
           (start[MAGIC + 3] == ' ' || start[MAGIC + 3] == 0);
}

static bool has_ending(const char *name) {
    static const char *const endings[] = {
        ".mrc", ".mrcs", ".map", ".ccp4", ".rec", ".st", ".ali"
    };
    const size_t n = strlen(name);
    const bool is_packed = n > 3 && strcasecmp(name + n - 3, ".gz") == 0;
    for (size_t i = 0; i < sizeof endings / sizeof *endings; i++) {
        const size_t m = strlen(endings[i]), end = n - (is_packed ? 3 : 0);
        if (end > m && strncasecmp(name + end - m, endings[i], m) == 0)
            return true;
    }
    return false;
}

static bool probe(const uint8_t *start, size_t size, const char *title) {
    return has_magic(start, size) || has_ending(title);
}

#define REFUSE(code, at, field, ...)                                                               \
    import_fail(p->err, code, p->file->title, at, field, __VA_ARGS__)

/* Takes the byte order of the machine stamp, or else the other one if only that gives a valid
 * header. */
static bool detect_order(struct parsing *p) {
    for (int i = 0; i < 2; i++) {
        p->is_big = i == 0 ? p->bytes[MACHINE] == 0x11 : !p->is_big;
        const int32_t nx = whole_at(p, DIMS), mode = whole_at(p, MODE);
        if (nx > 0 && nx <= (int32_t)SP_DIM_MAX && mode >= 0 && mode < 1000)
            return true;
    }
    return REFUSE(SP_ERR_FORMAT, DIMS, "nx",
                  "this is no MRC file: nx is %" PRId32 " and mode %" PRId32
                  ", also wrong in the other byte order; nx must be in [1, %u], mode in [0, 999]",
                  whole_at(p, DIMS), whole_at(p, MODE), SP_DIM_MAX);
}

static bool read_dims(struct parsing *p) {
    uint32_t *dims = p->header->grid.dims;
    uint64_t steps = 1;
    for (int axis = 0; axis < 3; axis++) {
        const int32_t count = whole_at(p, DIMS + 4 * (size_t)axis);
        if (count < 1 || count > (int32_t)SP_DIM_MAX)
            return REFUSE(SP_ERR_FORMAT, DIMS + 4 * (uint64_t)axis, "nx, ny, nz",
                          "%" PRId32 " samples are outside [1, %u]", count, SP_DIM_MAX);
        dims[axis] = (uint32_t)count;
    }
    const int32_t sections = whole_at(p, INTERVALS + 8), group = whole_at(p, SPACE_GROUP);
    if (group >= VOLUME_STACK && sections > 0 && dims[2] % (uint32_t)sections == 0) {
        steps = dims[2] / (uint32_t)sections;
        dims[2] = (uint32_t)sections;
    }
    return import_header_use_steps(p->header, p->file, steps, p->err);
}

static bool read_axes(struct parsing *p) {
    bool seen[3] = { false, false, false }, is_given = false;
    for (int i = 0; i < 3; i++) {
        const int32_t axis = whole_at(p, AXES + 4 * (size_t)i);
        is_given |= axis != 0;
        p->axes[i] = axis >= 1 && axis <= 3 ? axis - 1 : -1;
        if (p->axes[i] >= 0)
            seen[axis - 1] = true;
    }
    if (!is_given) /* old files leave them out */
        for (int i = 0; i < 3; i++)
            p->axes[i] = i;
    return !is_given || (seen[0] && seen[1] && seen[2]) ||
           REFUSE(SP_ERR_FORMAT, AXES, "mapc, mapr, maps",
                  "%d, %d and %d are not the axes 1, 2 and 3 in some order", whole_at(p, AXES),
                  whole_at(p, AXES + 4), whole_at(p, AXES + 8));
}

/* Directions of the edges of the cell as columns: a along x, b in the plane of x and y. False if
 * the angles span no cell. */
static bool compute_edges(const struct parsing *p, double edges[3][3]) {
    double cosines[3], sine;
    for (int i = 0; i < 3; i++) {
        const double angle = real_at(p, ANGLES + 4 * (size_t)i);
        if (!(angle >= 0 && angle < 180))
            return false;
        cosines[i] = angle == 0 || angle == 90 ? 0 : cos(angle * (3.14159265358979323846 / 180));
    }
    sine = sqrt(1 - cosines[2] * cosines[2]);
    const double y = (cosines[0] - cosines[1] * cosines[2]) / sine;
    const double z = 1 - cosines[1] * cosines[1] - y * y;
    if (!(z > 1e-6))
        return false;
    const double columns[3][3] = { { 1, 0, 0 },
                                   { cosines[2], sine, 0 },
                                   { cosines[1], y, sqrt(z) } };
    for (int row = 0; row < 3; row++)
        for (int column = 0; column < 3; column++)
            edges[row][column] = columns[column][row];
    return true;
}

/* The steps along the edges of the cell. False if the header does not give them. */
static bool compute_spacing(const struct parsing *p, double spacing[3]) {
    bool is_given = true;
    for (int edge = 0; edge < 3; edge++) {
        const double length = real_at(p, CELL + 4 * (size_t)edge);
        const int32_t intervals = whole_at(p, INTERVALS + 4 * (size_t)edge);
        spacing[edge] = length / intervals;
        is_given &= intervals > 0 && length > 0 && isfinite(length);
    }
    for (int edge = 0; edge < 3 && !is_given; edge++)
        spacing[edge] = 1;
    return is_given;
}

/* The flags of IMOD; 0 if another program wrote the file. */
static int32_t flags_of(const struct parsing *p) {
    return whole_at(p, STAMP) == IMOD_STAMP ? whole_at(p, FLAGS) : 0;
}

/* True if the origin is IMOD's, which is the negative of the origin of MRC2014: the place of the
 * world's origin, seen from the first sample. A flag or the version may say otherwise. */
static bool is_origin_of_imod(const struct parsing *p) {
    return whole_at(p, STAMP) == IMOD_STAMP && (flags_of(p) & ORIGIN_OF_MRC) == 0 &&
           whole_at(p, VERSION) < MRC_2014;
}

/* The origin of MRC2014, or else the first sample of CCP4, counted in steps along its axes. */
static void compute_origin(const struct parsing *p, const double edges[3][3],
                           const double spacing[3], double origin[3]) {
    bool is_given = false;
    for (int row = 0; row < 3; row++) {
        origin[row] = real_at(p, ORIGIN + 4 * (size_t)row);
        if (!isfinite(origin[row]) || !has_magic(p->bytes, HEADER))
            origin[row] = 0;
        origin[row] = is_origin_of_imod(p) ? 0 - origin[row] : origin[row];
        is_given |= origin[row] != 0;
    }
    for (int i = 0; i < 3 && !is_given; i++)
        for (int row = 0; row < 3; row++)
            origin[row] +=
                edges[row][p->axes[i]] * spacing[p->axes[i]] * whole_at(p, START + 4 * (size_t)i);
}

static void read_grid(struct parsing *p) {
    struct sp_grid *grid = &p->header->grid;
    double spacing[3], edges[3][3] = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } };
    if (!compute_edges(p, edges))
        import_warn(p->file->warnings, "The angles of the cell are wrong; they are taken as 90°.");
    const bool is_given = compute_spacing(p, spacing);
    if (is_given)
        memcpy(p->header->unit, "angstrom", sizeof "angstrom");
    else
        import_warn(p->file->warnings,
                    "The header gives no size of the cell, so the spacing is 1.");
    compute_origin(p, (const double(*)[3])edges, spacing, grid->origin);
    for (int axis = 0; axis < 3; axis++) {
        grid->spacing[axis] = spacing[p->axes[axis]];
        for (int row = 0; row < 3; row++)
            grid->direction[row][axis] = edges[row][p->axes[axis]];
    }
}

/* Bytes are signed since MRC2014. IMOD has a flag for it. In files of other programs the largest
 * value shows whether they are. */
static bool is_unsigned_byte(const struct parsing *p) {
    if (whole_at(p, STAMP) == IMOD_STAMP)
        return (flags_of(p) & SIGNED_BYTES) == 0;
    return real_at(p, LOW) >= 0 && real_at(p, HIGH) > INT8_MAX && real_at(p, HIGH) <= UINT8_MAX;
}

static bool describe_samples(struct parsing *p) {
    struct import_samples *s = &p->mrc->samples;
    struct import_conversion *c = &p->mrc->conversion;
    const int32_t mode = whole_at(p, MODE), extended = whole_at(p, EXTENDED);
    if (mode == MODE_FOUR_BITS || (mode == 0 && (flags_of(p) & HALF_BYTES)))
        return REFUSE(SP_ERR_UNSUPPORTED, MODE, "mode",
                      "mode %" PRId32 " with samples of 4 bits is not supported; convert it with "
                      "\"newstack -mode 1\" of IMOD",
                      mode);
    if (!import_number_by_code(modes, sizeof modes / sizeof *modes, mode, &s->number))
        return REFUSE(SP_ERR_UNSUPPORTED, MODE, "mode",
                      "mode %" PRId32 " is not supported; supported are 0 (int8), 1 (int16), 2 "
                      "(float32), 3 and 4 (complex), 6 (uint16), 12 (float16) and 16 (colours)",
                      mode);
    if (extended < 0)
        return REFUSE(SP_ERR_FORMAT, EXTENDED, "nsymbt",
                      "the extended header has %" PRId32 " bytes; it must have at least 0",
                      extended);
    if (mode == 0 && is_unsigned_byte(p))
        s->number.kind = IMPORT_UNSIGNED;
    *c = import_conversion_of(s->number, p->file->warnings);
    if (mode == MODE_RGB) {
        c->components = 3;
        c->component = import_header_choose_component(p->header, p->file->field, 3, true);
    }
    s->field = "nx, ny, nz";
    s->big_endian = p->is_big;
    s->rest = IMPORT_REST_WARNED;
    return import_sampled_use(p->mrc, p->file, HEADER + (uint64_t)extended, p->is_packed, p->header,
                              p->err);
}

static bool open_mrc(void *reader, const struct import_file *file, struct import_header *header,
                     struct sp_error *err) {
    struct import_sampled *mrc = reader;
    struct parsing parsing = { .file = file, .header = header, .mrc = mrc, .err = err };
    struct parsing *p = &parsing;
    if (import_stream_head(file, p->bytes, HEADER, &p->is_packed) < HEADER)
        return REFUSE(SP_ERR_FORMAT, 0, NULL,
                      "an MRC file begins with a header of %d bytes; this file is shorter", HEADER);
    if (!detect_order(p) || !read_dims(p) || !read_axes(p))
        return false;
    read_grid(p);
    return describe_samples(p);
}

const struct import_format import_mrc = { .name = "MRC",
                                          .probe = probe,
                                          .reader_size = sizeof(struct import_sampled),
                                          .open = open_mrc,
                                          .read = import_sampled_read,
                                          .close = import_sampled_close };
