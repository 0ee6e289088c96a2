/* SPDX-License-Identifier: Apache-2.0
 *
 * OpenVDB, version 224: one grid of float, a fog volume with background 0. Active are all voxels
 * other than 0, and the first and the last one, so that the box of active voxels is the box of the
 * volume. The tree is that of OpenVDB's FloatGrid:
 *
 *   root ─► inner nodes of 4096³ ─► inner nodes of 128³ (blocks) ─► leaves of 8³ voxels
 *
 * In nodes axis 2 is fastest. A file has the masks of all nodes first, depth first, then the values
 * of all leaves in the same order: two passes over the blocks. Numbers are packed by zlib, node by
 * node, and leaves have those of active voxels only. As OpenVDB, this writes the byte order of the
 * machine. The library itself is not used, because it holds a whole grid in memory.
 */
#include "data/export/vdb.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <unistd.h>
#include <zlib.h>

#include "base/parallel_for.h"
#include "base/transfer.h"
#include "data/volume/sample.h"
#include "data/volume/volume.h"
#include "sp/log.h"

enum {
    THREADS_MAX = 16,
    FILE_VERSION = 224,
    LIBRARY_MAJOR = 10, /* of the library that writes such files */
    ZIP = 1,
    ACTIVE_VALUES = 2,             /* compression: a node has the values of active voxels only */
    LEAVES = VDB_BLOCK / VDB_LEAF, /* of a block, per axis */
    BLOCK_LEAVES = LEAVES * LEAVES * LEAVES,
    ROOT_BLOCKS = VDB_ROOT / VDB_BLOCK, /* of a child of the root, per axis */
    ROOT_CHILDREN = ROOT_BLOCKS * ROOT_BLOCKS * ROOT_BLOCKS,
    WORD_BITS = 64,
    MASK_WORDS = VDB_LEAF_VOXELS / WORD_BITS,
    /* Of a leaf: its mask, how inactive values are stored, the packed size, the numbers. */
    PACKED_MAX = MASK_WORDS * 8 + 1 + 8 + VDB_LEAF_VOXELS * sizeof(float),
    OUT_BYTES = 1 << 20,
};

/* Shares of the time, for the progress: sorting the samples, then the masks. */
static const double sort_share = 0.3, mask_share = 0.1;

struct worker {
    z_stream packer;
    float values[VDB_LEAF_VOXELS];
};

struct writer {
    const struct sp_export_job *job;
    struct sp_vdb_blocks blocks;
    struct sp_pool *pool;
    struct worker *workers; /* [THREADS_MAX] */
    char *out;              /* bytes that are not in the file yet */
    size_t out_used;
    uint64_t at;        /* of the first of them in the file */
    uint64_t places_at; /* where the file states the places of the grid */
    /* The block that is written. */
    uint64_t block;
    void *samples;
    uint64_t (*masks)[MASK_WORDS]; /* [BLOCK_LEAVES]: active voxels of each leaf */
    char (*packed)[PACKED_MAX];    /* the same */
    size_t *packed_size;           /* the same; 0 = there is no such leaf */
    uint64_t done;                 /* blocks of this pass */
};

/* Writes a block: its masks or its values. */
typedef bool block_fn(struct writer *w, struct sp_error *err);

static bool fail(const struct writer *w, const char *what, struct sp_error *err) {
    return sp_fail(err, SP_ERR_IO, w->job->title, "cannot %s: %s", what, strerror(errno));
}

/* Output. */

static bool flush(struct writer *w, struct sp_error *err) {
    if (!sp_write_at(w->job->out, w->out, w->out_used, w->at))
        return fail(w, "write", err);
    w->at += w->out_used;
    w->out_used = 0;
    return true;
}

static bool put(struct writer *w, const void *bytes, size_t size, struct sp_error *err) {
    for (size_t done = 0; done < size;) {
        const size_t left = size - done, free_bytes = OUT_BYTES - w->out_used;
        const size_t part = left < free_bytes ? left : free_bytes;
        memcpy(w->out + w->out_used, (const char *)bytes + done, part);
        w->out_used += part;
        done += part;
        if (w->out_used == OUT_BYTES && !flush(w, err))
            return false;
    }
    return true;
}

static uint64_t place(const struct writer *w) {
    return w->at + w->out_used;
}

static bool put_uint32(struct writer *w, uint32_t n, struct sp_error *err) {
    return put(w, &n, sizeof n, err);
}

