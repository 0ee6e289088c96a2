/* SPDX-License-Identifier: Apache-2.0
 *
 * The classifications that a backend caches; the least recently used is replaced first. A volume
 * can have several, so that sessions with different transfer functions do not undo each other's
 * work. Successive edits of one transfer function update the same classification.
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
    uint64_t made;        /* last serial number of lists and tables: see struct sp_level */
    uint64_t limit_bytes; /* of all slots; no single classification may need more */
};

/* Returns the classification of the volume under job->tf, up to date and valid until the next call.
 * The cache keeps a reference to the volume. NULL with *err set: SP_ERR_MEMORY, SP_ERR_BUDGET,
 * SP_ERR_CANCELLED. */
struct sp_classification *sp_classify_cache_get(struct sp_classify_cache *cache,
                                                struct sp_volume *volume,
                                                const struct sp_classify_job *job,
                                                struct sp_error *err);

/* Drops what is cached of the volume; NULL = of all volumes. */
void sp_classify_cache_evict(struct sp_classify_cache *cache, const struct sp_volume *volume);
uint64_t sp_classify_cache_bytes(const struct sp_classify_cache *cache,
                                 const struct sp_volume *volume);

#endif
