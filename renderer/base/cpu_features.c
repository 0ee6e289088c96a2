/* SPDX-License-Identifier: Apache-2.0 */
#include "base/cpu_features.h"

#include <stdatomic.h>

enum { LOOKED_UP = 1 << 30 };

static atomic_uint cpu_mask; /* 0 = not detected yet */

#if defined __x86_64__
#include <cpuid.h>

/* The compiler's builtin also checks that the system saves the wide registers. */
static uint32_t look_up(void) {
    uint32_t mask = 0;
    unsigned a = 0, b = 0, c = 0, d = 0;
    __builtin_cpu_init();
    if (__builtin_cpu_supports("sse4.1"))
        mask |= SP_CPU_SSE41;
    __get_cpuid(1, &a, &b, &c, &d);
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") &&
        __builtin_cpu_supports("bmi") && __builtin_cpu_supports("bmi2") && (c & bit_F16C))
        mask |= SP_CPU_AVX2;
    if ((mask & SP_CPU_AVX2) && __builtin_cpu_supports("avx512f") &&
        __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512dq") &&
        __builtin_cpu_supports("avx512vl"))
        mask |= SP_CPU_AVX512;
    return mask;
}
#elif defined __aarch64__
static uint32_t look_up(void) {
    return SP_CPU_NEON;
}
#else
static uint32_t look_up(void) {
    return 0;
}
#endif

uint32_t sp_cpu_features(void) {
    unsigned mask = atomic_load_explicit(&cpu_mask, memory_order_relaxed);
    if (!mask) {
        mask = look_up() | LOOKED_UP; /* a race is harmless: all threads find the same mask */
        atomic_store_explicit(&cpu_mask, mask, memory_order_relaxed);
    }
    return mask & ~(uint32_t)LOOKED_UP;
}