static bool put_text(struct writer *w, const char *text, struct sp_error *err) {
    return put_uint32(w, (uint32_t)strlen(text), err) && put(w, text, strlen(text), err);
}

/* An entry of the metadata. */
static bool put_entry(struct writer *w, const char *name, const char *type, const void *value,
                      size_t size, struct sp_error *err) {
    return put_text(w, name, err) && put_text(w, type, err) && put_uint32(w, (uint32_t)size, err) &&
           put(w, value, size, err);
}

static bool put_word(struct writer *w, const char *name, const char *text, struct sp_error *err) {
    return put_entry(w, name, "string", text, strlen(text), err);
}

/* The numbers of an inner node: all are the background. */
static bool put_no_numbers(struct writer *w, struct sp_error *err) {
    static const char none[1 + sizeof(int64_t)]; /* how inactive values are stored; the size */
    return put(w, none, sizeof none, err);
}

/* The description of the file and of the grid. */

/* An identifier, as programs expect it to notice that another file has taken the place of one. */
static bool put_uuid(struct writer *w, struct sp_error *err) {
    unsigned char b[16];
    char text[37];
    if (getrandom(b, sizeof b, 0) != sizeof b)
        return fail(w, "make an identifier", err);
    b[6] = (b[6] & 0x0f) | 0x40; /* random, by RFC 4122 */
    b[8] = (b[8] & 0x3f) | 0x80;
    snprintf(text, sizeof text,
             "%02x%02x%02x%02x-%02x%02x-%02x%02x-%02x%02x-%02x%02x%02x%02x%02x%02x", b[0], b[1],
             b[2], b[3], b[4], b[5], b[6], b[7], b[8], b[9], b[10], b[11], b[12], b[13], b[14],
             b[15]);
    return put(w, text, 36, err);
}

/* The name that renderers of smoke and clouds look for by default. */
static const char *name_of(const struct writer *w) {
    return w->job->info->value_name[0] ? w->job->info->value_name : "density";
}

static bool put_start(struct writer *w, struct sp_error *err) {
    static const char magic[8] = " BDV", has_places = 1;
    static const uint64_t places[3];
    bool ok = put(w, magic, sizeof magic, err) && put_uint32(w, FILE_VERSION, err) &&
              put_uint32(w, LIBRARY_MAJOR, err) && put_uint32(w, 0, err) &&
              put(w, &has_places, 1, err) && put_uuid(w, err) && put_uint32(w, 1, err) &&
              put_word(w, "creator", "splatctl convert", err) && put_uint32(w, 1, err) &&
              put_text(w, name_of(w), err) && put_text(w, "Tree_float_5_4_3", err) &&
              put_text(w, "", err);
    w->places_at = place(w);
    return ok && put(w, places, sizeof places, err);
}

static bool put_metadata(struct writer *w, struct sp_error *err) {
    const uint32_t *dims = w->job->info->grid.dims;
    const int32_t first[3] = { 0 };
    const int32_t last[3] = { (int32_t)dims[0] - 1, (int32_t)dims[1] - 1, (int32_t)dims[2] - 1 };
    const char is_half = 0;
    return put_uint32(w, 6, err) && put_word(w, "class", "fog volume", err) &&
           put_entry(w, "file_bbox_max", "vec3i", last, sizeof last, err) &&
           put_entry(w, "file_bbox_min", "vec3i", first, sizeof first, err) &&
           put_word(w, "file_compression", "zip + active values", err) &&
           put_entry(w, "is_saved_as_half_float", "bool", &is_half, sizeof is_half, err) &&
           put_word(w, "name", name_of(w), err);
}

/* From indices to the world; a row for each axis, and the origin. */
static bool put_transform(struct writer *w, struct sp_error *err) {
    const struct sp_grid *grid = &w->job->info->grid;
    double matrix[4][4] = { { 0 } };
    for (int row = 0; row < 3; row++) {
        for (int axis = 0; axis < 3; axis++)
            matrix[axis][row] = grid->direction[row][axis] * grid->spacing[axis];
        matrix[3][row] = grid->origin[row];
    }
    matrix[3][3] = 1;
    return put_text(w, "AffineMap", err) && put(w, matrix, sizeof matrix, err);
}

/* Leaves of a block. */

