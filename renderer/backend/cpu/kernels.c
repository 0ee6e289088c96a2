/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/cpu/kernels.h"

#include <stdio.h>
#include <string.h>

#include "base/cpu_features.h"

extern const struct cpu_kernels cpu_table_sse41, cpu_table_avx2, cpu_table_avx512, cpu_table_neon;

/* In rising order. table NULL = this program was compiled without it (kernels.cmake). */
static const struct {
    const char *name;
    uint32_t feature; /* SP_CPU_… that it needs; 0 = none */
    const struct cpu_kernels *table;
} isas[] = {
    { "scalar", 0, &cpu_table },
    { "sse41", SP_CPU_SSE41, SP_WITH_SSE41 ? &cpu_table_sse41 : NULL },
    { "avx2", SP_CPU_AVX2, SP_WITH_AVX2 ? &cpu_table_avx2 : NULL },
    { "avx512", SP_CPU_AVX512, SP_WITH_AVX512 ? &cpu_table_avx512 : NULL },
    { "neon", SP_CPU_NEON, SP_WITH_NEON ? &cpu_table_neon : NULL },
};
enum { ISAS = sizeof isas / sizeof isas[0] };

static bool can_run(unsigned i) {
    return isas[i].table && (isas[i].feature & ~sp_cpu_features()) == 0;
}

const char *cpu_isa_at(unsigned i) {
    return i < ISAS ? isas[i].name : NULL;
}

static bool refuse(const char *isa, bool is_known, struct sp_error *err) {
    char available[80] = "auto";
    for (unsigned i = 0; i < ISAS; i++)
        if (can_run(i)) {
            size_t n = strlen(available);
            snprintf(available + n, sizeof available - n, ", %s", isas[i].name);
        }
    if (is_known)
        return sp_fail(err, SP_ERR_UNSUPPORTED, "",
                       "this machine cannot run instruction set %s; available: %s", isa, available);
    return sp_fail(err, SP_ERR_INVALID, "", "unknown instruction set \"%.64s\"; available: %s", isa,
                   available);
}

bool cpu_kernels_init(struct cpu_kernels *kernels, const char *isa, struct sp_error *err) {
    bool is_auto = strcmp(isa, "auto") == 0, is_known = false;
    for (unsigned i = ISAS; i-- > 0;) {
        bool is_named = strcmp(isa, isas[i].name) == 0;
        is_known = is_known || is_named;
        if ((is_auto || is_named) && can_run(i)) {
            *kernels = *isas[i].table;
            return true;
        }
    }
    return refuse(isa, is_known, err);
}
