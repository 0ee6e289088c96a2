/* SPDX-License-Identifier: Apache-2.0
 *
 * The budget of video memory: all that the backend has there counts.
 *
 *   |-- voxels, lists (volume.h) --|-- scratch: splats, pairs, bins, pixels --|-- rest --|  limit
 *
 * Scratch is what frames are drawn in; nothing of it outlives the frame, so that it can go whenever
 * one is planned. Pieces that frames are drawn in are as large as half of the budget allows, and
 * smaller where voxels and lists of the frame leave less; of others the least recently used go
 * first.
 */
#ifndef GL_MEMORY_H
#define GL_MEMORY_H

#include "backend/gl/draw.h"

/* Limits of the pieces, from what the GPU can do and from the budget, state->residency.limit_bytes.
 */
void gl_memory_limit(struct gl_state *state);

/* A frame is planned: once in a while scratch that was much larger than needed since goes. A
 * context must be current, here and below. */
void gl_memory_begin(struct gl_state *state);

/* Lets all scratch go; false if there was none. */
bool gl_memory_release(struct gl_state *state);

/* After scratch has grown: lists that are not of this frame make room for it. SP_ERR_BUDGET with
 * both numbers when that does not do. */
bool gl_memory_fit(struct gl_state *state, struct sp_error *err);

#endif
