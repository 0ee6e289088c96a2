/* SPDX-License-Identifier: Apache-2.0
 *
 * Divides a frame into layers, batches and chunks. The division persists from frame to frame, here
 * and on the GPU. A part is made again only if one of its inputs has changed.
 *
 *   layers   0 … … … … … … … … n         sheets, slabs or distances, front to back
 *   batch    |--- 0 ---|- 1 -|-- 2 --|   as many layers as the records and bins can hold
 *
 * A brick is in every batch that contains one of its layers, as chunks of GL_GROUP entries; each
 * entry has a record. If one layer has more entries than there are records, the next batch resumes
 * it.
 *
 *   what changes                    what is made again
 *   lists, level of detail, axis    bricks, and everything below
 *   order of sheets; any view       layers of each brick, and batches, unless one holds all
 *     by distance
 *   capacity of a batch             batches
 */
#ifndef GL_PARTITION_H
#define GL_PARTITION_H

#include "backend/gl/program.h"
#include "backend/gl/residency.h"
#include "base/arena.h"
#include "splat/camera.h"
#include "splat/detail.h"

/* shaders/passes/project.glsl: entries of one brick. */
struct gl_chunk {
    uint32_t first;  /* entry of the list */
    uint32_t brick;  /* of its level */
    uint32_t kind;   /* entries, 1 … GL_GROUP | part << 16: struct gl_constants */
    uint32_t record; /* of the batch: the first entry's */
};

struct gl_batch {
    uint32_t first, layers; /* layers [first, first + layers) */
    uint32_t records;
    bool resumes, stays_open; /* the batch begins or ends inside its layer; then layers = 1 */
    uint32_t chunk[SP_LEVELS], chunks[SP_LEVELS]; /* by level: first, count */
};

/* The source of the bricks. Its memory may be freed after the call. */
struct gl_partition_source {
    const struct sp_volume *volume;
    const struct gl_visible_list *const *lists; /* [SP_LEVELS] */
    const struct sp_detail *detail;             /* sheets: the bricks, of all levels */
    unsigned level;                             /* by distance: the mip level of all its entries */
    bool is_enlarged;                           /* that level is drawn enlarged */
};

/* Layers by distance from the eye: layer k is [k, k + 1) · thickness away. World units. */
struct gl_partition_depth {
    const struct sp_camera_transform *camera;
    double thickness;
    double reach;    /* of a kernel before and behind its voxel; single splats: 0 */
    double farthest; /* farther voxels count as this far */
};

struct gl_partition {
    struct sp_arena kept, pieces; /* of bricks; of batches and chunks */
    struct gl_item *items;        /* bricks that are not empty, level by level */
    uint32_t item_count;
    uint64_t entries; /* of all items */
    uint32_t layer_count;
    int64_t nearest;  /* by distance: number of layer 0, counted from the eye */
    uint32_t *sheets; /* [sheet_count]: place of each sheet of the finest level, front to back */
    uint32_t sheet_count;
    struct gl_batch *batches;
    uint32_t batch_count;
    struct gl_chunk *chunks; /* of the batches, one after the other */
    uint32_t chunk_count;
    uint64_t sheets_made, chunks_made; /* generation numbers; 0 = never made */

    /* The inputs for which the items were made; only compared. */
    const struct sp_volume *volume; /* NULL = there are none */
    uint64_t list_made[SP_LEVELS];
    struct sp_detail detail;
    unsigned axis; /* of the sheets; SP_NO_AXIS: by distance */
    unsigned level;
    bool is_enlarged;

    /* The inputs for which the batches were made. */
    bool is_cut;              /* for the layers of these items */
    bool is_whole;            /* one batch holds all items, in any layers */
    uint32_t layers, records; /* capacity of a batch */
};

/* budget: of the memory of frames; NULL = no limit. */
void gl_partition_init(struct gl_partition *partition, struct sp_budget *budget);
void gl_partition_finish(struct gl_partition *partition);
/* Frees its memory; the next frame chooses layers and makes batches again. */
void gl_partition_trim(struct gl_partition *partition);

/* Choose the layers of a frame: sheets along `axis`, with sheets[count] as in struct gl_partition,
 * or layers by distance. SP_ERR_MEMORY. */
bool gl_partition_sheets(struct gl_partition *partition, const struct gl_partition_source *from,
                         unsigned axis, const uint32_t *sheets, uint32_t count,
                         struct sp_error *err);
bool gl_partition_distances(struct gl_partition *partition, const struct gl_partition_source *from,
                            const struct gl_partition_depth *depth, struct sp_error *err);

/* Makes the batches after the layers were chosen. A batch has at most `layers` layers and `records`
 * records; records >= SP_BRICK_VOXELS. The function may be called again with other sizes. The
 * batches are valid until the layers of the next frame are chosen. SP_ERR_MEMORY. */
bool gl_partition_make(struct gl_partition *partition, uint32_t layers, uint32_t records,
                       struct sp_error *err);

#endif
