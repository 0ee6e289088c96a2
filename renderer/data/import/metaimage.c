/* SPDX-License-Identifier: Apache-2.0
 *
 * MetaImage: lines "Key = value", then the samples (.mha), or the names of their files (.mhd). The
 * header parser is our own: MetaIO, which comes with ITK or VTK, opens any file that a header
 * names, holds a packed file in memory beside the samples, and reads MET_LONG of 8 bytes wrongly
 * without an error.
 *
 *   lines ─► values by key ─► grid, type, data files ─► samples.c
 */
#include <inttypes.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#include "data/import/derived.h"
#include "data/import/meaning.h"
#include "data/import/pattern.h"
#include "data/import/samples.h"
#include "data/volume/anatomy.h"
#include "data/volume/volume.h"

enum { TEXT_MAX = 1 << 20, FILES_MAX = 65536, CHANNELS_MAX = 256 };

enum key {
    OBJECT_TYPE,
    DIMENSIONS,
    DIM_SIZE,
    ELEMENT_TYPE,
    CHANNELS,
    SPACING,
    ELEMENT_SIZE,
    OFFSET,
    TRANSFORM,
    ANATOMY,
    BINARY,
    BIG_ENDIAN_DATA,
    COMPRESSED,
    HEADER_SIZE,
    UNIT,
    DATA_FILE,
    KEY_COUNT
};

/* Keys with one meaning may have several names. */
static const struct {
    const char *name;
    enum key key;
} keys[] = {
    { "ObjectType", OBJECT_TYPE },
    { "NDims", DIMENSIONS },
    { "DimSize", DIM_SIZE },
    { "ElementType", ELEMENT_TYPE },
    { "ElementNumberOfChannels", CHANNELS },
    { "ElementSpacing", SPACING },
    { "ElementSize", ELEMENT_SIZE },
    { "Offset", OFFSET },
    { "Position", OFFSET },
    { "Origin", OFFSET },
    { "TransformMatrix", TRANSFORM },
    { "Rotation", TRANSFORM },
    { "Orientation", TRANSFORM },
    { "AnatomicalOrientation", ANATOMY },
    { "BinaryData", BINARY },
    { "BinaryDataByteOrderMSB", BIG_ENDIAN_DATA },
    { "ElementByteOrderMSB", BIG_ENDIAN_DATA },
    { "CompressedData", COMPRESSED },
    { "HeaderSize", HEADER_SIZE },
    { "DistanceUnits", UNIT },
    { "ElementDataFile", DATA_FILE },
};

struct parsing {
    const struct import_file *file;
    struct import_header *header;
    struct import_samples *samples;
    struct import_conversion *conversion;
    struct sp_error *err;
    char *text; /* the start of the file; ends with 0 */
    size_t size;
    char *values[KEY_COUNT]; /* in `text`; NULL = not given */
    unsigned dimensions;     /* 2 to 4 */
    unsigned channels;       /* side by side in the file */
    unsigned images;         /* components that follow one another, in place of time steps */
    enum import_as as;       /* of the channels, or of the fourth axis */
    char *list;              /* the lines after "ElementDataFile = LIST" */
};

__attribute__((format(printf, 4, 5))) static bool refuse(const struct parsing *p, enum sp_code code,
                                                         enum key key, const char *format, ...) {
    char text[SP_ERROR_TEXT];
    const char *name = NULL;
    va_list args;
    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    for (size_t i = 0; !name && i < sizeof keys / sizeof *keys; i++)
        if (keys[i].key == key)
            name = keys[i].name;
    return import_fail(p->err, code, p->file->title,
                       p->values[key] ? (uint64_t)(p->values[key] - p->text) : 0, name, "%s", text);
}

static bool require(const struct parsing *p, enum key key) {
    return p->values[key] || refuse(p, SP_ERR_FORMAT, key, "this field is missing");
}

static bool probe(const uint8_t *start, size_t size, const char *title) {
    static const char first[] = "ObjectType", other[] = "NDims";
    if (import_ends_with(title, ".mhd") || import_ends_with(title, ".mha"))
        return true;
    return (size >= sizeof first && memcmp(start, first, sizeof first - 1) == 0) ||
           (size >= sizeof other && memcmp(start, other, sizeof other - 1) == 0);
}

/* The header. */

static bool read_text(struct parsing *p) {
    p->size = p->file->size < TEXT_MAX ? p->file->size : TEXT_MAX;
    p->text = malloc(p->size + 1);
    if (!p->text)
        return sp_fail(p->err, SP_ERR_MEMORY, p->file->title, "out of memory");
    if (!import_read(p->file, p->text, p->size, 0, &p->size, p->err))
        return false;
    p->text[p->size] = 0;
    return true;
}

