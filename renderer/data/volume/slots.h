/* SPDX-License-Identifier: Apache-2.0
 *
 * The slots of a cache of data that is computed from volumes. The least recently used slot is
 * replaced first. A slot is a struct that begins with struct sp_slot. An empty slot is all zero.
 */
#ifndef SP_VOLUME_SLOTS_H
#define SP_VOLUME_SLOTS_H

#include <stddef.h>
#include <stdint.h>

#include "sp/volume.h"

struct sp_slot {
    struct sp_volume *volume; /* one reference; NULL = empty */
    struct sp_volume *colors; /* one reference to the volume that gives the colours; NULL = none */
    uint64_t used;            /* clock of the last use */
};

/* The description of an array of slots. */
struct sp_slots {
    size_t count, size;                  /* number of slots; bytes of a slot */
    void (*finish)(void *slot);          /* frees what the slot owns besides the references */
    uint64_t (*bytes)(const void *slot); /* bytes that a full slot owns */
};

/* `array` is the array of slots. */

void sp_slots_empty(const struct sp_slots *slots, void *slot);

/* Empties the slots whose data comes from the volume or has its colours; NULL = all slots. */
void sp_slots_evict(const struct sp_slots *slots, void *array, const struct sp_volume *volume);

/* Returns the bytes of data that comes from the volume; NULL = from all volumes. */
uint64_t sp_slots_bytes(const struct sp_slots *slots, const void *array,
                        const struct sp_volume *volume);

/* Returns the most recently used slot of exactly this volume; NULL = none. */
void *sp_slots_newest(const struct sp_slots *slots, void *array, const struct sp_volume *volume);

/* Returns an empty slot. If there is none, empties the least recently used slot that was last used
 * at `until` or before and is not `keep`. NULL = there is no such slot. */
void *sp_slots_acquire(const struct sp_slots *slots, void *array, uint64_t until, const void *keep);

/* Empties slots that were last used at `until` or before and are not `keep`, the least recently
 * used first, until all slots together have at most `bytes_max`, or none is left. */
void sp_slots_trim(const struct sp_slots *slots, void *array, uint64_t bytes_max, uint64_t until,
                   const void *keep);

#endif
