/* SPDX-License-Identifier: Apache-2.0 */
#include "import/nrrd_header.h"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

static const struct {
    const char *name, *alias;
} fields[NRRD_FIELD_COUNT] = {
    [NRRD_TYPE] = { "type", NULL },
    [NRRD_DIMENSION] = { "dimension", NULL },
    [NRRD_SIZES] = { "sizes", NULL },
    [NRRD_SPACINGS] = { "spacings", NULL },
    [NRRD_AXIS_MINS] = { "axis mins", "axismins" },
    [NRRD_AXIS_MAXS] = { "axis maxs", "axismaxs" },
    [NRRD_CENTERS] = { "centerings", "centers" },
    [NRRD_KINDS] = { "kinds", NULL },
    [NRRD_SPACE] = { "space", NULL },
    [NRRD_SPACE_DIMENSION] = { "space dimension", NULL },
    [NRRD_SPACE_DIRECTIONS] = { "space directions", NULL },
    [NRRD_SPACE_UNITS] = { "space units", NULL },
    [NRRD_SPACE_ORIGIN] = { "space origin", NULL },
    [NRRD_UNITS] = { "units", NULL },
    [NRRD_ENDIAN] = { "endian", NULL },
    [NRRD_ENCODING] = { "encoding", NULL },
    [NRRD_LINE_SKIP] = { "line skip", "lineskip" },
    [NRRD_BYTE_SKIP] = { "byte skip", "byteskip" },
    [NRRD_DATA_FILE] = { "data file", "datafile" },
    [NRRD_NUMBER] = { "number", NULL },
    [NRRD_BLOCK_SIZE] = { "block size", "blocksize" },
    [NRRD_THICKNESSES] = { "thicknesses", NULL },
    [NRRD_LABELS] = { "labels", NULL },
    [NRRD_MIN] = { "min", NULL },
    [NRRD_MAX] = { "max", NULL },
    [NRRD_OLD_MIN] = { "old min", "oldmin" },
    [NRRD_OLD_MAX] = { "old max", "oldmax" },
    [NRRD_SAMPLE_UNITS] = { "sample units", "sampleunits" },
    [NRRD_MEASUREMENT_FRAME] = { "measurement frame", NULL },
    [NRRD_CONTENT] = { "content", NULL },
};

const char *nrrd_field_name(enum nrrd_field field) {
    return fields[field].name;
}

bool nrrd_fail(struct sp_error *err, enum sp_code code, const struct import_file *file,
               const struct nrrd_header *header, enum nrrd_field field, const char *format, ...) {
    char text[SP_ERROR_TEXT];
    va_list args;
    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    return import_fail(err, code, file->shown, header->byte[field], fields[field].name, "%s", text);
}

static bool load_text(const struct import_file *file, struct nrrd_header *h, struct sp_error *err) {
    size_t most = file->size < NRRD_TEXT_MAX ? (size_t)file->size : NRRD_TEXT_MAX;
    h->text = malloc(most + 1);
    if (!h->text)
        return sp_fail(err, SP_ERR_MEMORY, file->shown, "out of memory for the header");
    while (h->size < most) {
        ssize_t r = pread(file->fd, h->text + h->size, most - h->size, (off_t)h->size);
        if (r < 0 && errno == EINTR)
            continue;
        if (r < 0)
            return import_fail(err, SP_ERR_IO, file->shown, h->size, NULL, "cannot read: %s",
                               strerror(errno));
        if (r == 0)
            break;
        h->size += (size_t)r;
    }
    h->text[h->size] = 0;
    return true;
}

static char *trim(char *text, char *end) {
    while (text < end && (*text == ' ' || *text == '\t'))
        text++;
    while (end > text && (end[-1] == ' ' || end[-1] == '\t'))
        end--;
    *end = 0;
    return text;
}

static int find_field(const char *name) {
    for (int f = 0; f < NRRD_FIELD_COUNT; f++)
        if (strcasecmp(name, fields[f].name) == 0 ||
            (fields[f].alias && strcasecmp(name, fields[f].alias) == 0))
            return f;
    return -1;
}

