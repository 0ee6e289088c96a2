/* SPDX-License-Identifier: Apache-2.0
 *
 * NRRD, attached and detached, raw and gzip. teem parses the fields; the samples are read by
 * samples.c, straight to where they belong and counted byte by byte.
 */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <teem/nrrd.h>

#include "import/nrrd_header.h"
#include "import/samples.h"
#include "volume/volume.h"

enum { PIECES_MAX = 65536 }; /* data files */

struct parsing {
    const struct import_file *file;
    struct nrrd_header *text;
    const Nrrd *nrrd; /* fields alone, no samples */
    const NrrdIoState *io;
    struct import_header *header;
    struct import_samples *samples;
    struct sp_error *err;
};

#define REFUSE(p, code, field, ...)                                                                \
    nrrd_fail((p)->err, code, (p)->file, (p)->text, field, __VA_ARGS__)

static bool probe(const uint8_t *start, size_t size, const char *shown) {
    size_t n = strlen(shown);
    return (size >= 4 && memcmp(start, "NRRD", 4) == 0) ||
           (n > 5 &&
            (strcasecmp(shown + n - 5, ".nrrd") == 0 || strcasecmp(shown + n - 5, ".nhdr") == 0));
}

/* teem explains itself in a stack of lines, "[nrrd] FUNCTION: TEXT": the innermost one says what is
 * wrong, one above it which field was parsed. -1 when none was. */
static int explain_biff(char *out, size_t room) {
    char *stack = biffGetDone(NRRD);
    int field = -1;
    snprintf(out, room, "no reason given");
    if (!stack)
        return field;
    for (int f = 0; f < NRRD_TO_TEEM; f++) {
        char phrase[64];
        snprintf(phrase, sizeof phrase, "trouble parsing %s info",
                 nrrd_field_name((enum nrrd_field)f));
        if (strstr(stack, phrase))
            field = f;
    }
    size_t n = strlen(stack);
    while (n > 0 && stack[n - 1] == '\n')
        stack[--n] = 0;
    const char *line = strrchr(stack, '\n');
    line = line ? line + 1 : stack;
    const char *text = strstr(line, ": ");
    snprintf(out, room, "%s", text ? text + 2 : line);
    free(stack);
    return field;
}

/* teem's view of the fields: nothing is opened, nothing is allocated for samples. */
static bool parse_fields(const struct parsing *p, Nrrd *nrrd, NrrdIoState *io) {
    FILE *stream = fmemopen(p->text->clean, p->text->clean_size, "r");
    if (!stream)
        return sp_fail(p->err, SP_ERR_MEMORY, p->file->shown, "no memory for the header");
    io->skipData = AIR_TRUE;
    nrrdStateVerboseIO = 0;
    bool failed = nrrdRead(nrrd, stream, io) != 0;
    fclose(stream);
    if (!failed)
        return true;
    char why[SP_ERROR_TEXT];
    int field = explain_biff(why, sizeof why);
    if (strstr(why, "require endian info"))
        return import_fail(p->err, SP_ERR_FORMAT, p->file->shown, p->text->byte[NRRD_TYPE],
                           "endian", "%.40s samples need this field: little or big",
                           p->text->value[NRRD_TYPE]);
    if (field < 0 && strstr(why, "block size")) /* teem finds it missing at the end */
        field = p->text->value[NRRD_BLOCK_SIZE] ? NRRD_BLOCK_SIZE : NRRD_TYPE;
    if (field >= 0 && p->text->value[field])
        return REFUSE(p, SP_ERR_FORMAT, (enum nrrd_field)field, "%s", why);
    return import_fail(p->err, SP_ERR_FORMAT, p->file->shown, 0, "header", "%s", why);
}

static bool take_type(const struct parsing *p) {
    static const struct {
        int teem;
        enum sp_type type;
    } types[] = {
        { nrrdTypeUChar, SP_UINT8 },    { nrrdTypeChar, SP_INT8 }, { nrrdTypeUShort, SP_UINT16 },
        { nrrdTypeShort, SP_INT16 },    { nrrdTypeInt, SP_INT32 }, { nrrdTypeFloat, SP_FLOAT32 },
        { nrrdTypeDouble, SP_FLOAT64 },
    };
    for (size_t i = 0; i < sizeof types / sizeof types[0]; i++)
        if (p->nrrd->type == types[i].teem) {
            p->header->type = types[i].type;
            return true;
        }
    return REFUSE(p, SP_ERR_UNSUPPORTED, NRRD_TYPE,
                  "%.40s samples are not supported; convert them to uint8, int8, uint16, int16, "
                  "int32, float or double",
                  p->text->value[NRRD_TYPE]);
}

