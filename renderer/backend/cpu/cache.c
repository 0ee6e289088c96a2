/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/cpu/cache.h"

static void empty_slot(struct cpu_slot *slot) {
    if (slot->c.volume)
        sp_classification_finish(&slot->c);
    *slot = (struct cpu_slot){ 0 };
}

static struct cpu_slot *find_exact(struct cpu_cache *cache, const struct sp_volume *volume,
                                   const struct sp_transfer_function *tf) {
    for (int i = 0; i < CPU_CACHE_SLOTS; i++) {
        struct cpu_slot *slot = &cache->slots[i];
        if (slot->c.volume == volume &&
            sp_transfer_function_equal(&slot->c.levels[0].transfer.tf, tf))
            return slot;
    }
    return NULL;
}

/* A slot whose lists serve the transfer function although its colours differ. */
static bool find_similar(struct cpu_cache *cache, const struct sp_volume *volume,
                         const struct sp_transfer_function *tf, struct cpu_slot **found,
                         struct sp_error *err) {
    struct sp_transfer transfer;
    if (!sp_transfer_init(&transfer, tf, sp_volume_info(volume), err))
        return false;
    *found = NULL;
    for (int i = 0; i < CPU_CACHE_SLOTS; i++) {
        struct cpu_slot *slot = &cache->slots[i];
        if (slot->c.volume == volume &&
            sp_transfer_same_voxels(&slot->c.levels[0].transfer, &transfer))
            *found = slot;
    }
    sp_transfer_finish(&transfer);
    return true;
}

static struct cpu_slot *find_oldest(struct cpu_cache *cache, const struct cpu_slot *except) {
    struct cpu_slot *oldest = NULL;
    for (int i = 0; i < CPU_CACHE_SLOTS; i++) {
        struct cpu_slot *slot = &cache->slots[i];
        if (slot != except && (!oldest || slot->used < oldest->used))
            oldest = slot;
    }
    return oldest;
}

static void trim(struct cpu_cache *cache, const struct cpu_slot *in_use) {
    uint64_t bytes = 0;
    for (int i = 0; i < CPU_CACHE_SLOTS; i++)
        bytes += sp_classification_bytes(&cache->slots[i].c);
    for (int i = 0; i < CPU_CACHE_SLOTS && bytes > cache->limit_bytes; i++) {
        struct cpu_slot *slot = find_oldest(cache, in_use);
        bytes -= sp_classification_bytes(&slot->c);
        empty_slot(slot);
        slot->used = UINT64_MAX; /* so that the next round finds another */
    }
    for (int i = 0; i < CPU_CACHE_SLOTS; i++)
        if (!cache->slots[i].c.volume)
            cache->slots[i].used = 0;
}

/* The newest lists of the volume; NULL = none. */
static const struct cpu_slot *find_newest(const struct cpu_cache *cache,
                                          const struct sp_volume *volume) {
    const struct cpu_slot *newest = NULL;
    for (int i = 0; i < CPU_CACHE_SLOTS; i++) {
        const struct cpu_slot *slot = &cache->slots[i];
        if (slot->c.volume == volume && (!newest || slot->used > newest->used))
            newest = slot;
    }
    return newest;
}

struct sp_classification *cpu_cache_get(struct cpu_cache *cache, struct sp_volume *volume,
                                        const struct sp_classify_job *job, struct sp_error *err) {
    struct cpu_slot *slot = find_exact(cache, volume, job->tf);
    if (!slot && !find_similar(cache, volume, job->tf, &slot, err))
        return NULL;
    struct sp_classify_job derive = *job;
    if (!slot) {
        const struct cpu_slot *newest = find_newest(cache, volume);
        slot = find_oldest(cache, newest);
        empty_slot(slot);
        sp_classification_init(&slot->c, volume);
        derive.from = newest ? &newest->c : NULL;
    }
    slot->used = ++cache->clock;
    if (!sp_classification_update(&slot->c, &derive, err)) {
        empty_slot(slot);
        return NULL;
    }
    trim(cache, slot);
    return &slot->c;
}

void cpu_cache_forget(struct cpu_cache *cache, const struct sp_volume *volume) {
    for (int i = 0; i < CPU_CACHE_SLOTS; i++)
        if (!volume || cache->slots[i].c.volume == volume)
            empty_slot(&cache->slots[i]);
}

uint64_t cpu_cache_bytes(const struct cpu_cache *cache, const struct sp_volume *volume) {
    uint64_t bytes = 0;
    for (int i = 0; i < CPU_CACHE_SLOTS; i++)
        if (cache->slots[i].c.volume == volume)
            bytes += sp_classification_bytes(&cache->slots[i].c);
    return bytes;
}
