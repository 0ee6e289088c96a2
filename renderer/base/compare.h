/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SP_BASE_COMPARE_H
#define SP_BASE_COMPARE_H

/* For qsort() of doubles that are not NaN: they rise. */
static inline int sp_compare_doubles(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

#endif
