/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/cpu/caches.h"

uint64_t cpu_cache_bytes(const struct cpu_state *state, enum cpu_cache cache,
                         const struct sp_volume *volume) {
    switch (cache) {
    case CPU_CACHE_LISTS:
        return sp_classify_cache_bytes(&state->cache, volume);
    case CPU_CACHE_SAMPLES:
        return sp_samples_bytes(&state->samples, volume);
    case CPU_CACHE_LIGHT:
        return sp_light_bytes(&state->light, volume);
    case CPU_CACHE_SURFACES:
        return sp_surface_cache_bytes(&state->surfaces, volume);
    case CPU_CACHE_SHELLS:
        return sp_shell_bytes(&state->shells, volume);
    case CPU_CACHE_VECTORS:
        return sp_vectors_bytes(&state->vectors, volume);
    case CPU_CACHE_CLOUDS:
        return sp_cloud_bytes(&state->clouds, volume);
    case CPU_CACHES:
        break;
    }
    return 0;
}

uint64_t cpu_cache_rest(const struct cpu_state *state, enum cpu_cache cache) {
    uint64_t used = 0;
    for (enum cpu_cache other = 0; other < CPU_CACHES; other++)
        used += other == cache ? 0 : cpu_cache_bytes(state, other, NULL);
    return used < state->memory_bytes ? state->memory_bytes - used : 0;
}

void cpu_cache_evict(struct cpu_state *state, enum cpu_cache cache,
                     const struct sp_volume *volume) {
    switch (cache) {
    case CPU_CACHE_LISTS:
        sp_classify_cache_evict(&state->cache, volume);
        break;
    case CPU_CACHE_SAMPLES:
        sp_samples_evict(&state->samples, volume);
        break;
    case CPU_CACHE_LIGHT:
        sp_light_evict(&state->light, volume);
        break;
    case CPU_CACHE_SURFACES:
        sp_surface_cache_evict(&state->surfaces, volume);
        break;
    case CPU_CACHE_SHELLS:
        sp_shell_evict(&state->shells, volume);
        break;
    case CPU_CACHE_VECTORS:
        sp_vectors_evict(&state->vectors, volume);
        break;
    case CPU_CACHE_CLOUDS:
        sp_cloud_evict(&state->clouds, volume);
        break;
    case CPU_CACHES:
        break;
    }
}
