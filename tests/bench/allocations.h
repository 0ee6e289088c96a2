/* SPDX-License-Identifier: Apache-2.0
 *
 * How often this program asked for memory. The linker puts the functions of allocations.c in the
 * place of the C library's (--wrap) for everything that is linked statically: the renderer is.
 */
#ifndef BENCH_ALLOCATIONS_H
#define BENCH_ALLOCATIONS_H

#include <stdint.h>

/* Calls of malloc, calloc, realloc and aligned_alloc so far, by all threads. */
uint64_t bench_allocations(void);

#endif
