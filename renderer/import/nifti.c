/* SPDX-License-Identifier: Apache-2.0
 *
 * NIfTI-1 and NIfTI-2, in one file (.nii, .nii.gz) or as a header beside its samples (.hdr, .img,
 * which may be .img.gz), and the ANALYZE 7.5 files that NIfTI-1 extends. The parser of the header
 * is our own, because libnifti2 writes beyond its stack for damaged headers.
 *
 *   header ─► struct fields ─► grid, conversion, place of the samples ─► samples.c
 */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>
#include <zlib.h>

#include "import/derived.h"
#include "import/samples.h"
#include "volume/volume.h"

enum { HEADER_ONE = 348, HEADER_TWO = 540, COMPONENTS_MAX = 256 };
enum {
    INTENT_DISPLACEMENT = 1006,
    INTENT_VECTOR = 1007,
    TYPE_RGB = 128,
    TYPE_RGBA = 2304,
    UNIT_MM = 2
};

/* Where a version of the header has its numbers, and of which type they are. */
struct layout {
    int size;
    struct import_number count, code, real, units, offset;
    size_t dims, datatype, pixdim, offset_at, slope, start_at, units_at, forms, quaternion, shift,
        rows, intent, intent_name, magic;
};

static const struct layout layouts[] = {
    { .size = HEADER_ONE,
      .count = { IMPORT_SIGNED, 2 },
      .code = { IMPORT_SIGNED, 2 },
      .real = { IMPORT_FLOAT, 4 },
      .units = { IMPORT_SIGNED, 1 },
      .offset = { IMPORT_FLOAT, 4 },
      .dims = 40,
      .datatype = 70,
      .pixdim = 76,
      .offset_at = 108,
      .slope = 112,
      .start_at = 136,
      .units_at = 123,
      .forms = 252,
      .quaternion = 256,
      .shift = 268,
      .rows = 280,
      .intent = 68,
      .intent_name = 328,
      .magic = 344 },
    { .size = HEADER_TWO,
      .count = { IMPORT_SIGNED, 8 },
      .code = { IMPORT_SIGNED, 4 },
      .real = { IMPORT_FLOAT, 8 },
      .units = { IMPORT_SIGNED, 4 },
      .offset = { IMPORT_SIGNED, 8 },
      .dims = 16,
      .datatype = 12,
      .pixdim = 104,
      .offset_at = 168,
      .slope = 176,
      .start_at = 216,
      .units_at = 500,
      .forms = 344,
      .quaternion = 352,
      .shift = 376,
      .rows = 400,
      .intent = 504,
      .intent_name = 508,
      .magic = 4 },
};

struct fields { /* of a header */
    const struct layout *layout;
    bool is_packed, is_swapped;
    bool is_single; /* the samples are in the file of the header */
    double dims[8], pixdim[8];
    int datatype, intent, units, time_units, qform, sform;
    double offset, slope, inter, start; /* start: the time of the first step */
    double quaternion[3], shift[3], rows[3][4];
    char intent_name[17];
};

struct nifti {
    struct import_samples samples;
    struct import_conversion conversion;
};

static bool ends_with(const char *name, const char *ending) {
    const size_t n = strlen(name), m = strlen(ending);
    return n > m && strcasecmp(name + n - m, ending) == 0;
}

/* The first number of the file is the size of its header, in either byte order. */
static const struct layout *find_layout(const uint8_t *start, bool *is_swapped) {
    int32_t size;
    memcpy(&size, start, sizeof size);
    for (size_t i = 0; i < sizeof layouts / sizeof *layouts; i++)
        for (int swapped = 0; swapped < 2; swapped++) {
            *is_swapped = swapped;
            if ((swapped ? (int32_t)__builtin_bswap32((uint32_t)size) : size) == layouts[i].size)
                return &layouts[i];
        }
    return NULL;
}

