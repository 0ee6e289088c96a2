/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/samples.h"

#include <assert.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/grow.h"
#include "data/import/confine.h"
#include "data/import/vectors.h"
#include "data/volume/volume.h"

void import_samples_finish(struct import_samples *samples) {
    for (size_t i = 0; i < samples->count; i++)
        free(samples->names[i]);
    free(samples->names);
    samples->names = NULL;
    samples->count = 0;
}

bool import_samples_add(struct import_samples *samples, const char *name, size_t length) {
    if (!sp_grow(&samples->names, samples->count, sizeof *samples->names))
        return false;
    char *copy = strndup(name, length);
    if (copy)
        samples->names[samples->count++] = copy;
    return copy != NULL;
}

/* Keeps `count` names from `first` on. */
static void keep_names(struct import_samples *s, size_t first, size_t count) {
    for (size_t i = 0; i < s->count; i++)
        if (i < first || i >= first + count)
            free(s->names[i]);
    memmove(s->names, s->names + first, count * sizeof *s->names);
    s->count = count;
}

bool import_samples_choose_block(struct import_samples *s, uint64_t blocks, uint64_t block) {
    uint64_t all;
    assert(block < blocks);
    if (__builtin_mul_overflow(s->bytes, blocks, &all))
        return false;
    if (s->count > 1) {
        const uint64_t piece = all / s->count;
        if (all % s->count != 0 || (s->bytes % piece != 0 && piece % s->bytes != 0))
            return false;
        if (s->bytes % piece == 0) { /* a block has whole files */
            const size_t files = (size_t)(s->bytes / piece);
            keep_names(s, (size_t)block * files, files);
            return true;
        }
        keep_names(s, (size_t)(block / (piece / s->bytes)), 1);
        blocks = piece / s->bytes;
        block %= blocks;
    }
    s->before_bytes = block * s->bytes;
    s->after_bytes = (blocks - block - 1) * s->bytes;
    return true;
}

/* Bytes of all components of a sample in the file. */
static size_t sample_size(const struct import_samples *s) {
    return (s->conversion ? s->conversion->components : 1) * s->number.size;
}

/* One data file. */

static bool open_piece(const struct import_samples *s, size_t i, struct import_stream *stream,
                       struct sp_error *err) {
    uint64_t size = s->file->size;
    int fd = s->file->fd;
    if (s->count == 0) {
        import_stream_open(stream, fd, false, s->file->title, size);
        return true;
    }
    const char *name = s->names[i];
    char path[2 * PATH_MAX], real[PATH_MAX];
    int n = snprintf(path, sizeof path, "%s/%s", name[0] == '/' ? "" : s->file->folder, name);
    if (n >= PATH_MAX)
        return sp_fail(err, SP_ERR_INVALID, s->file->title,
                       "the name of data file %zu and its folder are longer than a path may be", i);
    fd = sp_open_confined(s->file->root, path, name, real, &size, err);
    if (fd >= 0)
        import_stream_open(stream, fd, true, name, size);
    else
        sp_tell_namer(err, s->file->title);
    return fd >= 0;
}

/* Bytes that are skipped in the file itself, before it is decoded. */
static uint64_t plain_skip(const struct import_samples *s) {
    const bool is_packed = s->encoding == IMPORT_GZIP || s->encoding == IMPORT_BZIP2;
    return is_packed || s->from_end ? 0 : s->skip_bytes;
}

/* Bytes that are decoded and dropped; 0 for raw samples, which are skipped in the file. */
static uint64_t decoded_skip(const struct import_samples *s) {
    return s->encoding == IMPORT_RAW ? 0 : s->skip_bytes - plain_skip(s) + s->before_bytes;
}

static void warn_of_rest(const struct import_samples *s, const char *title, const char *bytes) {
    import_warn(s->file->warnings,
                "%.80s has %s after the samples that the header declares. They were not read: "
                "%s or the type may be wrong.",
                title, bytes, s->field);
}

static bool check_raw_size(const struct import_samples *s, const struct import_stream *stream,
                           uint64_t need, uint64_t have, struct sp_error *err) {
    if (have < need)
        return import_fail(err, SP_ERR_FORMAT, stream->title, stream->at, s->field,
                           "the samples need %" PRIu64 " bytes, the file has %" PRIu64
                           ": it is cut off or %s is wrong",
                           need, have, s->field);
    if (have == need || s->from_end || s->rest == IMPORT_REST_IGNORED)
        return true;
    if (s->rest == IMPORT_REST_REFUSED)
        return import_fail(err, SP_ERR_FORMAT, stream->title, stream->at + plain_skip(s) + need,
                           s->field,
                           "the samples need %" PRIu64 " bytes, the file has %" PRIu64
                           " more: %s or the type is wrong",
                           need, have - need, s->field);
    char bytes[40];
    snprintf(bytes, sizeof bytes, "%" PRIu64 " bytes", have - need);
    warn_of_rest(s, stream->title, bytes);
    return true;
}

