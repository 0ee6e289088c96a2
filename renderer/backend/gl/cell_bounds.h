/* SPDX-License-Identifier: Apache-2.0
 *
 * What can matter to post-classified pixels (classify/reach.h), on the GPU.
 *
 *   samples ─ once ─► range a cell of 4³ ─► with those of the cells around, axis by axis ─►
 * classify.h
 */
#ifndef GL_CELL_BOUNDS_H
#define GL_CELL_BOUNDS_H

#include "backend/gl/voxels.h"
#include "classify/classification.h"

struct gl_cell_bounds {
    unsigned measure, widen; /* programs */
    struct gl_buffer ends;
    struct gl_buffer scratch[2]; /* for the length of a pass over the bricks */
};

/* SP_ERR_BACKEND; gl_cell_bounds_finish() also after a failure. A context must be current, here and
 * below.
 */
bool gl_cell_bounds_init(struct gl_cell_bounds *bounds, struct sp_error *err);
void gl_cell_bounds_finish(struct gl_cell_bounds *bounds);

/* Video memory of the cells' ranges, once. */
uint64_t gl_cell_bounds_bytes(const struct sp_grid *grid);

/* Measures the cells, unless they are. most: bricks of a dispatch; block_bytes: as in classify.h.
 * SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED, SP_ERR_BACKEND, here and below. */
bool gl_cell_bounds_load(struct gl_cell_bounds *bounds, struct gl_voxels *voxels, uint32_t most,
                         uint64_t block_bytes, const atomic_bool *cancel, struct sp_error *err);

/* The ranges of all that the level's kernels mix a cell's values with: in scratch[0], until
 * gl_cell_bounds_drop(), which is to be called after a failure as well. Adds to *uploaded. */
bool gl_cell_bounds_widen(struct gl_cell_bounds *bounds, const struct gl_voxels *voxels,
                          const struct sp_level *level, uint32_t most, uint64_t block_bytes,
                          uint64_t *uploaded, const atomic_bool *cancel, struct sp_error *err);
void gl_cell_bounds_drop(struct gl_cell_bounds *bounds);

#endif
