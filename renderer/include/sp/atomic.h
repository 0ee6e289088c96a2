/* SPDX-License-Identifier: Apache-2.0
 *
 * Atomic types that C and C++ callers can both declare. GCC and Clang give _Atomic T and
 * std::atomic<T> the same size, alignment and lock-free operations.
 */
#ifndef SP_ATOMIC_H
#define SP_ATOMIC_H

#ifdef __cplusplus
#include <atomic>
typedef std::atomic<bool> sp_atomic_bool;
typedef std::atomic<double> sp_atomic_double;
#else
#include <stdatomic.h>
typedef _Atomic _Bool sp_atomic_bool;
typedef _Atomic double sp_atomic_double;
#endif

#endif
