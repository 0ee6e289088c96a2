/* SPDX-License-Identifier: Apache-2.0 */
#include "import/vtk_array.h"

#include <assert.h>
#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>
#include <zlib.h>

#include "import/samples.h"
#include "import/vtk_text.h"

enum { CHUNK = 1 << 16 }; /* bytes */
#define BLOCKS_MAX (UINT64_C(1) << 24)
#define BLOCK_MAX (UINT64_C(1) << 30) /* bytes */

static const struct vtk_type types[] = {
    { "unsigned_char", "UInt8", VTK_UNSIGNED, 1, SP_UINT8 },
    { "char", "Int8", VTK_SIGNED, 1, SP_INT8 },
    { "signed_char", NULL, VTK_SIGNED, 1, SP_INT8 },
    { "unsigned_short", "UInt16", VTK_UNSIGNED, 2, SP_UINT16 },
    { "short", "Int16", VTK_SIGNED, 2, SP_INT16 },
    { "unsigned_int", "UInt32", VTK_UNSIGNED, 4, -1 },
    { "int", "Int32", VTK_SIGNED, 4, SP_INT32 },
    { "vtkidtype", NULL, VTK_SIGNED, 4, -1 }, /* the size in legacy files */
    { "unsigned_long", "UInt64", VTK_UNSIGNED, 8, -1 },
    { "vtktypeuint64", NULL, VTK_UNSIGNED, 8, -1 },
    { "long", "Int64", VTK_SIGNED, 8, -1 },
    { "vtktypeint64", NULL, VTK_SIGNED, 8, -1 },
    { "float", "Float32", VTK_FLOAT, 4, SP_FLOAT32 },
    { "double", "Float64", VTK_FLOAT, 8, SP_FLOAT64 },
};

const struct vtk_type *vtk_find_type(const char *name, bool xml) {
    for (size_t i = 0; i < sizeof types / sizeof types[0]; i++)
        if (xml ? types[i].xml && strcmp(types[i].xml, name) == 0
                : strcasecmp(types[i].legacy, name) == 0)
            return &types[i];
    return NULL;
}

/* A stream of bytes, decoded from base64 if necessary. */

struct source {
    const struct import_file *file;
    const struct vtk_array *array;
    uint64_t at, end; /* the next byte of the file to read */
    uint8_t raw[CHUNK], out[CHUNK];
    size_t ready, used; /* decoded bytes in out */
    uint32_t bits;      /* of the current base64 group */
    unsigned digits, pads;
    bool ended; /* base64: the encoded text has ended */
};

static bool cut_off(const struct source *s, struct sp_error *err) {
    return import_fail(err, SP_ERR_FORMAT, s->file->shown, s->at, s->array->name,
                       "the data ends before the %" PRIu64 " values", s->array->count);
}

static bool fetch(struct source *s, void *out, size_t n, size_t *got, struct sp_error *err) {
    if (n > s->end - s->at)
        n = (size_t)(s->end - s->at);
    for (*got = 0; *got < n;) {
        ssize_t r = pread(s->file->fd, (char *)out + *got, n - *got, (off_t)s->at);
        if (r < 0 && errno == EINTR)
            continue;
        if (r < 0)
            return import_fail(err, SP_ERR_IO, s->file->shown, s->at, NULL, "cannot read: %s",
                               strerror(errno));
        if (r == 0)
            break;
        *got += (size_t)r;
        s->at += (size_t)r;
    }
    return true;
}

static int base64_digit(int c) {
    return c >= 'A' && c <= 'Z'   ? c - 'A'
           : c >= 'a' && c <= 'z' ? c - 'a' + 26
           : c >= '0' && c <= '9' ? c - '0' + 52
           : c == '+'             ? 62
           : c == '/'             ? 63
                                  : -1;
}

/* Decodes one character. Each group of four is independent, so that a second text may follow the
 * padding of the first, as after the lengths. False if the character is not base64. */
static bool take_base64(struct source *s, int c) {
    if (c == ' ' || (c >= '\t' && c <= '\r'))
        return true;
    int digit = base64_digit(c);
    if (c == '=' && s->digits + s->pads >= 2)
        s->pads++;
    else if (digit >= 0 && s->pads == 0)
        s->bits = s->bits << 6 | (uint32_t)digit, s->digits++;
    else
        return false;
    if (s->digits + s->pads == 4) {
        uint32_t group = s->bits << 6 * s->pads;
        for (unsigned i = 0; i < 3 - s->pads; i++)
            s->out[s->ready++] = (uint8_t)(group >> (16 - 8 * i));
        s->bits = s->digits = s->pads = 0;
    }
    return true;
}

