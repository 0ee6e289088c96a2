/* SPDX-License-Identifier: Apache-2.0
 *
 * Include this after <cmocka.h>. With ThreadSanitizer, a test of one_thread_test() is skipped and
 * says so: one thread runs its code, or another test of the same file runs the same threads.
 */
#ifndef TESTS_SUPPORT_ONE_THREAD_H
#define TESTS_SUPPORT_ONE_THREAD_H

#include "support/sanitized.h"

static inline void one_thread_skip(void **state) {
    (void)state;
    print_message("skipped with ThreadSanitizer: one thread, or the threads of another test\n");
    skip();
}

/* In place of cmocka_unit_test(). */
#define one_thread_test(function)                                                                  \
    { #function, TEST_TSAN ? one_thread_skip : (function), NULL, NULL, NULL }

#endif