static bool take_sizes(const struct parsing *p) {
    unsigned dim = p->text->dimension;
    for (unsigned axis = 0; axis < 3; axis++) {
        p->header->grid.dims[axis] = axis < dim ? (uint32_t)p->text->sizes[axis] : 1;
        if (axis < dim && (dim != p->nrrd->dim || p->text->sizes[axis] != p->nrrd->axis[axis].size))
            return REFUSE(p, SP_ERR_FORMAT, NRRD_SIZES, "axis %u is ambiguous", axis);
    }
    for (unsigned axis = 0; axis < dim; axis++) {
        int kind = p->nrrd->axis[axis].kind;
        if (kind != nrrdKindUnknown && kind != nrrdKindDomain && kind != nrrdKindSpace)
            return REFUSE(p, SP_ERR_UNSUPPORTED, NRRD_KINDS,
                          "axis %u is of kind %s; only scalar volumes are read", axis,
                          airEnumStr(nrrdKind, kind));
    }
    return true;
}

/* "spacings", "axis mins", "axis maxs": axes along the world's. */
static bool take_spacings(const struct parsing *p) {
    for (unsigned axis = 0; axis < p->nrrd->dim; axis++) {
        const NrrdAxisInfo *a = &p->nrrd->axis[axis];
        double *spacing = &p->header->grid.spacing[axis], n = (double)a->size;
        bool cell = a->center == nrrdCenterCell;
        if (p->text->value[NRRD_SPACINGS]) {
            if (!isfinite(a->spacing))
                return REFUSE(p, SP_ERR_FORMAT, NRRD_SPACINGS,
                              "the spacing of axis %u is not a number; write what it is, or leave "
                              "the field out for 1",
                              axis);
            *spacing = a->spacing;
        } else if (isfinite(a->min) && isfinite(a->max) && (cell || a->size > 1)) {
            *spacing = (a->max - a->min) / (cell ? n : n - 1);
        }
        if (isfinite(a->min))
            p->header->grid.origin[axis] = a->min + (cell ? *spacing / 2 : 0);
    }
    return true;
}

/* "space directions": columns with lengths; an image of two axes gets the third at right angles. */
static bool take_directions(const struct parsing *p) {
    struct sp_grid *grid = &p->header->grid;
    unsigned dim = p->nrrd->dim, space = p->nrrd->spaceDim;
    if (space > 3 || space < dim)
        return REFUSE(p, SP_ERR_UNSUPPORTED,
                      p->text->value[NRRD_SPACE] ? NRRD_SPACE : NRRD_SPACE_DIMENSION,
                      "a space of %u dimensions for %u axes; 3 are supported", space, dim);
    for (unsigned axis = 0; axis < dim; axis++) {
        double v[3] = { 0, 0, 0 }, length = 0;
        for (unsigned row = 0; row < space; row++) {
            v[row] = p->nrrd->axis[axis].spaceDirection[row];
            length += v[row] * v[row];
        }
        length = sqrt(length);
        if (!isfinite(length) || !(length > 0))
            return REFUSE(p, SP_ERR_FORMAT, NRRD_SPACE_DIRECTIONS,
                          "axis %u has no direction (none, not a number, or of length 0)", axis);
        grid->spacing[axis] = length;
        for (int row = 0; row < 3; row++)
            grid->direction[row][axis] = v[row] / length;
    }
    if (dim == 2) {
        double n[3], length = 0;
        for (int i = 0; i < 3; i++) {
            int j = (i + 1) % 3, k = (i + 2) % 3;
            n[i] = grid->direction[j][0] * grid->direction[k][1] -
                   grid->direction[k][0] * grid->direction[j][1];
            length += n[i] * n[i];
        }
        length = sqrt(length);
        if (!(length > 1e-6))
            return REFUSE(p, SP_ERR_FORMAT, NRRD_SPACE_DIRECTIONS, "the two axes are parallel");
        for (int row = 0; row < 3; row++)
            grid->direction[row][2] = n[row] / length;
    }
    return true;
}

