/* SPDX-License-Identifier: Apache-2.0
 *
 * Scenes of Gaussians in Niantic's SPZ format, versions 1 to 3: gzip of a header and one array per
 * property, in this order and in little endian:
 *
 *   positions    three numbers of 24 bits, fixed point; version 1: of 16 bits, floating point
 *   opacities    a byte
 *   colors       three bytes: 0.5 + 0.15·coefficient
 *   scales       three bytes: (logarithm + 10)·16
 *   rotations    x, y and z of the quaternion in a byte each; version 3: the three smallest numbers
 *   harmonics    a byte each; of a coefficient, red, green and blue
 *
 * Why this parser is our own: parsers.md.
 */
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <zlib.h>

#include "data/import/format.h"
#include "data/volume/factor.h"

enum { HEADER = 16, IN_ROOM = 1 << 16, OUT_ROOM = 1 << 16, RATIO_MAX = 1032 }; /* bytes */

struct spz {
    const struct import_file *file;
    uint32_t version, count, degree;
    double unit; /* of positions */
    z_stream z;
    bool has_ended; /* the gzip data, whose checksum is right */
    uint64_t at;    /* bytes of the file that were read */
    uint8_t in[IN_ROOM], out[OUT_ROOM];
};

static bool probe(const uint8_t *start, size_t size, const char *title) {
    (void)start;
    (void)size;
    return import_ends_with(title, ".spz");
}

/* Unpacks exactly n bytes. */
static bool unpack(struct spz *s, void *out, size_t n, struct sp_error *err) {
    int status = s->has_ended ? Z_STREAM_END : Z_OK;
    s->z.next_out = out;
    s->z.avail_out = (unsigned)n;
    while (s->z.avail_out > 0) {
        if (s->z.avail_in == 0) {
            size_t got;
            if (!import_read(s->file, s->in, IN_ROOM, s->at, &got, err))
                return false;
            s->at += got;
            s->z.next_in = s->in;
            s->z.avail_in = (unsigned)got;
        }
        bool ended = status == Z_STREAM_END || s->z.avail_in == 0;
        if (!ended)
            status = inflate(&s->z, Z_NO_FLUSH);
        s->has_ended = status == Z_STREAM_END;
        if (status == Z_MEM_ERROR)
            return sp_fail(err, SP_ERR_MEMORY, s->file->title, "out of memory while unpacking");
        if (ended && !s->has_ended)
            return import_fail(err, SP_ERR_FORMAT, s->file->title, s->at, NULL,
                               "the gzip data is cut off");
        if (ended)
            return import_fail(err, SP_ERR_FORMAT, s->file->title, s->at, NULL,
                               "the data ends before the %" PRIu32 " Gaussians", s->count);
        if (status != Z_OK && status != Z_STREAM_END)
            return import_fail(err, SP_ERR_FORMAT, s->file->title, s->at, NULL,
                               "the gzip data is damaged%s%s", s->z.msg ? ": " : "",
                               s->z.msg ? s->z.msg : "");
    }
    return true;
}

static uint32_t word(const uint8_t *b) {
    return (uint32_t)b[0] | (uint32_t)b[1] << 8 | (uint32_t)b[2] << 16 | (uint32_t)b[3] << 24;
}

static bool begin(struct spz *s, struct sp_error *err) {
    uint8_t magic[8] = { 0 };
    const bool is_read = pread(s->file->fd, magic, sizeof magic, 0) >= 2;
    if (is_read && memcmp(magic, "NGSP", 4) == 0)
        return import_fail(err, SP_ERR_UNSUPPORTED, s->file->title, 4, "version",
                           "is %" PRIu32 "; supported are 1 to 3; save the scene as one of these, "
                           "or as PLY",
                           word(magic + 4));
    if (!is_read || magic[0] != 0x1f || magic[1] != 0x8b)
        return import_fail(err, SP_ERR_UNSUPPORTED, s->file->title, 0, NULL,
                           "the file is not packed by gzip, as versions 1 to 3 of SPZ are; save "
                           "the scene as one of these, or as PLY");
    inflateEnd(&s->z);
    memset(&s->z, 0, sizeof s->z);
    s->has_ended = false;
    s->at = 0;
    return inflateInit2(&s->z, 15 + 16) == Z_OK ||
           sp_fail(err, SP_ERR_MEMORY, s->file->title, "out of memory while unpacking");
}

