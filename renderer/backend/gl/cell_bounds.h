/* SPDX-License-Identifier: Apache-2.0
 *
 * Value ranges of cells of 4³ voxels on the GPU. The ranges tell which voxels can matter to
 * post-classified pixels (classify/reach.h).
 *
 *   samples ─ once ─► range per cell ─► joined with the cells around it, axis by axis ─► classify.h
 */
#ifndef GL_CELL_BOUNDS_H
#define GL_CELL_BOUNDS_H

#include "backend/gl/voxels.h"
#include "classify/classification.h"

struct gl_cell_bounds {
    unsigned measure, widen; /* programs */
    struct gl_buffer ends;
    struct gl_buffer scratch[2]; /* during a pass over the bricks */
};

/* Compiles the programs. SP_ERR_BACKEND. Call gl_cell_bounds_finish() also after a failure. A
 * context must be current, here and below. */
bool gl_cell_bounds_init(struct gl_cell_bounds *bounds, struct sp_error *err);
void gl_cell_bounds_finish(struct gl_cell_bounds *bounds);

/* Returns the video memory that the ranges of the cells need [bytes]. */
uint64_t gl_cell_bounds_bytes(const struct sp_grid *grid);

/* Computes the ranges of the cells, unless they are resident. most: bricks per dispatch;
 * block_bytes: as in classify.h. SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED, SP_ERR_BACKEND,
 * here and below. */
bool gl_cell_bounds_load(struct gl_cell_bounds *bounds, struct gl_voxels *voxels, uint32_t most,
                         uint64_t block_bytes, const atomic_bool *cancel, struct sp_error *err);

/* Joins the range of each cell with the ranges of all cells whose values the level's kernels can
 * mix with the values of the cell. The result is in scratch[0] until gl_cell_bounds_drop(); call
 * that also after a failure. Adds to *uploaded. */
bool gl_cell_bounds_widen(struct gl_cell_bounds *bounds, const struct gl_voxels *voxels,
                          const struct sp_level *level, uint32_t most, uint64_t block_bytes,
                          uint64_t *uploaded, const atomic_bool *cancel, struct sp_error *err);
void gl_cell_bounds_drop(struct gl_cell_bounds *bounds);

#endif
