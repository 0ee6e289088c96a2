/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/stream.h"

#include <assert.h>
#include <ctype.h>
#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/transfer.h"

enum { WORD = 64 }; /* bytes of a number as text, with the 0 that ends it */

/* The most bytes that one byte of bzip2 becomes: 32 bytes can hold a block of 900 kB, in which five
 * bytes stand for 259 equal ones. */
enum { BZIP2_RATIO_MAX = 1500000 };

void import_stream_open(struct import_stream *s, int fd, bool owned, const char *title,
                        uint64_t size) {
    memset(s, 0, offsetof(struct import_stream, in));
    s->fd = fd;
    s->owned = owned;
    s->title = title;
    s->size = size;
}

void import_stream_close(struct import_stream *s) {
    if (s->encoding == IMPORT_GZIP)
        inflateEnd(&s->z);
    else if (s->encoding == IMPORT_BZIP2)
        BZ2_bzDecompressEnd(&s->bz);
    if (s->owned)
        close(s->fd);
    s->encoding = IMPORT_RAW;
    s->owned = false;
}

const char *import_encoding_name(enum import_encoding encoding) {
    static const char *const names[] = { [IMPORT_RAW] = "raw",
                                         [IMPORT_GZIP] = "gzip",
                                         [IMPORT_BZIP2] = "bzip2",
                                         [IMPORT_HEX] = "hexadecimal digits",
                                         [IMPORT_TEXT] = "text" };
    return names[encoding];
}

bool import_stream_may_hold(enum import_encoding encoding, struct import_number number,
                            uint64_t file_bytes, uint64_t bytes) {
    switch (encoding) {
    case IMPORT_GZIP:
        return file_bytes > 0 && bytes / DEFLATE_RATIO_MAX <= file_bytes;
    case IMPORT_BZIP2:
        return file_bytes > 0 && bytes / BZIP2_RATIO_MAX <= file_bytes;
    case IMPORT_HEX:
        return bytes <= file_bytes / 2;
    case IMPORT_TEXT: /* a digit and a blank per number; no blank after the last one */
        return bytes / import_number_part(number).size <= file_bytes / 2 + file_bytes % 2;
    default:
        return bytes <= file_bytes;
    }
}

/* The bytes of the file. */

static bool read_file(struct import_stream *s, void *out, size_t n, size_t *got,
                      struct sp_error *err) {
    *got = 0;
    while (*got < n) {
        ssize_t r = read(s->fd, (char *)out + *got, n - *got);
        if (r < 0 && errno == EINTR)
            continue;
        if (r < 0 && errno == EFAULT) /* the memory is a sparse file, see child.h */
            return sp_fail(err, SP_ERR_IO, s->title,
                           "cannot write the samples: the disk is full or fails");
        if (r < 0)
            return import_fail(err, SP_ERR_IO, s->title, s->at, NULL, "cannot read the file: %s",
                               strerror(errno));
        if (r == 0)
            break;
        *got += (size_t)r;
        s->at += (uint64_t)r;
    }
    return true;
}

bool import_stream_seek(struct import_stream *s, uint64_t byte, struct sp_error *err) {
    if (lseek(s->fd, (off_t)byte, SEEK_SET) < 0)
        return import_fail(err, SP_ERR_IO, s->title, byte, NULL,
                           "cannot read from this byte on: %s", strerror(errno));
    s->at = byte;
    return true;
}

bool import_stream_read_sparse(struct import_stream *s, char *out, size_t n, size_t *got,
                               struct sp_error *err) {
    const uint64_t begin = s->at;
    const uint64_t end = begin + n < s->size ? begin + n : s->size > begin ? s->size : begin;
    uint64_t from, to;
    *got = 0;
    for (uint64_t at = begin; at < end; at = to) {
        size_t part;
        sp_skip_holes(s->fd, at, end, &from, &to);
        if (!import_stream_seek(s, from, err) ||
            !read_file(s, out + (from - begin), to - from, &part, err))
            return false;
        *got = (size_t)(from - begin) + part;
        if (part < to - from)
            break;
    }
    /* Another program may have cut the file, whose end looks like a hole then. */
    struct stat st;
    if (fstat(s->fd, &st) == 0 && (uint64_t)st.st_size < begin + *got)
        *got = (uint64_t)st.st_size > begin ? (size_t)((uint64_t)st.st_size - begin) : 0;
    return true;
}