static void gather(const struct writer *w, size_t leaf, float values[VDB_LEAF_VOXELS]) {
    const size_t x = leaf / LEAVES / LEAVES * VDB_LEAF, y = leaf / LEAVES % LEAVES * VDB_LEAF;
    const size_t z = leaf % LEAVES * VDB_LEAF;
    for (size_t n = 0; n < VDB_LEAF_VOXELS; n++) {
        const size_t k = z + n / VDB_LEAF / VDB_LEAF, j = y + n / VDB_LEAF % VDB_LEAF;
        const size_t i = x + n % VDB_LEAF;
        values[(n % VDB_LEAF * VDB_LEAF + n / VDB_LEAF % VDB_LEAF) * VDB_LEAF +
               n / VDB_LEAF / VDB_LEAF] =
            (float)sp_sample(w->samples, w->job->info->type, (k * VDB_BLOCK + j) * VDB_BLOCK + i);
    }
}

static void set_active(struct writer *w, const uint32_t at[3]) {
    size_t leaf = 0, voxel = 0;
    for (int a = 0; a < 3; a++) {
        leaf = leaf * LEAVES + at[a] % VDB_BLOCK / VDB_LEAF;
        voxel = voxel * VDB_LEAF + at[a] % VDB_LEAF;
    }
    w->masks[leaf][voxel / WORD_BITS] |= UINT64_C(1) << voxel % WORD_BITS;
}

static bool has_voxels(const struct writer *w, size_t leaf) {
    static const uint64_t none[MASK_WORDS];
    return memcmp(w->masks[leaf], none, sizeof none) != 0;
}

static void fill_masks(void *user, size_t begin, size_t end, unsigned worker) {
    struct writer *w = user;
    float *values = w->workers[worker].values;
    for (size_t leaf = begin; leaf < end; leaf++) {
        gather(w, leaf, values);
        memset(w->masks[leaf], 0, sizeof w->masks[leaf]);
        for (size_t n = 0; n < VDB_LEAF_VOXELS; n++)
            w->masks[leaf][n / WORD_BITS] |= (uint64_t)(values[n] != 0) << n % WORD_BITS;
    }
}

/* Reads a block and finds its active voxels. */
static bool read_block(struct writer *w, struct sp_error *err) {
    static const uint32_t first[3];
    const uint32_t *dims = w->job->info->grid.dims, *count = w->blocks.count;
    if (!sp_vdb_blocks_read(&w->blocks, w->block, w->samples))
        return fail(w, "read the samples again", err);
    sp_parallel_for(w->pool, BLOCK_LEAVES, LEAVES, fill_masks, w);
    if (w->block == 0)
        set_active(w, first);
    if (w->block + 1 == (uint64_t)count[0] * count[1] * count[2])
        set_active(w, (uint32_t[3]){ dims[0] - 1, dims[1] - 1, dims[2] - 1 });
    return true;
}

static bool put_block_masks(struct writer *w, struct sp_error *err) {
    static const uint64_t no_tiles[BLOCK_LEAVES / WORD_BITS];
    uint64_t children[BLOCK_LEAVES / WORD_BITS] = { 0 };
    for (size_t leaf = 0; leaf < BLOCK_LEAVES; leaf++)
        children[leaf / WORD_BITS] |= (uint64_t)has_voxels(w, leaf) << leaf % WORD_BITS;
    bool ok = put(w, children, sizeof children, err) && put(w, no_tiles, sizeof no_tiles, err) &&
              put_no_numbers(w, err);
    for (size_t leaf = 0; ok && leaf < BLOCK_LEAVES; leaf++)
        ok = !has_voxels(w, leaf) || put(w, w->masks[leaf], sizeof w->masks[leaf], err);
    return ok;
}

/* Returns the size of the packed numbers, with the 8 bytes that state it. Numbers that packing does
 * not make smaller are stored as they are, and their size is negative. */
static size_t pack_numbers(z_stream *packer, const void *numbers, size_t size, char *out) {
    int64_t stated = -(int64_t)size;
    char *to = out + sizeof stated;
    deflateReset(packer);
    packer->next_in = (z_const Bytef *)numbers;
    packer->avail_in = (uInt)size;
    packer->next_out = (Bytef *)to;
    packer->avail_out = (uInt)size - 1;
    if (deflate(packer, Z_FINISH) == Z_STREAM_END)
        stated = (int64_t)packer->total_out;
    else
        memcpy(to, numbers, size);
    memcpy(out, &stated, sizeof stated);
    return sizeof stated + (size_t)(stated < 0 ? -stated : stated);
}

