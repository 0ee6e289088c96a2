/* SPDX-License-Identifier: Apache-2.0
 *
 * Sorts the elements of a cloud by depth on the GPU, as draw/layers/cloud/order.c does: a radix
 * sort in three passes of 8 bits.
 *
 *   compute_depths  element ─► depth, infinite if the camera does not see it; range of depths
 *   count_digits    counts by digit and work group ┐
 *   scan_digits     where they begin               │ per digit
 *   move_items      items in order of the digit    ┘
 */
#ifndef GL_DEPTH_ORDER_H
#define GL_DEPTH_ORDER_H

#include "backend/gl/state.h"

/* Compiles the programs at the first use. SP_ERR_UNSUPPORTED. A context must be current, here and
 * below. */
bool gl_depth_order_open(struct gl_state *state, struct sp_error *err);

/* Reserves memory for `count` elements. SP_ERR_MEMORY, SP_ERR_BUDGET. */
bool gl_depth_order_reserve(struct gl_state *state, uint32_t count, struct sp_error *err);

/* Sorts the elements of a layer, which are in the buffer `elements` (shaders/cloud.glsl). Fills
 * `order` with their numbers, front to back, and then 0xffffffff for each element that the camera
 * does not see. `choice`: the chosen elements; NULL = all elements. */
void gl_depth_order_make(struct gl_state *state, const struct gl_splats_made *made,
                         const struct gl_buffer *elements, const struct gl_buffer *choice,
                         const struct gl_buffer *order);

void gl_depth_order_finish(struct gl_state *state);

#endif