bool import_stream_skip_lines(struct import_stream *s, uint64_t lines, struct sp_error *err) {
    while (lines > 0) {
        size_t got, used = 0;
        if (!read_file(s, s->in, sizeof s->in, &got, err))
            return false;
        if (got == 0)
            return import_fail(err, SP_ERR_FORMAT, s->title, s->at, "line skip",
                               "%" PRIu64 " lines are missing", lines);
        while (used < got && lines > 0)
            lines -= s->in[used++] == '\n';
        if (!import_stream_seek(s, s->at - (got - used), err))
            return false;
    }
    return true;
}

/* gzip and zlib. */

static bool fail_memory(const struct import_stream *s, struct sp_error *err) {
    return sp_fail(err, SP_ERR_MEMORY, s->title, "out of memory while unpacking %s",
                   import_encoding_name(s->encoding));
}

static bool fail_cut(const struct import_stream *s, struct sp_error *err) {
    return import_fail(err, SP_ERR_FORMAT, s->title, s->at, "data",
                       "the %s data is cut off after %" PRIu64 " bytes",
                       import_encoding_name(s->encoding), s->at);
}

/* Starts the next gzip member of the file, if one follows. Other bytes are ignored, as gzip does;
 * 0 pads the blocks of tapes. What follows zlib data belongs to the format around it. */
static bool next_member(struct import_stream *s, struct sp_error *err) {
    if (s->z.avail_in == 0) {
        size_t got;
        if (!read_file(s, s->in, sizeof s->in, &got, err))
            return false;
        s->z.next_in = s->in;
        s->z.avail_in = (unsigned)got;
    }
    s->ended = s->z.avail_in == 0 || s->z.next_in[0] != 0x1f;
    for (unsigned i = 0; s->ended && s->is_gzip && i < s->z.avail_in; i++)
        s->has_garbage |= s->z.next_in[i] != 0;
    if (!s->ended)
        inflateReset(&s->z);
    return true;
}

static bool read_gzip(struct import_stream *s, void *out, size_t n, size_t *got,
                      struct sp_error *err) {
    s->z.next_out = out;
    s->z.avail_out = (unsigned)n;
    while (s->z.avail_out > 0 && !s->ended) {
        if (s->z.avail_in == 0) {
            size_t arrived;
            if (!read_file(s, s->in, sizeof s->in, &arrived, err))
                return false;
            if (arrived == 0)
                return fail_cut(s, err);
            s->z.next_in = s->in;
            s->z.avail_in = (unsigned)arrived;
            if (s->z.total_in == 0)
                s->is_gzip = s->in[0] == 0x1f;
        }
        int status = inflate(&s->z, Z_NO_FLUSH);
        if (status == Z_STREAM_END) {
            if (!next_member(s, err))
                return false;
        } else if (status == Z_MEM_ERROR) {
            return fail_memory(s, err);
        } else if (status != Z_OK && status != Z_BUF_ERROR) {
            return import_fail(err, SP_ERR_FORMAT, s->title, s->at - s->z.avail_in, "data",
                               "the gzip data is damaged%s%s", s->z.msg ? ": " : "",
                               s->z.msg ? s->z.msg : "");
        }
    }
    *got = n - s->z.avail_out;
    return true;
}

/* bzip2. */

static bool fill_bzip2(struct import_stream *s, struct sp_error *err) {
    size_t arrived;
    if (s->bz.avail_in > 0)
        return true;
    if (!read_file(s, s->in, sizeof s->in, &arrived, err))
        return false;
    s->bz.next_in = (char *)s->in;
    s->bz.avail_in = (unsigned)arrived;
    return true;
}

