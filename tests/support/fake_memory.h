/* SPDX-License-Identifier: Apache-2.0
 *
 * Memory that runs out on request. splat_fake_memory() of tests/CMakeLists.txt has the linker put
 * this file's functions in the place of malloc, calloc, realloc and aligned_alloc, for everything
 * that is linked statically; what shared libraries ask for themselves is there. Thread-safe.
 */
#ifndef TESTS_SUPPORT_FAKE_MEMORY_H
#define TESTS_SUPPORT_FAKE_MEMORY_H

#include <stdbool.h>
#include <stddef.h>

enum memory_end { MEMORY_FAILS_ONCE, MEMORY_STAYS_OUT };

/* From here on n allocations succeed, and the one behind them does not; MEMORY_STAYS_OUT: nor do
 * all after it. */
void memory_run_out(long n, enum memory_end end);
/* All succeed again. Did one fail? */
bool memory_come_back(void);
/* The largest allocation since the last call. [bytes] */
size_t memory_take_largest(void);
/* From here on the calling thread's allocations succeed, and do not count; false: as at first. */
void memory_spare_thread(bool is_spared);

/* For a library's own allocator: may it allocate once more? */
bool memory_is_left(void);
/* SQLite's memory runs out, too (fake_sqlite.c); before anything else of SQLite is called. */
void memory_play_sqlite(void);

#endif
