/* SPDX-License-Identifier: Apache-2.0
 *
 * Assertions on numbers that print both values. cmocka prints both for integers only, and compares
 * floating-point numbers with a tolerance.
 */
#ifndef TESTS_SUPPORT_COMPARE_H
#define TESTS_SUPPORT_COMPARE_H

/* Include after <cmocka.h>. Compares as double, so integers must be below 2^53:
 * assert_compare(a, <=, b). NaN fails every comparison but !=. */
#define assert_compare(a, op, b)                                                                   \
    do {                                                                                           \
        const double a_ = (double)(a), b_ = (double)(b);                                           \
        if (!(a_ op b_))                                                                           \
            fail_msg("%s " #op " %s fails: %.17g and %.17g", #a, #b, a_, b_);                      \
    } while (0)

#endif
