/* SPDX-License-Identifier: Apache-2.0
 *
 * Image memory. A pool creates reference-counted frames. It keeps the memory of released frames, up
 * to a cap, and reuses it, so that a stream of frames of one size allocates once. A frame and its
 * pixels are one block:
 *
 *   | struct block (the frame inside) | padding to 64 | pixels | depth, spread, if wanted |
 */
#ifndef SP_FRAME_POOL_H
#define SP_FRAME_POOL_H

#include "sp/frame.h"

/* Returns the number of calls of the system's allocator since the pool was created; constant in the
 * steady state. Thread-safe. */
uint64_t sp_frame_pool_allocations(struct sp_frame_pool *pool);

/* Returns the memory of released frames that the pool keeps for reuse [bytes], at most the cap.
 * Thread-safe. */
size_t sp_frame_pool_idle(struct sp_frame_pool *pool);

#endif