/* The first bytes that come out of the start of a gzip file. */
static bool unpack_start(const uint8_t *start, size_t size, uint8_t out[4]) {
    z_stream z = { .next_in = (uint8_t *)(uintptr_t)start,
                   .avail_in = (unsigned)size,
                   .next_out = out,
                   .avail_out = 4 };
    if (inflateInit2(&z, 15 + 16) != Z_OK)
        return false;
    inflate(&z, Z_SYNC_FLUSH);
    inflateEnd(&z);
    return z.avail_out == 0;
}

static bool probe(const uint8_t *start, size_t size, const char *shown) {
    uint8_t unpacked[4];
    bool is_swapped;
    if (ends_with(shown, ".nii") || ends_with(shown, ".nii.gz") || ends_with(shown, ".hdr"))
        return true;
    if (size >= 2 && start[0] == 0x1f && start[1] == 0x8b)
        return unpack_start(start, size, unpacked) && find_layout(unpacked, &is_swapped);
    return size >= 4 && find_layout(start, &is_swapped);
}

/* Reads the start of the file, which may be packed. Returns how many bytes there are. */
static size_t read_start(const struct import_file *file, void *out, size_t size, bool *packed) {
    uint8_t magic[2] = { 0, 0 };
    size_t got = 0;
    *packed = pread(file->fd, magic, sizeof magic, 0) == 2 && magic[0] == 0x1f && magic[1] == 0x8b;
    int fd = lseek(file->fd, 0, SEEK_SET) == 0 ? dup(file->fd) : -1;
    gzFile stream = fd >= 0 ? gzdopen(fd, "rb") : NULL;
    if (stream) {
        const int n = gzread(stream, out, (unsigned)size);
        got = n > 0 ? (size_t)n : 0;
        gzclose_r(stream);
    } else if (fd >= 0) {
        close(fd);
    }
    return got;
}

static double number_at(const struct fields *f, const uint8_t *header, size_t at,
                        struct import_number number) {
    uint64_t value = 0;
    memcpy(&value, header + at, number.size);
    if (f->is_swapped)
        import_swap(&value, number.size, 1);
    return import_widen(&value, number);
}

static void numbers_at(const struct fields *f, const uint8_t *header, size_t at,
                       struct import_number number, double *out, int count) {
    for (int i = 0; i < count; i++)
        out[i] = number_at(f, header, at + (size_t)i * number.size, number);
}

static void take_fields(const uint8_t *header, struct fields *f) {
    const struct layout *l = f->layout;
    double forms[2];
    numbers_at(f, header, l->dims, l->count, f->dims, 8);
    numbers_at(f, header, l->pixdim, l->real, f->pixdim, 8);
    numbers_at(f, header, l->forms, l->code, forms, 2);
    numbers_at(f, header, l->quaternion, l->real, f->quaternion, 3);
    numbers_at(f, header, l->shift, l->real, f->shift, 3);
    numbers_at(f, header, l->rows, l->real, f->rows[0], 12);
    f->qform = (int)forms[0];
    f->sform = (int)forms[1];
    f->datatype =
        (int)number_at(f, header, l->datatype, (struct import_number){ IMPORT_SIGNED, 2 });
    f->intent = (int)number_at(f, header, l->intent, l->code);
    const int units = (int)number_at(f, header, l->units_at, l->units);
    f->units = units & 7;
    f->time_units = units >> 3 & 7;
    f->start = number_at(f, header, l->start_at, l->real);
    f->offset = number_at(f, header, l->offset_at, l->offset);
    f->slope = number_at(f, header, l->slope, l->real);
    f->inter = number_at(f, header, l->slope + l->real.size, l->real);
    memcpy(f->intent_name, header + l->intent_name, 16);
    f->is_single = header[l->magic] == 'n' && header[l->magic + 1] == '+';
}

