/* SPDX-License-Identifier: Apache-2.0
 *
 * Raw samples, described by a JSON file beside them (the sidecar; README.md lists its members).
 * Unknown members are refused.
 *
 * Why this parser is our own: parsers.md.
 */
#include <ctype.h>
#include <errno.h>
#include <inttypes.h>
#include <jansson.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "data/import/conversion.h"
#include "data/import/derived.h"
#include "data/import/samples.h"
#include "data/volume/anatomy.h"
#include "data/volume/volume.h"

enum { SIDECAR_MAX = 1 << 20 }; /* bytes */

struct raw {
    struct import_sampled sampled; /* the first: read() is that of samples.h */
    double *coordinates[3];        /* owned; NULL = an even axis */
};

struct sidecar { /* state while the sidecar is read */
    const struct import_file *file;
    const json_t *root;
    struct import_header *header;
    struct import_samples *samples;
    struct import_conversion *conversion;
    double **coordinates;
    struct sp_error *err;
};

static bool probe(const uint8_t *start, size_t size, const char *title) {
    size_t i = 0;
    if (!*title) /* other formats are also JSON */
        return false;
    while (i < size && isspace(start[i]))
        i++;
    return (i < size && start[i] == '{') || import_ends_with(title, ".json");
}

__attribute__((format(printf, 3, 4))) static bool
refuse(const struct sidecar *s, const char *pointer, const char *format, ...) {
    char place[SP_ERROR_PLACE], text[SP_ERROR_TEXT];
    va_list args;
    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    snprintf(place, sizeof place, "%.180s: /%s", s->file->title, pointer);
    return sp_fail(s->err, SP_ERR_FORMAT, place, "%s", text);
}

static bool read_dims(const struct sidecar *s) {
    const json_t *dims = json_object_get(s->root, "dims");
    if (!dims)
        return refuse(s, "dims",
                      "is missing: it needs three whole numbers, the fastest axis first");
    if (json_array_size(dims) != 3)
        return refuse(s, "dims", "must be three whole numbers, the fastest axis first");
    for (size_t i = 0; i < 3; i++) {
        const json_t *n = json_array_get(dims, i);
        json_int_t value = json_integer_value(n);
        if (!json_is_integer(n) || value < 1 || value > SP_DIM_MAX)
            return refuse(s, "dims", "element %zu must be a whole number in [1, %u]", i,
                          SP_DIM_MAX);
        s->header->grid.dims[i] = (uint32_t)value;
    }
    return true;
}

static bool read_numbers(const struct sidecar *s, const json_t *array, const char *pointer,
                         double out[3]) {
    if (json_array_size(array) != 3)
        return refuse(s, pointer, "must be three numbers");
    for (size_t i = 0; i < 3; i++) {
        const json_t *n = json_array_get(array, i);
        out[i] = json_number_value(n);
        if (!json_is_number(n) || !isfinite(out[i]))
            return refuse(s, pointer, "element %zu must be a number", i);
    }
    return true;
}

static bool read_direction(const struct sidecar *s) {
    const json_t *axes = json_object_get(s->root, "direction");
    if (!axes)
        return true;
    if (json_array_size(axes) != 3)
        return refuse(s, "direction", "must be three vectors, one per axis");
    for (size_t axis = 0; axis < 3; axis++) {
        double v[3];
        char pointer[32];
        snprintf(pointer, sizeof pointer, "direction/%zu", axis);
        if (!read_numbers(s, json_array_get(axes, axis), pointer, v))
            return false;
        double length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
        if (!(fabs(length - 1) < 1e-2))
            return refuse(s, pointer, "has length %g instead of 1; put the length into spacing",
                          length);
        for (int row = 0; row < 3; row++) /* removes the rounding of the written digits */
            s->header->grid.direction[row][axis] = v[row] / length;
    }
    return true;
}