/* Decodes more bytes. A character that is not base64 ends the data; the caller reports an error if
 * bytes are missing. */
static bool decode_more(struct source *s, struct sp_error *err) {
    s->ready = s->used = 0;
    while (s->ready == 0 && !s->ended) {
        size_t got;
        if (!fetch(s, s->raw, CHUNK, &got, err))
            return false;
        s->ended = got == 0;
        for (size_t i = 0; i < got && !s->ended; i++)
            if (!take_base64(s, s->raw[i])) {
                s->at -= got - i;
                s->ended = true;
            }
    }
    return true;
}

/* Reads the next n bytes. */
static bool pull(struct source *s, void *out, size_t n, struct sp_error *err) {
    size_t got;
    if (s->array->form == VTK_BYTES)
        return fetch(s, out, n, &got, err) && (got == n || cut_off(s, err));
    for (size_t done = 0; done < n; done += got) {
        if (s->used == s->ready && !decode_more(s, err))
            return false;
        got = s->ready - s->used < n - done ? s->ready - s->used : n - done;
        if (got == 0 && s->at < s->end)
            return import_fail(err, SP_ERR_FORMAT, s->file->shown, s->at, s->array->name,
                               "the text is not base64, and values are missing");
        if (got == 0)
            return cut_off(s, err);
        memcpy((char *)out + done, s->out + s->used, got);
        s->used += got;
    }
    return true;
}

static bool pull_length(struct source *s, uint64_t *length, struct sp_error *err) {
    uint8_t b[8];
    unsigned n = s->array->length_size;
    if (!pull(s, b, n, err))
        return false;
    *length = 0;
    for (unsigned i = 0; i < n; i++)
        *length |= (uint64_t)b[i] << 8 * (s->array->big_endian ? n - 1 - i : i);
    return true;
}

static struct source *open_source(const struct import_file *file, const struct vtk_array *array,
                                  struct sp_error *err) {
    struct source *s = malloc(sizeof *s);
    if (!s) {
        sp_fail(err, SP_ERR_MEMORY, file->shown, "out of memory while reading %s", array->name);
        return NULL;
    }
    memset(s, 0, offsetof(struct source, raw));
    s->ready = s->used = 0;
    s->bits = s->digits = s->pads = 0;
    s->ended = false;
    s->file = file;
    s->array = array;
    s->at = array->begin;
    s->end = array->end < file->size ? array->end : file->size;
    return s;
}

/* The lengths before the values. */

struct blocks {
    uint64_t count, size, last; /* unpacked bytes of each block and of the last block */
};

static bool pull_blocks(struct source *s, uint64_t need, struct blocks *b, struct sp_error *err) {
    if (!pull_length(s, &b->count, err) || !pull_length(s, &b->size, err) ||
        !pull_length(s, &b->last, err))
        return false;
    if (b->last == 0)
        b->last = b->size;
    if (b->count > BLOCKS_MAX || b->size > BLOCK_MAX || b->last > b->size ||
        (b->count ? (b->count - 1) * b->size + b->last : 0) != need)
        return import_fail(err, SP_ERR_FORMAT, s->file->shown, s->array->begin, s->array->name,
                           "%" PRIu64 " blocks of %" PRIu64 " bytes, the last of %" PRIu64
                           ", are not the %" PRIu64 " bytes of the values",
                           b->count, b->size, b->last, need);
    return true;
}

static bool pull_byte_count(struct source *s, uint64_t need, struct sp_error *err) {
    uint64_t bytes;
    if (s->array->length_size == 0)
        return true;
    if (!pull_length(s, &bytes, err))
        return false;
    return bytes == need ||
           import_fail(err, SP_ERR_FORMAT, s->file->shown, s->array->begin, s->array->name,
                       "the file declares %" PRIu64 " bytes, the %" PRIu64 " values need %" PRIu64,
                       bytes, s->array->count, need);
}

bool vtk_array_check(const struct import_file *file, const struct vtk_array *a,
                     struct sp_error *err) {
    assert(a->count >= 1 && a->count <= SP_VOXELS_MAX);
    uint64_t need = a->count * a->type->size, least = need; /* bytes in the file */
    struct blocks blocks;
    struct source *s = open_source(file, a, err);
    bool ok = s != NULL;
    if (ok && a->form == VTK_WORDS) {
        least = 2 * a->count - 1;
    } else if (ok && a->zlib) {
        ok = pull_blocks(s, need, &blocks, err);
        least = ok ? (3 + blocks.count) * a->length_size + need / DEFLATE_RATIO_MAX : 0;
    } else if (ok) {
        ok = pull_byte_count(s, need, err);
        least = need + a->length_size;
    }
    if (a->form == VTK_BASE64)
        least += least / 3;
    uint64_t have = s && s->end > a->begin ? s->end - a->begin : 0;
    if (ok && have < least)
        ok = import_fail(err, SP_ERR_FORMAT, file->shown, a->begin, a->name,
                         "%" PRIu64 " values need at least %" PRIu64 " bytes, the file has %" PRIu64
                         ": it is cut off or a count is wrong",
                         a->count, least, have);
    free(s);
    return ok;
}