static bool take_unit(const struct parsing *p, enum nrrd_field field) {
    bool of_space = field == NRRD_SPACE_UNITS;
    unsigned count = of_space ? p->nrrd->spaceDim : p->nrrd->dim;
    const char *unit = NULL;
    for (unsigned i = 0; i < count; i++) {
        const char *u = of_space ? p->nrrd->spaceUnits[i] : p->nrrd->axis[i].units;
        if (!u || !*u)
            continue;
        if (unit && strcmp(unit, u) != 0)
            return REFUSE(p, SP_ERR_UNSUPPORTED, field,
                          "\"%.30s\" and \"%.30s\" differ; all axes must have one unit", unit, u);
        unit = u;
    }
    if (unit && strlen(unit) >= SP_UNIT_BYTES)
        return REFUSE(p, SP_ERR_FORMAT, field, "a unit has at most %d bytes", SP_UNIT_BYTES - 1);
    if (unit)
        snprintf(p->header->unit, sizeof p->header->unit, "%s", unit);
    return true;
}

static bool take_geometry(const struct parsing *p) {
    import_grid_init(&p->header->grid);
    if (!take_sizes(p))
        return false;
    bool directed = p->text->value[NRRD_SPACE_DIRECTIONS] != NULL;
    if (!(directed ? take_directions(p) : take_spacings(p)))
        return false;
    if (p->text->value[NRRD_SPACE_ORIGIN])
        for (unsigned i = 0; i < p->nrrd->spaceDim && i < 3; i++) {
            if (!isfinite(p->nrrd->spaceOrigin[i]))
                return REFUSE(p, SP_ERR_FORMAT, NRRD_SPACE_ORIGIN, "number %u is not a number", i);
            p->header->grid.origin[i] = p->nrrd->spaceOrigin[i];
        }
    return take_unit(p, NRRD_UNITS) && take_unit(p, NRRD_SPACE_UNITS);
}

static bool take_encoding(const struct parsing *p) {
    struct import_samples *s = p->samples;
    if (p->io->encoding == nrrdEncodingGzip)
        s->gzip = true;
    else if (p->io->encoding != nrrdEncodingRaw)
        return REFUSE(p, SP_ERR_UNSUPPORTED, NRRD_ENCODING,
                      "%.40s is not supported; write the file as raw or gzip",
                      p->text->value[NRRD_ENCODING]);
    if (sp_type_size(p->header->type) > 1) /* teem insists on the field then */
        s->big_endian = p->io->endian == airEndianBig;
    return true;
}

static bool parse_integer(const char *text, long long low, long long high, long long *out) {
    char *end;
    size_t n = strlen(text);
    if (n == 0 || n > 18 || strspn(text, "+-0123456789") != n)
        return false;
    *out = strtoll(text, &end, 10);
    return !*end && *out >= low && *out <= high;
}

static bool take_skips(const struct parsing *p) {
    struct import_samples *s = p->samples;
    long long n;
    if (p->text->value[NRRD_LINE_SKIP]) {
        if (!parse_integer(p->text->value[NRRD_LINE_SKIP], 0, 1000000, &n))
            return REFUSE(p, SP_ERR_FORMAT, NRRD_LINE_SKIP, "must be in [0, 1000000]");
        s->skip_lines = (uint64_t)n;
    }
    if (p->text->value[NRRD_BYTE_SKIP]) {
        if (!parse_integer(p->text->value[NRRD_BYTE_SKIP], -1, INT64_C(1) << 48, &n))
            return REFUSE(p, SP_ERR_FORMAT, NRRD_BYTE_SKIP, "must be in [-1, 2^48]");
        if (n < 0 && s->gzip)
            return REFUSE(p, SP_ERR_FORMAT, NRRD_BYTE_SKIP,
                          "-1 (the last bytes of the file) works with encoding raw alone");
        s->from_end = n < 0;
        s->skip_bytes = n < 0 ? 0 : (uint64_t)n;
    }
    s->rest_ignored = s->skip_lines > 0 || s->skip_bytes > 0;
    return true;
}

/* Data files. */

static bool add_name(const struct parsing *p, const char *name, size_t length) {
    if (p->samples->count >= PIECES_MAX)
        return REFUSE(p, SP_ERR_FORMAT, NRRD_DATA_FILE, "names more than %d files", PIECES_MAX);
    if (!import_samples_add(p->samples, name, length))
        return sp_fail(p->err, SP_ERR_MEMORY, p->file->shown, "no memory for file names");
    return true;
}

