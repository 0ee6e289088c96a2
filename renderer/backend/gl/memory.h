/* SPDX-License-Identifier: Apache-2.0
 *
 * The budget of video memory. All memory that the backend allocates there counts.
 *
 *   |-- voxels, lists (residency.h) --|-- scratch: splats, pairs, bins, pixels --|-- rest --| limit
 *
 * Scratch memory holds a frame while it is drawn. Its contents do not outlive the frame, so it may
 * be freed whenever a frame is planned. Batches are as large as half of the budget allows, or
 * smaller if the voxels and lists of the frame leave less memory. Data of other frames is evicted
 * first, least recently used first.
 */
#ifndef GL_MEMORY_H
#define GL_MEMORY_H

#include "backend/gl/state.h"

/* Sets the limits of the workload from the GPU's limits and the budget,
 * state->residency.limit_bytes. */
void gl_memory_limit(struct gl_state *state);

/* Call when a frame is planned. From time to time frees scratch memory that was much larger than
 * needed. A context must be current, here and below. */
void gl_memory_begin(struct gl_state *state);

/* Frees all scratch memory. Returns false if there was none. */
bool gl_memory_release(struct gl_state *state);

/* Call after scratch memory has grown. Evicts data of other frames until everything fits.
 * SP_ERR_BUDGET, with both numbers, if this is not enough. */
bool gl_memory_fit(struct gl_state *state, struct sp_error *err);

#endif
