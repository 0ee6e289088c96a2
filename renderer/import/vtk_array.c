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
#include "import/text.h"
#include "import/vectors.h"

enum { CHUNK = 1 << 16, RUN = 16 * CHUNK }; /* bytes */
#define BLOCKS_MAX (UINT64_C(1) << 24)
#define BLOCK_MAX (UINT64_C(1) << 30) /* bytes */

static const struct vtk_type types[] = {
    { "unsigned_char", "UInt8", { IMPORT_UNSIGNED, 1 }, SP_UINT8 },
    { "char", "Int8", { IMPORT_SIGNED, 1 }, SP_INT8 },
    { "signed_char", NULL, { IMPORT_SIGNED, 1 }, SP_INT8 },
    { "unsigned_short", "UInt16", { IMPORT_UNSIGNED, 2 }, SP_UINT16 },
    { "short", "Int16", { IMPORT_SIGNED, 2 }, SP_INT16 },
    { "unsigned_int", "UInt32", { IMPORT_UNSIGNED, 4 }, -1 },
    { "int", "Int32", { IMPORT_SIGNED, 4 }, SP_INT32 },
    { "vtkidtype", NULL, { IMPORT_SIGNED, 4 }, -1 }, /* the size in legacy files */
    { "unsigned_long", "UInt64", { IMPORT_UNSIGNED, 8 }, -1 },
    { "vtktypeuint64", NULL, { IMPORT_UNSIGNED, 8 }, -1 },
    { "long", "Int64", { IMPORT_SIGNED, 8 }, -1 },
    { "vtktypeint64", NULL, { IMPORT_SIGNED, 8 }, -1 },
    { "float", "Float32", { IMPORT_FLOAT, 4 }, SP_FLOAT32 },
    { "double", "Float64", { IMPORT_FLOAT, 8 }, SP_FLOAT64 },
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
    assert(a->count >= 1 && a->count <= 3 * SP_VOXELS_MAX);
    uint64_t need = a->count * a->type->number.size, least = need; /* bytes in the file */
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

struct target {
    char *out;                            /* NULL = to the vectors */
    const struct import_vectors *vectors; /* NULL = to `out` */
    const struct import_progress *progress;
};

/* Takes n bytes of values in native byte order that follow `at`; they are in `out` already if there
 * are no vectors. */
static void take_values(const struct target *t, const struct vtk_array *a, uint64_t at,
                        const void *bytes, size_t n) {
    size_t size = a->type->number.size;
    if (t->vectors)
        import_vectors_put(t->vectors, at / size, bytes, n / size);
    import_report(t->progress, t->vectors ? (at + n) / size * sizeof(float) : at + n);
}

/* zlib data in blocks, unpacked as one stream. */

struct unpacker {
    struct source *source;
    struct blocks blocks;
    uint64_t *sizes;       /* packed bytes of each block; owned */
    uint64_t next;         /* block */
    uint64_t packed, left; /* of the current block: bytes to read, bytes to unpack */
    z_stream z;
    uint8_t in[CHUNK];
};

static void close_unpacker(struct unpacker *u) {
    if (!u)
        return;
    inflateEnd(&u->z);
    free(u->sizes);
    free(u);
}

/* Reads the lengths of `need` bytes of values. */
static struct unpacker *open_unpacker(struct source *s, uint64_t need, struct sp_error *err) {
    struct blocks b;
    if (!pull_blocks(s, need, &b, err))
        return NULL;
    struct unpacker *u = calloc(1, sizeof *u);
    if (u && inflateInit(&u->z) != Z_OK) {
        free(u);
        u = NULL;
    }
    if (u) {
        u->source = s;
        u->blocks = b;
        u->sizes = malloc(b.count * sizeof *u->sizes);
    }
    bool ok = u && u->sizes;
    if (!ok)
        sp_fail(err, SP_ERR_MEMORY, s->file->shown, "out of memory for %" PRIu64 " zlib blocks",
                b.count);
    for (uint64_t i = 0; ok && i < b.count; i++)
        ok = pull_length(s, &u->sizes[i], err);
    if (ok)
        return u;
    close_unpacker(u);
    return NULL;
}

static bool check_inflated(const struct unpacker *u, int status, struct sp_error *err) {
    const struct source *s = u->source;
    if (status == Z_MEM_ERROR)
        return sp_fail(err, SP_ERR_MEMORY, s->file->shown, "out of memory while unpacking zlib");
    if (status == Z_BUF_ERROR)
        return import_fail(err, SP_ERR_FORMAT, s->file->shown, s->at, s->array->name,
                           u->z.avail_in ? "a block of zlib data is larger than declared"
                                         : "a block of zlib data is cut off");
    return status == Z_OK || status == Z_STREAM_END ||
           import_fail(err, SP_ERR_FORMAT, s->file->shown, s->at, s->array->name,
                       "the zlib data is damaged: %s", u->z.msg ? u->z.msg : "no reason");
}

/* Unpacks the next n bytes of the current block; its last bytes must also end its data. */
static bool inflate_part(struct unpacker *u, void *out, size_t n, struct sp_error *err) {
    struct source *s = u->source;
    bool is_last = n == u->left;
    int status = Z_OK;
    u->z.next_out = out;
    u->z.avail_out = (unsigned)n;
    while (status != Z_STREAM_END && (is_last || u->z.avail_out > 0)) {
        if (u->z.avail_in == 0 && u->packed > 0) {
            size_t more = u->packed < CHUNK ? (size_t)u->packed : CHUNK;
            if (!pull(s, u->in, more, err))
                return false;
            u->packed -= more;
            u->z.next_in = u->in;
            u->z.avail_in = (unsigned)more;
        }
        status = inflate(&u->z, Z_NO_FLUSH);
        if (!check_inflated(u, status, err))
            return false;
    }
    u->left -= n;
    if (u->z.avail_out || (is_last && (u->z.avail_in || u->packed)))
        return import_fail(err, SP_ERR_FORMAT, s->file->shown, s->at, s->array->name,
                           "a block of zlib data is shorter than declared");
    return true;
}

static bool unpack(struct unpacker *u, char *out, size_t n, struct sp_error *err) {
    while (n > 0) {
        if (u->left == 0) {
            inflateReset(&u->z);
            u->z.avail_in = 0;
            u->packed = u->sizes[u->next++];
            u->left = u->next < u->blocks.count ? u->blocks.size : u->blocks.last;
        }
        size_t part = n < u->left ? n : (size_t)u->left;
        if (!inflate_part(u, out, part, err))
            return false;
        out += part;
        n -= part;
    }
    return true;
}

static bool read_bytes(struct source *s, const struct target *target, struct sp_error *err) {
    const struct vtk_array *a = s->array;
    size_t size = a->type->number.size;
    uint64_t need = a->count * size;
    bool swap = a->big_endian != (__BYTE_ORDER__ == __ORDER_BIG_ENDIAN__);
    struct unpacker *u = a->zlib ? open_unpacker(s, need, err) : NULL;
    char *run = target->vectors ? malloc(RUN) : NULL;
    bool ok = a->zlib ? u != NULL : pull_byte_count(s, need, err);
    if (ok && target->vectors && !run)
        ok = sp_fail(err, SP_ERR_MEMORY, s->file->shown, "out of memory while reading %s", a->name);
    for (uint64_t at = 0; ok && at < need;) {
        size_t n = need - at < RUN ? (size_t)(need - at) : RUN;
        char *out = run ? run : target->out + at;
        ok = u ? unpack(u, out, n, err) : pull(s, out, n, err);
        if (ok && swap) /* while it is in the cache */
            import_swap(out, size, n / size);
        if (ok)
            take_values(target, a, at, out, n);
        at += n;
    }
    free(run);
    close_unpacker(u);
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
    double steps = ldexp(1, 8 * (int)type->number.size);
    double low = type->number.kind == IMPORT_SIGNED ? -steps / 2 : 0;
    if (!(value >= low && value < low + steps) || value != trunc(value))
        return false;
    if (type->number.size ==
        8) /* only coordinates and vectors have this type; rounded to 53 bits */
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

static bool read_words(const struct import_file *file, const struct vtk_array *a,
                       const struct target *target, struct sp_error *err) {
    struct import_text *text = malloc(sizeof *text);
    if (!text)
        return sp_fail(err, SP_ERR_MEMORY, file->shown, "out of memory while reading %s", a->name);
    import_text_init(text, file, a->begin, a->end < file->size ? a->end : file->size);
    char word[IMPORT_WORD_MAX + 1], *run = target->vectors ? malloc(RUN) : NULL;
    size_t size = a->type->number.size, in_run = RUN / size;
    uint64_t byte;
    bool ok = run || !target->vectors ||
              sp_fail(err, SP_ERR_MEMORY, file->shown, "out of memory while reading %s", a->name);
    for (uint64_t i = 0; ok && i < a->count; i++) {
        char *out = run ? run : target->out + i / in_run * RUN;
        size_t at = i % in_run;
        ok = import_text_word(text, word, &byte, err);
        if (ok && !word[0])
            ok = import_fail(err, SP_ERR_FORMAT, file->shown, byte, a->name,
                             "the data ends after %" PRIu64 " of %" PRIu64 " values", i, a->count);
        else if (ok && !store_word(word, a->type, out + at * size))
            ok = import_fail(err, SP_ERR_FORMAT, file->shown, byte, a->name,
                             "value %" PRIu64 ", \"%.40s\", is not of type %s", i, word,
                             a->type->legacy);
        if (ok && (at + 1 == in_run || i + 1 == a->count))
            take_values(target, a, (i - at) * size, out, (at + 1) * size);
    }
    ok = ok && import_text_word(text, word, &byte, err);
    if (ok && is_number(word))
        ok = import_fail(err, SP_ERR_FORMAT, file->shown, byte, a->name,
                         "more than %" PRIu64 " values: a count is wrong", a->count);
    free(text);
    free(run);
    return ok;
}

static bool read_values(const struct import_file *file, const struct vtk_array *a,
                        const struct target *target, struct sp_error *err) {
    if (a->form == VTK_WORDS)
        return read_words(file, a, target, err);
    struct source *s = open_source(file, a, err);
    bool ok = s && read_bytes(s, target, err);
    free(s);
    return ok;
}

bool vtk_array_read(const struct import_file *file, const struct vtk_array *a, void *out,
                    const struct import_progress *progress, struct sp_error *err) {
    return read_values(file, a, &(struct target){ .out = out, .progress = progress }, err);
}

bool vtk_array_read_floats(const struct import_file *file, const struct vtk_array *a, float *out,
                           const struct import_progress *progress, struct sp_error *err) {
    const struct import_vectors vectors = { .number = a->type->number,
                                            .out = (float(*)[3])(void *)out };
    return read_values(file, a, &(struct target){ .vectors = &vectors, .progress = progress }, err);
}

double *vtk_array_read_numbers(const struct import_file *file, const struct vtk_array *a,
                               struct sp_error *err) {
    char *values = malloc(a->count * a->type->number.size);
    double *numbers = malloc(a->count * sizeof *numbers);
    bool ok = values && numbers;
    if (!ok)
        sp_fail(err, SP_ERR_MEMORY, file->shown, "out of memory for %s", a->name);
    ok = ok && vtk_array_read(file, a, values, NULL, err);
    for (uint64_t i = 0; ok && i < a->count; i++)
        numbers[i] = import_widen(values + i * a->type->number.size, a->type->number);
    free(values);
    if (ok)
        return numbers;
    free(numbers);
    return NULL;
}
