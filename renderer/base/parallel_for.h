/* SPDX-License-Identifier: Apache-2.0
 *
 * A pool of workers that claim blocks of an index range.
 *
 *   range [0, count)  ─► blocks of `grain`  ─► each claimed by one of the workers 0 … threads − 1
 *
 * Worker 0 is the calling thread; a pool of one thread runs the same code. A result may depend on
 * its block but not on the worker that computes it, so that an image is bit-equal for any number of
 * threads. During a loop, all workers and the caller flush denormals to zero (FTZ, DAZ). A pool
 * runs one loop at a time.
 */
#ifndef SP_BASE_PARALLEL_FOR_H
#define SP_BASE_PARALLEL_FOR_H

#include <stddef.h>

#include "sp/status.h"

struct sp_pool;

/* Creates a pool of `threads` workers, [1, 256], of which the caller is one. Returns NULL if
 * threads cannot be started: SP_ERR_MEMORY. */
struct sp_pool *sp_pool_create(unsigned threads, struct sp_error *err);
void sp_pool_destroy(struct sp_pool **pool);
unsigned sp_pool_threads(const struct sp_pool *pool);

/* Processes the block [begin, end). It starts at a multiple of `grain` and has at most `grain`
 * elements. No other thread has the same `worker`, [0, threads − 1], during the call: use it to
 * select scratch memory. */
typedef void sp_block_fn(void *user, size_t begin, size_t end, unsigned worker);

/* Calls fn() for every block and returns when all calls have returned. grain > 0; count may be 0.
 * One thread may use a pool at a time. */
void sp_parallel_for(struct sp_pool *pool, size_t count, size_t grain, sp_block_fn *fn, void *user);

#endif
