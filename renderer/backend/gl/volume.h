/* SPDX-License-Identifier: Apache-2.0
 *
 * What is kept on the GPU of the volumes that were drawn: samples, and lists of visible voxels
 * level by level. Lists are made there from the samples (classify.h), or uploaded as the processor
 * made them (classify/visible.h). A change of colours uploads a table.
 *
 *   samples   as they lie in memory
 *   entries   a word an entry, in the order of the bricks: i0 | i1 << 4 | i2 << 8 | key << 12
 *   tables    [scale of the opacity by packed magnitude, four a row][rows of rectilinear axes]
 *             [classes: colour and depth, by key; by entry where keys do not fit the word]
 *   normals   gradients or flakes as classify/ packs them
 *
 * The order of a brick's entries, and so the axis that bricks are cut along, does not matter here.
 * Samples and lists share one budget: the least recently used go. A volume whose samples have no
 * room beside its lists, or in a buffer, is classified by the processor.
 */
#ifndef GL_VOLUME_H
#define GL_VOLUME_H

#include "backend/gl/buffer.h"
#include "backend/gl/classify.h"
#include "backend/gl/voxels.h"
#include "classify/classification.h"

enum { GL_LISTS = 32, GL_VOLUMES = 16 }; /* lists of all volumes and levels */

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
    struct gl_voxels voxels[GL_VOLUMES];
    struct gl_classify classify;
    uint64_t clock;
    uint64_t frame;        /* the clock when this frame began: what was used since stays */
    uint64_t limit_bytes;  /* beyond this the least recently used go … */
    uint64_t beside_bytes; /* … with what else counts in it */
    uint64_t block_bytes;  /* the most that a shader sees of one buffer; 0 = not known */
    uint64_t uploaded;     /* bytes, since the beginning */
};

/* What a list is made of. */
struct gl_list_source {
    const struct sp_volume *volume;
    const struct sp_level *level;
    struct gl_voxels *voxels; /* the GPU makes the list from them; NULL = the level has entries */
    bool normals;             /* then it makes normals as well */
    struct sp_pool *pool;
    const atomic_bool *cancel; /* NULL = never */
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

/* Programs; block_bytes as above. SP_ERR_BACKEND; gl_lists_finish() also after a failure, and then
 * they can be initialised again. A context must be current, here and below. */
bool gl_lists_init(struct gl_lists *lists, bool software, uint64_t block_bytes,
                   struct sp_error *err);
void gl_lists_finish(struct gl_lists *lists);

/* A frame begins: lists that were got for the one before may go. */
static inline void gl_lists_begin(struct gl_lists *lists) {
    lists->frame = lists->clock;
}

/* The samples that the GPU classifies the volume from, uploaded when they are needed; valid until
 * the next frame begins. NULL: the processor classifies it, which is so for order post, types
 * without a table by key, and volumes that were refused. */
struct gl_voxels *gl_lists_voxels(struct gl_lists *lists, const struct sp_volume *volume,
                                  enum sp_tf_order order);

/* Uploads the samples, unless they are there. SP_ERR_BUDGET, SP_ERR_MEMORY, SP_ERR_CANCELLED,
 * SP_ERR_BACKEND. cancel: NULL = never. */
bool gl_lists_load(struct gl_lists *lists, struct gl_voxels *voxels, const atomic_bool *cancel,
                   struct sp_error *err);

/* From now on the processor classifies their volume: logs why. */
void gl_lists_refuse(struct gl_voxels *voxels, const struct sp_error *why);

/* The level's list on the GPU, brought up to date; valid until the next frame begins. NULL with
 * *err set: SP_ERR_BUDGET, SP_ERR_MEMORY, SP_ERR_CANCELLED, SP_ERR_BACKEND. */
const struct gl_list *gl_lists_get(struct gl_lists *lists, const struct gl_list_source *source,
                                   struct sp_error *err);

/* What is not of this frame makes room for beside_bytes. SP_ERR_BUDGET. */
bool gl_lists_trim(struct gl_lists *lists, struct sp_error *err);

/* Drops what is there of the volume; NULL = of any. */
void gl_lists_forget(struct gl_lists *lists, const struct sp_volume *volume);

/* Bytes on the GPU for the volume; NULL = for all. */
uint64_t gl_lists_bytes(const struct gl_lists *lists, const struct sp_volume *volume);

#endif
