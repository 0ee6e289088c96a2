/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/vtk_array.h"

#include <assert.h>
#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "data/import/number.h"
#include "data/import/text.h"
#include "data/import/vectors.h"
#include "data/import/vtk_unpack.h"

enum { RUN = 16 * VTK_CHUNK }; /* bytes */

static const struct vtk_type types[] = {
    { "unsigned_char", "UInt8", { IMPORT_UNSIGNED, 1 }, false },
    { "char", "Int8", { IMPORT_SIGNED, 1 }, false },
    { "signed_char", NULL, { IMPORT_SIGNED, 1 }, false },
    { "unsigned_short", "UInt16", { IMPORT_UNSIGNED, 2 }, false },
    { "short", "Int16", { IMPORT_SIGNED, 2 }, false },
    { "unsigned_int", "UInt32", { IMPORT_UNSIGNED, 4 }, false },
    { "int", "Int32", { IMPORT_SIGNED, 4 }, false },
    { "vtkidtype", NULL, { IMPORT_SIGNED, 4 }, false }, /* the size in legacy files */
    { "unsigned_long", "UInt64", { IMPORT_UNSIGNED, 8 }, false },
    { "vtktypeuint64", NULL, { IMPORT_UNSIGNED, 8 }, false },
    { "long", "Int64", { IMPORT_SIGNED, 8 }, false },
    { "vtktypeint64", NULL, { IMPORT_SIGNED, 8 }, false },
    { "float", "Float32", { IMPORT_FLOAT, 4 }, false },
    { "double", "Float64", { IMPORT_FLOAT, 8 }, false },
    { "bit", "Bit", { IMPORT_UNSIGNED, 1 }, true },
};

const struct vtk_type *vtk_find_type(const char *name, bool xml) {
    for (size_t i = 0; i < sizeof types / sizeof types[0]; i++)
        if (xml ? types[i].xml && strcmp(types[i].xml, name) == 0
                : strcasecmp(types[i].legacy, name) == 0)
            return &types[i];
    return NULL;
}

uint64_t vtk_type_bytes(const struct vtk_type *type, uint64_t count) {
    return type->are_bits ? count / 8 + (count % 8 != 0) : count * type->number.size;
}

static bool pull_byte_count(struct vtk_source *s, uint64_t need, struct sp_error *err) {
    uint64_t bytes;
    if (s->array->length_size == 0)
        return true;
    if (!vtk_source_pull_length(s, &bytes, err))
        return false;
    return bytes == need ||
           import_fail(err, SP_ERR_FORMAT, s->file->title, s->array->begin, s->array->name,
                       "the file declares %" PRIu64 " bytes, the %" PRIu64 " values need %" PRIu64,
                       bytes, s->array->count, need);
}

bool vtk_array_check(const struct import_file *file, const struct vtk_array *a,
                     struct sp_error *err) {
    assert(a->count >= 1 && a->count <= VTK_VALUES_MAX);
    uint64_t need = vtk_type_bytes(a->type, a->count), least = need; /* bytes in the file */
    struct vtk_source *s = vtk_source_open(file, a, err);
    bool ok = s != NULL;
    if (ok && a->form == VTK_WORDS) {
        least = 2 * a->count - 1;
    } else if (ok && a->packing) {
        ok = vtk_unpack_check(s, need, &least, err);
    } else if (ok) {
        ok = pull_byte_count(s, need, err);
        least = need + a->length_size;
    }
    if (a->form == VTK_BASE64)
        least += least / 3;
    uint64_t have = s && s->end > a->begin ? s->end - a->begin : 0;
    if (ok && have < least)
        ok = import_fail(err, SP_ERR_FORMAT, file->title, a->begin, a->name,
                         "%" PRIu64 " values need at least %" PRIu64 " bytes, the file has %" PRIu64
                         ": it is cut off or a count is wrong",
                         a->count, least, have);
    free(s);
    return ok;
}

/* Values. */

struct target {
    char *out;                   /* gets the values; NULL = `sink` does, run by run */
    const struct vtk_sink *sink; /* with `out`: only its report is used; NULL = none */
};

/* Passes on `n` values in native byte order that follow the first `at`. */
static void pass_values(const struct target *t, uint64_t at, const void *values, size_t n) {
    if (t->sink)
        t->sink->receive(t->sink->user, at, t->out ? NULL : values, n);
}

