/* SPDX-License-Identifier: Apache-2.0 */
#include "import/samples.h"

#include <assert.h>
#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include "base/transfer.h"
#include "import/confine.h"
#include "import/vectors.h"

enum { CHUNK = 1 << 20, IN_ROOM = 1 << 16 }; /* bytes */

void import_samples_finish(struct import_samples *samples) {
    for (size_t i = 0; i < samples->count; i++)
        free(samples->names[i]);
    free(samples->names);
    samples->names = NULL;
    samples->count = 0;
}

bool import_samples_add(struct import_samples *samples, const char *name, size_t length) {
    if (samples->count % 64 == 0) {
        char **more = realloc(samples->names, (samples->count + 64) * sizeof *more);
        if (!more)
            return false;
        samples->names = more;
    }
    char *copy = strndup(name, length);
    if (copy)
        samples->names[samples->count++] = copy;
    return copy != NULL;
}

void import_samples_choose_step(struct import_samples *s, uint32_t steps, uint32_t step) {
    assert(step < steps);
    s->skip_bytes += step * s->bytes;
    s->after_bytes = (steps - step - 1) * s->bytes;
}

/* One data file. */

struct stream {
    int fd;
    bool owned; /* fd */
    const char *shown;
    uint64_t size, at; /* file bytes; at: what was read from the file so far */
    bool gzip, ended;
    z_stream z;
    uint8_t in[IN_ROOM];
};

static bool open_piece(const struct import_samples *s, size_t i, struct stream *stream,
                       struct sp_error *err) {
    memset(stream, 0, offsetof(struct stream, in));
    if (s->count == 0) {
        stream->fd = s->file->fd;
        stream->shown = s->file->shown;
        stream->size = s->file->size;
        return true;
    }
    const char *name = s->names[i];
    char path[2 * PATH_MAX], real[PATH_MAX];
    int n = snprintf(path, sizeof path, "%s/%s", name[0] == '/' ? "" : s->file->folder, name);
    if (n >= PATH_MAX)
        return sp_fail(err, SP_ERR_INVALID, s->file->shown, "the name of data file %zu is too long",
                       i);
    stream->fd = sp_open_confined(s->file->root, path, name, real, &stream->size, err);
    stream->owned = stream->fd >= 0;
    stream->shown = name;
    return stream->owned;
}

static void close_stream(struct stream *stream) {
    if (stream->gzip)
        inflateEnd(&stream->z);
    if (stream->owned)
        close(stream->fd);
    stream->gzip = stream->owned = false;
}

static bool read_file(struct stream *s, void *out, size_t n, size_t *got, struct sp_error *err) {
    *got = 0;
    while (*got < n) {
        ssize_t r = read(s->fd, (char *)out + *got, n - *got);
        if (r < 0 && errno == EINTR)
            continue;
        if (r < 0 && errno == EFAULT) /* the memory is a sparse file, see child.h */
            return sp_fail(err, SP_ERR_IO, s->shown,
                           "cannot write the samples: the disk is full or fails");
        if (r < 0)
            return import_fail(err, SP_ERR_IO, s->shown, s->at, NULL, "cannot read: %s",
                               strerror(errno));
        if (r == 0)
            break;
        *got += (size_t)r;
        s->at += (uint64_t)r;
    }
    return true;
}

static bool seek_to(struct stream *s, uint64_t byte, struct sp_error *err) {
    if (lseek(s->fd, (off_t)byte, SEEK_SET) < 0)
        return import_fail(err, SP_ERR_IO, s->shown, byte, NULL, "cannot seek: %s",
                           strerror(errno));
    s->at = byte;
    return true;
}

/* As read_file(), into memory that is 0: bytes of holes are neither read nor touched, so that the
 * memory of a sparse file stays sparse. */
