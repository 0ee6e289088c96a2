/* SPDX-License-Identifier: Apache-2.0
 *
 * The caches of the CPU backend for data of volumes. All caches share the backend's memory limit.
 */
#ifndef SP_BACKEND_CPU_CACHES_H
#define SP_BACKEND_CPU_CACHES_H

#include "backend/cpu/frame.h"

enum cpu_cache {
    CPU_CACHE_LISTS,    /* of visible voxels (classify/) */
    CPU_CACHE_SAMPLES,  /* of interpolated sheets (draw/resample/) */
    CPU_CACHE_LIGHT,    /* draw/light/ */
    CPU_CACHE_SURFACES, /* draw/layers/surface/ */
    CPU_CACHE_SHELLS,   /* draw/layers/shell/ */
    CPU_CACHE_VECTORS,  /* draw/layers/vectors/ */
    CPU_CACHE_CLOUDS,   /* draw/layers/cloud/ */
    CPU_CACHES
};

/* Returns the bytes that a cache holds of the volume; NULL = of all volumes. */
uint64_t cpu_cache_bytes(const struct cpu_state *state, enum cpu_cache cache,
                         const struct sp_volume *volume);

/* Returns the part of the backend's memory that the other caches leave to this cache [bytes]. */
uint64_t cpu_cache_rest(const struct cpu_state *state, enum cpu_cache cache);

/* Evicts the data of the volume from a cache; NULL = of all volumes. */
void cpu_cache_evict(struct cpu_state *state, enum cpu_cache cache, const struct sp_volume *volume);

#endif
