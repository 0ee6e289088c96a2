/* SPDX-License-Identifier: Apache-2.0 */
#include "bricks/box.h"

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

/* Where the parts of the memory begin: the blocks, one sample per brick, the bricks. */
struct layout {
    uint64_t block, single, bricks, end;
};

static struct layout find_layout(const struct sp_brick_file *file,
                                 const struct sp_brick_need *need) {
    enum { LINE = 64, BRICK = BRICK_SIDE * BRICK_SIDE * BRICK_SIDE };
    const uint64_t count = sp_brick_need_count(need);
    const size_t sample = sp_type_size(sp_brick_file_header(file)->info.type);
    struct layout at = { .block = sizeof(struct sp_blocks) };
    at.single = at.block + count * sizeof(struct sp_block);
    at.bricks = (at.single + count * sample + LINE - 1) / LINE * LINE;
    at.end = at.bricks + sp_brick_need_wanted(need) * sample * BRICK;
    return at;
}

uint64_t sp_brick_blocks_bytes(const struct sp_brick_file *file, const struct sp_brick_need *need) {
    return find_layout(file, need).end;
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
    return (need->is_sparse ? sp_brick_blocks_bytes(file, need) : array_bytes(file, need)) +
           samples / RANGE_SAMPLES * RANGE_BYTES;
}

struct sp_blocks *sp_brick_blocks_init(const struct sp_brick_file *file,
                                       const struct sp_brick_need *need, void *memory) {
    const struct layout at = find_layout(file, need);
    const struct sp_brick_header *header = sp_brick_file_header(file);
    const size_t sample = sp_type_size(header->info.type);
    struct sp_blocks *blocks = memory;
    char *next = (char *)memory + at.bricks;
    uint32_t first[3];
    *blocks = (struct sp_blocks){ .size = sample, .block = (void *)((char *)memory + at.block) };
    sp_brick_need_box(need, &header->level[need->level], first, blocks->dims);
    for (int a = 0; a < 3; a++)
        blocks->count[a] = need->count[a];
    for (uint64_t i = 0; i < sp_brick_need_count(need); i++) {
        blocks->block[i].is_constant = !need->wanted[i];
        blocks->block[i].samples = (char *)memory + at.single + i * sample;
        if (need->wanted[i]) {
            blocks->block[i].samples = next;
            next += (size_t)BRICK_SIDE * BRICK_SIDE * BRICK_SIDE * sample;
        }
    }
    return blocks;
}
