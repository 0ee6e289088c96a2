/* SPDX-License-Identifier: Apache-2.0
 *
 * What is kept on the GPU of the volumes that were drawn: the lists of classify/ (visible.h), level
 * by level, uploaded when they are made anew. A change of colours uploads a table.
 *
 *   entries   a word an entry, in the order of the bricks: i0 | i1 << 4 | i2 << 8 | key << 12
 *   tables    [scale of the opacity by packed magnitude, four a row][rows of rectilinear axes]
 *             [classes: colour and depth, by key; by entry where keys do not fit the word]
 *   normals   gradients or flakes as they are in the list
 *
 * The order of a brick's entries, and so the axis that bricks are cut along, does not matter here.
 */
#ifndef GL_VOLUME_H
#define GL_VOLUME_H

#include "backend/gl/buffer.h"
#include "classify/classification.h"

enum { GL_LISTS = 32 }; /* of all volumes and levels */

struct gl_list {
    const struct sp_volume *volume; /* not a reference: gl_lists_forget(); NULL = empty */
    uint64_t list_made, table_made; /* of the level: what was uploaded */
    uint64_t used;                  /* clock of the last use */
    struct sp_grid grid;            /* of the level */
    uint32_t bricks[3];             /* an axis, axis 0 fastest */
    uint64_t count;                 /* entries */
    const uint64_t *first;          /* [bricks + 1]: entries of brick b begin at first[b] */
    double base;                    /* what values are counted from (order post), data units */
    struct gl_buffer entries, tables, normals;
    bool has_keys;         /* in the words */
    bool has_scales;       /* of the opacity */
    uint32_t normal_bytes; /* 0 = no normals */
    uint32_t axis_row[3];  /* of the tables: of sample 0 of each rectilinear axis */
    uint32_t first_class;  /* row of the tables */
};

struct gl_lists {
    struct gl_list list[GL_LISTS];
    uint64_t clock;
    uint64_t frame;       /* the clock when this frame began: what was used since stays */
    uint64_t limit_bytes; /* beyond this the least recently used go */
    uint64_t block_bytes; /* the most that a shader sees of one buffer; 0 = not known */
    uint64_t uploaded;    /* bytes, since the beginning */
};

static inline uint32_t gl_list_bricks(const struct gl_list *list) {
    return list->bricks[0] * list->bricks[1] * list->bricks[2];
}

/* Index of the first voxel of a brick. */
static inline void gl_list_corner(const struct gl_list *list, uint32_t brick, uint32_t corner[3]) {
    uint32_t row = brick / list->bricks[0];
    corner[0] = brick % list->bricks[0] << SP_BRICK_SHIFT;
    corner[1] = row % list->bricks[1] << SP_BRICK_SHIFT;
    corner[2] = row / list->bricks[1] << SP_BRICK_SHIFT;
}

/* A frame begins: lists that were got for the one before may go. */
static inline void gl_lists_begin(struct gl_lists *lists) {
    lists->frame = lists->clock;
}

/* The level's list on the GPU, brought up to date; valid until the next frame begins. A context
 * must be current. NULL with *err set: SP_ERR_BUDGET, SP_ERR_MEMORY, SP_ERR_BACKEND. */
const struct gl_list *gl_lists_get(struct gl_lists *lists, const struct sp_volume *volume,
                                   const struct sp_level *level, struct sp_pool *pool,
                                   struct sp_error *err);

/* Drops what was uploaded of the volume; NULL = of any. A context must be current. */
void gl_lists_forget(struct gl_lists *lists, const struct sp_volume *volume);

/* Bytes on the GPU for the volume; NULL = for all. */
uint64_t gl_lists_bytes(const struct gl_lists *lists, const struct sp_volume *volume);

#endif
