/* SPDX-License-Identifier: Apache-2.0
 *
 * PVM volumes of the V³ renderer (Röttger), plain or packed as "DDS": differences of bytes in runs
 * of one width. Only V³ itself reads the format, so the reader is our own.
 *
 *   file ─► unpack (DDS v3d, v3e) ─► "PVM", "PVM2", "PVM3" ─► samples
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/grow.h"
#include "data/import/samples.h"
#include "data/volume/volume.h"

enum {
    MAGIC = 8,            /* bytes of "DDS v3d\n" */
    INTERLEAVE = 1 << 24, /* v3e: samples whose bytes are stored apart */
    HEADER_MAX = 512      /* of a PVM */
};

/* A run of 127 equal bytes takes 10 bits. */
#define RATIO_MAX 102

struct pvm {
    uint8_t *bytes; /* owned; the whole unpacked file */
    size_t size;
    size_t start, count, sample; /* where the samples begin, how many, bytes of each */
};

static bool probe(const uint8_t *start, size_t size, const char *title) {
    if (import_ends_with(title, ".pvm"))
        return true;
    return size >= MAGIC &&
           (memcmp(start, "DDS v3d\n", MAGIC) == 0 || memcmp(start, "DDS v3e\n", MAGIC) == 0 ||
            memcmp(start, "PVM\n", 4) == 0 || memcmp(start, "PVM2\n", 5) == 0 ||
            memcmp(start, "PVM3\n", 5) == 0);
}

/* DDS. */

struct bits { /* most significant bit first */
    const uint8_t *bytes;
    uint64_t at, end; /* bits */
};

/* Beyond the end there are zeros, which end the data. */
static unsigned read_bits(struct bits *b, unsigned count) {
    unsigned value = 0;
    for (unsigned i = 0; i < count; i++, b->at++)
        value = value << 1 | (b->at < b->end ? b->bytes[b->at / 8] >> (7 - b->at % 8) & 1u : 0);
    return value;
}

struct output {
    uint8_t *bytes;
    size_t size, limit;
};

static bool put_byte(struct output *o, uint8_t byte) {
    if (o->size >= o->limit || !sp_grow(&o->bytes, o->size, 1))
        return false;
    o->bytes[o->size++] = byte;
    return true;
}

/* A byte is the one before it, plus how much the bytes of the row above rise there, plus a
 * difference. Rows have `strip` bytes. */
static bool unpack_bytes(struct bits *b, size_t strip, struct output *o) {
    uint8_t last = 0;
    for (unsigned run; (run = read_bits(b, 7)) != 0;) {
        const unsigned code = read_bits(b, 3), width = code > 0 ? code + 1 : 0;
        for (; run > 0; run--) {
            int step = (int)read_bits(b, width) - (width ? 1 << (width - 1) : 0);
            if (strip > 1 && o->size > strip)
                step += o->bytes[o->size - strip] - o->bytes[o->size - strip - 1];
            last = (uint8_t)(last + step);
            if (!put_byte(o, last))
                return false;
        }
    }
    return true;
}

/* The bytes of a block are stored apart: first all first bytes of its samples, and so on. */
static bool join(struct output *o, size_t skip, size_t block) {
    uint8_t *joined = skip > 1 ? malloc(o->size ? o->size : 1) : NULL;
    if (skip <= 1)
        return true;
    if (!joined)
        return false;
    for (size_t begin = 0, at = 0; begin < o->size; begin += block) {
        const size_t end = o->size - begin < block ? o->size : begin + block;
        for (size_t first = begin; first < begin + skip; first++)
            for (size_t i = first; i < end; i += skip)
                joined[i] = o->bytes[at++];
    }
    free(o->bytes);
    o->bytes = joined;
    return true;
}

/* Replaces *pvm by what it unpacks to. */
static bool unpack(const struct import_file *file, struct pvm *pvm, struct sp_error *err) {
    struct bits bits = { pvm->bytes, 8 * MAGIC, 8 * (uint64_t)pvm->size };
    struct output out = { .limit = RATIO_MAX * pvm->size + RATIO_MAX };
    const bool is_interleaved = pvm->bytes[6] == 'e';
    const size_t skip = read_bits(&bits, 2) + 1, strip = read_bits(&bits, 16) + 1;
    const bool ok = unpack_bytes(&bits, strip, &out) &&
                    join(&out, skip, is_interleaved ? skip * INTERLEAVE : SIZE_MAX - skip);
    free(pvm->bytes);
    pvm->bytes = out.bytes;
    pvm->size = out.size;
    return ok || sp_fail(err, SP_ERR_MEMORY, file->title, "out of memory while unpacking DDS");
}