/* Parses one line that is neither empty nor a comment: bytes [line, end), *end writable. */
static bool take_line(const struct import_file *file, struct nrrd_header *h, char *line, char *end,
                      struct sp_error *err) {
    uint64_t byte = (uint64_t)(line - h->text);
    char *colon = memchr(line, ':', (size_t)(end - line));
    if (!colon)
        return import_fail(err, SP_ERR_FORMAT, file->shown, byte, NULL,
                           "\"%.40s\" is neither a field, a comment nor the blank line that ends "
                           "the header",
                           line);
    if (colon[1] == '=') /* a key and a value of another program */
        return true;
    char *name = trim(line, colon);
    int f = find_field(name);
    if (f < 0)
        return import_fail(err, SP_ERR_FORMAT, file->shown, byte, NULL,
                           "\"%.40s\" is not a field of a NRRD header", name);
    if (h->value[f])
        return import_fail(err, SP_ERR_FORMAT, file->shown, byte, fields[f].name,
                           "the header has this field twice");
    h->value[f] = trim(colon + 1, end);
    h->byte[f] = byte;
    if (strlen(h->value[f]) > NRRD_VALUE_MAX)
        return import_fail(err, SP_ERR_FORMAT, file->shown, byte, fields[f].name,
                           "is longer than %d bytes", NRRD_VALUE_MAX);
    return true;
}

static bool check_magic(const struct import_file *file, const struct nrrd_header *h,
                        const char *line, size_t length, struct sp_error *err) {
    if (h->size == 0)
        return import_fail(err, SP_ERR_FORMAT, file->shown, 0, NULL, "the file is empty");
    if (length != 8 || memcmp(line, "NRRD000", 7) != 0)
        return import_fail(err, SP_ERR_FORMAT, file->shown, 0, NULL,
                           "a NRRD file starts with the line NRRD0001 to NRRD0005");
    if (line[7] < '1' || line[7] > '5')
        return import_fail(err, SP_ERR_UNSUPPORTED, file->shown, 7, NULL,
                           "NRRD version %c is not supported; supported are 1 to 5", line[7]);
    return true;
}

static bool is_list(const char *value) {
    return value && strncmp(value, "LIST", 4) == 0 && (!value[4] || value[4] == ' ');
}

/* Splits the text into lines up to the blank line. Sets `end`, and `list` for LIST. */
static bool split_lines(const struct import_file *file, struct nrrd_header *h,
                        struct sp_error *err) {
    char *at = h->text, *stop = h->text + h->size;
    for (bool first = true;; first = false) {
        char *newline = memchr(at, '\n', (size_t)(stop - at));
        char *end = newline ? newline : stop;
        char *next = newline ? newline + 1 : stop;
        if (end > at && end[-1] == '\r')
            end--;
        char *zero = memchr(at, 0, (size_t)(end - at));
        if (zero)
            return import_fail(err, SP_ERR_FORMAT, file->shown, (uint64_t)(zero - h->text), NULL,
                               "the header has a byte of value 0");
        if (first) {
            if (!check_magic(file, h, at, (size_t)(end - at), err))
                return false;
        } else if (end == at) {
            h->end = (uint64_t)(next - h->text);
            /* Without a newline this is the end of the file, not a blank line. */
            return newline || h->value[NRRD_DATA_FILE] ||
                   import_fail(err, SP_ERR_FORMAT, file->shown, h->end, NULL,
                               h->size == NRRD_TEXT_MAX
                                   ? "the header is longer than 1 MiB"
                                   : "the file ends before the blank line that ends the header");
        } else if (*at != '#') {
            *end = 0;
            if (!take_line(file, h, at, end, err))
                return false;
            if (is_list(h->value[NRRD_DATA_FILE])) {
                h->list = next;
                h->end = h->size;
                return true;
            }
        }
        at = next;
    }
}

static bool parse_whole(const char **text, uint64_t limit, uint64_t *out) {
    const char *t = *text;
    *out = 0;
    if (*t < '0' || *t > '9')
        return false;
    for (; *t >= '0' && *t <= '9'; t++) {
        if (*out > limit)
            return false;
        *out = *out * 10 + (uint64_t)(*t - '0');
    }
    if (*t && *t != ' ' && *t != '\t')
        return false;
    while (*t == ' ' || *t == '\t')
        t++;
    *text = t;
    return *out <= limit;
}