static char *trim(char *text) {
    size_t n;
    text += strspn(text, " \t");
    for (n = strlen(text); n > 0 && strchr(" \t\r", text[n - 1]);)
        text[--n] = 0;
    return text;
}

static void parse_line(struct parsing *p, char *line) {
    char *equals = strchr(line, '=');
    if (!equals)
        return;
    *equals = 0;
    const char *name = trim(line);
    for (size_t i = 0; i < sizeof keys / sizeof *keys; i++)
        if (strcasecmp(name, keys[i].name) == 0)
            p->values[keys[i].key] = trim(equals + 1);
}

/* The header ends with ElementDataFile. Keys that are not known describe no samples. */
static bool read_lines(struct parsing *p) {
    char *line = p->text;
    while (*line && !p->values[DATA_FILE]) {
        const size_t length = strcspn(line, "\n");
        char *next = line + length + (line[length] == '\n');
        line[length] = 0;
        parse_line(p, line);
        line = next;
    }
    p->samples->start = (uint64_t)(line - p->text);
    p->list = line;
    return require(p, DATA_FILE);
}

/* Reads `count` numbers; a key that is missing changes nothing. */
static bool parse_numbers(const struct parsing *p, enum key key, unsigned count, double *out) {
    char *at = p->values[key], *end;
    for (unsigned i = 0; at && i < count; i++, at = end) {
        out[i] = strtod(at, &end);
        if (end == at || !isfinite(out[i]))
            return refuse(p, SP_ERR_FORMAT, key, "\"%.60s\" is not %u numbers", p->values[key],
                          count);
    }
    return !at || !at[strspn(at, " \t")] ||
           refuse(p, SP_ERR_FORMAT, key, "has more than %u numbers", count);
}

static bool is_true(const struct parsing *p, enum key key) {
    const char *value = p->values[key];
    return value && (value[0] == 'T' || value[0] == 't' || value[0] == '1');
}

static bool find_number(const struct parsing *p, struct import_number *number);

/* What the channels are, or else the fourth axis. Three real numbers are a vector, three or four
 * bytes a colour. */
static bool choose_meaning(struct parsing *p, uint64_t steps) {
    long long channels = 1;
    struct import_number number = { IMPORT_UNSIGNED, 0 };
    struct sp_error later; /* parse_type() reports an unknown type */
    struct parsing quiet = *p;
    quiet.err = &later;
    if (p->values[CHANNELS] && !import_integer(p->values[CHANNELS], 1, CHANNELS_MAX, &channels))
        return refuse(p, SP_ERR_FORMAT, CHANNELS, "\"%.40s\" is no whole number in [1, %d]",
                      p->values[CHANNELS], CHANNELS_MAX);
    find_number(&quiet, &number);
    const bool has_both = channels > 1 && steps > 1, is_byte = number.size == 1;
    const struct import_extra extra = { .count = channels > 1 ? (uint64_t)channels : steps,
                                        .meaning = channels == 1 ? IMPORT_AS_TIME
                                                   : channels == 3 && number.kind == IMPORT_FLOAT
                                                       ? IMPORT_AS_VECTORS
                                                   : is_byte && (channels == 3 || channels == 4)
                                                       ? IMPORT_AS_RGB
                                                       : IMPORT_AS_CHANNELS,
                                        .are_parts = has_both };
    if (!import_meaning_choose(p->file, &extra, p->header, &p->as, p->err))
        return false;
    const bool is_axis = channels == 1 && p->as != IMPORT_AS_TIME && p->as != IMPORT_AS_FILE;
    const bool are_steps = channels > 1 && p->as == IMPORT_AS_TIME;
    p->channels = (unsigned)channels;
    p->images = is_axis ? (unsigned)steps : 1;
    return import_header_use_steps(p->header, p->file,
                                   is_axis     ? 1
                                   : are_steps ? (uint64_t)channels
                                               : steps,
                                   p->err);
}

