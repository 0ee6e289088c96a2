/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/vectors/cache.h"

#include "classify/transfer.h"
#include "data/volume/volume.h"
#include "draw/layers/splat_list/clip.h"

static void finish_slot(void *pointer) {
    struct sp_vectors_slot *slot = pointer;
    sp_voxel_list_finish(&slot->list);
}

static uint64_t slot_bytes(const void *pointer) {
    const struct sp_vectors_slot *slot = pointer;
    return sp_voxel_list_bytes(&slot->list);
}

static const struct sp_slots slots = { SP_VECTORS_SLOTS, sizeof(struct sp_vectors_slot),
                                       finish_slot, slot_bytes };

void sp_vectors_evict(struct sp_vectors_cache *cache, const struct sp_volume *volume) {
    sp_slots_evict(&slots, cache->slots, volume);
}

uint64_t sp_vectors_bytes(const struct sp_vectors_cache *cache, const struct sp_volume *volume) {
    return sp_slots_bytes(&slots, cache->slots, volume);
}

/* The order and the reference length have no influence on a list. */
static bool is_wanted(const struct sp_vectors_slot *slot, const struct sp_volume *volume,
                      const struct sp_vectors_job *job) {
    if (slot->base.volume != volume || slot->density != job->density ||
        !sp_coloring_equal(&slot->coloring, &job->coloring) ||
        !sp_voxel_clip_equal(&slot->clip, job->clip))
        return false;
    struct sp_transfer_function wanted = *job->tf;
    wanted.order = slot->tf.order;
    wanted.reference_length = slot->tf.reference_length;
    return sp_transfer_function_equal(&slot->tf, &wanted);
}

const struct sp_voxel_list *sp_vectors_cache_get(struct sp_vectors_cache *cache,
                                                 struct sp_volume *volume,
                                                 const struct sp_vectors_job *job,
                                                 struct sp_error *err) {
    for (int i = 0; i < SP_VECTORS_SLOTS; i++)
        if (is_wanted(&cache->slots[i], volume, job)) {
            cache->slots[i].base.used = ++cache->clock;
            return &cache->slots[i].list;
        }
    struct sp_vectors_slot *slot = sp_slots_acquire(&slots, cache->slots, UINT64_MAX, NULL);
    if (!sp_vectors_extract(job, &slot->list, err))
        return NULL;
    slot->base =
        (struct sp_slot){ sp_volume_ref(volume),
                          job->coloring.volume ? sp_volume_ref(job->coloring.volume) : NULL,
                          ++cache->clock };
    slot->coloring = job->coloring;
    slot->tf = *job->tf;
    slot->clip = *job->clip;
    slot->density = job->density;
    sp_slots_trim(&slots, cache->slots, job->bytes_max, UINT64_MAX, slot);
    return &slot->list;
}