static size_t pack_leaf(const struct writer *w, size_t leaf, struct worker *own, char *out) {
    size_t active = 0, used = sizeof w->masks[leaf];
    gather(w, leaf, own->values);
    for (size_t n = 0; n < VDB_LEAF_VOXELS; n++)
        if (w->masks[leaf][n / WORD_BITS] >> n % WORD_BITS & 1)
            own->values[active++] = own->values[n];
    memcpy(out, w->masks[leaf], used);
    out[used++] = 0; /* inactive voxels have the background */
    return used + pack_numbers(&own->packer, own->values, active * sizeof(float), out + used);
}

static void pack_leaves(void *user, size_t begin, size_t end, unsigned worker) {
    struct writer *w = user;
    for (size_t leaf = begin; leaf < end; leaf++)
        w->packed_size[leaf] =
            has_voxels(w, leaf) ? pack_leaf(w, leaf, &w->workers[worker], w->packed[leaf]) : 0;
}

static bool put_block_values(struct writer *w, struct sp_error *err) {
    bool ok = true;
    sp_parallel_for(w->pool, BLOCK_LEAVES, LEAVES, pack_leaves, w);
    for (size_t leaf = 0; ok && leaf < BLOCK_LEAVES; leaf++)
        ok = put(w, w->packed[leaf], w->packed_size[leaf], err);
    return ok;
}

/* The tree. */

/* Block i of the child of the root whose first block is `first`; false if there is none. */
static bool find_block(const struct writer *w, const uint32_t first[3], size_t i, uint64_t *block) {
    const uint32_t *count = w->blocks.count;
    const uint32_t x = first[0] + (uint32_t)(i / ROOT_BLOCKS / ROOT_BLOCKS);
    const uint32_t y = first[1] + (uint32_t)(i / ROOT_BLOCKS % ROOT_BLOCKS);
    const uint32_t z = first[2] + (uint32_t)(i % ROOT_BLOCKS);
    if (x >= count[0] || y >= count[1] || z >= count[2])
        return false;
    *block = ((uint64_t)x * count[1] + y) * count[2] + z;
    return w->blocks.is_used[*block];
}

static bool put_root_masks(struct writer *w, const uint32_t first[3], struct sp_error *err) {
    static const uint64_t no_tiles[ROOT_CHILDREN / WORD_BITS];
    uint64_t children[ROOT_CHILDREN / WORD_BITS] = { 0 }, block;
    int32_t origin[3];
    for (int a = 0; a < 3; a++)
        origin[a] = (int32_t)(first[a] * VDB_BLOCK);
    for (size_t i = 0; i < ROOT_CHILDREN; i++)
        children[i / WORD_BITS] |= (uint64_t)find_block(w, first, i, &block) << i % WORD_BITS;
    return put(w, origin, sizeof origin, err) && put(w, children, sizeof children, err) &&
           put(w, no_tiles, sizeof no_tiles, err) && put_no_numbers(w, err);
}

static bool has_blocks(const struct writer *w, const uint32_t first[3]) {
    uint64_t block;
    bool found = false;
    for (size_t i = 0; !found && i < ROOT_CHILDREN; i++)
        found = find_block(w, first, i, &block);
    return found;
}

/* Finds the child of the root at or after *number; its first block is first[]. */
static bool next_child(const struct writer *w, uint64_t *number, uint32_t first[3]) {
    uint64_t count[3];
    for (int a = 0; a < 3; a++)
        count[a] = (w->blocks.count[a] + ROOT_BLOCKS - 1) / ROOT_BLOCKS;
    for (; *number < count[0] * count[1] * count[2]; ++*number) {
        first[0] = (uint32_t)(*number / count[2] / count[1]) * ROOT_BLOCKS;
        first[1] = (uint32_t)(*number / count[2] % count[1]) * ROOT_BLOCKS;
        first[2] = (uint32_t)(*number % count[2]) * ROOT_BLOCKS;
        if (has_blocks(w, first))
            return true;
    }
    return false;
}

