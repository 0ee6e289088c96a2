/* SPDX-License-Identifier: Apache-2.0
 *
 * Draws a frame on the CPU by one of three paths:
 *
 *   resample/   sheets that are classified after interpolation             sp_resample_draws()
 *   postconv/   fast path: sheets, tile by tile, without footprints        see cpu_draw()
 *   general.c   general path: every footprint is set up, binned and added  all other frames
 *
 * The last two paths share frame.c: camera, mip levels, classified lists.
 */
#ifndef SP_BACKEND_CPU_DRAW_H
#define SP_BACKEND_CPU_DRAW_H

#include "backend/cpu/frame.h"

/* Draws every pixel and fills the stats. Sheets that are classified after interpolation are
 * resampled.
 *
 * Other frames take the fast path if all of these hold, or else the general path:
 *   1. the instruction set uses it (cpu_kernels.has_fast_path: every set except scalar);
 *   2. sp_postconv_can_draw(): sheets of Gaussians with a cutoff of at least 3, classified before
 *      splatting, on an evenly spaced grid, with nothing clipped;
 *   3. sp_postconv_is_worthwhile(): filters serve at least three quarters of the voxels that the
 *      tiles look at, which is not so if the eye is close to the voxels;
 *   4. among other layers the eye is not between slices.
 *
 * sp_backend.render(); `state` is a struct cpu_state. SP_ERR_MEMORY, SP_ERR_BUDGET,
 * SP_ERR_CANCELLED. */
bool cpu_draw(void *state, const struct sp_backend_job *job, struct sp_error *err);

#endif
