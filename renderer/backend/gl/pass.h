/* SPDX-License-Identifier: Apache-2.0
 *
 * A pass of classification over the bricks of a volume: one work group per brick.
 */
#ifndef GL_PASS_H
#define GL_PASS_H

#include <stdatomic.h>

#include "backend/gl/voxels.h"

/* True with SP_ERR_CANCELLED if *cancel is set. cancel: NULL = never. */
bool gl_pass_cancelled(const atomic_bool *cancel, struct sp_error *err);

/* Selects a program that contains shaders/samples.glsl and binds the samples. normal_bytes: width
 * of the normals that it writes. */
void gl_pass_use(unsigned program, const struct gl_voxels *voxels, uint32_t normal_bytes);

/* Runs the selected program over `bricks` bricks and waits until the GPU has finished. `most`
 * bricks per dispatch limit the duration of a dispatch. A cancelled pass leaves at most two
 * dispatches on the GPU. SP_ERR_CANCELLED, SP_ERR_BACKEND. */
bool gl_pass_run(uint32_t bricks, uint32_t most, const atomic_bool *cancel, struct sp_error *err);

#endif
