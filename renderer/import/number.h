/* SPDX-License-Identifier: Apache-2.0
 *
 * Single numbers as files store them.
 */
#ifndef SP_IMPORT_NUMBER_H
#define SP_IMPORT_NUMBER_H

#include "import/format.h"

struct import_number import_number_of(enum sp_type type);

/* Converts a number in native byte order, which need not be aligned. */
double import_widen(const void *value, struct import_number number);

/* Reverses the bytes of `count` values of 1, 2, 4 or 8 bytes each (`size`). */
void import_swap(void *values, size_t size, uint64_t count);

/* The numbers that the kind can have; of a floating-point kind those of integers of its size. */
void import_number_range(struct import_number number, double *low, double *high);

#endif