/* PVM. */

static bool read_file(const struct import_file *file, struct pvm *pvm, struct sp_error *err) {
    pvm->size = (size_t)file->size;
    pvm->bytes = malloc(pvm->size + 1);
    if (!pvm->bytes)
        return sp_fail(err, SP_ERR_MEMORY, file->title, "out of memory for %" PRIu64 " bytes",
                       file->size);
    size_t got;
    return import_read(file, pvm->bytes, pvm->size, 0, &got, err) &&
           (got == pvm->size || import_fail(err, SP_ERR_IO, file->title, got, NULL,
                                            "cannot read the file: the file became shorter"));
}

/* Numbers on the lines before the samples. */
static bool read_header(const struct import_file *file, struct pvm *pvm,
                        struct import_header *header, struct sp_error *err) {
    char text[HEADER_MAX + 1];
    const size_t n = pvm->size < HEADER_MAX ? pvm->size : HEADER_MAX;
    unsigned dims[3], sample;
    double spacing[3] = { 1, 1, 1 };
    int used = 0;
    if (n > 0) /* nothing may have come out of DDS */
        memcpy(text, pvm->bytes, n);
    text[n] = 0;
    const bool has_spacing = n > 4 && text[3] != '\n'; /* PVM2 and PVM3 */
    const bool ok =
        has_spacing ? sscanf(text, "PVM%*1[23]%9u %9u %9u %lf %lf %lf %9u%n", &dims[0], &dims[1],
                             &dims[2], &spacing[0], &spacing[1], &spacing[2], &sample, &used) == 7
                    : sscanf(text, "PVM%9u %9u %9u %9u%n", &dims[0], &dims[1], &dims[2], &sample,
                             &used) == 4;
    if (!ok || text[used] != '\n')
        return import_fail(err, SP_ERR_FORMAT, file->title, 0, "header",
                           "this is no PVM volume: three dimensions, their spacings and the bytes "
                           "of a sample must follow PVM, PVM2 or PVM3");
    if (sample < 1 || sample > 2)
        return import_fail(err, SP_ERR_UNSUPPORTED, file->title, 0, "components",
                           "samples of %u bytes are not supported; supported are 1 and 2", sample);
    for (int axis = 0; axis < 3; axis++) {
        header->grid.dims[axis] = dims[axis];
        header->grid.spacing[axis] = spacing[axis];
    }
    header->type = sample == 2 ? SP_UINT16 : SP_UINT8;
    pvm->start = (size_t)used + 1;
    pvm->sample = sample;
    return sp_grid_check(&header->grid, header->type, file->title, &header->bytes, err);
}

static bool open_pvm(void *reader, const struct import_file *file, struct import_header *header,
                     struct sp_error *err) {
    struct pvm *pvm = reader;
    if (!read_file(file, pvm, err))
        return false;
    if (pvm->size >= MAGIC && memcmp(pvm->bytes, "DDS v3", 6) == 0 && !unpack(file, pvm, err))
        return false;
    if (!read_header(file, pvm, header, err))
        return false;
    pvm->count = (size_t)header->bytes / pvm->sample;
    return pvm->size - pvm->start >= header->bytes ||
           import_fail(err, SP_ERR_FORMAT, file->title, pvm->start, "dimensions",
                       "the samples need %" PRIu64 " bytes, the file has %zu: it is cut off",
                       header->bytes, pvm->size - pvm->start);
}

static void close_pvm(void *reader) {
    struct pvm *pvm = reader;
    free(pvm->bytes);
}

/* Samples of two bytes are big-endian. */
static bool read_pvm(void *reader, void *voxels, float (*vectors)[3],
                     const struct import_progress *progress, struct sp_error *err) {
    const struct pvm *pvm = reader;
    (void)vectors;
    (void)err;
    memcpy(voxels, pvm->bytes + pvm->start, pvm->count * pvm->sample);
    if (__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__)
        import_swap(voxels, pvm->sample, pvm->count);
    import_report(progress, pvm->count * pvm->sample);
    return true;
}

const struct import_format import_pvm = { .name = "PVM",
                                          .probe = probe,
                                          .reader_size = sizeof(struct pvm),
                                          .open = open_pvm,
                                          .read = read_pvm,
                                          .close = close_pvm };
