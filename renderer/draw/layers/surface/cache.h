/* SPDX-License-Identifier: Apache-2.0
 *
 * The points of the iso-surfaces that frames have shown, and the ranges of the blocks of their
 * volumes. They are made when a frame first needs them. New entries replace the least recently used
 * ones, but never an entry that the current frame uses.
 */
#ifndef SP_SURFACE_CACHE_H
#define SP_SURFACE_CACHE_H

#include "data/volume/slots.h"
#include "draw/layers/surface/points.h"
#include "draw/layers/surface/ranges.h"

enum { SURFACE_VOLUMES = 8, SURFACE_LISTS = 32 };

struct sp_surface_cache {
    struct sp_surface_volume {
        struct sp_slot base;
        struct sp_surface_ranges ranges;
    } volumes[SURFACE_VOLUMES];
    struct sp_surface_list {
        struct sp_slot base;
        double value;
        struct sp_surface_points points; /* on one level of detail */
    } lists[SURFACE_LISTS];
    uint64_t clock;
    uint64_t frame; /* the clock when the current frame began */
};

struct sp_surface_cache_job {
    struct sp_volume *volume;
    double value;
    unsigned level; /* [0, SURFACE_LEVELS − 1]; merged from level 0, which the cache also keeps */
    uint64_t bytes_max; /* of the cache */
    struct sp_pool *pool;
    struct sp_interrupt interrupt;
};

/* Begins a frame: entries that the cache returned before may be evicted from now on. */
void sp_surface_cache_begin(struct sp_surface_cache *cache);

/* Returns the points, valid until the next frame begins or the volume is evicted. NULL with *err
 * set: SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED. */
const struct sp_surface_points *sp_surface_cache_get(struct sp_surface_cache *cache,
                                                     const struct sp_surface_cache_job *job,
                                                     struct sp_error *err);

/* Evict the cached data of the volume, or return its bytes; NULL = of all volumes. */
void sp_surface_cache_evict(struct sp_surface_cache *cache, const struct sp_volume *volume);
uint64_t sp_surface_cache_bytes(const struct sp_surface_cache *cache,
                                const struct sp_volume *volume);

#endif
