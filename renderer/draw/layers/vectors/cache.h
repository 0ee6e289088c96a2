/* SPDX-License-Identifier: Apache-2.0
 *
 * The lists of vectors that a backend caches. A new one replaces the least recently used one. The
 * phase, the style and the stretch of a layer do not change its list, so that an animation only
 * costs the drawing.
 */
#ifndef SP_VECTORS_CACHE_H
#define SP_VECTORS_CACHE_H

#include "data/volume/slots.h"
#include "draw/layers/vectors/extract.h"

enum { SP_VECTORS_SLOTS = 2 };

struct sp_vectors_cache {
    struct sp_vectors_slot {
        struct sp_slot base;
        struct sp_coloring coloring;
        struct sp_transfer_function tf;
        struct sp_clip clip;
        double density;
        struct sp_voxel_list list;
    } slots[SP_VECTORS_SLOTS];
    uint64_t clock;
};

/* Returns the list. It belongs to the cache and is valid until the next call. job->bytes_max limits
 * the whole cache. NULL with *err set: SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED. */
const struct sp_voxel_list *sp_vectors_cache_get(struct sp_vectors_cache *cache,
                                                 struct sp_volume *volume,
                                                 const struct sp_vectors_job *job,
                                                 struct sp_error *err);

/* Evict the cached data of the volume, or return its bytes; NULL = of all volumes. */
void sp_vectors_evict(struct sp_vectors_cache *cache, const struct sp_volume *volume);
uint64_t sp_vectors_bytes(const struct sp_vectors_cache *cache, const struct sp_volume *volume);

#endif