static bool parse_dims(struct parsing *p) {
    double dims[4] = { 1, 1, 1, 1 };
    long long count;
    if (p->values[OBJECT_TYPE] && strcasecmp(p->values[OBJECT_TYPE], "Image") != 0)
        return refuse(p, SP_ERR_UNSUPPORTED, OBJECT_TYPE, "is \"%.40s\"; only images are supported",
                      p->values[OBJECT_TYPE]);
    if (!require(p, DIMENSIONS))
        return false;
    if (!import_integer(p->values[DIMENSIONS], 2, 4, &count))
        return refuse(p, SP_ERR_FORMAT, DIMENSIONS, "is \"%.40s\"; it must be 2, 3 or 4",
                      p->values[DIMENSIONS]);
    if (!require(p, DIM_SIZE))
        return false;
    if (!parse_numbers(p, DIM_SIZE, (unsigned)count, dims))
        return false;
    for (int axis = 0; axis < 4; axis++)
        if (!(dims[axis] >= 1 && dims[axis] <= SP_DIM_MAX && trunc(dims[axis]) == dims[axis]))
            return refuse(p, SP_ERR_FORMAT, DIM_SIZE,
                          "axis %d has %g samples; it must be a whole number in [1, %u]", axis + 1,
                          dims[axis], SP_DIM_MAX);
    if (!choose_meaning(p, (uint64_t)dims[3]))
        return false;
    for (int axis = 0; axis < 3; axis++)
        p->header->grid.dims[axis] = (uint32_t)dims[axis];
    p->dimensions = (unsigned)count;
    return true;
}

/* The rows of the matrix are the directions of the axes. Their lengths scale the spacing: ITK does
 * the same. */
static bool parse_directions(const struct parsing *p) {
    double matrix[16] = { 0 };
    const unsigned n = p->dimensions;
    if (!p->values[TRANSFORM])
        return true;
    if (!parse_numbers(p, TRANSFORM, n * n, matrix))
        return false;
    for (unsigned axis = 0; axis < n && axis < 3; axis++) {
        double length = 0;
        for (unsigned row = 0; row < n && row < 3; row++)
            length += matrix[n * axis + row] * matrix[n * axis + row];
        if (!(length > 0))
            return refuse(p, SP_ERR_FORMAT, TRANSFORM, "the direction of axis %u has length 0",
                          axis + 1);
        for (unsigned row = 0; row < n && row < 3; row++)
            p->header->grid.direction[row][axis] = matrix[n * axis + row];
    }
    return true;
}

static bool parse_geometry(const struct parsing *p) {
    double spacing[4] = { 1, 1, 1, 1 }, origin[4] = { 0 };
    const enum key key = p->values[SPACING] ? SPACING : ELEMENT_SIZE;
    if (!parse_numbers(p, key, p->dimensions, spacing) ||
        !parse_numbers(p, OFFSET, p->dimensions, origin) || !parse_directions(p))
        return false;
    for (int axis = 0; axis < 3; axis++) {
        p->header->grid.spacing[axis] = fabs(spacing[axis]);
        p->header->grid.origin[axis] = origin[axis];
        for (int row = 0; row < 3 && spacing[axis] < 0; row++) /* as ITK does */
            p->header->grid.direction[row][axis] = 0 - p->header->grid.direction[row][axis];
    }
    import_grid_normalize(&p->header->grid);
    if (p->header->steps.count > 1 && p->dimensions == 4)
        import_header_use_interval(p->header, origin[3], spacing[3], "");
    /* ITK's world is in mm, and so are the files of its users. */
    const char *unit = p->values[UNIT] ? p->values[UNIT] : "";
    snprintf(p->header->unit, sizeof p->header->unit, "%s",
             *unit && strcmp(unit, "?") != 0 ? unit : "mm");
    /* The letters name the axes of the samples. The world of a patient always has the axes of
     * DICOM. */
    if (p->values[ANATOMY] && strlen(p->values[ANATOMY]) == 3 &&
        sp_anatomy_is_valid(p->values[ANATOMY]))
        import_header_set_anatomy(p->header, "LPS");
    return true;
}

/* The samples. */

static uint64_t count_samples(const struct parsing *p) { /* of all time steps */
    const uint32_t *dims = p->header->grid.dims;
    const bool are_channels = p->as == IMPORT_AS_TIME && p->channels > 1; /* the steps */
    return (uint64_t)dims[0] * dims[1] * dims[2] * (are_channels ? 1 : p->header->steps.count);
}

