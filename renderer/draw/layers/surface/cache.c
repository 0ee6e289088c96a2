/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/surface/cache.h"

#include <stddef.h>

#include "data/volume/volume.h"
#include "draw/layers/surface/extract.h"
#include "draw/layers/surface/merge.h"

static void finish_volume(struct sp_surface_volume *slot) {
    sp_surface_ranges_finish(&slot->ranges);
    sp_volume_unref(&slot->volume);
    slot->used = 0;
}

static void finish_list(struct sp_surface_list *slot) {
    sp_surface_points_finish(&slot->points);
    sp_volume_unref(&slot->volume);
    slot->used = 0;
}

void sp_surface_cache_begin(struct sp_surface_cache *cache) {
    cache->frame = ++cache->clock;
}

void sp_surface_cache_evict(struct sp_surface_cache *cache, const struct sp_volume *volume) {
    for (int i = 0; i < SURFACE_VOLUMES; i++)
        if (cache->volumes[i].volume && sp_volume_is_of(cache->volumes[i].volume, volume))
            finish_volume(&cache->volumes[i]);
    for (int i = 0; i < SURFACE_LISTS; i++)
        if (cache->lists[i].volume && sp_volume_is_of(cache->lists[i].volume, volume))
            finish_list(&cache->lists[i]);
}

uint64_t sp_surface_cache_bytes(const struct sp_surface_cache *cache,
                                const struct sp_volume *volume) {
    uint64_t bytes = 0;
    for (int i = 0; i < SURFACE_VOLUMES; i++)
        if (cache->volumes[i].volume && sp_volume_is_of(cache->volumes[i].volume, volume))
            bytes += sp_surface_ranges_bytes(&cache->volumes[i].ranges);
    for (int i = 0; i < SURFACE_LISTS; i++)
        if (cache->lists[i].volume && sp_volume_is_of(cache->lists[i].volume, volume))
            bytes += sp_surface_points_bytes(&cache->lists[i].points);
    return bytes;
}

/* The least recently used list that the current frame does not use; NULL = none. */
static struct sp_surface_list *find_old_list(struct sp_surface_cache *cache) {
    struct sp_surface_list *oldest = NULL;
    for (int i = 0; i < SURFACE_LISTS; i++) {
        struct sp_surface_list *slot = &cache->lists[i];
        if (slot->volume && slot->used <= cache->frame && (!oldest || slot->used < oldest->used))
            oldest = slot;
    }
    return oldest;
}

/* Evicts lists, then ranges of other volumes, until at most `bytes` are used, as far as it can. */
static void evict_until(struct sp_surface_cache *cache, uint64_t bytes,
                        const struct sp_surface_volume *keep) {
    struct sp_surface_list *list;
    while (sp_surface_cache_bytes(cache, NULL) > bytes && (list = find_old_list(cache)))
        finish_list(list);
    for (int i = 0; i < SURFACE_VOLUMES && sp_surface_cache_bytes(cache, NULL) > bytes; i++)
        if (cache->volumes[i].volume && &cache->volumes[i] != keep)
            finish_volume(&cache->volumes[i]);
}

static struct sp_surface_volume *get_ranges(struct sp_surface_cache *cache,
                                            const struct sp_surface_cache_job *job,
                                            struct sp_error *err) {
    struct sp_surface_volume *oldest = &cache->volumes[0];
    for (int i = 0; i < SURFACE_VOLUMES; i++) {
        struct sp_surface_volume *slot = &cache->volumes[i];
        if (slot->volume == job->volume) {
            slot->used = ++cache->clock;
            return slot;
        }
        if (slot->used < oldest->used)
            oldest = slot;
    }
    const struct sp_surface_job own = { job->volume, job->value, job->pool, job->interrupt };
    if (oldest->volume)
        finish_volume(oldest);
    if (!sp_surface_ranges_init(&oldest->ranges, &own, err))
        return NULL;
    oldest->volume = sp_volume_ref(job->volume);
    oldest->used = ++cache->clock;
    return oldest;
}

/* Returns an empty slot, or one that is not used in this frame. A view has fewer layers than there
 * are slots. */
static struct sp_surface_list *find_slot(struct sp_surface_cache *cache) {
    for (int i = 0; i < SURFACE_LISTS; i++)
        if (!cache->lists[i].volume)
            return &cache->lists[i];
    struct sp_surface_list *slot = find_old_list(cache);
    if (slot)
        finish_list(slot);
    return slot;
}

/* Makes the points; finer: those of level 0, NULL = extracts them. */
static bool make_points(const struct sp_surface_cache *cache,
                        const struct sp_surface_cache_job *job,
                        const struct sp_surface_volume *volume,
                        const struct sp_surface_points *finer, struct sp_surface_points *points,
                        struct sp_error *err) {
    const struct sp_surface_job own = { job->volume, job->value, job->pool, job->interrupt };
    uint64_t used = sp_surface_cache_bytes(cache, NULL);
    uint64_t rest = used < job->bytes_max ? job->bytes_max - used : 0;
    return finer ? sp_surface_merge(finer, job->level, &own, rest, points, err)
                 : sp_surface_extract(points, &own, &volume->ranges, rest, err);
}

static const struct sp_surface_points *add_list(struct sp_surface_cache *cache,
                                                const struct sp_surface_cache_job *job,
                                                const struct sp_surface_points *finer,
                                                struct sp_error *err) {
    struct sp_surface_volume *volume = finer ? NULL : get_ranges(cache, job, err);
    struct sp_surface_list *slot = finer || volume ? find_slot(cache) : NULL;
    struct sp_surface_points points;
    struct sp_error why = { 0 };
    if (!slot)
        return NULL;
    for (int attempt = 0; !make_points(cache, job, volume, finer, &points, &why); attempt++) {
        if (why.code != SP_ERR_BUDGET || attempt) {
            if (err)
                *err = why;
            return NULL;
        }
        evict_until(cache, 0, volume); /* what the frame uses stays */
    }
    *slot =
        (struct sp_surface_list){ sp_volume_ref(job->volume), job->value, points, ++cache->clock };
    slot->points.made = slot->used;
    return &slot->points;
}

const struct sp_surface_points *sp_surface_cache_get(struct sp_surface_cache *cache,
                                                     const struct sp_surface_cache_job *job,
                                                     struct sp_error *err) {
    struct sp_surface_cache_job first = *job;
    const struct sp_surface_points *finer;
    for (int i = 0; i < SURFACE_LISTS; i++) {
        struct sp_surface_list *slot = &cache->lists[i];
        if (slot->volume != job->volume || slot->value != job->value ||
            slot->points.level != job->level)
            continue;
        slot->used = ++cache->clock;
        return &slot->points;
    }
    if (!job->level)
        return add_list(cache, job, NULL, err);
    first.level = 0;
    if (!(finer = sp_surface_cache_get(cache, &first, err)))
        return NULL;
    struct sp_error why = { 0 };
    const struct sp_surface_points *merged = add_list(cache, job, finer, &why);
    if (!merged && why.code == SP_ERR_BUDGET)
        return finer; /* slower, but right */
    if (!merged && err)
        *err = why;
    return merged;
}
