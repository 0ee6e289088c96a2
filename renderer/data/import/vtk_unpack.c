/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/vtk_unpack.h"

#include <inttypes.h>
#include <lz4.h>
#include <lzma.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include "data/import/samples.h"

#define BLOCKS_MAX (UINT64_C(1) << 24)
#define BLOCK_MAX (UINT64_C(1) << 30)     /* bytes, unpacked */
#define LZ4_BLOCK_MAX (UINT64_C(1) << 27) /* the same; LZ4 needs a whole block in memory */
#define LZMA_MEMORY (UINT64_C(1) << 28)   /* bytes for the dictionary */

struct blocks {
    uint64_t count, size, last; /* unpacked bytes of each block and of the last block */
};

/* A method of compression. */
struct method {
    const char *name;
    uint64_t ratio_max; /* unpacked bytes per packed byte, at most */
    bool (*init)(struct vtk_unpacker *u);
    /* Begins a block; the packed bytes of the last one are used up. */
    bool (*begin)(struct vtk_unpacker *u, struct sp_error *err);
    /* Unpacks n more bytes of the block; the last ones must also end it. */
    bool (*part)(struct vtk_unpacker *u, void *out, size_t n, struct sp_error *err);
    void (*finish)(struct vtk_unpacker *u);
};

struct vtk_unpacker {
    struct vtk_source *source;
    const struct method *method;
    struct blocks blocks;
    uint64_t *sizes;       /* packed bytes of each block; owned */
    uint64_t next;         /* block */
    uint64_t packed, left; /* of the current block: bytes to read, bytes to unpack */
    z_stream z;
    lzma_stream lzma;
    char *whole, *unpacked; /* of LZ4: the packed and the unpacked block; owned */
    size_t whole_bytes, at; /* size of `whole`; what was taken of `unpacked` */
    uint8_t in[VTK_CHUNK];
};

static bool fail(const struct vtk_unpacker *u, const char *what, struct sp_error *err) {
    const struct vtk_source *s = u->source;
    return import_fail(err, SP_ERR_FORMAT, s->file->title, s->at, s->array->name,
                       "a block of %s data is %s", u->method->name, what);
}

static bool fail_memory(const struct vtk_unpacker *u, struct sp_error *err) {
    return sp_fail(err, SP_ERR_MEMORY, u->source->file->title, "out of memory while unpacking %s",
                   u->method->name);
}

/* Reads more of the block's packed bytes into `in`; *n = 0 at its end. */
static bool pull_more(struct vtk_unpacker *u, size_t *n, struct sp_error *err) {
    *n = u->packed < VTK_CHUNK ? (size_t)u->packed : VTK_CHUNK;
    u->packed -= *n;
    return vtk_source_pull(u->source, u->in, *n, err);
}

/* zlib. */

static bool zlib_init(struct vtk_unpacker *u) {
    return inflateInit(&u->z) == Z_OK;
}

static bool zlib_begin(struct vtk_unpacker *u, struct sp_error *err) {
    (void)err;
    inflateReset(&u->z);
    u->z.avail_in = 0;
    return true;
}

static bool zlib_check(const struct vtk_unpacker *u, int status, struct sp_error *err) {
    const struct vtk_source *s = u->source;
    if (status == Z_MEM_ERROR)
        return fail_memory(u, err);
    if (status == Z_BUF_ERROR)
        return fail(u, u->z.avail_in ? "larger than declared" : "cut off", err);
    return status == Z_OK || status == Z_STREAM_END ||
           import_fail(err, SP_ERR_FORMAT, s->file->title, s->at, s->array->name,
                       "the zlib data is damaged%s%s", u->z.msg ? ": " : "",
                       u->z.msg ? u->z.msg : "");
}