static bool read_axis(const struct sidecar *s, size_t axis, const json_t *array) {
    uint32_t count = s->header->grid.dims[axis];
    char pointer[40];
    snprintf(pointer, sizeof pointer, "coordinates/%zu", axis);
    if (json_is_null(array))
        return true;
    if (!json_is_array(array) || json_array_size(array) != count)
        return refuse(s, pointer, "must be null or %" PRIu32 " numbers, one per sample", count);
    double *positions = s->coordinates[axis] = malloc(count * sizeof *positions);
    if (!positions)
        return sp_fail(s->err, SP_ERR_MEMORY, s->file->title, "out of memory for coordinates");
    for (size_t i = 0; i < count; i++) {
        const json_t *n = json_array_get(array, i);
        if (!json_is_number(n))
            return refuse(s, pointer, "element %zu must be a number", i);
        positions[i] = json_number_value(n);
    }
    import_grid_set_positions(&s->header->grid, (unsigned)axis, positions);
    return true;
}

/* Call after the rest of the geometry, which this function changes. */
static bool read_coordinates(const struct sidecar *s) {
    const json_t *axes = json_object_get(s->root, "coordinates");
    if (!axes)
        return true;
    if (json_array_size(axes) != 3)
        return refuse(s, "coordinates",
                      "must be three arrays, one per axis; null for an even axis");
    for (size_t axis = 0; axis < 3; axis++)
        if (!read_axis(s, axis, json_array_get(axes, axis)))
            return false;
    return true;
}

/* The anatomical directions of the axes of the world, as NRRD's "space" states them. Call after
 * the rest of the geometry, which this function may mirror. */
static bool read_space(const struct sidecar *s) {
    const json_t *space = json_object_get(s->root, "space");
    char letters[sizeof s->header->anatomy] = "";
    if (!space)
        return true;
    if (json_string_length(space) == sizeof letters - 1)
        memcpy(letters, json_string_value(space), sizeof letters);
    if (!letters[0] || !sp_anatomy_is_valid(letters))
        return refuse(s, "space",
                      "must be three letters: where x, y and z of the world point to, one each of "
                      "R or L, A or P, S or I; such as LPS");
    import_header_set_anatomy(s->header, letters);
    return true;
}

static bool read_unit(const struct sidecar *s, const char *key, char unit[SP_UNIT_BYTES]) {
    const json_t *text = json_object_get(s->root, key);
    if (text && (!json_is_string(text) || json_string_length(text) >= SP_UNIT_BYTES))
        return refuse(s, key, "must be a string of at most %d bytes", SP_UNIT_BYTES - 1);
    snprintf(unit, SP_UNIT_BYTES, "%s", text ? json_string_value(text) : "");
    return true;
}

static bool read_geometry(const struct sidecar *s) {
    const json_t *spacing = json_object_get(s->root, "spacing");
    const json_t *origin = json_object_get(s->root, "origin");
    if (!read_dims(s) ||
        (spacing && !read_numbers(s, spacing, "spacing", s->header->grid.spacing)) ||
        (origin && !read_numbers(s, origin, "origin", s->header->grid.origin)) ||
        !read_direction(s) || !read_coordinates(s) || !read_space(s))
        return false;
    return read_unit(s, "unit", s->header->unit) &&
           read_unit(s, "value_unit", s->header->value_unit);
}

/* Reads a member that must be one of `count` names; *index is its position. */
static bool read_choice(const struct sidecar *s, const char *key, const char *const *names,
                        int count, int *index) {
    const json_t *member = json_object_get(s->root, key);
    const char *text = json_string_value(member);
    for (*index = 0; text && *index < count; ++*index)
        if (strcmp(text, names[*index]) == 0)
            return true;
    char list[192] = "";
    for (int i = 0; i < count; i++) {
        strcat(list, i ? ", " : "");
        strcat(list, names[i]);
    }
    return refuse(s, key, "%s %s", member ? "must be one of" : "is missing; write one of", list);
}

