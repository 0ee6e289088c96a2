/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SP_BASE_COMPARE_H
#define SP_BASE_COMPARE_H

/* Comparison function for qsort(): sorts doubles in rising order. No value may be NaN. */
static inline int sp_compare_doubles(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

#endif
