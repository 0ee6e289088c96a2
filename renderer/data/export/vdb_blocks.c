/* SPDX-License-Identifier: Apache-2.0 */
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/transfer.h"
#include "data/export/vdb.h"
#include "data/volume/volume.h"

enum { SLICES = 8 }; /* that are taken at once */

/* All columns of 128 rows of a few slices. */
struct strip {
    const struct sp_export_job *job;
    size_t sample;
    uint32_t first[2], size[2]; /* along axes 1 and 2 */
    char *samples;              /* [size[1]][size[0]][dims[0]] */
    char *piece;                /* of a block: [size[1]][128][128] */
};

static bool fail(const struct strip *s, const char *what, struct sp_error *err) {
    return sp_fail(err, SP_ERR_IO, s->job->title, "cannot %s: %s", what, strerror(errno));
}

static uint64_t slice_at(const struct strip *s, uint32_t z) {
    const uint32_t *dims = s->job->info->grid.dims;
    return ((uint64_t)(s->first[1] + z) * dims[1] + s->first[0]) * dims[0] * s->sample;
}

/* True if all samples lie in holes of the file: they are 0. */
static bool is_empty(const struct strip *s) {
    const size_t part = (size_t)s->size[0] * s->job->info->grid.dims[0] * s->sample;
    for (uint32_t z = 0; z < s->size[1]; z++)
        if (!sp_is_hole(s->job->samples, part, slice_at(s, z)))
            return false;
    return true;
}

static bool read_strip(const struct strip *s, struct sp_error *err) {
    const size_t part = (size_t)s->size[0] * s->job->info->grid.dims[0] * s->sample;
    for (uint32_t z = 0; z < s->size[1]; z++)
        if (!sp_read_sparse(s->job->samples, s->samples + z * part, part, slice_at(s, z)))
            return fail(s, "read the samples", err);
    return true;
}

/* Copies the part of the strip that lies in column x of blocks. Returns the copied bytes. */
static size_t copy_piece(const struct strip *s, uint32_t x) {
    const uint32_t *dims = s->job->info->grid.dims;
    const uint32_t left = dims[0] - x * VDB_BLOCK, width = left < VDB_BLOCK ? left : VDB_BLOCK;
    const size_t row = VDB_BLOCK * s->sample, bytes = s->size[1] * VDB_BLOCK * row;
    if (width < VDB_BLOCK || s->size[0] < VDB_BLOCK)
        memset(s->piece, 0, bytes);
    for (uint32_t z = 0; z < s->size[1]; z++)
        for (uint32_t y = 0; y < s->size[0]; y++)
            memcpy(s->piece + ((size_t)z * VDB_BLOCK + y) * row,
                   s->samples +
                       (((size_t)z * s->size[0] + y) * dims[0] + x * VDB_BLOCK) * s->sample,
                   width * s->sample);
    return bytes;
}

static bool write_strip(const struct sp_vdb_blocks *b, const struct strip *s,
                        struct sp_error *err) {
    const uint32_t y = s->first[0] / VDB_BLOCK, z = s->first[1] / VDB_BLOCK;
    for (uint32_t x = 0; x < b->count[0]; x++) {
        const size_t bytes = copy_piece(s, x);
        const uint64_t block = ((uint64_t)x * b->count[1] + y) * b->count[2] + z;
        const uint64_t slice = s->first[1] % VDB_BLOCK;
        if (s->piece[0] == 0 && memcmp(s->piece, s->piece + 1, bytes - 1) == 0)
            continue;
        b->is_used[block] = 1;
        if (!sp_write_sparse(b->file, s->piece, bytes,
                             block * b->bytes + slice * VDB_BLOCK * VDB_BLOCK * s->sample))
            return fail(s, "write", err);
    }
    return true;
}

static bool sort_samples(const struct sp_vdb_blocks *b, struct strip *s, double share,
                         struct sp_error *err) {
    const uint32_t *dims = s->job->info->grid.dims;
    for (s->first[1] = 0; s->first[1] < dims[2]; s->first[1] += SLICES)
        for (s->first[0] = 0; s->first[0] < dims[1]; s->first[0] += VDB_BLOCK) {
            static const uint32_t most[2] = { VDB_BLOCK, SLICES };
            for (int i = 0; i < 2; i++) {
                const uint32_t left = dims[i + 1] - s->first[i];
                s->size[i] = left < most[i] ? left : most[i];
            }
            const double done = (s->first[1] + (double)s->first[0] / dims[1]) / dims[2];
            if (!sp_export_report(s->job, share * done, err))
                return false;
            if (!is_empty(s) && !(read_strip(s, err) && write_strip(b, s, err)))
                return false;
        }
    return true;
}

bool sp_vdb_blocks_init(struct sp_vdb_blocks *b, const struct sp_export_job *job, double share,
                        struct sp_error *err) {
    const uint32_t *dims = job->info->grid.dims;
    struct strip s = { .job = job, .sample = sp_type_size(job->info->type) };
    uint64_t blocks = 1;
    *b = (struct sp_vdb_blocks){ .file = -1, .bytes = VDB_BLOCK_VOXELS * s.sample };
    for (int a = 0; a < 3; a++) {
        b->count[a] = (dims[a] + VDB_BLOCK - 1) / VDB_BLOCK;
        blocks *= b->count[a];
    }
    b->file = sp_temporary_file(job->folder, err);
    if (b->file < 0)
        return false;
    b->is_used = calloc(blocks, 1);
    s.samples = malloc((size_t)SLICES * VDB_BLOCK * dims[0] * s.sample);
    s.piece = malloc((size_t)SLICES * VDB_BLOCK * VDB_BLOCK * s.sample);
    bool ok = (b->is_used && s.samples && s.piece) ||
              sp_fail(err, SP_ERR_MEMORY, job->title, "out of memory for rows of blocks");
    if (ok && ftruncate(b->file, (off_t)(blocks * b->bytes)) != 0)
        ok = fail(&s, "write", err);
    ok = ok && sort_samples(b, &s, share, err);
    if (ok)
        b->is_used[0] = b->is_used[blocks - 1] = 1;
    for (uint64_t i = 0; ok && i < blocks; i++)
        b->used += b->is_used[i];
    free(s.samples);
    free(s.piece);
    return ok;
}

void sp_vdb_blocks_finish(struct sp_vdb_blocks *b) {
    free(b->is_used);
    if (b->file >= 0)
        close(b->file);
    *b = (struct sp_vdb_blocks){ .file = -1 };
}

bool sp_vdb_blocks_read(const struct sp_vdb_blocks *b, uint64_t block, void *samples) {
    return sp_read_sparse(b->file, samples, b->bytes, block * b->bytes);
}
