/* SPDX-License-Identifier: Apache-2.0 */
#include "data/bricks/box.h"

#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

_Static_assert((int)SP_BLOCK_SIDE == (int)BRICK_SIDE, "a block is a brick");

struct sp_brick_place sp_brick_place(const struct sp_brick_box_samples *box,
                                     const struct sp_brick_level *level, size_t sample,
                                     uint64_t i) {
    uint32_t begin[3], extent[3], first[3];
    struct sp_brick_place p;
    sp_brick_box(level, sp_brick_need_at(box->need, level, i), first, p.size);
    if (box->blocks) {
        const struct sp_block *block = &box->blocks->block[i];
        const size_t side = block->is_constant ? 1 : BRICK_SIDE;
        p.samples = (char *)block->samples;
        p.row = side * sample;
        p.slice = side * p.row;
        for (int a = 0; a < 3 && block->is_constant; a++)
            p.size[a] = 1;
        return p;
    }
    sp_brick_need_box(box->need, level, begin, extent);
    p.row = extent[0] * sample;
    p.slice = p.row * extent[1];
    p.samples = (char *)box->samples + (first[2] - begin[2]) * p.slice +
                (first[1] - begin[1]) * p.row + (first[0] - begin[0]) * sample;
    return p;
}

void sp_brick_unmap(void *samples, size_t bytes) {
    munmap(samples, bytes);
}

void *sp_brick_map(size_t bytes, struct sp_error *err) {
    void *memory = mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (memory != MAP_FAILED)
        return memory;
    sp_fail(err, SP_ERR_MEMORY, "", "out of memory for %zu bytes of bricks", bytes);
    return NULL;
}

/* The memory of bricks. */
struct shared {
    atomic_uint references;
    char *samples;
    size_t bytes; /* 0 = there are none */
};

/* The blocks of one volume. */
struct own {
    struct sp_blocks blocks; /* the first member: their memory begins with them */
    struct shared *shared;   /* a reference */
    void *single;            /* samples that stand for a brick each, one per brick */
};

static void unref(struct shared *shared) {
    if (!shared || atomic_fetch_sub_explicit(&shared->references, 1, memory_order_acq_rel) != 1)
        return;
    if (shared->bytes)
        sp_brick_unmap(shared->samples, shared->bytes);
    free(shared);
}

void sp_brick_blocks_release(void *blocks, size_t bytes) {
    struct own *own = blocks;
    (void)bytes;
    if (!own)
        return;
    unref(own->shared);
    free(own->blocks.block);
    free(own->single);
    free(own);
}

/* Without memory for bricks. */
static struct own *create(const struct sp_brick_file *file, const struct sp_brick_need *need) {
    const struct sp_brick_header *header = sp_brick_file_header(file);
    const uint64_t count = sp_brick_need_count(need);
    struct own *own = aligned_alloc(64, (sizeof *own + 63) / 64 * 64);
    uint32_t first[3];
    if (!own)
        return NULL;
    *own = (struct own){ .single = calloc(count, sp_type_size(header->info.type)) };
    own->blocks.type = header->info.type;
    own->blocks.block = calloc(count, sizeof *own->blocks.block);
    sp_brick_need_box(need, &header->level[need->level], first, own->blocks.dims);
    memcpy(own->blocks.count, need->count, sizeof need->count);
    if (!own->single || !own->blocks.block) {
        sp_brick_blocks_release(own, 0);
        return NULL;
    }
    for (uint64_t i = 0; i < count; i++)
        if (need->wanted[i] == BRICK_HIDDEN)
            own->blocks.block[i] =
                (struct sp_block){ (char *)own->single + i * sp_type_size(header->info.type),
                                   true };
    return own;
}

static struct shared *map(uint64_t bytes, struct sp_error *err) {
    struct shared *shared = calloc(1, sizeof *shared);
    if (!shared || (bytes && !(shared->samples = sp_brick_map(bytes, err)))) {
        free(shared);
        return NULL;
    }
    shared->bytes = bytes;
    atomic_init(&shared->references, 1);
    return shared;
}

static size_t brick_bytes(const struct sp_brick_file *file) {
    return sp_type_size(sp_brick_file_header(file)->info.type) * BRICK_SIDE * BRICK_SIDE *
           BRICK_SIDE;
}

uint64_t sp_brick_blocks_bytes(const struct sp_brick_file *file, const struct sp_brick_need *need) {
    return sp_brick_need_wanted(need) * brick_bytes(file);
}

struct sp_blocks *sp_brick_blocks_create(const struct sp_brick_file *file,
                                         const struct sp_brick_need *need, struct sp_error *err) {
    struct own *own = create(file, need);
    sp_fail(err, SP_ERR_MEMORY, "", "out of memory for bricks");
    if (!own || !(own->shared = map(sp_brick_blocks_bytes(file, need), err))) {
        sp_brick_blocks_release(own, 0);
        return NULL;
    }
    char *next = own->shared->samples;
    for (uint64_t i = 0; i < sp_brick_need_count(need); i++)
        if (need->wanted[i] >= BRICK_WANTED) {
            own->blocks.block[i].samples = next;
            next += brick_bytes(file);
        }
    return &own->blocks;
}

struct sp_blocks *sp_brick_blocks_share(const struct sp_brick_file *file,
                                        const struct sp_brick_need *need,
                                        const struct sp_blocks *from, const uint8_t *has,
                                        struct sp_error *err) {
    const struct own *other = (const struct own *)from;
    struct own *own = create(file, need);
    if (!own) {
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory for bricks");
        return NULL;
    }
    const uint64_t count = sp_brick_need_count(need);
    own->shared = other->shared;
    atomic_fetch_add_explicit(&own->shared->references, 1, memory_order_relaxed);
    memcpy(own->single, other->single, count * sp_type_size(from->type));
    for (uint64_t i = 0; i < count; i++)
        if (need->wanted[i] >= BRICK_WANTED && has[i])
            own->blocks.block[i] = from->block[i];
    own->blocks.coarse = from->coarse;
    return &own->blocks;
}

/* Bytes of memory of an array. */
static uint64_t array_bytes(const struct sp_brick_file *file, const struct sp_brick_need *need) {
    const struct sp_brick_header *header = sp_brick_file_header(file);
    const struct sp_brick_level *level = &header->level[need->level];
    const struct sp_brick_entry *entries = sp_brick_file_entries(file, need->level);
    const enum sp_type type = header->info.type;
    const uint64_t rows = (uint64_t)need->count[1] * need->count[2], width = need->count[0];
    const uint64_t bytes = sp_brick_need_bytes(file, need);
    uint64_t used = 0;
    sp_brick_file_begin(file);
    for (uint64_t row = 0; row < rows; row++) {
        bool is_used = false;
        for (uint64_t i = row * width; i < (row + 1) * width; i++)
            is_used = is_used || need->wanted[i] ||
                      sp_brick_value(&entries[sp_brick_need_at(need, level, i)], type) != 0;
        used += is_used;
    }
    sp_brick_file_end(file);
    return bytes / rows * used;
}

uint64_t sp_brick_need_cost(const struct sp_brick_file *file, const struct sp_brick_need *need) {
    enum { RANGE_SAMPLES = 64, RANGE_BYTES = 9 }; /* of a region: its range, and what is visible */
    const uint64_t samples = sp_brick_need_samples(file, need);
    const uint64_t blocks = sp_brick_need_count(need) * (sizeof(struct sp_block) + sizeof(double));
    return (need->is_sparse ? sp_brick_blocks_bytes(file, need) + blocks
                            : array_bytes(file, need)) +
           samples / RANGE_SAMPLES * RANGE_BYTES;
}
