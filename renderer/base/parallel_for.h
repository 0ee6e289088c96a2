/* SPDX-License-Identifier: Apache-2.0
 *
 * A pool of workers that claim blocks of an index range.
 *
 *   range [0, count)  ─► blocks of `grain`  ─► claimed one by one by workers 0 … threads-1
 *
 * Worker 0 is the calling thread; one thread runs the same code. Results must not depend on who did
 * which block, only on the block: then an image is bit-equal for any number of threads. Workers
 * flush denormals (FTZ, DAZ), and so does the caller for the length of a call. One loop at a time a
 * pool.
 */
#ifndef SP_BASE_PARALLEL_FOR_H
#define SP_BASE_PARALLEL_FOR_H

#include <stddef.h>

#include "sp/status.h"

struct sp_pool;

/* threads in [1, 256]; NULL with *err set when threads cannot be started. */
struct sp_pool *sp_pool_create(unsigned threads, struct sp_error *err);
void sp_pool_destroy(struct sp_pool **pool);
unsigned sp_pool_threads(const struct sp_pool *pool);

/* Handles [begin, end), at most `grain` long and starting at a multiple of it. `worker` < threads
 * is stable for the length of the call: use it to pick scratch memory. */
typedef void sp_block_fn(void *user, size_t begin, size_t end, unsigned worker);

/* Returns when every block is done. grain > 0; count may be 0. */
void sp_parallel_for(struct sp_pool *pool, size_t count, size_t grain, sp_block_fn *fn, void *user);

#endif