static bool find_number(const struct parsing *p, struct import_number *number) {
    static const struct import_number_entry types[] = {
        { "MET_CHAR", 0, { IMPORT_SIGNED, 1 } },
        { "MET_UCHAR", 0, { IMPORT_UNSIGNED, 1 } },
        { "MET_SHORT", 0, { IMPORT_SIGNED, 2 } },
        { "MET_USHORT", 0, { IMPORT_UNSIGNED, 2 } },
        { "MET_INT", 0, { IMPORT_SIGNED, 4 } },
        { "MET_UINT", 0, { IMPORT_UNSIGNED, 4 } },
        { "MET_LONG", 0, { IMPORT_SIGNED, 4 } },
        { "MET_ULONG", 0, { IMPORT_UNSIGNED, 4 } },
        { "MET_LONG_LONG", 0, { IMPORT_SIGNED, 8 } },
        { "MET_ULONG_LONG", 0, { IMPORT_UNSIGNED, 8 } },
        { "MET_FLOAT", 0, { IMPORT_FLOAT, 4 } },
        { "MET_DOUBLE", 0, { IMPORT_FLOAT, 8 } },
    };
    const char *value = p->values[ELEMENT_TYPE];
    size_t length = value ? strlen(value) : 0;
    if (length > 6 && strcmp(value + length - 6, "_ARRAY") == 0)
        length -= 6;
    if (value && import_number_by_name(types, sizeof types / sizeof *types, value, length, number))
        return true;
    return refuse(
        p, value ? SP_ERR_UNSUPPORTED : SP_ERR_FORMAT, ELEMENT_TYPE,
        value
            ? "samples of type %.40s are not supported; supported are MET_CHAR to MET_ULONG_LONG, "
              "MET_FLOAT and MET_DOUBLE, and the same with _ARRAY"
            : "is missing%.0s; write it, such as ElementType = MET_FLOAT",
        value ? value : "");
}

/* MetaIO's long has 4 bytes. Programs that wrote the long of their machine may have used 8, which
 * the size of the file tells unless the samples are packed or text. */
static void widen_long(const struct parsing *p, uint64_t bytes) {
    const char *type = p->values[ELEMENT_TYPE];
    const struct import_samples *s = p->samples;
    const bool is_long = strncmp(type, "MET_LONG", 8) == 0 || strncmp(type, "MET_ULONG", 9) == 0;
    if (!is_long || s->number.size != 4 || s->count > 0 || s->encoding != IMPORT_RAW ||
        p->file->size != s->start + s->skip_bytes + 2 * bytes)
        return;
    p->samples->number.size = 8;
    import_warn(p->file->warnings, "%s has 8 bytes per number in this file; it should have 4.",
                type);
}

static bool parse_type(const struct parsing *p) {
    struct import_samples *s = p->samples;
    struct import_conversion *c = p->conversion;
    if (!find_number(p, &s->number))
        return false;
    widen_long(p, count_samples(p) * p->channels * p->images * s->number.size);
    *c = import_conversion_of(s->number, p->file->warnings);
    c->components = p->channels;
    s->is_vectors = p->as == IMPORT_AS_VECTORS;
    s->is_planar = s->is_vectors && p->images > 1;
    if (s->is_vectors) {
        import_header_add_vectors(p->header, "");
        import_header_use_vectors(p->header, p->file->field);
        return true;
    }
    if (p->channels > 1)
        c->component =
            p->as == IMPORT_AS_TIME
                ? p->file->step
                : import_meaning_choose_component(p->file, p->header, c->components, p->as, NULL);
    s->conversion = import_conversion_is_copy(c) ? NULL : c;
    p->header->type = c->type;
    return true;
}

/* Chooses one of the steps or images that follow one another in the file. */
static bool choose_block(const struct parsing *p) {
    struct import_samples *s = p->samples;
    if (s->is_planar) {
        s->bytes *= 3;
        return true;
    }
    if (p->images > 1)
        return import_samples_choose_block(
            s, p->images,
            import_meaning_choose_component(p->file, p->header, p->images, p->as, NULL));
    if (p->as == IMPORT_AS_TIME && p->channels > 1)
        return true;
    return import_samples_choose_block(s, p->header->steps.count, p->file->step);
}

static bool add_file(const struct parsing *p, const char *name) {
    if (p->samples->count >= FILES_MAX)
        return refuse(p, SP_ERR_FORMAT, DATA_FILE, "names more than %d files", FILES_MAX);
    return import_samples_add(p->samples, name, strlen(name)) ||
           sp_fail(p->err, SP_ERR_MEMORY, p->file->title, "out of memory for file names");
}

static bool parse_list(const struct parsing *p) {
    char *rest = NULL;
    for (char *line = strtok_r(p->list, "\n", &rest); line; line = strtok_r(NULL, "\n", &rest)) {
        const char *name = trim(line);
        if (*name && !add_file(p, name))
            return false;
    }
    return true;
}