static bool read_sparse(struct stream *s, char *out, size_t n, size_t *got, struct sp_error *err) {
    const uint64_t begin = s->at;
    const uint64_t end = begin + n < s->size ? begin + n : s->size > begin ? s->size : begin;
    uint64_t from, to;
    *got = 0;
    for (uint64_t at = begin; at < end; at = to) {
        size_t part;
        sp_find_data(s->fd, at, end, &from, &to);
        if (!seek_to(s, from, err) || !read_file(s, out + (from - begin), to - from, &part, err))
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

static bool start_gzip(struct stream *s, struct sp_error *err) {
    /* 32 allows the wrappers of gzip and zlib; zlib checks their checksums. */
    if (inflateInit2(&s->z, 15 + 32) != Z_OK)
        return sp_fail(err, SP_ERR_MEMORY, s->shown, "out of memory while unpacking gzip");
    s->gzip = true;
    return true;
}

/* Starts the next gzip member of the file, if one follows. Other bytes are ignored, as gzip does.
 */
static bool next_member(struct stream *s, struct sp_error *err) {
    if (s->z.avail_in == 0) {
        size_t got;
        if (!read_file(s, s->in, IN_ROOM, &got, err))
            return false;
        s->z.next_in = s->in;
        s->z.avail_in = (unsigned)got;
    }
    if (s->z.avail_in == 0 || s->z.next_in[0] != 0x1f)
        s->ended = true;
    else
        inflateReset(&s->z);
    return true;
}

static bool read_gzip(struct stream *s, void *out, size_t n, size_t *got, struct sp_error *err) {
    assert(n <= CHUNK);
    s->z.next_out = out;
    s->z.avail_out = (unsigned)n;
    while (s->z.avail_out > 0 && !s->ended) {
        if (s->z.avail_in == 0) {
            size_t arrived;
            if (!read_file(s, s->in, IN_ROOM, &arrived, err))
                return false;
            if (arrived == 0)
                return import_fail(err, SP_ERR_FORMAT, s->shown, s->at, "data",
                                   "the gzip data is cut off after %" PRIu64 " bytes", s->at);
            s->z.next_in = s->in;
            s->z.avail_in = (unsigned)arrived;
        }
        int status = inflate(&s->z, Z_NO_FLUSH);
        if (status == Z_STREAM_END) {
            if (!next_member(s, err))
                return false;
        } else if (status == Z_MEM_ERROR) {
            return sp_fail(err, SP_ERR_MEMORY, s->shown, "out of memory while unpacking gzip");
        } else if (status != Z_OK && status != Z_BUF_ERROR) {
            return import_fail(err, SP_ERR_FORMAT, s->shown, s->at - s->z.avail_in, "data",
                               "the gzip data is damaged: %s", s->z.msg ? s->z.msg : "no reason");
        }
    }
    *got = n - s->z.avail_out;
    return true;
}

static bool read_stream(struct stream *s, void *out, size_t n, size_t *got, struct sp_error *err) {
    return s->gzip ? read_gzip(s, out, n, got, err) : read_file(s, out, n, got, err);
}

static bool skip_lines(struct stream *s, uint64_t lines, struct sp_error *err) {
    while (lines > 0) {
        size_t got, used = 0;
        if (!read_file(s, s->in, IN_ROOM, &got, err))
            return false;
        if (got == 0)
            return import_fail(err, SP_ERR_FORMAT, s->shown, s->at, "line skip",
                               "%" PRIu64 " lines are missing", lines);
        while (used < got && lines > 0)
            lines -= s->in[used++] == '\n';
        s->at -= got - used;
        if (lseek(s->fd, (off_t)s->at, SEEK_SET) < 0)
            return import_fail(err, SP_ERR_IO, s->shown, s->at, NULL, "cannot seek: %s",
                               strerror(errno));
    }
    return true;
}

/* The size of a gzip file only bounds the size of its content. */
static bool check_size(const struct import_samples *s, const struct stream *stream, uint64_t need,
                       struct sp_error *err) {
    uint64_t have = stream->size > stream->at ? stream->size - stream->at : 0;
    need += s->after_bytes;
    if (s->gzip) {
        if (have == 0 || (need + s->skip_bytes) / DEFLATE_RATIO_MAX > have)
            return import_fail(err, SP_ERR_FORMAT, stream->shown, stream->at, s->field,
                               "%" PRIu64 " bytes cannot come out of %" PRIu64
                               " bytes of gzip: the file is cut off or %s is wrong",
                               need + s->skip_bytes, have, s->field);
        return true;
    }
    uint64_t skip = s->from_end ? 0 : s->skip_bytes;
    if (have < skip || have - skip < need)
        return import_fail(err, SP_ERR_FORMAT, stream->shown, stream->at, s->field,
                           "the samples need %" PRIu64 " bytes, the file has %" PRIu64
                           ": it is cut off or %s is wrong",
                           need, have < skip ? 0 : have - skip, s->field);
    if (have - skip > need && !s->rest_ignored && !s->from_end)
        return import_fail(err, SP_ERR_FORMAT, stream->shown, stream->at + skip + need, s->field,
                           "the samples need %" PRIu64 " bytes, the file has %" PRIu64
                           " more: %s or the type is wrong",
                           need, have - skip - need, s->field);
    return true;
}

/* Seeks to the first sample of file i. */
static bool begin_piece(const struct import_samples *s, size_t i, uint64_t need,
                        struct stream *stream, struct sp_error *err) {
    if (!open_piece(s, i, stream, err))
        return false;
    bool ok = seek_to(stream, s->count == 0 ? s->start : 0, err) &&
              skip_lines(stream, s->skip_lines, err) && check_size(s, stream, need, err);
    if (ok && !s->gzip)
        ok = seek_to(
            stream, s->from_end ? stream->size - need - s->after_bytes : stream->at + s->skip_bytes,
            err);
    if (!ok)
        close_stream(stream);
    return ok;
}

bool import_samples_check(const struct import_samples *s, struct sp_error *err) {
    size_t pieces = s->count ? s->count : 1;
    struct stream *stream = malloc(sizeof *stream);
    if (!stream)
        return sp_fail(err, SP_ERR_MEMORY, s->file->shown, "out of memory");
    bool ok = true;
    for (size_t i = 0; ok && i < pieces; i++) {
        ok = begin_piece(s, i, s->bytes / pieces, stream, err);
        if (ok)
            close_stream(stream);
    }
    free(stream);
    return ok;
}

static bool skip_unpacked(struct stream *s, uint64_t bytes, void *scratch, struct sp_error *err) {
    while (bytes > 0) {
        size_t n = bytes < CHUNK ? (size_t)bytes : CHUNK, got;
        if (!read_stream(s, scratch, n, &got, err))
            return false;
        if (got < n)
            return import_fail(err, SP_ERR_FORMAT, s->shown, s->at, "byte skip",
                               "the unpacked data ends %" PRIu64 " bytes before the samples",
                               bytes - got);
        bytes -= n;
    }
    return true;
}

/* Checks that nothing is left. Reading to the end also verifies the checksum of gzip. */
static bool check_end(const struct import_samples *s, struct stream *stream, uint64_t need,
                      struct sp_error *err) {
    uint8_t extra;
    size_t got;
    if (!stream->gzip || s->rest_ignored || s->after_bytes > 0)
        return true;
    if (!read_stream(stream, &extra, 1, &got, err))
        return false;
    if (got > 0)
        return import_fail(err, SP_ERR_FORMAT, stream->shown, stream->at, s->field,
                           "the gzip data unpacks to more than the %" PRIu64
                           " bytes that %s declares; "
                           "stopped there",
                           need, s->field);
    return true;
}

struct reading {
    const struct import_samples *samples;
    char *voxels;
    struct import_vectors vectors; /* if the samples are vectors */
    const struct import_progress *progress;
    struct stream *stream;
    char *chunk; /* CHUNK bytes */
};

/* Bytes of the file that are read at once: whole samples. */
static size_t chunk_of(const struct import_samples *s) {
    const unsigned components = s->conversion ? s->conversion->components : 1;
    return CHUNK - CHUNK % (components * s->number.size);
}

/* Converts the numbers of whole samples, the first of which begins at byte `at`. Returns the bytes
 * of all samples so far in memory. */
static uint64_t convert(const struct reading *r, uint64_t at, const char *bytes, size_t n) {
    const struct import_conversion *c = r->samples->conversion;
    const size_t sample = c->components * c->number.size, size = sp_type_size(c->type);
    import_conversion_put(c, bytes, n / sample, r->voxels + at / sample * size);
    return (at + n) / sample * size;
}

/* Takes the n bytes that follow `at`, while they are in the cache. */
static void take_numbers(const struct reading *r, uint64_t at, char *bytes, size_t n) {
    const struct import_samples *s = r->samples;
    size_t size = s->number.size;
    uint64_t done = at + n;
    if (s->big_endian != (__BYTE_ORDER__ == __ORDER_BIG_ENDIAN__))
        import_swap_numbers(bytes, s->number, n / size);
    if (s->is_vectors) {
        import_vectors_put(&r->vectors, at / size, bytes, n / size);
        done = done / size * sizeof(float);
    } else if (s->conversion) {
        done = convert(r, at, bytes, n);
    }
    import_report(r->progress, done);
}

/* Reads file i, whose first byte is byte `begin` of the array. */
static bool read_piece(const struct reading *r, size_t i, uint64_t begin, uint64_t need,
                       struct sp_error *err) {
    const struct import_samples *s = r->samples;
    struct stream *stream = r->stream;
    if (!begin_piece(s, i, need, stream, err))
        return false;
    bool ok = true;
    if (s->gzip)
        ok = start_gzip(stream, err) && skip_unpacked(stream, s->skip_bytes, r->chunk, err);
    for (uint64_t at = 0; ok && at < need;) {
        size_t n = need - at < chunk_of(s) ? (size_t)(need - at) : chunk_of(s), got;
        const bool is_in_place = !s->is_vectors && !s->conversion;
        char *out = is_in_place ? r->voxels + begin + at : r->chunk;
        ok = is_in_place && !s->gzip ? read_sparse(stream, out, n, &got, err)
                                     : read_stream(stream, out, n, &got, err);
        if (ok && got < n)
            ok = import_fail(err, SP_ERR_FORMAT, stream->shown, stream->at, s->field,
                             "the samples need %" PRIu64 " bytes, the file has %" PRIu64
                             ": it is cut off or %s is wrong",
                             need, at + got, s->field);
        if (ok)
            take_numbers(r, begin + at, out, n);
        at += n;
    }
    ok = ok && check_end(s, stream, need, err);
    close_stream(stream);
    return ok;
}

bool import_samples_read(const struct import_samples *s, void *voxels, float (*vectors)[3],
                         const struct import_progress *progress, struct sp_error *err) {
    size_t pieces = s->count ? s->count : 1;
    uint64_t need = s->bytes / pieces;
    assert(need * pieces == s->bytes && need % s->number.size == 0);
    struct reading r = { .samples = s,
                         .voxels = voxels,
                         .vectors = { .number = s->number,
                                      .count = s->bytes / (3 * s->number.size),
                                      .planar = s->is_planar,
                                      .out = vectors },
                         .progress = progress,
                         .stream = malloc(sizeof *r.stream),
                         .chunk = malloc(CHUNK) };
    bool ok = (r.stream && r.chunk) ||
              sp_fail(err, SP_ERR_MEMORY, s->file->shown, "out of memory while reading samples");
    for (size_t i = 0; ok && i < pieces; i++)
        ok = read_piece(&r, i, i * need, need, err);
    free(r.stream);
    free(r.chunk);
    return ok;
}