static size_t position_bytes(const struct spz *s) {
    return s->version == 1 ? 6 : 9;
}

static size_t rotation_bytes(const struct spz *s) {
    return s->version < 3 ? 3 : 4;
}

static bool read_header(struct spz *s, struct sp_error *err) {
    const char *title = s->file->title;
    uint8_t b[HEADER];
    if (!unpack(s, b, sizeof b, err))
        return false;
    if (word(b) != 0x5053474e)
        return import_fail(err, SP_ERR_FORMAT, title, 0, "magic",
                           "the file does not begin like an SPZ file");
    s->version = word(b + 4);
    s->count = word(b + 8);
    s->degree = b[12];
    s->unit = ldexp(1, -b[13]);
    if (s->version < 1 || s->version > 3)
        return import_fail(err, SP_ERR_UNSUPPORTED, title, 4, "version",
                           "is %" PRIu32
                           "; supported are 1 to 3; save the scene as one of these, or "
                           "as PLY",
                           s->version);
    if (s->degree > SP_HARMONICS_DEGREE_MAX)
        return import_fail(
            err, SP_ERR_UNSUPPORTED, title, 12, "shDegree",
            "is %" PRIu32 "; supported are 0 to 3; save the scene with fewer harmonics", s->degree);
    if (s->count > SP_ELEMENTS_MAX)
        return import_fail(err, SP_ERR_UNSUPPORTED, title, 8, "numPoints",
                           "is %" PRIu32 "; a volume has at most %d", s->count, SP_ELEMENTS_MAX);
    const uint64_t each =
        position_bytes(s) + 1 + 3 + 3 + rotation_bytes(s) + 3 * (sp_harmonics_count(s->degree) - 1);
    return s->count * each <= s->file->size * RATIO_MAX ||
           import_fail(err, SP_ERR_FORMAT, title, 8, "numPoints",
                       "%" PRIu32 " Gaussians need %" PRIu64 " bytes; the file has too few even "
                       "if they are packed: it is cut off or the number is wrong",
                       s->count, s->count * each);
}

static void close_spz(void *reader) {
    struct spz *s = reader;
    inflateEnd(&s->z);
}

static bool open_spz(void *reader, const struct import_file *file, struct import_header *header,
                     struct sp_error *err) {
    struct spz *s = reader;
    s->file = file;
    if (!begin(s, err) || !read_header(s, err))
        return false;
    import_header_use_elements(header, &(struct sp_elements_shape){ .kind = SP_KIND_GAUSSIANS,
                                                                    .count = s->count,
                                                                    .degree = s->degree });
    return true;
}

/* A float of 16 bits. */
static double half(const uint8_t *b) {
    const unsigned bits = b[0] | (unsigned)b[1] << 8, exponent = bits >> 10 & 31;
    const unsigned fraction = bits & 1023;
    double value = exponent == 31  ? (fraction ? NAN : INFINITY)
                   : exponent == 0 ? ldexp(fraction, -24)
                                   : ldexp(1024 + fraction, (int)exponent - 25);
    return bits >> 15 ? -value : value;
}

static void decode_position(const struct spz *s, const struct sp_elements *e, size_t i,
                            const uint8_t *b) {
    for (int a = 0; a < 3; a++, b += position_bytes(s) / 3) {
        /* The sign is bit 23. */
        int32_t fixed = (int32_t)((uint32_t)b[0] << 8 | (uint32_t)b[1] << 16 |
                                  (s->version == 1 ? 0 : (uint32_t)b[2] << 24)) >>
                        8;
        e->positions[i][a] = (float)(s->version == 1 ? half(b) : fixed * s->unit);
    }
}

static void decode_opacity(const struct spz *s, const struct sp_elements *e, size_t i,
                           const uint8_t *b) {
    (void)s;
    e->opacities[i] = (float)b[0] / 255;
}

static void decode_color(const struct spz *s, const struct sp_elements *e, size_t i,
                         const uint8_t *b) {
    for (int c = 0; c < 3; c++)
        e->harmonics[3 * sp_harmonics_count(s->degree) * i + (size_t)c] =
            (float)((b[c] / 255.0 - 0.5) / 0.15);
}

