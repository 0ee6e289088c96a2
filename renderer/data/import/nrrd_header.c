/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/nrrd_header.h"

#include <inttypes.h>
#include <math.h>
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
    [NRRD_MEASUREMENT_FRAME] = { "measurement frame", NULL },
    [NRRD_CONTENT] = { "content", NULL },
    [NRRD_NUMBER] = { "number", NULL },
    [NRRD_BLOCK_SIZE] = { "block size", "blocksize" },
    [NRRD_THICKNESSES] = { "thicknesses", NULL },
    [NRRD_LABELS] = { "labels", NULL },
    [NRRD_MIN] = { "min", NULL },
    [NRRD_MAX] = { "max", NULL },
    [NRRD_OLD_MIN] = { "old min", "oldmin" },
    [NRRD_OLD_MAX] = { "old max", "oldmax" },
    [NRRD_SAMPLE_UNITS] = { "sample units", "sampleunits" },
};

const char *nrrd_field_name(enum nrrd_field field) {
    return fields[field].name;
}

static bool load_text(const struct import_file *file, struct nrrd_header *h, struct sp_error *err) {
    size_t most = file->size < NRRD_TEXT_MAX ? (size_t)file->size : NRRD_TEXT_MAX;
    h->text = malloc(most + 1);
    if (!h->text)
        return sp_fail(err, SP_ERR_MEMORY, file->title, "out of memory for the header");
    if (!import_read(file, h->text, most, 0, &h->size, err))
        return false;
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
static bool parse_line(const struct import_file *file, struct nrrd_header *h, char *line, char *end,
                       struct sp_error *err) {
    uint64_t byte = (uint64_t)(line - h->text);
    char *colon = memchr(line, ':', (size_t)(end - line));
    if (!colon)
        return import_fail(err, SP_ERR_FORMAT, file->title, byte, NULL,
                           "\"%.40s\" is neither a field, a comment nor the blank line that ends "
                           "the header",
                           line);
    if (colon[1] == '=') { /* a key and a value of another program */
        nrrd_keys_parse(h, line);
        return true;
    }
    char *name = trim(line, colon);
    int f = find_field(name);
    if (f < 0)
        return import_fail(err, SP_ERR_FORMAT, file->title, byte, NULL,
                           "\"%.40s\" is not a field of a NRRD header", name);
    if (h->value[f])
        return import_fail(err, SP_ERR_FORMAT, file->title, byte, fields[f].name,
                           "the header has this field twice");
    h->value[f] = trim(colon + 1, end);
    h->byte[f] = byte;
    if (strlen(h->value[f]) > NRRD_VALUE_MAX)
        return import_fail(err, SP_ERR_FORMAT, file->title, byte, fields[f].name,
                           "the value has %zu bytes; the limit is %d", strlen(h->value[f]),
                           NRRD_VALUE_MAX);
    return true;
}

static bool check_magic(const struct import_file *file, const struct nrrd_header *h,
                        const char *line, size_t length, struct sp_error *err) {
    if (h->size == 0)
        return import_fail(err, SP_ERR_FORMAT, file->title, 0, NULL, "the file is empty");
    if (length != 8 || memcmp(line, "NRRD000", 7) != 0)
        return import_fail(err, SP_ERR_FORMAT, file->title, 0, NULL,
                           "a NRRD file starts with the line NRRD0001 to NRRD0005");
    if (line[7] < '1' || line[7] > '5')
        return import_fail(err, SP_ERR_UNSUPPORTED, file->title, 7, NULL,
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
            return import_fail(err, SP_ERR_FORMAT, file->title, (uint64_t)(zero - h->text), NULL,
                               "the header has a byte of value 0");
        if (first) {
            if (!check_magic(file, h, at, (size_t)(end - at), err))
                return false;
        } else if (end == at) {
            h->end = (uint64_t)(next - h->text);
            /* Without a newline this is the end of the file, not a blank line. */
            return newline || h->value[NRRD_DATA_FILE] ||
                   import_fail(err, SP_ERR_FORMAT, file->title, h->end, NULL,
                               h->size == NRRD_TEXT_MAX
                                   ? "the header is longer than 1 MiB"
                                   : "the file ends before the blank line that ends the header");
        } else if (*at != '#') {
            *end = 0;
            if (!parse_line(file, h, at, end, err))
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

bool nrrd_parse_whole(const char **text, uint64_t limit, uint64_t *out) {
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
            return import_fail(err, SP_ERR_FORMAT, file->title, h->end, fields[needed[i]].name,
                               "the header ends without this field");
    const char *text = h->value[NRRD_DIMENSION];
    uint64_t number;
    if (!nrrd_parse_whole(&text, 16, &number) || *text || number == 0)
        return NRRD_FAIL(err, SP_ERR_FORMAT, file, h, NRRD_DIMENSION,
                         "\"%.40s\" is not a number in [1, 16]", h->value[NRRD_DIMENSION]);
    if (number < 2 || number > NRRD_AXES_MAX)
        return NRRD_FAIL(err, SP_ERR_UNSUPPORTED, file, h, NRRD_DIMENSION,
                         "%u axes; a volume has three, or two for a single slice, and at most one "
                         "more each for components and time steps",
                         (unsigned)number);
    h->dimension = (unsigned)number;
    text = h->value[NRRD_SIZES];
    for (unsigned axis = 0; axis < h->dimension; axis++) {
        if (!*text)
            return NRRD_FAIL(err, SP_ERR_FORMAT, file, h, NRRD_SIZES,
                             "has %u numbers instead of %u", axis, h->dimension);
        if (!nrrd_parse_whole(&text, SP_DIM_MAX, &h->sizes[axis]) || h->sizes[axis] == 0)
            return NRRD_FAIL(err, SP_ERR_FORMAT, file, h, NRRD_SIZES,
                             "number %u of \"%.60s\" is not a whole number in [1, %u]", axis + 1,
                             h->value[NRRD_SIZES], SP_DIM_MAX);
    }
    if (*text)
        return NRRD_FAIL(err, SP_ERR_FORMAT, file, h, NRRD_SIZES,
                         "has more than the %u numbers of "
                         "the dimension",
                         h->dimension);
    return true;
}

/* The typed fields. */

#define REFUSE(code, field, ...) NRRD_FAIL(err, code, file, h, field, __VA_ARGS__)

static bool parse_type(const struct import_file *file, struct nrrd_header *h,
                       struct sp_error *err) {
    static const struct {
        const char *names[5];
        struct import_number number;
    } types[] = {
        { { "signed char", "char", "int8", "int8_t" }, { IMPORT_SIGNED, 1 } },
        { { "uchar", "unsigned char", "uint8", "uint8_t" }, { IMPORT_UNSIGNED, 1 } },
        { { "short", "short int", "signed short", "signed short int", "int16" },
          { IMPORT_SIGNED, 2 } },
        { { "int16_t" }, { IMPORT_SIGNED, 2 } },
        { { "ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t" },
          { IMPORT_UNSIGNED, 2 } },
        { { "int", "signed int", "int32", "int32_t" }, { IMPORT_SIGNED, 4 } },
        { { "uint", "unsigned int", "uint32", "uint32_t" }, { IMPORT_UNSIGNED, 4 } },
        { { "longlong", "long long", "long long int", "signed long long", "signed long long int" },
          { IMPORT_SIGNED, 8 } },
        { { "int64", "int64_t" }, { IMPORT_SIGNED, 8 } },
        { { "ulonglong", "unsigned long long", "unsigned long long int", "uint64", "uint64_t" },
          { IMPORT_UNSIGNED, 8 } },
        { { "float" }, { IMPORT_FLOAT, 4 } },
        { { "double" }, { IMPORT_FLOAT, 8 } },
    };
    const char *name = h->value[NRRD_TYPE];
    for (size_t i = 0; i < sizeof types / sizeof types[0]; i++)
        for (int n = 0; n < 5 && types[i].names[n]; n++)
            if (strcasecmp(name, types[i].names[n]) == 0)
                h->number = types[i].number;
    if (strcasecmp(name, "block") == 0)
        return REFUSE(SP_ERR_UNSUPPORTED, NRRD_TYPE,
                      "blocks of bytes have no values; save the samples as numbers");
    return h->number.size ||
           REFUSE(SP_ERR_FORMAT, NRRD_TYPE, "\"%.40s\" is not a sample type of NRRD", name);
}

static bool parse_encoding(const struct import_file *file, struct nrrd_header *h,
                           struct sp_error *err) {
    static const struct {
        const char *name;
        enum import_encoding encoding;
    } encodings[] = { { "raw", IMPORT_RAW },   { "gzip", IMPORT_GZIP }, { "gz", IMPORT_GZIP },
                      { "bz2", IMPORT_BZIP2 }, { "txt", IMPORT_TEXT },  { "bzip2", IMPORT_BZIP2 },
                      { "hex", IMPORT_HEX },   { "text", IMPORT_TEXT }, { "ascii", IMPORT_TEXT } };
    const char *name = h->value[NRRD_ENCODING], *endian = h->value[NRRD_ENDIAN];
    size_t i = 0;
    while (i < sizeof encodings / sizeof *encodings && strcasecmp(name, encodings[i].name) != 0)
        i++;
    if (i == sizeof encodings / sizeof *encodings)
        return strcasecmp(name, "zrl") == 0
                   ? REFUSE(SP_ERR_UNSUPPORTED, NRRD_ENCODING,
                            "zrl is not supported; write the file as raw or gzip")
                   : REFUSE(SP_ERR_FORMAT, NRRD_ENCODING, "\"%.40s\" is not an encoding of NRRD",
                            name);
    h->encoding = encodings[i].encoding;
    if (!endian)
        return h->number.size == 1 || h->encoding == IMPORT_TEXT ||
               import_fail(err, SP_ERR_FORMAT, file->title, h->byte[NRRD_TYPE], "endian",
                           "%.40s samples need this field: little or big", h->value[NRRD_TYPE]);
    h->big_endian = strcasecmp(endian, "big") == 0;
    return h->big_endian || strcasecmp(endian, "little") == 0 ||
           REFUSE(SP_ERR_FORMAT, NRRD_ENDIAN, "\"%.40s\" is neither little nor big", endian);
}

bool nrrd_parse_number(const char **text, const char *stops, double *out) {
    char *end;
    if (!**text || strchr(" \t", **text))
        return false;
    *out = strtod(*text, &end);
    if (end == *text || (*end && !strchr(" \t", *end) && !strchr(stops, *end)))
        return false;
    *text = nrrd_skip_blanks(end);
    return true;
}

/* A number per axis. A missing field leaves `out` as it is. */
static bool parse_numbers(const struct import_file *file, struct nrrd_header *h,
                          enum nrrd_field field, double out[NRRD_AXES_MAX], struct sp_error *err) {
    const char *text = h->value[field];
    unsigned count = 0;
    if (!text)
        return true;
    for (; *text && count < h->dimension; count++)
        if (!nrrd_parse_number(&text, "", &out[count]))
            return REFUSE(SP_ERR_FORMAT, field, "\"%.40s\" does not start with a number", text);
    if (count < h->dimension)
        return REFUSE(SP_ERR_FORMAT, field, "has %u numbers instead of %u", count, h->dimension);
    return !*text || REFUSE(SP_ERR_FORMAT, field, "has more than the %u numbers of the dimension",
                            h->dimension);
}

/* "cell", "node" or unknown per axis. Unknown centers count as "cell", as in Teem. */
static bool parse_centers(const struct import_file *file, struct nrrd_header *h,
                          struct sp_error *err) {
    const char *text = h->value[NRRD_CENTERS];
    char word[64];
    for (unsigned axis = 0; axis < h->dimension; axis++)
        h->is_cell[axis] = true;
    if (!text)
        return true;
    for (unsigned axis = 0; axis < h->dimension; axis++) {
        if (!nrrd_next_word(&text, word))
            return REFUSE(SP_ERR_FORMAT, NRRD_CENTERS, "has %u words instead of %u", axis,
                          h->dimension);
        h->is_cell[axis] = strcasecmp(word, "node") != 0;
        if (h->is_cell[axis] && strcasecmp(word, "cell") != 0 && strcmp(word, "???") != 0 &&
            strcasecmp(word, "none") != 0)
            return REFUSE(SP_ERR_FORMAT, NRRD_CENTERS, "\"%.40s\" is neither cell nor node", word);
    }
    return !nrrd_next_word(&text, word) ||
           REFUSE(SP_ERR_FORMAT, NRRD_CENTERS, "has more than the %u words of the dimension",
                  h->dimension);
}

static bool parse_fields(const struct import_file *file, struct nrrd_header *h,
                         struct sp_error *err) {
    for (int axis = 0; axis < NRRD_AXES_MAX; axis++)
        h->spacing[axis] = h->min[axis] = h->max[axis] = NAN;
    return parse_type(file, h, err) && parse_numbers(file, h, NRRD_SPACINGS, h->spacing, err) &&
           nrrd_kinds_read(file, h, err) && parse_encoding(file, h, err) &&
           parse_numbers(file, h, NRRD_AXIS_MINS, h->min, err) &&
           parse_numbers(file, h, NRRD_AXIS_MAXS, h->max, err) && parse_centers(file, h, err) &&
           nrrd_space_read(file, h, err);
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