static bool add_pattern(const struct parsing *p, const struct import_pattern *f) {
    if (!import_pattern_is_sound(f))
        return refuse(p, SP_ERR_FORMAT, DATA_FILE,
                      "counts from %lld to %lld by %lld; the step must lead from the first number "
                      "to the last one",
                      f->low, f->high, f->step);
    for (long long i = f->low; f->step > 0 ? i <= f->high : i >= f->high; i += f->step) {
        char name[IMPORT_PATTERN_NAME];
        import_pattern_name(f, i, name);
        if (!add_file(p, name))
            return false;
    }
    return true;
}

static bool parse_files(const struct parsing *p) {
    const char *value = p->values[DATA_FILE];
    struct import_pattern pattern;
    if (!*value)
        return refuse(p, SP_ERR_FORMAT, DATA_FILE, "names no file");
    if (strcasecmp(value, "LOCAL") == 0)
        return true;
    /* A number of axes may follow, for example "LIST 3D". Their product gives the same. */
    const bool is_list = strncasecmp(value, "LIST", 4) == 0 && strchr(" \t", value[4]);
    if (!is_list && !import_pattern_parse(value, &pattern))
        return add_file(p, value);
    if (!(is_list ? parse_list(p) : add_pattern(p, &pattern)))
        return false;
    const uint64_t slices = p->header->grid.dims[2];
    const uint64_t steps = p->images > 1                                ? p->images
                           : p->channels > 1 && p->as == IMPORT_AS_TIME ? 1
                                                                        : p->header->steps.count;
    const uint64_t count = p->samples->count;
    return count == slices * steps || count == steps ||
           refuse(p, SP_ERR_FORMAT, DATA_FILE,
                  "names %" PRIu64 " files for %" PRIu64 " slices in %" PRIu64 " steps", count,
                  slices, steps);
}

static bool parse_encoding(const struct parsing *p) {
    struct import_samples *s = p->samples;
    long long size = 0;
    if (p->values[HEADER_SIZE] &&
        !import_integer(p->values[HEADER_SIZE], -1, INT64_C(1) << 48, &size))
        return refuse(p, SP_ERR_FORMAT, HEADER_SIZE, "\"%.40s\" is no whole number in [-1, 2^48]",
                      p->values[HEADER_SIZE]);
    s->big_endian = is_true(p, BIG_ENDIAN_DATA);
    s->encoding = is_true(p, COMPRESSED)                     ? IMPORT_GZIP
                  : p->values[BINARY] && !is_true(p, BINARY) ? IMPORT_TEXT
                                                             : IMPORT_RAW;
    if (s->encoding != IMPORT_RAW && size != 0)
        return refuse(p, SP_ERR_UNSUPPORTED, HEADER_SIZE, "must be 0 for packed samples and text");
    if (size > 0 && s->count == 0)
        s->start = 0; /* it counts from the start of the file */
    s->skip_bytes = size > 0 ? (uint64_t)size : 0;
    s->from_end = size < 0;
    s->rest = size > 0 ? IMPORT_REST_IGNORED : IMPORT_REST_WARNED;
    return true;
}

static bool parse_all(struct parsing *p) {
    struct import_samples *s = p->samples;
    s->field = "DimSize";
    if (!read_text(p) || !read_lines(p) || !parse_dims(p) || !parse_geometry(p) ||
        !parse_files(p) || !parse_encoding(p) || !parse_type(p) ||
        !sp_grid_check(&p->header->grid, p->header->type, p->file->title, &p->header->bytes,
                       p->err))
        return false;
    s->bytes = p->header->bytes / sp_type_size(p->header->type) * p->conversion->components *
               s->number.size;
    if (!choose_block(p))
        return refuse(p, SP_ERR_FORMAT, DATA_FILE, "names files that hold no whole slices");
    return import_samples_check(s, p->err);
}

static bool open_metaimage(void *reader, const struct import_file *file,
                           struct import_header *header, struct sp_error *err) {
    struct import_sampled *m = reader;
    m->samples.file = file;
    struct parsing p = { .file = file,
                         .header = header,
                         .samples = &m->samples,
                         .conversion = &m->conversion,
                         .err = err };
    const bool ok = parse_all(&p);
    free(p.text);
    return ok;
}

const struct import_format import_metaimage = { .name = "MetaImage",
                                                .probe = probe,
                                                .reader_size = sizeof(struct import_sampled),
                                                .open = open_metaimage,
                                                .read = import_sampled_read,
                                                .close = import_sampled_close };
