/* SPDX-License-Identifier: Apache-2.0
 *
 * Allocations that fail on request. splat_fake_memory() of tests/CMakeLists.txt makes the linker
 * replace malloc, calloc, realloc and aligned_alloc by the functions of this file, in all code that
 * is linked statically. Allocations of shared libraries never fail. Thread-safe.
 */
#ifndef TESTS_SUPPORT_FAKE_MEMORY_H
#define TESTS_SUPPORT_FAKE_MEMORY_H

#include <stdbool.h>
#include <stddef.h>

#include "support/sanitized.h"

enum memory_end { MEMORY_FAILS_ONCE, MEMORY_STAYS_OUT };

/* Lets the next n allocations succeed and the one after them fail. With MEMORY_STAYS_OUT, all later
 * allocations fail as well. */
void memory_fail_after(long n, enum memory_end end);
/* For a test that repeats the same code, each time with another allocation that fails. A place is
 * the chain of the innermost MEMORY_PLACE_CALLS calls. The first two allocations of each place
 * fail, each in a run of its own. In a loop, the second allocation belongs to the second round; if
 * it fails, the code must release what the first round made. memory_fail_at_place() lets the next
 * of these allocations fail once; memory_forget_places() starts again with the first place. */
enum { MEMORY_PLACE_CALLS = TEST_TSAN ? 4 : 16 }; /* TSan: a sample of the places */
void memory_fail_at_place(void);
void memory_forget_places(void);
/* Lets all allocations succeed again. Returns true if one has failed since memory_fail_after() or
 * memory_fail_at_place(). */
bool memory_restore(void);
/* Returns the size of the largest allocation since the last call [bytes]. */
size_t memory_consume_largest(void);
/* true: all allocations of the calling thread succeed, and none is counted. false: the default. */
void memory_exempt_thread(bool is_spared);

/* For the allocator of a library: counts one allocation. Returns false if it must fail. */
bool memory_is_available(void);
/* Makes SQLite's allocations fail as well (fake_sqlite.c). Call it before any function of SQLite.
 */
void memory_fake_sqlite(void);

#endif