static bool check_sizes(const struct import_file *file, struct nrrd_header *h,
                        struct sp_error *err) {
    static const enum nrrd_field needed[] = { NRRD_TYPE, NRRD_DIMENSION, NRRD_SIZES,
                                              NRRD_ENCODING };
    for (size_t i = 0; i < sizeof needed / sizeof needed[0]; i++)
        if (!h->value[needed[i]])
            return import_fail(err, SP_ERR_FORMAT, file->shown, h->end, fields[needed[i]].name,
                               "the header ends without this field");
    const char *text = h->value[NRRD_DIMENSION];
    uint64_t number;
    if (!parse_whole(&text, 16, &number) || *text || number == 0)
        return nrrd_fail(err, SP_ERR_FORMAT, file, h, NRRD_DIMENSION,
                         "\"%.40s\" is not a number in [1, 16]", h->value[NRRD_DIMENSION]);
    if (number < 2 || number > 3)
        return nrrd_fail(err, SP_ERR_UNSUPPORTED, file, h, NRRD_DIMENSION,
                         "%" PRIu64 " axes; a volume has three, or two for a single slice", number);
    h->dimension = (unsigned)number;
    text = h->value[NRRD_SIZES];
    for (unsigned axis = 0; axis < h->dimension; axis++) {
        if (!*text)
            return nrrd_fail(err, SP_ERR_FORMAT, file, h, NRRD_SIZES,
                             "has %u numbers instead of %u", axis, h->dimension);
        if (!parse_whole(&text, SP_DIM_MAX, &h->sizes[axis]) || h->sizes[axis] == 0)
            return nrrd_fail(err, SP_ERR_FORMAT, file, h, NRRD_SIZES,
                             "number %u of \"%.60s\" is not a whole number in [1, %u]", axis + 1,
                             h->value[NRRD_SIZES], SP_DIM_MAX);
    }
    if (*text)
        return nrrd_fail(err, SP_ERR_FORMAT, file, h, NRRD_SIZES,
                         "has more than the %u numbers of "
                         "the dimension",
                         h->dimension);
    return true;
}

/* The typed fields. */

#define REFUSE(code, field, ...) nrrd_fail(err, code, file, h, field, __VA_ARGS__)

static const char *skip_blanks(const char *text) {
    return text + strspn(text, " \t");
}

static bool parse_type(const struct import_file *file, struct nrrd_header *h,
                       struct sp_error *err) {
    enum { UNSUPPORTED = -1 };
    static const struct {
        const char *name;
        int type;
    } types[] = {
        { "signed char", SP_INT8 },
        { "char", SP_INT8 },
        { "int8", SP_INT8 },
        { "int8_t", SP_INT8 },
        { "uchar", SP_UINT8 },
        { "unsigned char", SP_UINT8 },
        { "uint8", SP_UINT8 },
        { "uint8_t", SP_UINT8 },
        { "short", SP_INT16 },
        { "short int", SP_INT16 },
        { "signed short", SP_INT16 },
        { "signed short int", SP_INT16 },
        { "int16", SP_INT16 },
        { "int16_t", SP_INT16 },
        { "ushort", SP_UINT16 },
        { "unsigned short", SP_UINT16 },
        { "unsigned short int", SP_UINT16 },
        { "uint16", SP_UINT16 },
        { "uint16_t", SP_UINT16 },
        { "int", SP_INT32 },
        { "signed int", SP_INT32 },
        { "int32", SP_INT32 },
        { "int32_t", SP_INT32 },
        { "float", SP_FLOAT32 },
        { "double", SP_FLOAT64 },
        { "uint", UNSUPPORTED },
        { "unsigned int", UNSUPPORTED },
        { "uint32", UNSUPPORTED },
        { "uint32_t", UNSUPPORTED },
        { "longlong", UNSUPPORTED },
        { "long long", UNSUPPORTED },
        { "long long int", UNSUPPORTED },
        { "signed long long", UNSUPPORTED },
        { "signed long long int", UNSUPPORTED },
        { "int64", UNSUPPORTED },
        { "int64_t", UNSUPPORTED },
        { "ulonglong", UNSUPPORTED },
        { "unsigned long long", UNSUPPORTED },
        { "unsigned long long int", UNSUPPORTED },
        { "uint64", UNSUPPORTED },
        { "uint64_t", UNSUPPORTED },
        { "block", UNSUPPORTED },
    };
    const char *name = h->value[NRRD_TYPE];
    for (size_t i = 0; i < sizeof types / sizeof types[0]; i++)
        if (strcasecmp(name, types[i].name) == 0) {
            if (types[i].type == UNSUPPORTED)
                return REFUSE(SP_ERR_UNSUPPORTED, NRRD_TYPE,
                              "%.40s samples are not supported; convert them to uint8, int8, "
                              "uint16, int16, int32, float or double",
                              name);
            h->type = (enum sp_type)types[i].type;
            return true;
        }
    return REFUSE(SP_ERR_FORMAT, NRRD_TYPE, "\"%.40s\" is not a sample type of NRRD", name);
}

