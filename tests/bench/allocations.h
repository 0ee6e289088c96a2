/* SPDX-License-Identifier: Apache-2.0
 *
 * Counts the memory allocations of this program. The linker replaces the functions of the C library
 * by those of allocations.c (--wrap) in everything that is linked statically, which includes the
 * renderer.
 */
#ifndef BENCH_ALLOCATIONS_H
#define BENCH_ALLOCATIONS_H

#include <stdint.h>

/* Returns the number of malloc, calloc, realloc and aligned_alloc calls so far, by all threads. */
uint64_t bench_allocations(void);

#endif