static bool take_list(const struct parsing *p) {
    const char *at = p->text->list, *stop = p->text->text + p->text->size;
    size_t length = strlen(at); /* the text ends with 0 */
    if (at + length != stop)
        return import_fail(p->err, SP_ERR_FORMAT, p->file->shown,
                           (uint64_t)(at + length - p->text->text), "data file",
                           "a byte 0 in a name");
    while (*at) {
        size_t line = strcspn(at, "\n"), n = line;
        while (n > 0 && (at[n - 1] == '\r' || at[n - 1] == ' '))
            n--;
        if (n > 0 && !add_name(p, at, n))
            return false;
        at += line + (at[line] == '\n');
    }
    if (p->samples->count == 0)
        return REFUSE(p, SP_ERR_FORMAT, NRRD_DATA_FILE, "the LIST is empty");
    return true;
}

/* The last word of `text`, taken off it; NULL when there is only one left. */
static char *take_word(char *text) {
    size_t n = strlen(text);
    while (n > 0 && (text[n - 1] == ' ' || text[n - 1] == '\t'))
        text[--n] = 0;
    char *space = strrchr(text, ' ');
    if (!space)
        return NULL;
    *space = 0;
    return space + 1;
}

/* "FORMAT MIN MAX STEP [SUBDIM]" with one %d, %03d or the like in FORMAT. False when the value is
 * not of that form; it may then be a plain name. */
struct pattern {
    char value[NRRD_VALUE_MAX + 1];
    size_t before, after; /* FORMAT up to '%', and where it goes on */
    int width;
    bool zeros;
    long long low, high, step, subdim;
};

static bool parse_pattern(const char *value, struct pattern *f) {
    snprintf(f->value, sizeof f->value, "%s", value);
    if (!strchr(f->value, '%'))
        return false;
    long long numbers[4];
    int count = 0;
    for (char *word; count < 4; count++) {
        char copy[sizeof f->value];
        snprintf(copy, sizeof copy, "%s", f->value);
        if (!(word = take_word(copy)) || !parse_integer(word, -1000000, 1000000, &numbers[count]))
            break;
        take_word(f->value);
    }
    if (count < 3)
        return false;
    f->subdim = count == 4 ? numbers[0] : 0;
    f->step = numbers[count - 3];
    f->high = numbers[count - 2];
    f->low = numbers[count - 1];
    const char *percent = strchr(f->value, '%'), *c = percent + 1;
    f->before = (size_t)(percent - f->value);
    f->zeros = *c == '0';
    f->width = 0;
    while (*c >= '0' && *c <= '9' && f->width < 10)
        f->width = f->width * 10 + (*c++ - '0');
    f->after = (size_t)(c + 1 - f->value);
    return (*c == 'd' || *c == 'u' || *c == 'i') && f->width <= 20 && !strchr(c, '%');
}

static bool take_pattern(const struct parsing *p, const struct pattern *f) {
    if (f->step == 0 || (f->step > 0 ? f->high < f->low : f->high > f->low))
        return REFUSE(p, SP_ERR_FORMAT, NRRD_DATA_FILE, "counts from %lld to %lld by %lld", f->low,
                      f->high, f->step);
    for (long long i = f->low; f->step > 0 ? i <= f->high : i >= f->high; i += f->step) {
        char name[NRRD_VALUE_MAX + 32];
        int n = snprintf(name, sizeof name, f->zeros ? "%.*s%0*lld%s" : "%.*s%*lld%s",
                         (int)f->before, f->value, f->width, i, f->value + f->after);
        if (!add_name(p, name, (size_t)n))
            return false;
    }
    return true;
}

/* Each file holds the axes below `subdim`, or a slab along the last one when it is all of them. In
 * every case the files follow each other in memory. */
static bool check_pieces(const struct parsing *p, long long subdim) {
    unsigned dim = p->nrrd->dim;
    uint64_t pieces = p->samples->count, expected = 1;
    if (subdim < 0 || subdim > dim)
        return REFUSE(p, SP_ERR_FORMAT, NRRD_DATA_FILE, "files of %lld axes for a volume of %u",
                      subdim, dim);
    if (subdim == 0)
        subdim = dim - 1;
    for (unsigned axis = (unsigned)subdim; axis < dim; axis++)
        expected *= p->text->sizes[axis];
    if (subdim < dim ? pieces != expected : p->text->sizes[dim - 1] % pieces != 0)
        return REFUSE(p, SP_ERR_FORMAT, NRRD_DATA_FILE,
                      "names %" PRIu64 " files, but sizes want %" PRIu64, pieces,
                      subdim < dim ? expected : p->text->sizes[dim - 1]);
    return true;
}