/* How many values make a run: whole tuples, and whole bytes of bits. */
static size_t run_of(const struct vtk_array *a) {
    const size_t unit = 8 * (size_t)(a->tuple ? a->tuple : 1);
    const size_t units = RUN / (unit * a->type->number.size);
    return unit * (units ? units : 1);
}

static bool read_run(struct vtk_source *s, struct vtk_unpacker *u, char *out, size_t n,
                     uint8_t *bits, struct sp_error *err) {
    const struct vtk_array *a = s->array;
    char *to = bits ? (char *)bits : out;
    const size_t bytes = (size_t)vtk_type_bytes(a->type, n);
    if (!(u ? vtk_unpack(u, to, bytes, err) : vtk_source_pull(s, to, bytes, err)))
        return false;
    if (bits)
        import_bits_unpack(bits, 1, true, 0, n, out);
    else if (a->big_endian != (__BYTE_ORDER__ == __ORDER_BIG_ENDIAN__))
        import_swap(out, a->type->number.size, n); /* while it is in the cache */
    return true;
}

static bool read_bytes(struct vtk_source *s, const struct target *target, struct sp_error *err) {
    const struct vtk_array *a = s->array;
    const size_t size = a->type->number.size, run = run_of(a);
    const uint64_t need = vtk_type_bytes(a->type, a->count);
    struct vtk_unpacker *u = a->packing ? vtk_unpack_open(s, need, err) : NULL;
    char *own = target->out ? NULL : malloc(run * size);
    uint8_t *bits = a->type->are_bits ? malloc(run / 8) : NULL;
    bool ok = a->packing ? u != NULL : pull_byte_count(s, need, err);
    if (ok && ((!target->out && !own) || (a->type->are_bits && !bits)))
        ok = sp_fail(err, SP_ERR_MEMORY, s->file->title, "out of memory while reading %s", a->name);
    for (uint64_t at = 0; ok && at < a->count; at += run) {
        const size_t n = a->count - at < run ? (size_t)(a->count - at) : run;
        char *out = own ? own : target->out + at * size;
        ok = read_run(s, u, out, n, bits, err);
        if (ok)
            pass_values(target, at, out, n);
    }
    free(bits);
    free(own);
    vtk_unpack_close(u);
    return ok;
}

#define STORE(T, value)                                                                            \
    do {                                                                                           \
        T typed = (T)(value);                                                                      \
        memcpy(out, &typed, sizeof typed);                                                         \
    } while (0)

/* Whole numbers of 64 bits, which double does not hold near the ends of their range. */
static bool store_long(const char *word, const struct vtk_type *type, void *out) {
    char *end;
    errno = 0;
    if (type->number.kind == IMPORT_SIGNED)
        STORE(int64_t, strtoll(word, &end, 10));
    else
        STORE(uint64_t, strtoull(word, &end, 10));
    return end != word && !*end && errno == 0 &&
           (type->number.kind == IMPORT_SIGNED || word[0] != '-');
}

/* Parses one number into the native form of its type. False if it is none or out of range. */
static bool store_word(const char *word, const struct vtk_type *type, void *out) {
    char *end;
    if (type->number.kind == IMPORT_FLOAT && type->number.size == 4) {
        STORE(float, strtof(word, &end));
        return end != word && !*end;
    }
    double value = strtod(word, &end);
    if (end == word || *end)
        return false;
    if (type->number.kind == IMPORT_FLOAT) {
        STORE(double, value);
        return true;
    }
    if (type->number.size == 8 && strspn(word, "+-0123456789") == strlen(word))
        return store_long(word, type, out);
    double steps = type->are_bits ? 2 : ldexp(1, 8 * (int)type->number.size);
    double low = type->number.kind == IMPORT_SIGNED ? -steps / 2 : 0;
    if (!(value >= low && value < low + steps) || value != trunc(value))
        return false;
    if (type->number.size == 8) /* "1e3" */
        STORE(uint64_t,
              type->number.kind == IMPORT_SIGNED ? (uint64_t)(int64_t)value : (uint64_t)value);
    else if (type->number.size == 4)
        STORE(uint32_t, (int64_t)value);
    else if (type->number.size == 2)
        STORE(uint16_t, (int64_t)value);
    else
        STORE(uint8_t, (int64_t)value);
    return true;
}

static bool is_number(const char *word) {
    char *end;
    strtod(word, &end);
    return end != word && !*end;
}