static bool read_header(const struct import_file *file, struct fields *f, struct sp_error *err) {
    uint8_t header[HEADER_TWO] = { 0 };
    const size_t got = read_start(file, header, sizeof header, &f->is_packed);
    f->layout = got >= HEADER_ONE ? find_layout(header, &f->is_swapped) : NULL;
    if (!f->layout || got < (size_t)f->layout->size)
        return import_fail(err, SP_ERR_FORMAT, file->shown, 0, "sizeof_hdr",
                           "this is no NIfTI file: it does not begin with a header of 348 or 540 "
                           "bytes");
    take_fields(header, f);
    return true;
}

/* Dimensions beyond those of the file have one sample. */
static bool check_dims(const struct import_file *file, struct fields *f,
                       struct import_header *header, struct sp_error *err) {
    const uint64_t at = f->layout->dims;
    if (!(f->dims[0] >= 1 && f->dims[0] <= 7))
        return import_fail(err, SP_ERR_FORMAT, file->shown, at, "dim",
                           "%g dimensions, outside [1, 7]", f->dims[0]);
    for (int i = (int)f->dims[0] + 1; i < 8; i++)
        f->dims[i] = 1;
    for (int axis = 0; axis < 3; axis++) {
        const double count = f->dims[axis + 1];
        if (!(count >= 1 && count <= SP_DIM_MAX))
            return import_fail(err, SP_ERR_FORMAT, file->shown, at, "dim",
                               "axis %d has %g samples, outside [1, %u]", axis + 1, count,
                               SP_DIM_MAX);
        header->grid.dims[axis] = (uint32_t)count;
    }
    static const char *const units[8] = { "", "s", "ms", "us", "Hz", "ppm", "rad/s", "" };
    const double steps = f->dims[4];
    if (!(steps >= 1 && trunc(steps) == steps))
        return import_fail(err, SP_ERR_FORMAT, file->shown, at, "dim", "%g time steps", steps);
    if (!import_header_use_steps(header, file, (uint64_t)fmin(steps, 1e9), err))
        return false;
    if (steps > 1)
        import_header_use_interval(header, f->start, f->pixdim[4], units[f->time_units]);
    if (f->dims[5] > COMPONENTS_MAX || f->dims[6] > 1 || f->dims[7] > 1)
        return import_fail(err, SP_ERR_UNSUPPORTED, file->shown, at, "dim",
                           "more than five dimensions, or more than %d components, are not "
                           "supported",
                           COMPONENTS_MAX);
    return true;
}

/* The directions that a quaternion turns the axes into (nifti1.h, method 2). */
static void turn(const struct fields *f, double direction[3][3]) {
    double b = f->quaternion[0], c = f->quaternion[1], d = f->quaternion[2];
    double a = 1 - (b * b + c * c + d * d);
    if (a < 1e-7) { /* a half turn, apart from rounding */
        const double length = sqrt(b * b + c * c + d * d);
        a = 0;
        b /= length;
        c /= length;
        d /= length;
    } else {
        a = sqrt(a);
    }
    const double third = f->pixdim[0] < 0 ? -1 : 1;
    const double rows[3][3] = {
        { a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c) * third },
        { 2 * (b * c + a * d), a * a + c * c - b * b - d * d, 2 * (c * d - a * b) * third },
        { 2 * (b * d - a * c), 2 * (c * d + a * b), (a * a + d * d - c * c - b * b) * third },
    };
    memcpy(direction, rows, sizeof rows);
}

/* The columns of a matrix are the steps along the axes. */
static void use_rows(const struct fields *f, struct sp_grid *grid) {
    for (int axis = 0; axis < 3; axis++) {
        double length = 0;
        for (int row = 0; row < 3; row++)
            length += f->rows[row][axis] * f->rows[row][axis];
        grid->spacing[axis] = sqrt(length);
        for (int row = 0; row < 3; row++)
            grid->direction[row][axis] = f->rows[row][axis] / grid->spacing[axis];
        grid->origin[axis] = f->rows[axis][3];
    }
}

/* The world is that of the scanner or of an atlas, with the axes right, anterior and superior; or
 * not known. */