/* Like gzip, bzip2 joins streams that follow one another. */
static bool next_bzip2(struct import_stream *s, struct sp_error *err) {
    char *next;
    unsigned left;
    if (!fill_bzip2(s, err))
        return false;
    next = s->bz.next_in;
    left = s->bz.avail_in;
    s->ended = left == 0 || *next != 'B';
    if (s->ended)
        return true;
    char *const out = s->bz.next_out;
    const unsigned capacity = s->bz.avail_out;
    BZ2_bzDecompressEnd(&s->bz);
    memset(&s->bz, 0, sizeof s->bz);
    if (BZ2_bzDecompressInit(&s->bz, 0, 0) != BZ_OK)
        return fail_memory(s, err);
    s->bz.next_in = next;
    s->bz.avail_in = left;
    s->bz.next_out = out;
    s->bz.avail_out = capacity;
    return true;
}

static bool read_bzip2(struct import_stream *s, void *out, size_t n, size_t *got,
                       struct sp_error *err) {
    s->bz.next_out = out;
    s->bz.avail_out = (unsigned)n;
    while (s->bz.avail_out > 0 && !s->ended) {
        if (!fill_bzip2(s, err))
            return false;
        if (s->bz.avail_in == 0)
            return fail_cut(s, err);
        const int status = BZ2_bzDecompress(&s->bz);
        if (status == BZ_STREAM_END) {
            if (!next_bzip2(s, err))
                return false;
        } else if (status == BZ_MEM_ERROR) {
            return fail_memory(s, err);
        } else if (status != BZ_OK) {
            return import_fail(err, SP_ERR_FORMAT, s->title, s->at - s->bz.avail_in, "data",
                               "the bzip2 data is damaged");
        }
    }
    *got = n - s->bz.avail_out;
    return true;
}

/* Text. */

/* The next byte of the file; −1 at its end, −2 with *err set. */
static int next_byte(struct import_stream *s, struct sp_error *err) {
    if (s->used == s->filled) {
        s->used = 0;
        if (!read_file(s, s->in, sizeof s->in, &s->filled, err))
            return -2;
    }
    return s->used < s->filled ? s->in[s->used++] : -1;
}

static bool fail_text(const struct import_stream *s, const char *word, struct sp_error *err) {
    return import_fail(err, SP_ERR_FORMAT, s->title, s->at - (s->filled - s->used), "data",
                       "\"%.20s\" is not a number that the type holds", word);
}

static int digit_of(int c) {
    return c >= '0' && c <= '9' ? c - '0' : isxdigit(c) ? tolower(c) - 'a' + 10 : -1;
}

static bool read_hex(struct import_stream *s, uint8_t *out, size_t n, size_t *got,
                     struct sp_error *err) {
    int c, high = -1;
    *got = 0;
    while (*got < n && (c = next_byte(s, err)) != -1) {
        if (c == -2)
            return false;
        if (isspace(c))
            continue;
        const char word[2] = { isprint(c) ? (char)c : '?', 0 };
        const int digit = digit_of(c);
        if (digit < 0)
            return import_fail(err, SP_ERR_FORMAT, s->title, s->at - (s->filled - s->used), "data",
                               "\"%s\" is not a hexadecimal digit", word);
        if (high >= 0)
            out[(*got)++] = (uint8_t)(16 * high + digit);
        high = high >= 0 ? -1 : digit;
    }
    return true;
}

/* Reads the next word; an empty one at the end. */
static bool next_word(struct import_stream *s, char word[WORD], struct sp_error *err) {
    size_t n = 0;
    int c;
    do
        c = next_byte(s, err);
    while (c >= 0 && (isspace(c) || c == ','));
    for (; c >= 0 && !isspace(c) && c != ','; c = next_byte(s, err)) {
        if (n == WORD - 1 || !isprint(c)) {
            word[n] = 0;
            return fail_text(s, word, err);
        }
        word[n++] = (char)c;
    }
    word[n] = 0;
    return c != -2;
}

