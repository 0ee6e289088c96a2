/* SPDX-License-Identifier: Apache-2.0
 *
 * What a backend keeps of the volumes that it has drawn: a few classifications, the least recently
 * used replaced first. Several a volume, so that sessions with different transfer
 * functions do not undo each other's work; edits of one follow each other in the same.
 */
#ifndef SP_CLASSIFY_CACHE_H
#define SP_CLASSIFY_CACHE_H

#include "classify/classification.h"

enum { SP_CLASSIFY_SLOTS = 8 };

struct sp_classify_cache {
    struct sp_classify_slot {
        struct sp_classification c; /* c.volume == NULL: empty */
        uint64_t used;              /* clock of the last use */
        uint32_t repeats;           /* uses in a row for the transfer function that it has */
    } slots[SP_CLASSIFY_SLOTS];
    uint64_t clock;
    uint64_t made;        /* lists and tables, so far: see struct sp_level */
    uint64_t limit_bytes; /* beyond this the least recently used go; one alone may not need more */
};

/* The classification of the volume under job->tf, brought up to date; the cache keeps a reference
 * to the volume. Valid until the next call. NULL with *err set: SP_ERR_MEMORY, SP_ERR_BUDGET,
 * SP_ERR_CANCELLED. */
struct sp_classification *sp_classify_cache_get(struct sp_classify_cache *cache,
                                                struct sp_volume *volume,
                                                const struct sp_classify_job *job,
                                                struct sp_error *err);

/* Drops what was derived from the volume; NULL = from any. */
void sp_classify_cache_evict(struct sp_classify_cache *cache, const struct sp_volume *volume);
uint64_t sp_classify_cache_bytes(const struct sp_classify_cache *cache,
                                 const struct sp_volume *volume);

#endif
