/* SPDX-License-Identifier: Apache-2.0
 *
 * What this machine's processor and system can run, of what the kernels are compiled for.
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

/* Looked up at the first call. Any thread. */
uint32_t sp_cpu_features(void);

#endif
