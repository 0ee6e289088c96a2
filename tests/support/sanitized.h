/* SPDX-License-Identifier: Apache-2.0
 *
 * Sanitizers make tests several times slower and do not look for wrong images. Where TEST_SANITIZED
 * is 1, image tests may draw fewer or smaller images; they then print this. TEST_ASAN is 1 with
 * AddressSanitizer, the only one that finds leaks.
 */
#ifndef TESTS_SUPPORT_SANITIZED_H
#define TESTS_SUPPORT_SANITIZED_H

#if defined __SANITIZE_ADDRESS__
#define TEST_ASAN 1
#elif defined __has_feature
#if __has_feature(address_sanitizer)
#define TEST_ASAN 1
#endif
#endif
#ifndef TEST_ASAN
#define TEST_ASAN 0
#endif

#if TEST_ASAN || defined __SANITIZE_THREAD__
#define TEST_SANITIZED 1
#elif defined __has_feature
#if __has_feature(thread_sanitizer)
#define TEST_SANITIZED 1
#endif
#endif
#ifndef TEST_SANITIZED
#define TEST_SANITIZED 0
#endif

#endif