static bool zlib_part(struct vtk_unpacker *u, void *out, size_t n, struct sp_error *err) {
    const bool is_last = n == u->left;
    int status = Z_OK;
    u->z.next_out = out;
    u->z.avail_out = (unsigned)n;
    while (status != Z_STREAM_END && (is_last || u->z.avail_out > 0)) {
        if (u->z.avail_in == 0 && u->packed > 0) {
            size_t more;
            if (!pull_more(u, &more, err))
                return false;
            u->z.next_in = u->in;
            u->z.avail_in = (unsigned)more;
        }
        status = inflate(&u->z, Z_NO_FLUSH);
        if (!zlib_check(u, status, err))
            return false;
    }
    return (!u->z.avail_out && !(is_last && (u->z.avail_in || u->packed))) ||
           fail(u, "shorter than declared", err);
}

static void zlib_finish(struct vtk_unpacker *u) {
    inflateEnd(&u->z);
}

/* LZMA, each block a stream as in .xz files. */

static bool xz_init(struct vtk_unpacker *u) {
    u->lzma = (lzma_stream)LZMA_STREAM_INIT;
    return true;
}

static bool xz_begin(struct vtk_unpacker *u, struct sp_error *err) {
    u->lzma.avail_in = 0;
    return lzma_stream_decoder(&u->lzma, LZMA_MEMORY, 0) == LZMA_OK || fail_memory(u, err);
}

static bool xz_check(const struct vtk_unpacker *u, lzma_ret status, struct sp_error *err) {
    if (status == LZMA_OK || status == LZMA_STREAM_END)
        return true;
    if (status == LZMA_MEM_ERROR || status == LZMA_MEMLIMIT_ERROR)
        return fail_memory(u, err);
    return fail(u,
                status != LZMA_BUF_ERROR ? "damaged"
                : u->lzma.avail_in       ? "larger than declared"
                                         : "cut off",
                err);
}

static bool xz_part(struct vtk_unpacker *u, void *out, size_t n, struct sp_error *err) {
    const bool is_last = n == u->left;
    lzma_ret status = LZMA_OK;
    u->lzma.next_out = out;
    u->lzma.avail_out = n;
    while (status != LZMA_STREAM_END && (is_last || u->lzma.avail_out > 0)) {
        if (u->lzma.avail_in == 0 && u->packed > 0) {
            if (!pull_more(u, &u->lzma.avail_in, err))
                return false;
            u->lzma.next_in = u->in;
        }
        status = lzma_code(&u->lzma, LZMA_RUN);
        if (!xz_check(u, status, err))
            return false;
    }
    return (!u->lzma.avail_out && !(is_last && (u->lzma.avail_in || u->packed))) ||
           fail(u, "shorter than declared", err);
}

static void xz_finish(struct vtk_unpacker *u) {
    lzma_end(&u->lzma);
}

/* LZ4, each block without a frame. */

static bool lz4_init(struct vtk_unpacker *u) {
    u->unpacked = malloc((size_t)u->blocks.size + 1);
    return u->unpacked != NULL;
}

static bool lz4_begin(struct vtk_unpacker *u, struct sp_error *err) {
    if (u->packed > (uint64_t)LZ4_compressBound((int)u->left))
        return fail(u, "longer than LZ4 makes it", err);
    if (u->packed > u->whole_bytes) {
        free(u->whole);
        u->whole_bytes = (size_t)u->packed;
        u->whole = malloc(u->whole_bytes);
    }
    if (!u->whole)
        return fail_memory(u, err);
    if (!vtk_source_pull(u->source, u->whole, (size_t)u->packed, err))
        return false;
    const int got = LZ4_decompress_safe(u->whole, u->unpacked, (int)u->packed, (int)u->left);
    u->at = 0;
    if (got < 0)
        return fail(u, "damaged or larger than declared", err);
    return (uint64_t)got == u->left || fail(u, "shorter than declared", err);
}

static bool lz4_part(struct vtk_unpacker *u, void *out, size_t n, struct sp_error *err) {
    (void)err;
    memcpy(out, u->unpacked + u->at, n);
    u->at += n;
    return true;
}