/* Values. */

static void report(const struct import_progress *progress, uint64_t bytes) {
    if (progress)
        progress->report(progress->user, bytes);
}

static bool read_plain(struct source *s, char *out, uint64_t need,
                       const struct import_progress *progress, struct sp_error *err) {
    size_t size = s->array->type->size;
    bool swap = s->array->big_endian != (__BYTE_ORDER__ == __ORDER_BIG_ENDIAN__);
    if (!pull_byte_count(s, need, err))
        return false;
    for (uint64_t at = 0; at < need;) {
        size_t n = need - at < 16 * CHUNK ? (size_t)(need - at) : 16 * CHUNK;
        if (!pull(s, out + at, n, err))
            return false;
        if (swap) /* while it is in the cache */
            import_swap(out + at, size, n / size);
        at += n;
        report(progress, at);
    }
    return true;
}

/* Unpacks one block of `packed` bytes, which must become exactly `size` bytes. */
static bool inflate_block(struct source *s, z_stream *z, uint64_t packed, void *out, uint64_t size,
                          struct sp_error *err) {
    uint8_t in[CHUNK];
    inflateReset(z);
    z->next_out = out;
    z->avail_out = (unsigned)size;
    z->avail_in = 0;
    for (int status = Z_OK; status != Z_STREAM_END;) {
        if (z->avail_in == 0 && packed > 0) {
            size_t n = packed < CHUNK ? (size_t)packed : CHUNK;
            if (!pull(s, in, n, err))
                return false;
            packed -= n;
            z->next_in = in;
            z->avail_in = (unsigned)n;
        }
        status = inflate(z, Z_NO_FLUSH);
        if (status == Z_MEM_ERROR)
            return sp_fail(err, SP_ERR_MEMORY, s->file->shown,
                           "out of memory while unpacking zlib");
        if (status == Z_BUF_ERROR)
            return import_fail(err, SP_ERR_FORMAT, s->file->shown, s->at, s->array->name,
                               z->avail_in ? "a block of zlib data is larger than declared"
                                           : "a block of zlib data is cut off");
        if (status != Z_OK && status != Z_STREAM_END)
            return import_fail(err, SP_ERR_FORMAT, s->file->shown, s->at, s->array->name,
                               "the zlib data is damaged: %s", z->msg ? z->msg : "no reason");
    }
    if (z->avail_out || z->avail_in || packed)
        return import_fail(err, SP_ERR_FORMAT, s->file->shown, s->at, s->array->name,
                           "a block of zlib data is shorter than declared");
    return true;
}

static bool read_sizes(struct source *s, uint64_t *sizes, uint64_t count, struct sp_error *err) {
    for (uint64_t i = 0; i < count; i++)
        if (!pull_length(s, &sizes[i], err))
            return false;
    return true;
}

static bool read_zlib(struct source *s, char *out, uint64_t need,
                      const struct import_progress *progress, struct sp_error *err) {
    struct blocks b;
    size_t size = s->array->type->size;
    if (!pull_blocks(s, need, &b, err))
        return false;
    uint64_t *sizes = malloc(b.count * sizeof *sizes);
    z_stream z = { .next_in = NULL };
    if (!sizes || inflateInit(&z) != Z_OK) {
        free(sizes);
        return sp_fail(err, SP_ERR_MEMORY, s->file->shown,
                       "out of memory for %" PRIu64 " zlib blocks", b.count);
    }
    bool ok = read_sizes(s, sizes, b.count, err);
    uint64_t at = 0;
    for (uint64_t i = 0; ok && i < b.count; i++) {
        uint64_t n = i + 1 < b.count ? b.size : b.last;
        ok = inflate_block(s, &z, sizes[i], out + at, n, err);
        at += n;
        report(progress, ok ? at : 0);
    }
    inflateEnd(&z);
    free(sizes);
    if (ok && s->array->big_endian != (__BYTE_ORDER__ == __ORDER_BIG_ENDIAN__))
        import_swap(out, size, need / size);
    return ok;
}

#define STORE(T, value)                                                                            \
    do {                                                                                           \
        T typed = (T)(value);                                                                      \
        memcpy(out, &typed, sizeof typed);                                                         \
    } while (0)