static void place(const struct fields *f, struct import_header *header) {
    struct sp_grid *grid = &header->grid;
    for (int axis = 0; axis < 3; axis++)
        grid->spacing[axis] = fabs(f->pixdim[axis + 1]);
    if (f->sform > 0) {
        use_rows(f, grid);
    } else if (f->qform > 0) {
        turn(f, grid->direction);
        memcpy(grid->origin, f->shift, sizeof grid->origin);
    } else {
        return;
    }
    import_header_set_anatomy(header, "RAS");
}

static bool find_number(const struct import_file *file, const struct fields *f,
                        struct import_number *number, struct sp_error *err) {
    static const struct {
        int code;
        struct import_number number;
    } known[] = {
        { 2, { IMPORT_UNSIGNED, 1 } },        { 256, { IMPORT_SIGNED, 1 } },
        { 512, { IMPORT_UNSIGNED, 2 } },      { 4, { IMPORT_SIGNED, 2 } },
        { 768, { IMPORT_UNSIGNED, 4 } },      { 8, { IMPORT_SIGNED, 4 } },
        { 1280, { IMPORT_UNSIGNED, 8 } },     { 1024, { IMPORT_SIGNED, 8 } },
        { 16, { IMPORT_FLOAT, 4 } },          { 64, { IMPORT_FLOAT, 8 } },
        { TYPE_RGB, { IMPORT_UNSIGNED, 1 } }, { TYPE_RGBA, { IMPORT_UNSIGNED, 1 } },
    };
    for (size_t i = 0; i < sizeof known / sizeof *known; i++)
        if (f->datatype == known[i].code) {
            *number = known[i].number;
            return true;
        }
    return import_fail(err, SP_ERR_UNSUPPORTED, file->shown, f->layout->datatype, "datatype",
                       "samples of type %d are not supported; complex numbers, bits and numbers "
                       "of 16 bytes never are",
                       f->datatype);
}

static bool is_vectors(const struct fields *f) {
    return f->dims[5] == 3 && (f->intent == INTENT_VECTOR || f->intent == INTENT_DISPLACEMENT);
}

/* The components of a sample: colours, which alternate in the file, or images one after another. */
static void choose_component(const struct import_file *file, const struct fields *f,
                             struct nifti *n, struct import_header *header) {
    const unsigned colors = f->datatype == TYPE_RGB ? 3 : f->datatype == TYPE_RGBA ? 4 : 1;
    if (colors > 1) {
        n->conversion.components = colors;
        n->conversion.component = import_header_choose_component(header, file->field, colors, true);
    } else if (f->dims[5] > 1) {
        n->samples.skip_bytes +=
            n->samples.bytes * header->steps.count *
            import_header_choose_component(header, file->field, (unsigned)f->dims[5], false);
    } else {
        import_name(header->value_name, f->intent_name);
    }
}

/* Which numbers of the file are read, and how they become samples. */
static bool describe(const struct import_file *file, const struct fields *f, struct nifti *n,
                     struct import_header *header, struct sp_error *err) {
    struct import_samples *s = &n->samples;
    struct import_conversion *c = &n->conversion;
    double low, high;
    if (!find_number(file, f, &s->number, err))
        return false;
    *c = import_conversion_of(s->number, n->samples.file->warnings);
    if (isfinite(f->slope) && isfinite(f->inter) && f->slope != 0) {
        c->slope = f->slope;
        c->offset = f->inter;
    }
    import_number_range(c->number, &low, &high);
    import_conversion_choose(c, low, high);
    header->type = c->type;
    if (!sp_grid_check(&header->grid, header->type, file->shown, &header->bytes, err))
        return false;
    const uint64_t count = header->bytes / sp_type_size(header->type);
    s->bytes = count * s->number.size;
    s->skip_bytes = (uint64_t)f->offset;
    s->big_endian = f->is_swapped == (__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__);
    s->rest_ignored = true; /* components; some programs write more than they need */
    if (is_vectors(f) && header->steps.count > 1)
        return import_fail(err, SP_ERR_UNSUPPORTED, file->shown, f->layout->intent, "intent_code",
                           "vectors with several time steps are not supported; save one step as a "
                           "file");
    if (is_vectors(f)) {
        s->is_vectors = s->is_planar = true;
        s->bytes *= 3;
        import_header_add_vectors(header, f->intent_name);
        import_header_use_vectors(header, file->field);
        return sp_grid_check(&header->grid, header->type, file->shown, &header->bytes, err);
    }
    choose_component(file, f, n, header);
    s->bytes *= c->components;
    import_samples_choose_step(s, header->steps.count, file->step);
    s->conversion = import_conversion_is_copy(c) ? NULL : c;
    return true;
}

