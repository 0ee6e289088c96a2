/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/vectors/cache.h"

#include "classify/transfer.h"
#include "data/volume/volume.h"
#include "draw/layers/splat_list/clip.h"

static void empty_slot(struct sp_vectors_slot *slot) {
    sp_voxel_list_finish(&slot->list);
    sp_volume_unref(&slot->volume);
    sp_volume_unref(&slot->colors);
    slot->used = 0;
}

static bool is_made_of(const struct sp_vectors_slot *slot, const struct sp_volume *volume) {
    return slot->volume && (sp_volume_is_of(slot->volume, volume) ||
                            (slot->colors && sp_volume_is_of(slot->colors, volume)));
}

void sp_vectors_evict(struct sp_vectors_cache *cache, const struct sp_volume *volume) {
    for (int i = 0; i < SP_VECTORS_SLOTS; i++)
        if (is_made_of(&cache->slots[i], volume))
            empty_slot(&cache->slots[i]);
}

uint64_t sp_vectors_bytes(const struct sp_vectors_cache *cache, const struct sp_volume *volume) {
    uint64_t bytes = 0;
    for (int i = 0; i < SP_VECTORS_SLOTS; i++)
        if (cache->slots[i].volume && sp_volume_is_of(cache->slots[i].volume, volume))
            bytes += sp_voxel_list_bytes(&cache->slots[i].list);
    return bytes;
}

/* The order and the reference length have no influence on a list. */
static bool is_wanted(const struct sp_vectors_slot *slot, const struct sp_volume *volume,
                      const struct sp_vectors_job *job) {
    if (slot->volume != volume || slot->density != job->density ||
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
    struct sp_vectors_slot *slot = &cache->slots[0];
    for (int i = 0; i < SP_VECTORS_SLOTS; i++) {
        if (is_wanted(&cache->slots[i], volume, job)) {
            cache->slots[i].used = ++cache->clock;
            return &cache->slots[i].list;
        }
        if (cache->slots[i].used < slot->used)
            slot = &cache->slots[i];
    }
    empty_slot(slot);
    if (!sp_vectors_extract(job, &slot->list, err))
        return NULL;
    slot->volume = sp_volume_ref(volume);
    slot->colors = job->coloring.volume ? sp_volume_ref(job->coloring.volume) : NULL;
    slot->coloring = job->coloring;
    slot->tf = *job->tf;
    slot->clip = *job->clip;
    slot->density = job->density;
    slot->used = ++cache->clock;
    for (int i = 0; i < SP_VECTORS_SLOTS && sp_vectors_bytes(cache, NULL) > job->bytes_max; i++)
        if (&cache->slots[i] != slot)
            empty_slot(&cache->slots[i]);
    return &slot->list;
}
