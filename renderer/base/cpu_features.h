/* SPDX-License-Identifier: Apache-2.0
 *
 * The instruction sets that the kernels are compiled for and that this machine can run: the
 * processor has them, and the system saves their registers.
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

/* Returns a mask of SP_CPU_…, looked up at the first call. Thread-safe. */
uint32_t sp_cpu_features(void);

#endif
