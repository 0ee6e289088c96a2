/* SPDX-License-Identifier: Apache-2.0
 *
 * The classifications that a backend caches. A new one replaces the least recently used one. A
 * volume can have several classifications, so that sessions with different transfer functions do
 * not undo each other's work. Successive edits of one transfer function update the same
 * classification.
 */
#ifndef SP_CLASSIFY_CACHE_H
#define SP_CLASSIFY_CACHE_H

#include "classify/classification.h"
#include "data/volume/slots.h"

enum { SP_CLASSIFY_SLOTS = 8 };

struct sp_classify_cache {
    struct sp_classify_slot {
        struct sp_slot base;
        struct sp_classification c;
        uint32_t repeats; /* successive uses without a change of the transfer function */
    } slots[SP_CLASSIFY_SLOTS];
    uint64_t clock;
    uint64_t made;        /* last serial number given to a list or table: see struct sp_level */
    uint64_t limit_bytes; /* limit of all slots together, and so of each classification */
};

/* Returns the classification of the volume under job->tf. It is up to date, belongs to the cache
 * and is valid until the next call. The cache keeps a reference to the volume. NULL with *err set:
 * SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED. */
struct sp_classification *sp_classify_cache_get(struct sp_classify_cache *cache,
                                                struct sp_volume *volume,
                                                const struct sp_classify_job *job,
                                                struct sp_error *err);

/* Evict the classifications of the volume, or return their bytes; NULL = of all volumes. */
void sp_classify_cache_evict(struct sp_classify_cache *cache, const struct sp_volume *volume);
uint64_t sp_classify_cache_bytes(const struct sp_classify_cache *cache,
                                 const struct sp_volume *volume);

#endif
