/* SPDX-License-Identifier: Apache-2.0
 *
 * What the CPU backend keeps of the volumes that it has drawn: a few classifications, the least
 * recently used replaced first. Several a volume, so that sessions with different transfer
 * functions do not undo each other's work; edits of one follow each other in the same.
 */
#ifndef SP_BACKEND_CPU_CACHE_H
#define SP_BACKEND_CPU_CACHE_H

#include "classify/classification.h"

enum { CPU_CACHE_SLOTS = 8 };

struct cpu_cache {
    struct cpu_slot {
        struct sp_classification c; /* c.volume == NULL: empty */
        uint64_t used;              /* clock of the last use */
        uint32_t repeats;           /* uses in a row for the transfer function that it has */
    } slots[CPU_CACHE_SLOTS];
    uint64_t clock;
    uint64_t limit_bytes; /* beyond this the least recently used go; one alone may not need more */
};

/* The classification of the volume under job->tf, brought up to date; the cache keeps a reference
 * to the volume. Valid until the next call. NULL with *err set: SP_ERR_MEMORY, SP_ERR_BUDGET,
 * SP_ERR_CANCELLED. */
struct sp_classification *cpu_cache_get(struct cpu_cache *cache, struct sp_volume *volume,
                                        const struct sp_classify_job *job, struct sp_error *err);

/* Drops what was derived from the volume; NULL = from any. */
void cpu_cache_forget(struct cpu_cache *cache, const struct sp_volume *volume);
uint64_t cpu_cache_bytes(const struct cpu_cache *cache, const struct sp_volume *volume);

#endif
