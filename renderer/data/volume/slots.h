/* SPDX-License-Identifier: Apache-2.0
 *
 * The slots of a cache of what is made from volumes; the least recently used is replaced first. A
 * slot is a struct that begins with struct sp_slot. An empty one is all zero.
 */
#ifndef SP_VOLUME_SLOTS_H
#define SP_VOLUME_SLOTS_H

#include <stddef.h>
#include <stdint.h>

#include "sp/volume.h"

struct sp_slot {
    struct sp_volume *volume; /* one reference; NULL = empty */
    struct sp_volume *colors; /* the same: has the colours; NULL = none */
    uint64_t used;            /* clock of the last use */
};

/* What is the same for all slots of an array. */
struct sp_slots {
    size_t count, size;                  /* of slots; bytes of a slot */
    void (*finish)(void *slot);          /* frees what the slot owns besides the references */
    uint64_t (*bytes)(const void *slot); /* of what a full slot owns */
};

/* The functions take the array. */

void sp_slots_empty(const struct sp_slots *slots, void *slot);

/* Empties the slots that are made from the volume, or have its colours; NULL = all slots. */
void sp_slots_evict(const struct sp_slots *slots, void *array, const struct sp_volume *volume);

/* Bytes that are made from the volume; NULL = of all volumes. */
uint64_t sp_slots_bytes(const struct sp_slots *slots, const void *array,
                        const struct sp_volume *volume);

/* The last used slot of exactly this volume; NULL = none. */
void *sp_slots_newest(const struct sp_slots *slots, void *array, const struct sp_volume *volume);

/* Returns an empty slot. If there is none, empties the least recently used one of those that were
 * last used at `until` or before and are not `keep`; NULL = none. */
void *sp_slots_acquire(const struct sp_slots *slots, void *array, uint64_t until, const void *keep);

/* Empties such slots, least recently used first, until all have at most `bytes_max`, as far as it
 * can. */
void sp_slots_trim(const struct sp_slots *slots, void *array, uint64_t bytes_max, uint64_t until,
                   const void *keep);

#endif
