/* SPDX-License-Identifier: Apache-2.0
 *
 * Classification on the GPU: resident samples → lists of visible voxels.
 *
 *   samples ─ once ─► value range of each brick; order post: of its cells (cell_bounds.h)
 *   listed values ─► number of entries per brick ─► read back: the processor computes where the
 *                                                   entries of each brick begin
 *                 ─► entries, gradients and classes, written from there on
 *   points of the transfer function ─► new classes of existing entries
 *   a level ─► the next coarser level, in the same two passes
 *
 * Types with a table by key (8 and 16 bits), order pre: one bit per key says which keys are listed.
 * Otherwise intervals say which samples are listed (visible_ranges.h). Bricks whose range contains
 * no listed value are not read. Types without a table have a class per entry; order post: a value
 * per entry.
 */
#ifndef GL_CLASSIFY_H
#define GL_CLASSIFY_H

#include "backend/gl/cell_bounds.h"
#include "backend/gl/visible_list.h"
#include "backend/gl/voxels.h"

/* The programs, and their buffers during a pass. */
struct gl_classify {
    unsigned range, count, fill, histogram, classes, mip_count, mip_fill;
    struct gl_buffer listed, points, counts, firsts;
    struct gl_cell_bounds cell_bounds;
    uint32_t bricks;      /* per dispatch, which bounds its duration */
    uint64_t block_bytes; /* largest buffer that a shader can read; 0 = not known */
    uint64_t *uploaded;   /* counter of bytes; not owned */
};

/* Compiles the programs. SP_ERR_BACKEND. Call gl_classify_finish() also after a failure. A context
 * must be current, here and below. software: use the short dispatches that software GL needs. */
bool gl_classify_init(struct gl_classify *classify, bool software, struct sp_error *err);
void gl_classify_finish(struct gl_classify *classify);

/* Uploads the samples, unless they are resident. cells: also computes the ranges of cells, for
 * order post. SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED, SP_ERR_BACKEND, here and below.
 * cancel: NULL = never. */
bool gl_classify_load(struct gl_classify *classify, struct gl_voxels *voxels, bool cells,
                      const atomic_bool *cancel, struct sp_error *err);

/* Fills counts[bricks] with the number of listed voxels of each brick of the finest level. */
bool gl_classify_count(struct gl_classify *classify, const struct gl_voxels *voxels,
                       const struct sp_level *level, const atomic_bool *cancel, uint64_t *counts,
                       struct sp_error *err);

/* Fills counts[keys] with the number of voxels of each key. */
bool gl_classify_histogram(struct gl_classify *classify, const struct gl_voxels *voxels,
                           uint32_t keys, const atomic_bool *cancel, uint64_t *counts,
                           struct sp_error *err);

/* Writes the list of a level whose entries were counted: entries, normals as wide as the list's,
 * and classes if the list has one class per entry. Returns when the GPU has finished. */
bool gl_classify_fill(struct gl_classify *classify, const struct gl_voxels *voxels,
                      const struct sp_level *level, const struct gl_visible_list *list,
                      const atomic_bool *cancel, struct sp_error *err);

/* Writes only the classes of a list that has no keys and that the GPU has made. */
bool gl_classify_color(struct gl_classify *classify, const struct gl_voxels *voxels,
                       const struct sp_level *level, const struct gl_visible_list *list,
                       const atomic_bool *cancel, struct sp_error *err);

/* Count and fill a coarse level, from the list of the next finer level, which the GPU has made. The
 * list contains the cells with a visible voxel: entries, classes, and microflakes if the finer list
 * has normals; order post: entries, values and gradients. */
bool gl_classify_count_mip(struct gl_classify *classify, const struct gl_visible_list *finer,
                           bool is_post, const struct sp_level *level, const atomic_bool *cancel,
                           uint64_t *counts, struct sp_error *err);
bool gl_classify_fill_mip(struct gl_classify *classify, const struct gl_visible_list *finer,
                          bool is_post, const struct sp_level *level,
                          const struct gl_visible_list *list, const atomic_bool *cancel,
                          struct sp_error *err);

#endif