static bool parse_encoding(const struct import_file *file, struct nrrd_header *h,
                           struct sp_error *err) {
    static const char *const others[] = { "txt", "text", "ascii", "hex", "bzip2", "bz2", "zrl" };
    const char *name = h->value[NRRD_ENCODING], *endian = h->value[NRRD_ENDIAN];
    h->gzip = strcasecmp(name, "gzip") == 0 || strcasecmp(name, "gz") == 0;
    if (!h->gzip && strcasecmp(name, "raw") != 0) {
        for (size_t i = 0; i < sizeof others / sizeof others[0]; i++)
            if (strcasecmp(name, others[i]) == 0)
                return REFUSE(SP_ERR_UNSUPPORTED, NRRD_ENCODING,
                              "%.40s is not supported; write the file as raw or gzip", name);
        return REFUSE(SP_ERR_FORMAT, NRRD_ENCODING, "\"%.40s\" is not an encoding of NRRD", name);
    }
    if (!endian)
        return sp_type_size(h->type) == 1 ||
               import_fail(err, SP_ERR_FORMAT, file->shown, h->byte[NRRD_TYPE], "endian",
                           "%.40s samples need this field: little or big", h->value[NRRD_TYPE]);
    h->big_endian = strcasecmp(endian, "big") == 0;
    return h->big_endian || strcasecmp(endian, "little") == 0 ||
           REFUSE(SP_ERR_FORMAT, NRRD_ENDIAN, "\"%.40s\" is neither little nor big", endian);
}

/* One finite or infinite number or NaN, up to a blank or one of `stops`. */
static bool parse_number(const char **text, const char *stops, double *out) {
    char *end;
    if (!**text || strchr(" \t", **text))
        return false;
    *out = strtod(*text, &end);
    if (end == *text || (*end && !strchr(" \t", *end) && !strchr(stops, *end)))
        return false;
    *text = skip_blanks(end);
    return true;
}

/* A number per axis. A missing field leaves `out` as it is. */
static bool parse_numbers(const struct import_file *file, struct nrrd_header *h,
                          enum nrrd_field field, double out[3], struct sp_error *err) {
    const char *text = h->value[field];
    unsigned count = 0;
    if (!text)
        return true;
    for (; *text && count < h->dimension; count++)
        if (!parse_number(&text, "", &out[count]))
            return REFUSE(SP_ERR_FORMAT, field, "\"%.40s\" does not start with a number", text);
    if (count < h->dimension)
        return REFUSE(SP_ERR_FORMAT, field, "has %u numbers instead of %u", count, h->dimension);
    return !*text || REFUSE(SP_ERR_FORMAT, field, "has more than the %u numbers of the dimension",
                            h->dimension);
}

/* The next word of a list; false at the end. A word of more than 63 bytes is cut. */
static bool next_word(const char **text, char word[64]) {
    const char *start = skip_blanks(*text);
    size_t size = strcspn(start, " \t");
    snprintf(word, 64, "%.*s", (int)(size < 63 ? size : 63), start);
    *text = start + size;
    return size > 0;
}

static bool is_unknown(const char *word) {
    return strcmp(word, "???") == 0 || strcasecmp(word, "none") == 0;
}

/* "cell", "node" or unknown per axis. */
static bool take_center(struct nrrd_header *h, unsigned axis, const char *word) {
    h->is_cell[axis] = strcasecmp(word, "cell") == 0;
    return h->is_cell[axis] || strcasecmp(word, "node") == 0 || is_unknown(word);
}

static bool parse_words(const struct import_file *file, struct nrrd_header *h,
                        enum nrrd_field field, struct sp_error *err) {
    const char *text = h->value[field];
    char word[64];
    if (!text)
        return true;
    for (unsigned axis = 0; axis < h->dimension; axis++) {
        if (!next_word(&text, word))
            return REFUSE(SP_ERR_FORMAT, field, "has %u words instead of %u", axis, h->dimension);
        if (field == NRRD_CENTERS && !take_center(h, axis, word))
            return REFUSE(SP_ERR_FORMAT, field, "\"%.40s\" is neither cell nor node", word);
        if (field == NRRD_KINDS && !is_unknown(word) && strcasecmp(word, "domain") != 0 &&
            strcasecmp(word, "space") != 0)
            return REFUSE(SP_ERR_UNSUPPORTED, field,
                          "axis %u is of kind %.40s; only scalar volumes are supported", axis,
                          word);
    }
    return !next_word(&text, word) ||
           REFUSE(SP_ERR_FORMAT, field, "has more than the %u words of the dimension",
                  h->dimension);
}