/* Writes the blocks of a child of the root. Progress goes from `from` on, by `share`. */
static bool put_blocks(struct writer *w, const uint32_t first[3], block_fn *put_block, double from,
                       double share, struct sp_error *err) {
    for (size_t i = 0; i < ROOT_CHILDREN; i++) {
        if (!find_block(w, first, i, &w->block))
            continue;
        const double done = (double)w->done++ / (double)w->blocks.used;
        if (!sp_export_report(w->job, from + share * done, err) || !read_block(w, err) ||
            !put_block(w, err))
            return false;
    }
    return true;
}

static bool put_topology(struct writer *w, struct sp_error *err) {
    static const float background;
    uint32_t children = 0, first[3];
    for (uint64_t n = 0; next_child(w, &n, first); n++)
        children++;
    bool ok = put_uint32(w, 1, err) /* buffers per leaf */ &&
              put(w, &background, sizeof background, err) && put_uint32(w, 0, err) /* tiles */ &&
              put_uint32(w, children, err);
    w->done = 0;
    for (uint64_t n = 0; ok && next_child(w, &n, first); n++)
        ok = put_root_masks(w, first, err) &&
             put_blocks(w, first, put_block_masks, sort_share, mask_share, err);
    return ok;
}

static bool put_values(struct writer *w, struct sp_error *err) {
    const double from = sort_share + mask_share;
    uint32_t first[3];
    bool ok = true;
    w->done = 0;
    for (uint64_t n = 0; ok && next_child(w, &n, first); n++)
        ok = put_blocks(w, first, put_block_values, from, 1 - from, err);
    return ok;
}

static bool put_grid(struct writer *w, struct sp_error *err) {
    uint64_t places[3] = { place(w) }; /* the grid, its values, its end */
    if (!put_uint32(w, ZIP | ACTIVE_VALUES, err) || !put_metadata(w, err) ||
        !put_transform(w, err) || !put_topology(w, err))
        return false;
    places[1] = place(w);
    if (!put_values(w, err) || !flush(w, err))
        return false;
    places[2] = w->at;
    return sp_write_at(w->job->out, places, sizeof places, w->places_at) || fail(w, "write", err);
}

static bool allocate(struct writer *w, struct sp_error *err) {
    enum { FASTEST = 1, WINDOW_BITS = 11 /* bytes of a leaf */, MEMORY_LEVEL = 5 };
    w->out = malloc(OUT_BYTES);
    w->samples = malloc(VDB_BLOCK_VOXELS * sp_type_size(w->job->info->type));
    w->masks = malloc(BLOCK_LEAVES * sizeof *w->masks);
    w->packed = malloc(BLOCK_LEAVES * sizeof *w->packed);
    w->packed_size = malloc(BLOCK_LEAVES * sizeof *w->packed_size);
    w->workers = calloc(THREADS_MAX, sizeof *w->workers);
    bool ok = w->out && w->samples && w->masks && w->packed && w->packed_size && w->workers;
    for (unsigned t = 0; ok && t < sp_pool_threads(w->pool); t++)
        ok = deflateInit2(&w->workers[t].packer, FASTEST, Z_DEFLATED, WINDOW_BITS, MEMORY_LEVEL,
                          Z_DEFAULT_STRATEGY) == Z_OK;
    return ok || sp_fail(err, SP_ERR_MEMORY, w->job->title, "out of memory for a block");
}

static void release(struct writer *w) {
    for (int t = 0; w->workers && t < THREADS_MAX; t++)
        deflateEnd(&w->workers[t].packer);
    free(w->workers);
    free(w->out);
    free(w->samples);
    free(w->masks);
    free(w->packed);
    free(w->packed_size);
    sp_vdb_blocks_finish(&w->blocks);
    sp_pool_destroy(&w->pool);
}

bool sp_export_vdb(const struct sp_export_job *job, struct sp_error *err) {
    struct writer w = { .job = job, .blocks = { .file = -1 } };
    if (job->info->type == SP_INT32 || job->info->type == SP_FLOAT64)
        sp_log(SP_LOG_WARN, "%s: the samples become float, which has 24 significant bits",
               job->title);
    w.pool = sp_pool_create(sp_volume_threads(), err);
    bool ok = w.pool && allocate(&w, err) && sp_vdb_blocks_init(&w.blocks, job, sort_share, err) &&
              put_start(&w, err) && put_grid(&w, err);
    if (ok && fsync(job->out) != 0)
        ok = fail(&w, "write", err);
    release(&w);
    return ok && sp_export_report(job, 1, err);
}