static void lz4_finish(struct vtk_unpacker *u) {
    free(u->whole);
    free(u->unpacked);
}

/* The limits of the ratio: LZ4 has one byte per 255; a match of LZMA, 273 bytes, costs some bits.
 */
static const struct method methods[] = {
    [VTK_ZLIB] = { "zlib", DEFLATE_RATIO_MAX, zlib_init, zlib_begin, zlib_part, zlib_finish },
    [VTK_LZ4] = { "LZ4", 256, lz4_init, lz4_begin, lz4_part, lz4_finish },
    [VTK_LZMA] = { "LZMA", 1 << 16, xz_init, xz_begin, xz_part, xz_finish },
};

static bool pull_blocks(struct vtk_source *s, uint64_t need, struct blocks *b,
                        struct sp_error *err) {
    if (!vtk_source_pull_length(s, &b->count, err) || !vtk_source_pull_length(s, &b->size, err) ||
        !vtk_source_pull_length(s, &b->last, err))
        return false;
    if (b->last == 0)
        b->last = b->size;
    if (b->count > BLOCKS_MAX || b->size > BLOCK_MAX || b->last > b->size ||
        (b->count ? (b->count - 1) * b->size + b->last : 0) != need)
        return import_fail(err, SP_ERR_FORMAT, s->file->title, s->array->begin, s->array->name,
                           "%" PRIu64 " blocks of %" PRIu64 " bytes, the last of %" PRIu64
                           ", are not the %" PRIu64 " bytes of the values",
                           b->count, b->size, b->last, need);
    return s->array->packing != VTK_LZ4 || b->size <= LZ4_BLOCK_MAX ||
           import_fail(err, SP_ERR_UNSUPPORTED, s->file->title, s->array->begin, s->array->name,
                       "blocks of %" PRIu64 " bytes are larger than the %" PRIu64
                       " that LZ4 data may have; write the file with smaller blocks",
                       b->size, LZ4_BLOCK_MAX);
}

bool vtk_unpack_check(struct vtk_source *s, uint64_t need, uint64_t *least, struct sp_error *err) {
    struct blocks b;
    if (!pull_blocks(s, need, &b, err))
        return false;
    *least = (3 + b.count) * s->array->length_size + need / methods[s->array->packing].ratio_max;
    return true;
}

struct vtk_unpacker *vtk_unpack_open(struct vtk_source *s, uint64_t need, struct sp_error *err) {
    struct blocks b;
    if (!pull_blocks(s, need, &b, err))
        return NULL;
    struct vtk_unpacker *u = calloc(1, sizeof *u);
    if (u) {
        u->source = s;
        u->blocks = b;
        u->method = &methods[s->array->packing];
        u->sizes = malloc((b.count + 1) * sizeof *u->sizes);
    }
    bool ok = u && u->sizes && u->method->init(u);
    if (!ok)
        sp_fail(err, SP_ERR_MEMORY, s->file->title, "out of memory for %" PRIu64 " packed blocks",
                b.count);
    for (uint64_t i = 0; ok && i < b.count; i++)
        ok = vtk_source_pull_length(s, &u->sizes[i], err);
    if (ok)
        return u;
    vtk_unpack_close(u);
    return NULL;
}

bool vtk_unpack(struct vtk_unpacker *u, char *out, size_t n, struct sp_error *err) {
    while (n > 0) {
        if (u->left == 0) {
            u->packed = u->sizes[u->next++];
            u->left = u->next < u->blocks.count ? u->blocks.size : u->blocks.last;
            if (!u->method->begin(u, err))
                return false;
        }
        const size_t part = n < u->left ? n : (size_t)u->left;
        if (!u->method->part(u, out, part, err))
            return false;
        u->left -= part;
        out += part;
        n -= part;
    }
    return true;
}

void vtk_unpack_close(struct vtk_unpacker *u) {
    if (!u)
        return;
    u->method->finish(u);
    free(u->sizes);
    free(u);
}
