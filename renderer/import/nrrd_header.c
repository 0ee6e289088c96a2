/* SPDX-License-Identifier: Apache-2.0 */
#include "import/nrrd_header.h"

#include <errno.h>
#include <inttypes.h>
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
    size_t room = file->size < NRRD_TEXT_MAX ? (size_t)file->size : NRRD_TEXT_MAX;
    h->text = malloc(room + 1);
    if (!h->text)
        return sp_fail(err, SP_ERR_MEMORY, file->shown, "no memory for the header");
    while (h->size < room) {
        ssize_t r = pread(file->fd, h->text + h->size, room - h->size, (off_t)h->size);
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

/* One line that is neither empty nor a comment, of bytes [line, end) with *end writable. */
static bool take_line(const struct import_file *file, struct nrrd_header *h, char *line, char *end,
                      struct sp_error *err) {
    uint64_t byte = (uint64_t)(line - h->text);
    char *colon = memchr(line, ':', (size_t)(end - line));
    if (!colon)
        return import_fail(err, SP_ERR_FORMAT, file->shown, byte, NULL,
                           "\"%.40s\" is neither a field, a comment nor the blank line that ends "
                           "the header",
                           line);
    if (colon[1] == '=') /* a key and its value: somebody else's */
        return true;
    char *name = trim(line, colon);
    int f = find_field(name);
    if (f < 0)
        return import_fail(err, SP_ERR_FORMAT, file->shown, byte, NULL,
                           "\"%.40s\" is not a field of a NRRD header", name);
    if (h->value[f])
        return import_fail(err, SP_ERR_FORMAT, file->shown, byte, fields[f].name,
                           "is given a second time");
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
                           "version %c of NRRD is not known, 1 to 5 are", line[7]);
    return true;
}

static bool is_list(const char *value) {
    return value && strncmp(value, "LIST", 4) == 0 && (!value[4] || value[4] == ' ');
}

/* Splits the text into lines up to the blank one; sets `end`, and `list` for LIST. */
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
                               "a byte 0 in the header");
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

/* Some writers leave out the dimension of the space that their vectors live in: it is then the
 * number of components of the first vector. 0 = nothing is missing. */
static unsigned missing_space_dimension(const struct nrrd_header *h) {
    const char *vectors = h->value[NRRD_SPACE_DIRECTIONS];
    if (!vectors || h->value[NRRD_SPACE] || h->value[NRRD_SPACE_DIMENSION])
        return 0;
    const char *first = strchr(vectors, '(');
    unsigned count = 1;
    for (const char *c = first; c && *c && *c != ')'; c++)
        count += *c == ',';
    return first && count <= 3 ? count : 0;
}

/* Fields in the order of the file: teem wants dimension before sizes, space before directions. */
static bool write_clean(const struct import_file *file, struct nrrd_header *h,
                        struct sp_error *err) {
    size_t room = 48;
    unsigned space = missing_space_dimension(h);
    for (int f = 0; f < NRRD_TO_TEEM; f++)
        if (h->value[f])
            room += strlen(fields[f].name) + strlen(h->value[f]) + 3;
    h->clean = malloc(room);
    if (!h->clean)
        return sp_fail(err, SP_ERR_MEMORY, file->shown, "no memory for the header");
    size_t at = (size_t)snprintf(h->clean, room, "NRRD0005\n");
    for (uint64_t last = 0;;) {
        int next = -1;
        for (int f = 0; f < NRRD_TO_TEEM; f++)
            if (h->value[f] && h->byte[f] > last && (next < 0 || h->byte[f] < h->byte[next]))
                next = f;
        if (next < 0)
            break;
        last = h->byte[next];
        if (space && (next == NRRD_SPACE_DIRECTIONS || next == NRRD_SPACE_ORIGIN ||
                      next == NRRD_SPACE_UNITS)) {
            at += (size_t)snprintf(h->clean + at, room - at, "space dimension: %u\n", space);
            space = 0;
        }
        at += (size_t)snprintf(h->clean + at, room - at, "%s: %s\n", fields[next].name,
                               h->value[next]);
    }
    at += (size_t)snprintf(h->clean + at, room - at, "\n");
    h->clean_size = at;
    return true;
}

bool nrrd_header_read(const struct import_file *file, struct nrrd_header *header,
                      struct sp_error *err) {
    memset(header, 0, sizeof *header);
    if (load_text(file, header, err) && split_lines(file, header, err) &&
        check_sizes(file, header, err) && write_clean(file, header, err))
        return true;
    nrrd_header_finish(header);
    return false;
}

void nrrd_header_finish(struct nrrd_header *header) {
    free(header->text);
    free(header->clean);
    memset(header, 0, sizeof *header);
}