static bool read_encoding(const struct sidecar *s) {
    static const char *const orders[] = { "little", "big" }, *const encodings[] = { "raw", "gzip" };
    static const char *const types[] = { "uint8",   "int8",      "uint16",    "int16",   "uint32",
                                         "int32",   "uint64",    "int64",     "float16", "float32",
                                         "float64", "complex64", "complex128" };
    int type, order = 0, encoding = 0;
    if (!read_choice(s, "type", types, sizeof types / sizeof *types, &type))
        return false;
    import_number_named(types[type], &s->samples->number);
    *s->conversion = import_conversion_of(s->samples->number, s->file->warnings);
    s->header->type = s->conversion->type;
    s->samples->conversion = import_conversion_is_copy(s->conversion) ? NULL : s->conversion;
    /* Samples of one byte need no byte order. */
    if (s->samples->number.size > 1 || json_object_get(s->root, "endian"))
        if (!read_choice(s, "endian", orders, 2, &order))
            return false;
    if (json_object_get(s->root, "encoding") &&
        !read_choice(s, "encoding", encodings, 2, &encoding))
        return false;
    s->samples->big_endian = order == 1;
    s->samples->encoding = encoding == 1 ? IMPORT_GZIP : IMPORT_RAW;
    return true;
}

static bool read_components(const struct sidecar *s) {
    const json_t *components = json_object_get(s->root, "components");
    json_int_t value = components ? json_integer_value(components) : 1;
    if (value != 1 && value != 3)
        return refuse(s, "components", "must be 1, or 3 for vectors along x, y and z of the world");
    s->samples->is_vectors = value == 3;
    if (value == 3) {
        import_header_add_vectors(s->header, "");
        import_header_use_vectors(s->header, s->file->field);
    }
    return true;
}

static bool read_file_name(const struct sidecar *s) {
    const json_t *name = json_object_get(s->root, "file");
    const json_t *offset = json_object_get(s->root, "offset");
    if (!name)
        return refuse(s, "file", "is missing; write the name of the file with the samples");
    if (json_string_length(name) == 0)
        return refuse(s, "file", "must be the name of the file with the samples");
    if (!import_samples_add(s->samples, json_string_value(name), json_string_length(name)))
        return sp_fail(s->err, SP_ERR_MEMORY, s->file->title, "out of memory");
    if (!offset)
        return true;
    json_int_t value = json_integer_value(offset);
    if (!json_is_integer(offset) || value < 0 || value > INT64_MAX / 2)
        return refuse(s, "offset", "must be a whole number of bytes, 0 or more");
    s->samples->skip_bytes = (uint64_t)value;
    s->samples->rest = IMPORT_REST_IGNORED;
    return true;
}

static bool check_members(const struct sidecar *s) {
    static const char *const known[] = { "dims",    "type",    "components", "endian",
                                         "spacing", "origin",  "direction",  "coordinates",
                                         "space",   "unit",    "value_unit", "file",
                                         "offset",  "encoding" };
    const char *key;
    json_t *value,
        *object = (json_t *)s->root; /* jansson's loop needs a mutable pointer; nothing changes */
    json_object_foreach(object, key, value) {
        bool found = false;
        for (size_t i = 0; i < sizeof known / sizeof known[0]; i++)
            found |= strcmp(key, known[i]) == 0;
        if (!found)
            return refuse(
                s, key,
                "is not a member; the members are dims, type, components, endian, spacing, "
                "origin, direction, coordinates, space, unit, value_unit, file, offset, encoding");
    }
    return true;
}