/* The dimension of the space in which vectors live. Some writers leave it out: it is then the
 * number of components of the first vector. 0 = there is no space. */
static bool parse_space(const struct import_file *file, struct nrrd_header *h,
                        struct sp_error *err) {
    enum { ANATOMICAL = 3 };
    static const struct {
        const char *name, *alias;
    } names[] = {
        { "right-anterior-superior", "RAS" }, { "left-anterior-superior", "LAS" },
        { "left-posterior-superior", "LPS" }, /* the anatomical spaces come first */
        { "scanner-xyz", "scanner-xyz" },     { "3D-right-handed", "3DRH" },
        { "3D-left-handed", "3DLH" },
    };
    const char *name = h->value[NRRD_SPACE], *text = h->value[NRRD_SPACE_DIMENSION];
    const char *first =
        h->value[NRRD_SPACE_DIRECTIONS] ? strchr(h->value[NRRD_SPACE_DIRECTIONS], '(') : NULL;
    enum nrrd_field field = name ? NRRD_SPACE : text ? NRRD_SPACE_DIMENSION : NRRD_SPACE_DIRECTIONS;
    uint64_t space = 0;
    if (name && text)
        return REFUSE(SP_ERR_FORMAT, NRRD_SPACE_DIMENSION, "the field space excludes this field");
    if (name) {
        for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
            size_t n = strlen(names[i].name);
            if (strcasecmp(name, names[i].name) == 0 || strcasecmp(name, names[i].alias) == 0) {
                space = 3;
                if (i < ANATOMICAL)
                    memcpy(h->anatomy, names[i].alias, sizeof h->anatomy);
            } else if (strncasecmp(name, names[i].name, n) == 0 &&
                       strcasecmp(name + n, "-time") == 0)
                space = 4;
        }
        if (space == 0)
            return REFUSE(SP_ERR_FORMAT, NRRD_SPACE, "\"%.40s\" is not a space of NRRD", name);
    } else if (text) {
        if (!parse_whole(&text, 8, &space) || *text || space == 0)
            return REFUSE(SP_ERR_FORMAT, NRRD_SPACE_DIMENSION,
                          "\"%.40s\" is not a number in [1, 8]", h->value[NRRD_SPACE_DIMENSION]);
    } else if (first) {
        space = 1;
        for (const char *c = first; *c && *c != ')'; c++)
            space += *c == ',';
    }
    if (space != 0 && (space > 3 || space < h->dimension))
        return REFUSE(SP_ERR_UNSUPPORTED, field,
                      "a space of %" PRIu64 " dimensions for %u axes; 3 are supported", space,
                      h->dimension);
    h->space = (unsigned)space;
    return true;
}

/* "(1,0,0)", with `count` components. */
static bool parse_vector(const char **text, unsigned count, double out[3]) {
    const char *t = *text;
    if (*t != '(')
        return false;
    t = skip_blanks(t + 1);
    for (unsigned i = 0; i < count; i++) {
        if (!parse_number(&t, ",)", &out[i]) || *t != (i + 1 < count ? ',' : ')'))
            return false;
        t = skip_blanks(t + 1);
    }
    *text = t;
    return true;
}

static bool parse_directions(const struct import_file *file, struct nrrd_header *h,
                             struct sp_error *err) {
    const char *text = h->value[NRRD_SPACE_DIRECTIONS];
    if (!text)
        return true;
    for (unsigned axis = 0; axis < h->dimension; axis++) {
        bool is_none = strncasecmp(text, "none", 4) == 0;
        if (is_none || !*text)
            return REFUSE(SP_ERR_FORMAT, NRRD_SPACE_DIRECTIONS,
                          is_none ? "axis %u has no direction" : "has %u vectors, too few", axis);
        if (!parse_vector(&text, h->space, h->direction[axis]))
            return REFUSE(SP_ERR_FORMAT, NRRD_SPACE_DIRECTIONS,
                          "vector %u is not of the form (x,y,z) with %u numbers", axis + 1,
                          h->space);
    }
    if (*text)
        return REFUSE(SP_ERR_FORMAT, NRRD_SPACE_DIRECTIONS, "has more than %u vectors",
                      h->dimension);
    for (unsigned axis = 0; axis < h->dimension; axis++)
        if (isfinite(h->spacing[axis]) || isfinite(h->min[axis]) || isfinite(h->max[axis]))
            return REFUSE(SP_ERR_FORMAT, NRRD_SPACE_DIRECTIONS,
                          "axis %u also has a spacing, axis min or axis max; remove one of them",
                          axis);
    return true;
}