/* The size of an encoded file only bounds the size of its content. */
static bool check_size(const struct import_samples *s, const struct import_stream *stream,
                       uint64_t need, struct sp_error *err) {
    const uint64_t left = stream->size > stream->at ? stream->size - stream->at : 0;
    const uint64_t skip = plain_skip(s), have = left > skip ? left - skip : 0;
    if (s->encoding == IMPORT_RAW)
        return check_raw_size(s, stream, s->before_bytes + need + s->after_bytes, have, err);
    const uint64_t all = decoded_skip(s) + need + s->after_bytes;
    return import_stream_may_hold(s->encoding, s->number, have, all) ||
           import_fail(err, SP_ERR_FORMAT, stream->title, stream->at, s->field,
                       "%" PRIu64 " bytes cannot come out of %" PRIu64
                       " bytes of %s: the file is cut off or %s is wrong",
                       all, have, import_encoding_name(s->encoding), s->field);
}

/* Seeks to the first sample of file i, or to the first byte of its encoding. */
static bool begin_piece(const struct import_samples *s, size_t i, uint64_t need,
                        struct import_stream *stream, struct sp_error *err) {
    if (!open_piece(s, i, stream, err))
        return false;
    bool ok = import_stream_seek(stream, s->count == 0 ? s->start : 0, err) &&
              import_stream_skip_lines(stream, s->skip_lines, err) &&
              check_size(s, stream, need, err);
    if (ok) {
        const uint64_t raw_skip = s->encoding == IMPORT_RAW ? s->before_bytes : 0;
        ok = import_stream_seek(stream,
                                s->from_end ? stream->size - need - s->after_bytes
                                            : stream->at + plain_skip(s) + raw_skip,
                                err);
    }
    if (!ok)
        import_stream_close(stream);
    return ok;
}

bool import_samples_check(const struct import_samples *s, struct sp_error *err) {
    size_t pieces = s->count ? s->count : 1;
    if (sample_size(s) > IMPORT_STREAM_CHUNK)
        return sp_fail(err, SP_ERR_UNSUPPORTED, s->file->title,
                       "a sample and its components have %zu bytes, more than %d", sample_size(s),
                       IMPORT_STREAM_CHUNK);
    if (s->bytes % pieces != 0 || s->bytes / pieces % sample_size(s) != 0)
        return sp_fail(err, SP_ERR_UNSUPPORTED, s->file->title,
                       "each of the %zu data files holds %" PRIu64
                       " bytes, but a sample and its components have %zu; write whole samples into "
                       "each file",
                       pieces, s->bytes / pieces, sample_size(s));
    struct import_stream *stream = malloc(sizeof *stream);
    if (!stream)
        return sp_fail(err, SP_ERR_MEMORY, s->file->title, "out of memory");
    bool ok = true;
    for (size_t i = 0; ok && i < pieces; i++) {
        ok = begin_piece(s, i, s->bytes / pieces, stream, err);
        if (ok)
            import_stream_close(stream);
    }
    free(stream);
    return ok;
}

static bool skip_decoded(const struct import_samples *s, struct import_stream *stream,
                         void *scratch, struct sp_error *err) {
    uint64_t bytes = decoded_skip(s);
    while (bytes > 0) {
        size_t n = bytes < IMPORT_STREAM_CHUNK ? (size_t)bytes : IMPORT_STREAM_CHUNK, got;
        if (!import_stream_read(stream, scratch, n, &got, err))
            return false;
        if (got < n)
            return import_fail(err, SP_ERR_FORMAT, stream->title, stream->at,
                               s->before_bytes ? s->field : "byte skip",
                               "the unpacked data ends %" PRIu64 " bytes before the samples",
                               bytes - got);
        bytes -= n;
    }
    return true;
}

static bool fail_short(const struct import_samples *s, const struct import_stream *stream,
                       uint64_t need, uint64_t have, struct sp_error *err) {
    return import_fail(err, SP_ERR_FORMAT, stream->title, stream->at, s->field,
                       "the samples need %" PRIu64 " bytes, the file has %" PRIu64
                       ": it is cut off or %s is wrong",
                       need, have, s->field);
}

/* Decodes what follows the samples. Packed data has its checksum at the end, so damage is found
 * whichever part is read. *rest gets the decoded bytes after the samples; it stops counting where
 * their number is known to be too large. */
static bool read_rest(const struct import_samples *s, struct import_stream *stream, char *scratch,
                      uint64_t *rest, struct sp_error *err) {
    const size_t number = import_number_part(s->number).size;
    const bool is_packed = s->encoding == IMPORT_GZIP || s->encoding == IMPORT_BZIP2;
    const uint64_t more = is_packed && s->rest != IMPORT_REST_REFUSED ? UINT64_MAX - s->after_bytes
                          : is_packed || s->rest != IMPORT_REST_IGNORED ? number
                                                                        : 0;
    const uint64_t limit = s->after_bytes + more;
    const size_t chunk = IMPORT_STREAM_CHUNK - IMPORT_STREAM_CHUNK % number;
    size_t got = 1;
    for (*rest = 0; got > 0 && *rest < limit; *rest += got) {
        const size_t n = limit - *rest < chunk ? (size_t)(limit - *rest) : chunk;
        if (!import_stream_read(stream, scratch, n, &got, err))
            return false;
    }
    return true;
}

