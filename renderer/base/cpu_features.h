/* SPDX-License-Identifier: Apache-2.0
 *
 * The instruction sets that kernels are compiled for and this machine can run. A set counts if the
 * processor supports it and the operating system saves its registers.
 */
#ifndef SP_BASE_CPU_FEATURES_H
#define SP_BASE_CPU_FEATURES_H

#include <stdint.h>

enum {
    SP_CPU_SSE41 = 1,
    SP_CPU_AVX2 = 2,   /* with FMA, F16C, BMI and BMI2 */
    SP_CPU_AVX512 = 4, /* F, BW, DQ and VL, and all of AVX2 */
    SP_CPU_NEON = 8,
};

/* Returns a mask of SP_CPU_…. The first call detects the features. Thread-safe. */
uint32_t sp_cpu_features(void);

#endif
