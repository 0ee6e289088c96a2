/* SPDX-License-Identifier: Apache-2.0
 *
 * Counts the memory allocations of this program. The linker (--wrap) replaces the allocation
 * functions of the C library by functions of allocations.c in all code that is linked statically,
 * the renderer included.
 */
#ifndef BENCH_ALLOCATIONS_H
#define BENCH_ALLOCATIONS_H

#include <stdint.h>

/* Returns the number of malloc, calloc, realloc and aligned_alloc calls so far, by all threads. */
uint64_t bench_allocations(void);

#endif