static bool parse_origin(const struct import_file *file, struct nrrd_header *h,
                         struct sp_error *err) {
    const char *text = h->value[NRRD_SPACE_ORIGIN];
    if (!text)
        return true;
    if (h->space == 0)
        return REFUSE(SP_ERR_FORMAT, NRRD_SPACE_ORIGIN, "needs the field space");
    if (!parse_vector(&text, h->space, h->origin) || *text)
        return REFUSE(SP_ERR_FORMAT, NRRD_SPACE_ORIGIN,
                      "\"%.40s\" is not of the form (x,y,z) with %u numbers",
                      h->value[NRRD_SPACE_ORIGIN], h->space);
    for (unsigned i = 0; i < h->space; i++)
        if (!isfinite(h->origin[i]))
            return REFUSE(SP_ERR_FORMAT, NRRD_SPACE_ORIGIN, "number %u is not a number", i);
    return true;
}

/* One quoted string per axis, "mm" "mm" "mm", all equal or empty. */
static bool parse_units(const struct import_file *file, struct nrrd_header *h,
                        enum nrrd_field field, struct sp_error *err) {
    const char *text = h->value[field];
    unsigned count = field == NRRD_UNITS ? h->dimension : h->space;
    if (!text)
        return true;
    if (count == 0)
        return REFUSE(SP_ERR_FORMAT, field, "needs the field space");
    for (unsigned axis = 0; axis < count; axis++) {
        char unit[NRRD_VALUE_MAX + 1];
        size_t n = 0;
        if (*text++ != '"')
            return REFUSE(SP_ERR_FORMAT, field, "needs %u strings in quotation marks", count);
        for (; *text && *text != '"'; text++) {
            if (*text == '\\' && text[1])
                text++;
            unit[n++] = *text;
        }
        unit[n] = 0;
        if (*text != '"')
            return REFUSE(SP_ERR_FORMAT, field, "string %u has no closing quotation mark",
                          axis + 1);
        text = skip_blanks(text + 1);
        if (n == 0)
            continue;
        if (n >= SP_UNIT_BYTES)
            return REFUSE(SP_ERR_FORMAT, field, "a unit has at most %d bytes", SP_UNIT_BYTES - 1);
        if (h->unit[0] && strcmp(h->unit, unit) != 0)
            return REFUSE(SP_ERR_UNSUPPORTED, field,
                          "\"%.30s\" and \"%.30s\" differ; all axes must have one unit", h->unit,
                          unit);
        memcpy(h->unit, unit, n + 1);
    }
    return !*text || REFUSE(SP_ERR_FORMAT, field, "has more than %u strings", count);
}

static bool parse_fields(const struct import_file *file, struct nrrd_header *h,
                         struct sp_error *err) {
    for (int axis = 0; axis < 3; axis++)
        h->spacing[axis] = h->min[axis] = h->max[axis] = NAN;
    return parse_type(file, h, err) && parse_encoding(file, h, err) &&
           parse_numbers(file, h, NRRD_SPACINGS, h->spacing, err) &&
           parse_numbers(file, h, NRRD_AXIS_MINS, h->min, err) &&
           parse_numbers(file, h, NRRD_AXIS_MAXS, h->max, err) &&
           parse_words(file, h, NRRD_CENTERS, err) && parse_words(file, h, NRRD_KINDS, err) &&
           parse_space(file, h, err) && parse_directions(file, h, err) &&
           parse_origin(file, h, err) && parse_units(file, h, NRRD_UNITS, err) &&
           parse_units(file, h, NRRD_SPACE_UNITS, err);
}

bool nrrd_header_read(const struct import_file *file, struct nrrd_header *header,
                      struct sp_error *err) {
    memset(header, 0, sizeof *header);
    if (load_text(file, header, err) && split_lines(file, header, err) &&
        check_sizes(file, header, err) && parse_fields(file, header, err))
        return true;
    nrrd_header_finish(header);
    return false;
}

void nrrd_header_finish(struct nrrd_header *header) {
    free(header->text);
    memset(header, 0, sizeof *header);
}