/* A whole number may be written with a fraction, which is dropped, as MetaIO does. */
static bool parse_whole(const char *word, struct import_number number, void *out) {
    char *end;
    union {
        int64_t i;
        uint64_t u;
    } value;
    double low, high;
    import_number_range(number, &low, &high);
    errno = 0;
    if (number.kind == IMPORT_SIGNED)
        value.i = strtoll(word, &end, 10);
    else
        value.u = strtoull(word, &end, 10);
    if (number.size == 8 && end > word && !*end && errno == 0 &&
        (number.kind == IMPORT_SIGNED || *word != '-')) {
        memcpy(out, &value, sizeof value); /* not by way of float64, which would round it */
        return true;
    }
    const double real = trunc(strtod(word, &end));
    if (end == word || *end || !(real >= low && real <= high))
        return false;
    if (number.size == 8 && !(fabs(real) < 0x1p53)) /* it may be rounded */
        return false;
    import_narrow(real, number, out);
    return true;
}

static bool read_text(struct import_stream *s, char *out, size_t n, size_t *got,
                      struct sp_error *err) {
    const struct import_number part = import_number_part(s->number);
    char word[WORD], *end;
    for (*got = 0; *got < n; *got += part.size) {
        if (!next_word(s, word, err))
            return false;
        if (!*word)
            return true;
        if (import_number_is_whole(part)) {
            if (!parse_whole(word, part, out + *got))
                return fail_text(s, word, err);
        } else {
            import_narrow(strtod(word, &end), part, out + *got);
            if (*end)
                return fail_text(s, word, err);
        }
    }
    return true;
}

bool import_stream_begin(struct import_stream *s, enum import_encoding encoding,
                         struct import_number number, struct sp_error *err) {
    s->number = number;
    s->ended = false;
    /* 32 allows the wrappers of gzip and zlib; zlib checks their checksums. */
    const bool ok = encoding == IMPORT_GZIP    ? inflateInit2(&s->z, 15 + 32) == Z_OK
                    : encoding == IMPORT_BZIP2 ? BZ2_bzDecompressInit(&s->bz, 0, 0) == BZ_OK
                                               : true;
    if (ok)
        s->encoding = encoding;
    return ok || sp_fail(err, SP_ERR_MEMORY, s->title, "out of memory while unpacking %s",
                         import_encoding_name(encoding));
}

bool import_stream_read(struct import_stream *s, void *out, size_t n, size_t *got,
                        struct sp_error *err) {
    assert(n <= IMPORT_STREAM_CHUNK || s->encoding == IMPORT_RAW);
    switch (s->encoding) {
    case IMPORT_GZIP:
        return read_gzip(s, out, n, got, err);
    case IMPORT_BZIP2:
        return read_bzip2(s, out, n, got, err);
    case IMPORT_HEX:
        return read_hex(s, out, n, got, err);
    case IMPORT_TEXT:
        return read_text(s, out, n, got, err);
    default:
        return read_file(s, out, n, got, err);
    }
}

size_t import_stream_head(const struct import_file *file, void *out, size_t size, bool *is_packed) {
    struct import_stream *s = malloc(sizeof *s);
    struct sp_error ignored;
    uint8_t magic[2] = { 0, 0 };
    size_t got = 0;
    *is_packed =
        pread(file->fd, magic, sizeof magic, 0) == 2 && magic[0] == 0x1f && magic[1] == 0x8b;
    if (!s)
        return 0;
    import_stream_open(s, file->fd, false, file->title, file->size);
    if (import_stream_seek(s, 0, &ignored) &&
        import_stream_begin(s, *is_packed ? IMPORT_GZIP : IMPORT_RAW,
                            (struct import_number){ IMPORT_UNSIGNED, 1 }, &ignored) &&
        !import_stream_read(s, out, size, &got, &ignored))
        got = 0;
    import_stream_close(s);
    free(s);
    return got;
}
