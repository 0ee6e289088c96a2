/* SPDX-License-Identifier: Apache-2.0
 *
 * The general path: it draws every view, and with the scalar kernels it is the reference.
 *
 *   for each band of tiles:
 *     for each batch of visible voxels, front to back, until every tile is saturated:
 *       splat   blocks of voxels → records              parallel over blocks
 *       bin     records → one list per tile             parallel over blocks
 *       tile    lists → sums → composited               parallel over tiles
 *     resolve   composited → pixels                     parallel over tiles
 *
 * Batches limit the memory for records and bands limit the memory for tiles, for any volume and
 * image size. The ends of batches and bands depend on neither threads nor time, and so the image
 * does not depend on them either.
 */
#ifndef SP_BACKEND_CPU_GENERAL_H
#define SP_BACKEND_CPU_GENERAL_H

#include "backend/cpu/frame.h"

/* Draws every pixel and fills the stats. SP_ERR_MEMORY, SP_ERR_CANCELLED. */
bool cpu_general_draw(struct cpu_frame *frame, struct sp_error *err);

#endif