/* Reads value i of ASCII data. */
static bool read_word(struct import_text *text, const struct vtk_array *a, uint64_t i, char *out,
                      struct sp_error *err) {
    char word[IMPORT_WORD_MAX + 1];
    uint64_t byte;
    if (!import_text_word(text, word, &byte, err))
        return false;
    if (!word[0])
        return import_fail(err, SP_ERR_FORMAT, text->file->title, byte, a->name,
                           "the data ends after %" PRIu64 " of %" PRIu64 " values", i, a->count);
    return store_word(word, a->type, out) ||
           import_fail(err, SP_ERR_FORMAT, text->file->title, byte, a->name,
                       "value %" PRIu64 ", \"%.40s\", is not of type %s", i, word, a->type->legacy);
}

/* Another number behind the last one means that a count is wrong, unless it is the name of the next
 * array of a legacy FIELD: NAME COMPONENTS TUPLES TYPE. */
static bool check_end(struct import_text *text, const struct vtk_array *a, struct sp_error *err) {
    char word[IMPORT_WORD_MAX + 1];
    uint64_t byte, first = 0;
    int numbers = 0;
    do {
        if (!import_text_word(text, word, &byte, err))
            return false;
        first = numbers ? first : byte;
    } while (is_number(word) && ++numbers <= 3);
    return numbers == 0 || (numbers == 3 && vtk_find_type(word, false)) ||
           import_fail(err, SP_ERR_FORMAT, text->file->title, first, a->name,
                       "more than %" PRIu64 " values: a count is wrong", a->count);
}

static bool read_words(const struct import_file *file, const struct vtk_array *a,
                       const struct target *target, struct sp_error *err) {
    const size_t size = a->type->number.size, run = run_of(a);
    struct import_text *text = malloc(sizeof *text);
    char *own = target->out ? NULL : malloc(run * size);
    bool ok = text && (own || target->out);
    if (ok)
        import_text_init(text, file, a->begin, a->end < file->size ? a->end : file->size);
    else
        sp_fail(err, SP_ERR_MEMORY, file->title, "out of memory while reading %s", a->name);
    for (uint64_t at = 0; ok && at < a->count; at += run) {
        const size_t n = a->count - at < run ? (size_t)(a->count - at) : run;
        char *out = own ? own : target->out + at * size;
        for (size_t i = 0; ok && i < n; i++)
            ok = read_word(text, a, at + i, out + i * size, err);
        if (ok)
            pass_values(target, at, out, n);
    }
    ok = ok && check_end(text, a, err);
    free(text);
    free(own);
    return ok;
}

static bool read_values(const struct import_file *file, const struct vtk_array *a,
                        const struct target *target, struct sp_error *err) {
    if (a->form == VTK_WORDS)
        return read_words(file, a, target, err);
    struct vtk_source *s = vtk_source_open(file, a, err);
    bool ok = s && read_bytes(s, target, err);
    free(s);
    return ok;
}

bool vtk_array_read(const struct import_file *file, const struct vtk_array *a,
                    const struct vtk_sink *sink, struct sp_error *err) {
    return read_values(file, a, &(struct target){ .sink = sink }, err);
}

bool vtk_array_copy(const struct import_file *file, const struct vtk_array *a, void *out,
                    const struct vtk_sink *report, struct sp_error *err) {
    return read_values(file, a, &(struct target){ .out = out, .sink = report }, err);
}

static void put_floats(void *user, uint64_t first, const void *values, size_t n) {
    import_vectors_put(user, first, values, n);
}

bool vtk_array_read_floats(const struct import_file *file, const struct vtk_array *a, float *out,
                           struct import_shift *shift, struct sp_error *err) {
    struct import_vectors vectors = { .number = a->type->number,
                                      .out = (float(*)[3])(void *)out,
                                      .shift = shift };
    return vtk_array_read(file, a, &(struct vtk_sink){ put_floats, &vectors }, err);
}

double *vtk_array_read_numbers(const struct import_file *file, const struct vtk_array *a,
                               struct sp_error *err) {
    char *values = malloc(a->count * a->type->number.size);
    double *numbers = malloc(a->count * sizeof *numbers);
    bool ok = values && numbers;
    if (!ok)
        sp_fail(err, SP_ERR_MEMORY, file->title, "out of memory for %s", a->name);
    ok = ok && vtk_array_copy(file, a, values, NULL, err);
    for (uint64_t i = 0; ok && i < a->count; i++)
        numbers[i] = import_widen(values + i * a->type->number.size, a->type->number);
    free(values);
    if (ok)
        return numbers;
    free(numbers);
    return NULL;
}