static bool take_data_files(const struct parsing *p) {
    const char *value = p->text->value[NRRD_DATA_FILE];
    struct pattern pattern;
    p->samples->start = p->text->end;
    if (!value)
        return true;
    if (!*value)
        return REFUSE(p, SP_ERR_FORMAT, NRRD_DATA_FILE, "names no file");
    if (p->text->list) {
        long long subdim = 0;
        if (value[4] && !parse_integer(value + 4 + strspn(value + 4, " "), 1, 3, &subdim))
            return REFUSE(p, SP_ERR_FORMAT, NRRD_DATA_FILE, "after LIST comes a number of axes");
        return take_list(p) && check_pieces(p, subdim);
    }
    if (parse_pattern(value, &pattern))
        return take_pattern(p, &pattern) && check_pieces(p, pattern.subdim);
    return add_name(p, value, strlen(value));
}

static void close_nrrd(void *reader) {
    struct import_samples *samples = reader;
    import_samples_finish(samples);
    free(samples);
}

/* The field that gave the part of the grid which is refused. */
static enum nrrd_field field_at_fault(const struct parsing *p) {
    char *const *value = p->text->value;
    bool directed = value[NRRD_SPACE_DIRECTIONS] != NULL;
    enum nrrd_field spacing = directed                ? NRRD_SPACE_DIRECTIONS
                              : value[NRRD_SPACINGS]  ? NRRD_SPACINGS
                              : value[NRRD_AXIS_MAXS] ? NRRD_AXIS_MAXS
                                                      : NRRD_SIZES;
    switch (sp_grid_bad_part(&p->header->grid)) {
    case SP_GRID_SPACING:
        return spacing;
    case SP_GRID_DIRECTION:
        return NRRD_SPACE_DIRECTIONS;
    case SP_GRID_ORIGIN:
        return value[NRRD_SPACE_ORIGIN] ? NRRD_SPACE_ORIGIN
               : value[NRRD_AXIS_MINS]  ? NRRD_AXIS_MINS
                                        : spacing;
    default:
        return NRRD_SIZES;
    }
}

static bool build(const struct parsing *p, Nrrd *nrrd, NrrdIoState *io) {
    struct import_samples *s = p->samples;
    if (!parse_fields(p, nrrd, io) || !take_type(p) || !take_geometry(p) || !take_encoding(p) ||
        !take_skips(p) || !take_data_files(p))
        return false;
    char place[SP_ERROR_PLACE];
    enum nrrd_field field = field_at_fault(p);
    import_place(place, p->file->shown, p->text->byte[field], nrrd_field_name(field));
    if (!sp_grid_check(&p->header->grid, p->header->type, place, &p->header->bytes, p->err))
        return false;
    s->file = p->file;
    s->type = p->header->type;
    s->bytes = p->header->bytes;
    s->field = "sizes";
    return import_samples_check(s, p->err);
}

static void *open_nrrd(const struct import_file *file, struct import_header *header,
                       struct sp_error *err) {
    struct nrrd_header text;
    if (!nrrd_header_read(file, &text, err))
        return NULL;
    struct import_samples *samples = calloc(1, sizeof *samples);
    Nrrd *nrrd = nrrdNew();
    NrrdIoState *io = nrrdIoStateNew();
    struct parsing p = { file, &text, nrrd, io, header, samples, err };
    bool ok = false;
    if (samples && nrrd && io)
        ok = build(&p, nrrd, io);
    else
        sp_fail(err, SP_ERR_MEMORY, file->shown, "no memory for the header");
    if (io)
        nrrdIoStateNix(io);
    if (nrrd)
        nrrdNuke(nrrd);
    nrrd_header_finish(&text);
    if (!ok && samples) {
        close_nrrd(samples);
        samples = NULL;
    }
    return samples;
}

static bool read_nrrd(void *reader, void *voxels, const struct import_progress *progress,
                      struct sp_error *err) {
    return import_samples_read(reader, voxels, progress, err);
}

const struct import_format import_nrrd = {
    .name = "NRRD", .probe = probe, .open = open_nrrd, .read = read_nrrd, .close = close_nrrd
};
