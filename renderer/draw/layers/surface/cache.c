/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/surface/cache.h"

#include <stddef.h>

#include "data/volume/volume.h"
#include "draw/layers/surface/extract.h"
#include "draw/layers/surface/merge.h"

static void finish_ranges(void *pointer) {
    struct sp_surface_volume *slot = pointer;
    sp_surface_ranges_finish(&slot->ranges);
}

static uint64_t range_bytes(const void *pointer) {
    const struct sp_surface_volume *slot = pointer;
    return sp_surface_ranges_bytes(&slot->ranges);
}

static void finish_points(void *pointer) {
    struct sp_surface_list *slot = pointer;
    sp_surface_points_finish(&slot->points);
}

static uint64_t point_bytes(const void *pointer) {
    const struct sp_surface_list *slot = pointer;
    return sp_surface_points_bytes(&slot->points);
}

static const struct sp_slots ranges = { SURFACE_VOLUMES, sizeof(struct sp_surface_volume),
                                        finish_ranges, range_bytes };
static const struct sp_slots lists = { SURFACE_LISTS, sizeof(struct sp_surface_list), finish_points,
                                       point_bytes };

void sp_surface_cache_begin(struct sp_surface_cache *cache) {
    cache->frame = ++cache->clock;
}

void sp_surface_cache_evict(struct sp_surface_cache *cache, const struct sp_volume *volume) {
    sp_slots_evict(&ranges, cache->volumes, volume);
    sp_slots_evict(&lists, cache->lists, volume);
}

uint64_t sp_surface_cache_bytes(const struct sp_surface_cache *cache,
                                const struct sp_volume *volume) {
    return sp_slots_bytes(&ranges, cache->volumes, volume) +
           sp_slots_bytes(&lists, cache->lists, volume);
}

static struct sp_surface_volume *get_ranges(struct sp_surface_cache *cache,
                                            const struct sp_surface_cache_job *job,
                                            struct sp_error *err) {
    const struct sp_surface_job own = { job->volume, job->value, job->pool, job->interrupt };
    struct sp_surface_volume *slot = sp_slots_newest(&ranges, cache->volumes, job->volume);
    if (!slot) {
        slot = sp_slots_acquire(&ranges, cache->volumes, UINT64_MAX, NULL);
        if (!sp_surface_ranges_init(&slot->ranges, &own, err))
            return NULL;
        slot->base.volume = sp_volume_ref(job->volume);
    }
    slot->base.used = ++cache->clock;
    return slot;
}

/* Makes the points of a level. finer: the points of level 0 to merge; NULL = extracts points from
 * the volume. */
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
    /* A view has fewer layers than there are slots. */
    struct sp_surface_list *slot =
        finer || volume ? sp_slots_acquire(&lists, cache->lists, cache->frame, NULL) : NULL;
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
        /* What the frame uses stays. */
        sp_slots_trim(&lists, cache->lists, 0, cache->frame, NULL);
        sp_slots_trim(&ranges, cache->volumes, 0, UINT64_MAX, volume);
    }
    *slot = (struct sp_surface_list){ .base = { .volume = sp_volume_ref(job->volume),
                                                .used = ++cache->clock },
                                      .value = job->value,
                                      .points = points };
    slot->points.made = slot->base.used;
    return &slot->points;
}

const struct sp_surface_points *sp_surface_cache_get(struct sp_surface_cache *cache,
                                                     const struct sp_surface_cache_job *job,
                                                     struct sp_error *err) {
    struct sp_surface_cache_job first = *job;
    const struct sp_surface_points *finer;
    for (int i = 0; i < SURFACE_LISTS; i++) {
        struct sp_surface_list *slot = &cache->lists[i];
        if (slot->base.volume != job->volume || slot->value != job->value ||
            slot->points.level != job->level)
            continue;
        slot->base.used = ++cache->clock;
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
