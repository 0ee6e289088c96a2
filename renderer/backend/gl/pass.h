/* SPDX-License-Identifier: Apache-2.0
 *
 * A pass of classification over the bricks of a volume, a work group each.
 */
#ifndef GL_PASS_H
#define GL_PASS_H

#include <stdatomic.h>

#include "backend/gl/voxels.h"

/* SP_ERR_CANCELLED when *cancel is set; NULL = never. */
bool gl_pass_cancelled(const atomic_bool *cancel, struct sp_error *err);

/* Uses the program, one of shaders/samples.glsl, and binds the samples; normal_bytes: of what it
 * writes. */
void gl_pass_use(unsigned program, const struct gl_voxels *voxels, uint32_t normal_bytes);

/* Runs the program in use over `bricks`, at most `most` a dispatch, which bounds how long it takes,
 * and waits for it. A pass that is cancelled leaves two dispatches behind. SP_ERR_CANCELLED,
 * SP_ERR_BACKEND. */
bool gl_pass_run(uint32_t bricks, uint32_t most, const atomic_bool *cancel, struct sp_error *err);

#endif