/* Parses one number into the native form of its type. False if it is none or out of range. */
static bool store_word(const char *word, const struct vtk_type *type, void *out) {
    char *end;
    if (type->kind == VTK_FLOAT && type->size == 4) {
        STORE(float, strtof(word, &end));
        return end != word && !*end;
    }
    double value = strtod(word, &end);
    if (end == word || *end)
        return false;
    if (type->kind == VTK_FLOAT) {
        STORE(double, value);
        return true;
    }
    double steps = ldexp(1, 8 * (int)type->size);
    double low = type->kind == VTK_SIGNED ? -steps / 2 : 0;
    if (!(value >= low && value < low + steps) || value != trunc(value))
        return false;
    if (type->size == 8) /* beyond the precision of a double; only coordinates have this type */
        STORE(uint64_t, type->kind == VTK_SIGNED ? (uint64_t)(int64_t)value : (uint64_t)value);
    else if (type->size == 4)
        STORE(uint32_t, (int64_t)value);
    else if (type->size == 2)
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

static bool read_words(const struct import_file *file, const struct vtk_array *a, char *out,
                       const struct import_progress *progress, struct sp_error *err) {
    struct vtk_text *text = malloc(sizeof *text);
    if (!text)
        return sp_fail(err, SP_ERR_MEMORY, file->shown, "out of memory while reading %s", a->name);
    vtk_text_init(text, file, a->begin, a->end < file->size ? a->end : file->size);
    char word[VTK_WORD_MAX + 1];
    uint64_t byte;
    bool ok = true;
    for (uint64_t i = 0; ok && i < a->count; i++) {
        ok = vtk_text_word(text, word, &byte, err);
        if (ok && !word[0])
            ok = import_fail(err, SP_ERR_FORMAT, file->shown, byte, a->name,
                             "the data ends after %" PRIu64 " of %" PRIu64 " values", i, a->count);
        else if (ok && !store_word(word, a->type, out + i * a->type->size))
            ok = import_fail(err, SP_ERR_FORMAT, file->shown, byte, a->name,
                             "value %" PRIu64 ", \"%.40s\", is not of type %s", i, word,
                             a->type->legacy);
        if (i % CHUNK == CHUNK - 1 || i + 1 == a->count)
            report(progress, ok ? (i + 1) * a->type->size : 0);
    }
    ok = ok && vtk_text_word(text, word, &byte, err);
    if (ok && is_number(word))
        ok = import_fail(err, SP_ERR_FORMAT, file->shown, byte, a->name,
                         "more than %" PRIu64 " values: a count is wrong", a->count);
    free(text);
    return ok;
}

bool vtk_array_read(const struct import_file *file, const struct vtk_array *a, void *out,
                    const struct import_progress *progress, struct sp_error *err) {
    if (a->form == VTK_WORDS)
        return read_words(file, a, out, progress, err);
    struct source *s = open_source(file, a, err);
    uint64_t need = a->count * a->type->size;
    bool ok = s && (a->zlib ? read_zlib(s, out, need, progress, err)
                            : read_plain(s, out, need, progress, err));
    free(s);
    return ok;
}

static double widen(const void *p, const struct vtk_type *type) {
    union {
        uint8_t u8;
        uint16_t u16;
        uint32_t u32;
        uint64_t u64;
        float f;
        double d;
    } v;
    memcpy(&v, p, type->size);
    if (type->kind == VTK_FLOAT)
        return type->size == 4 ? (double)v.f : v.d;
    bool is_signed = type->kind == VTK_SIGNED;
    switch (type->size) {
    case 1:
        return is_signed ? (int8_t)v.u8 : v.u8;
    case 2:
        return is_signed ? (int16_t)v.u16 : v.u16;
    case 4:
        return is_signed ? (int32_t)v.u32 : (double)v.u32;
    default:
        return is_signed ? (double)(int64_t)v.u64 : (double)v.u64;
    }
}

double *vtk_array_read_numbers(const struct import_file *file, const struct vtk_array *a,
                               struct sp_error *err) {
    char *values = malloc(a->count * a->type->size);
    double *numbers = malloc(a->count * sizeof *numbers);
    bool ok = values && numbers;
    if (!ok)
        sp_fail(err, SP_ERR_MEMORY, file->shown, "out of memory for %s", a->name);
    ok = ok && vtk_array_read(file, a, values, NULL, err);
    for (uint64_t i = 0; ok && i < a->count; i++)
        numbers[i] = widen(values + i * a->type->size, a->type);
    free(values);
    if (ok)
        return numbers;
    free(numbers);
    return NULL;
}