/* The scales wait in the place of the factor. */
static void decode_scales(const struct spz *s, const struct sp_elements *e, size_t i,
                          const uint8_t *b) {
    (void)s;
    for (int a = 0; a < 3; a++)
        e->factors[i][a] = b[a];
}

/* Four numbers, w first. Version 3: two bits name the largest one of x, y, z and w, which is
 * positive; the others have a sign and nine bits each, the last one the lowest bits. */
static void unpack_rotation(uint32_t version, const uint8_t *b, double q[4]) {
    double squares = 0;
    uint32_t bits = version < 3 ? 0 : word(b);
    const uint32_t largest = version < 3 ? 3 : bits >> 30;
    for (uint32_t k = 4; k-- > 0;) {
        if (k == largest)
            continue;
        double value = version < 3 ? b[k] / 127.5 - 1 : (bits & 511) / 511.0 * M_SQRT1_2;
        if (version >= 3 && bits >> 9 & 1)
            value = -value;
        bits >>= 10;
        squares += value * value;
        q[(k + 1) % 4] = value;
    }
    q[(largest + 1) % 4] = sqrt(fmax(0, 1 - squares));
}

static void decode_rotation(const struct spz *s, const struct sp_elements *e, size_t i,
                            const uint8_t *b) {
    double scales[3], rotation[4];
    for (int a = 0; a < 3; a++)
        scales[a] = exp((double)e->factors[i][a] / 16 - 10);
    unpack_rotation(s->version, b, rotation);
    sp_gaussian_factor(scales, rotation, e->factors[i]);
}

static void decode_harmonics(const struct spz *s, const struct sp_elements *e, size_t i,
                             const uint8_t *b) {
    const uint32_t count = 3 * sp_harmonics_count(s->degree);
    for (uint32_t k = 3; k < count; k++)
        e->harmonics[count * i + k] = ((float)b[k - 3] - 128) / 128;
}

/* Unpacks the rest, because the checksum is at its end. */
static bool check_end(struct spz *s, struct sp_error *err) {
    struct sp_error why = { .code = SP_OK };
    bool has_more = false;
    while (unpack(s, s->out, 1, &why))
        has_more = true;
    if (!s->has_ended) {
        if (err)
            *err = why;
        return false;
    }
    if (has_more)
        import_warn(s->file->warnings,
                    "The file goes on after Gaussian %" PRIu32
                    ", the last one that its header declares; the rest is not read.",
                    s->count);
    return true;
}

static bool read_elements(void *reader, const struct sp_elements *elements,
                          const struct import_progress *progress, struct sp_error *err) {
    struct spz *s = reader;
    const struct {
        size_t bytes; /* of a Gaussian */
        void (*decode)(const struct spz *s, const struct sp_elements *e, size_t i,
                       const uint8_t *b);
        unsigned floats; /* that it becomes */
    } arrays[] = {
        { position_bytes(s), decode_position, 3 },
        { 1, decode_opacity, 1 },
        { 3, decode_color, 3 },
        { 3, decode_scales, 0 },
        { rotation_bytes(s), decode_rotation, 6 },
        { 3 * (sp_harmonics_count(s->degree) - 1), decode_harmonics,
          3 * (sp_harmonics_count(s->degree) - 1) },
    };
    uint8_t header[HEADER];
    struct import_progress rest = *progress;
    if (!begin(s, err) || !unpack(s, header, sizeof header, err))
        return false;
    for (size_t a = 0; a < sizeof arrays / sizeof *arrays; a++) {
        const size_t bytes = arrays[a].bytes, run = bytes ? OUT_ROOM / bytes : 0;
        for (size_t at = 0; bytes && at < s->count; at += run) {
            size_t n = s->count - at < run ? s->count - at : run;
            if (!unpack(s, s->out, n * bytes, err))
                return false;
            for (size_t i = 0; i < n; i++)
                arrays[a].decode(s, elements, at + i, s->out + i * bytes);
            import_report(&rest, (at + n) * arrays[a].floats * sizeof(float));
        }
        rest.before += (uint64_t)s->count * arrays[a].floats * sizeof(float);
    }
    return check_end(s, err);
}

const struct import_format import_spz = { .name = "SPZ",
                                          .probe = probe,
                                          .reader_size = sizeof(struct spz),
                                          .open = open_spz,
                                          .read_elements = read_elements,
                                          .close = close_spz };