/* Checks that as much follows the samples as the header says. */
static bool check_end(const struct import_samples *s, struct import_stream *stream, char *scratch,
                      uint64_t need, struct sp_error *err) {
    uint64_t rest;
    if (s->encoding == IMPORT_RAW)
        return true; /* check_raw_size() has compared the sizes */
    if (!read_rest(s, stream, scratch, &rest, err))
        return false;
    const uint64_t declared = s->before_bytes + need + s->after_bytes;
    if (rest < s->after_bytes)
        return fail_short(s, stream, declared, s->before_bytes + need + rest, err);
    if (rest > s->after_bytes && s->rest == IMPORT_REST_REFUSED)
        return import_fail(err, SP_ERR_FORMAT, stream->title, stream->at, s->field,
                           "the %s data unpacks to more than the %" PRIu64
                           " bytes that %s declares; stopped there",
                           import_encoding_name(s->encoding), declared, s->field);
    if (rest > s->after_bytes && s->rest == IMPORT_REST_WARNED)
        warn_of_rest(s, stream->title, "more data");
    if (stream->has_garbage)
        import_warn(s->file->warnings,
                    "%.80s has other bytes after its gzip data. They were not read; the data "
                    "itself is sound.",
                    stream->title);
    return true;
}

struct reading {
    const struct import_samples *samples;
    char *voxels;
    struct import_vectors vectors; /* if the samples are vectors */
    const struct import_progress *progress;
    struct import_stream *stream;
    char *chunk; /* IMPORT_STREAM_CHUNK bytes */
};

/* Decoded bytes that are read at once: whole samples. */
static size_t chunk_of(const struct import_samples *s) {
    return IMPORT_STREAM_CHUNK - IMPORT_STREAM_CHUNK % sample_size(s);
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
static void convert_numbers(const struct reading *r, uint64_t at, char *bytes, size_t n) {
    const struct import_samples *s = r->samples;
    size_t size = s->number.size;
    uint64_t done = at + n;
    if (s->encoding != IMPORT_TEXT && s->big_endian != (__BYTE_ORDER__ == __ORDER_BIG_ENDIAN__))
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
    struct import_stream *stream = r->stream;
    if (!begin_piece(s, i, need, stream, err))
        return false;
    bool ok = import_stream_begin(stream, s->encoding, s->number, err) &&
              skip_decoded(s, stream, r->chunk, err);
    for (uint64_t at = 0; ok && at < need;) {
        size_t n = need - at < chunk_of(s) ? (size_t)(need - at) : chunk_of(s), got;
        const bool is_in_place = !s->is_vectors && !s->conversion;
        char *out = is_in_place ? r->voxels + begin + at : r->chunk;
        ok = is_in_place && s->encoding == IMPORT_RAW
                 ? import_stream_read_sparse(stream, out, n, &got, err)
                 : import_stream_read(stream, out, n, &got, err);
        if (ok && got < n)
            ok = fail_short(s, stream, need, at + got, err);
        if (ok)
            convert_numbers(r, begin + at, out, n);
        at += n;
    }
    ok = ok && check_end(s, stream, r->chunk, need, err);
    import_stream_close(stream);
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
                                      .scale = s->is_vectors ? s->conversion : NULL,
                                      .out = vectors },
                         .progress = progress,
                         .stream = malloc(sizeof *r.stream),
                         .chunk = malloc(IMPORT_STREAM_CHUNK) };
    bool ok = (r.stream && r.chunk) ||
              sp_fail(err, SP_ERR_MEMORY, s->file->title, "out of memory while reading samples");
    for (size_t i = 0; ok && i < pieces; i++)
        ok = read_piece(&r, i, i * need, need, err);
    free(r.stream);
    free(r.chunk);
    return ok;
}

bool import_sampled_use(struct import_sampled *reader, const struct import_file *file,
                        uint64_t skip, bool is_packed, struct import_header *header,
                        struct sp_error *err) {
    struct import_samples *s = &reader->samples;
    const struct import_conversion *c = &reader->conversion;
    header->type = c->type;
    if (!sp_grid_check(&header->grid, c->type, file->title, &header->bytes, err))
        return false;
    s->file = file;
    s->encoding = is_packed ? IMPORT_GZIP : IMPORT_RAW;
    s->skip_bytes = skip;
    s->conversion = import_conversion_is_copy(c) ? NULL : c;
    s->bytes = header->bytes / sp_type_size(c->type) * c->components * s->number.size;
    return import_samples_choose_block(s, header->steps.count, file->step) &&
           import_samples_check(s, err);
}

bool import_sampled_read(void *reader, void *voxels, float (*vectors)[3],
                         const struct import_progress *progress, struct sp_error *err) {
    const struct import_sampled *r = reader;
    return import_samples_read(&r->samples, voxels, vectors, progress, err);
}

void import_sampled_close(void *reader) {
    struct import_sampled *r = reader;
    import_samples_finish(&r->samples);
}