/* The file of the samples has the name of the header with another ending. */
static bool find_samples(const struct import_file *file, const struct fields *f,
                         struct import_samples *s, struct sp_error *err) {
    if (f->is_single) {
        s->gzip = f->is_packed;
        return true;
    }
    const char *slash = strrchr(file->shown, '/'), *name = slash ? slash + 1 : file->shown;
    const int stem = (int)strlen(name) - 4;
    static const char *const endings[] = { ".img", ".img.gz", ".IMG" };
    for (size_t i = 0; i < sizeof endings / sizeof *endings && ends_with(name, ".hdr"); i++) {
        char beside[NAME_MAX + 8], path[PATH_MAX + NAME_MAX + 10];
        snprintf(beside, sizeof beside, "%.*s%s", stem, name, endings[i]);
        snprintf(path, sizeof path, "%s/%s", file->folder, beside);
        s->gzip = i == 1;
        if (access(path, R_OK) == 0)
            return import_samples_add(s, beside, strlen(beside)) ||
                   sp_fail(err, SP_ERR_MEMORY, file->shown, "out of memory");
    }
    return import_fail(err, SP_ERR_NOT_FOUND, file->shown, f->layout->magic, "magic",
                       "the samples are in another file, %.*s.img or .img.gz, which is not there",
                       stem > 0 ? stem : 0, name);
}

static bool take(const struct import_file *file, struct nifti *n, struct import_header *header,
                 struct sp_error *err) {
    static const char *const units[8] = { "", "m", "mm", "um", "", "", "", "" };
    struct fields f = { .layout = NULL };
    n->samples.file = file;
    n->samples.field = "dim";
    import_header_init(header);
    if (!read_header(file, &f, err) || !check_dims(file, &f, header, err))
        return false;
    place(&f, header);
    /* Programs that place a patient without a unit mean mm. */
    const int unit = f.units == 0 && header->anatomy[0] ? UNIT_MM : f.units;
    snprintf(header->unit, sizeof header->unit, "%s", units[unit]);
    if (!(f.offset >= 0 && f.offset <= (double)(INT64_C(1) << 48)))
        return import_fail(err, SP_ERR_FORMAT, file->shown, f.layout->offset_at, "vox_offset",
                           "is outside [0, 2^48]");
    return describe(file, &f, n, header, err) && find_samples(file, &f, &n->samples, err) &&
           import_samples_check(&n->samples, err);
}

static void close_nifti(void *reader) {
    struct nifti *n = reader;
    import_samples_finish(&n->samples);
    free(n);
}

static void *open_nifti(const struct import_file *file, struct import_header *header,
                        struct sp_error *err) {
    struct nifti *n = calloc(1, sizeof *n);
    if (!n)
        sp_fail(err, SP_ERR_MEMORY, file->shown, "out of memory");
    else if (take(file, n, header, err))
        return n;
    else
        close_nifti(n);
    return NULL;
}

static bool read_nifti(void *reader, void *voxels, float (*vectors)[3],
                       const struct import_progress *progress, struct sp_error *err) {
    const struct nifti *n = reader;
    return import_samples_read(&n->samples, voxels, vectors, progress, err);
}

const struct import_format import_nifti = {
    .name = "NIfTI", .probe = probe, .open = open_nifti, .read = read_nifti, .close = close_nifti
};
