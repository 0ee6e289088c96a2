/* SPDX-License-Identifier: Apache-2.0 */
#include "data/volume/slots.h"

#include <string.h>

#include "data/volume/volume.h"

static struct sp_slot *slot_at(const struct sp_slots *slots, void *array, size_t i) {
    return (struct sp_slot *)(void *)((char *)array + i * slots->size);
}

void sp_slots_empty(const struct sp_slots *slots, void *pointer) {
    struct sp_slot *slot = pointer;
    slots->finish(slot);
    sp_volume_unref(&slot->volume);
    sp_volume_unref(&slot->colors);
    memset(pointer, 0, slots->size);
}

void sp_slots_evict(const struct sp_slots *slots, void *array, const struct sp_volume *volume) {
    for (size_t i = 0; i < slots->count; i++) {
        struct sp_slot *slot = slot_at(slots, array, i);
        if (slot->volume && (sp_volume_is_of(slot->volume, volume) ||
                             (slot->colors && sp_volume_is_of(slot->colors, volume))))
            sp_slots_empty(slots, slot);
    }
}

uint64_t sp_slots_bytes(const struct sp_slots *slots, const void *array,
                        const struct sp_volume *volume) {
    uint64_t bytes = 0;
    for (size_t i = 0; i < slots->count; i++) {
        const struct sp_slot *slot =
            (const struct sp_slot *)(const void *)((const char *)array + i * slots->size);
        if (slot->volume && sp_volume_is_of(slot->volume, volume))
            bytes += slots->bytes(slot);
    }
    return bytes;
}

void *sp_slots_newest(const struct sp_slots *slots, void *array, const struct sp_volume *volume) {
    struct sp_slot *newest = NULL;
    for (size_t i = 0; i < slots->count; i++) {
        struct sp_slot *slot = slot_at(slots, array, i);
        if (slot->volume == volume && (!newest || slot->used > newest->used))
            newest = slot;
    }
    return newest;
}

static struct sp_slot *find_oldest(const struct sp_slots *slots, void *array, uint64_t until,
                                   const void *keep) {
    struct sp_slot *oldest = NULL;
    for (size_t i = 0; i < slots->count; i++) {
        struct sp_slot *slot = slot_at(slots, array, i);
        if (slot->volume && slot->used <= until && slot != keep &&
            (!oldest || slot->used < oldest->used))
            oldest = slot;
    }
    return oldest;
}

void *sp_slots_acquire(const struct sp_slots *slots, void *array, uint64_t until,
                       const void *keep) {
    for (size_t i = 0; i < slots->count; i++)
        if (!slot_at(slots, array, i)->volume)
            return slot_at(slots, array, i);
    struct sp_slot *oldest = find_oldest(slots, array, until, keep);
    if (oldest)
        sp_slots_empty(slots, oldest);
    return oldest;
}

void sp_slots_trim(const struct sp_slots *slots, void *array, uint64_t bytes_max, uint64_t until,
                   const void *keep) {
    struct sp_slot *oldest;
    while (sp_slots_bytes(slots, array, NULL) > bytes_max &&
           (oldest = find_oldest(slots, array, until, keep)))
        sp_slots_empty(slots, oldest);
}