static bool check_samples(const struct sidecar *s) {
    static const char *const members[] = {
        [SP_GRID_GOOD] = "dims",       [SP_GRID_DIMS] = "dims",
        [SP_GRID_SPACING] = "spacing", [SP_GRID_COORDINATES] = "coordinates",
        [SP_GRID_ORIGIN] = "origin",   [SP_GRID_DIRECTION] = "direction"
    };
    char place[SP_ERROR_PLACE];
    snprintf(place, sizeof place, "%.180s: /%s", s->file->title,
             members[sp_grid_invalid_field(&s->header->grid)]);
    if (!sp_grid_check(&s->header->grid, s->header->type, place, &s->header->bytes, s->err))
        return false;
    s->samples->bytes = s->header->bytes / sp_type_size(s->header->type) *
                        (s->samples->is_vectors ? 3 : 1) * s->samples->number.size;
    return import_samples_check(s->samples, s->err);
}

/* The texts of jansson name its flags and tokens. */
static const char *reason_of(const json_error_t *why) {
    switch (json_error_code(why)) {
    case json_error_out_of_memory:
        return "out of memory";
    case json_error_stack_overflow:
        return "nested too deeply; a sidecar needs three levels";
    case json_error_invalid_utf8:
        return "not UTF-8; save the sidecar as UTF-8";
    case json_error_premature_end_of_input:
        return "the text ends inside of a value";
    case json_error_end_of_input_expected:
        return "more text follows the end of the object";
    case json_error_null_character:
    case json_error_null_byte_in_key:
        return "the character \\u0000 is not allowed";
    case json_error_duplicate_key:
        return "the object has a duplicate key; keep one of them";
    case json_error_numeric_overflow:
        return "the number is too large";
    default:
        return "not valid JSON; a quote, comma, colon or bracket is wrong or missing";
    }
}

static json_t *parse(const struct import_file *file, struct sp_error *err) {
    if (file->size > SIDECAR_MAX) {
        import_fail(err, SP_ERR_FORMAT, file->title, SIDECAR_MAX, NULL,
                    "a sidecar has at most %d bytes, this file has %" PRIu64, SIDECAR_MAX,
                    file->size);
        return NULL;
    }
    char *text = malloc(file->size ? file->size : 1);
    json_t *root = NULL;
    if (!text) {
        sp_fail(err, SP_ERR_MEMORY, file->title, "out of memory");
        return NULL;
    }
    ssize_t got = pread(file->fd, text, file->size, 0);
    json_error_t why = { .position = 0 };
    if (got < 0)
        sp_fail(err, SP_ERR_IO, file->title, "cannot read the file: %s", strerror(errno));
    else if (!(root = json_loadb(text, (size_t)got, JSON_REJECT_DUPLICATES, &why)))
        import_fail(err, SP_ERR_FORMAT, file->title,
                    (uint64_t)(why.position < 0 ? 0 : why.position), NULL, "line %d, column %d: %s",
                    why.line, why.column, reason_of(&why));
    free(text);
    if (root && !json_is_object(root)) {
        import_fail(err, SP_ERR_FORMAT, file->title, 0, NULL, "the sidecar must be a JSON object");
        json_decref(root);
        root = NULL;
    }
    return root;
}

static void close_raw(void *reader) {
    struct raw *raw = reader;
    import_samples_finish(&raw->sampled.samples);
    for (int axis = 0; axis < 3; axis++)
        free(raw->coordinates[axis]);
}

static bool open_raw(void *reader, const struct import_file *file, struct import_header *header,
                     struct sp_error *err) {
    struct raw *raw = reader;
    struct import_samples *samples = &raw->sampled.samples;
    json_t *root = parse(file, err);
    if (!root)
        return false;
    samples->file = file;
    samples->field = "dims";
    struct sidecar s = { file, root, header, samples, &raw->sampled.conversion, raw->coordinates,
                         err };
    const bool ok = check_members(&s) && read_geometry(&s) && read_encoding(&s) &&
                    read_components(&s) && read_file_name(&s) && check_samples(&s);
    json_decref(root);
    return ok;
}

const struct import_format import_raw = { .name = "raw samples with a JSON sidecar (.json)",
                                          .probe = probe,
                                          .reader_size = sizeof(struct raw),
                                          .open = open_raw,
                                          .read = import_sampled_read,
                                          .close = close_raw };
