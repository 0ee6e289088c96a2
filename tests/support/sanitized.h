/* SPDX-License-Identifier: Apache-2.0
 *
 * Sanitizers make tests several times slower and do not look for wrong images. Where TEST_SANITIZED
 * is 1, image tests may draw fewer or smaller images; they then print this. TEST_TSAN is 1 with
 * ThreadSanitizer, which finds no leaks.
 */
#ifndef TESTS_SUPPORT_SANITIZED_H
#define TESTS_SUPPORT_SANITIZED_H

#if defined __SANITIZE_THREAD__
#define TEST_TSAN 1
#elif defined __has_feature
#if __has_feature(thread_sanitizer)
#define TEST_TSAN 1
#endif
#endif
#ifndef TEST_TSAN
#define TEST_TSAN 0
#endif

#if TEST_TSAN || defined __SANITIZE_ADDRESS__
#define TEST_SANITIZED 1
#elif defined __has_feature
#if __has_feature(address_sanitizer)
#define TEST_SANITIZED 1
#endif
#endif
#ifndef TEST_SANITIZED
#define TEST_SANITIZED 0
#endif

#endif
