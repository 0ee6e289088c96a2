/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/cloud/cache.h"

#include <stdlib.h>

#include "data/volume/volume.h"
#include "draw/layers/cloud/colors.h"

static void empty_slot(struct sp_cloud_slot *slot) {
    sp_cloud_tree_finish(&slot->tree);
    sp_volume_unref(&slot->volume);
    slot->used = 0;
}

static void empty_colors(struct sp_cloud_colors *slot) {
    free(slot->numbers);
    sp_volume_unref(&slot->points);
    sp_volume_unref(&slot->colors);
    *slot = (struct sp_cloud_colors){ 0 };
}

static void evict_colors(struct sp_cloud_cache *cache, const struct sp_volume *volume) {
    for (int i = 0; i < SP_CLOUD_SLOTS; i++) {
        struct sp_cloud_colors *slot = &cache->colors[i];
        if (slot->points &&
            (sp_volume_is_of(slot->points, volume) || sp_volume_is_of(slot->colors, volume)))
            empty_colors(slot);
    }
}

void sp_cloud_evict(struct sp_cloud_cache *cache, const struct sp_volume *volume) {
    for (int i = 0; i < SP_CLOUD_SLOTS; i++)
        if (cache->slots[i].volume && sp_volume_is_of(cache->slots[i].volume, volume))
            empty_slot(&cache->slots[i]);
    evict_colors(cache, volume);
}

uint64_t sp_cloud_bytes(const struct sp_cloud_cache *cache, const struct sp_volume *volume) {
    uint64_t bytes = 0;
    for (int i = 0; i < SP_CLOUD_SLOTS; i++)
        if (cache->slots[i].volume && sp_volume_is_of(cache->slots[i].volume, volume))
            bytes += cache->slots[i].tree.bytes;
    for (int i = 0; i < SP_CLOUD_SLOTS; i++)
        if (cache->colors[i].points && sp_volume_is_of(cache->colors[i].points, volume))
            bytes += cache->colors[i].bytes;
    return bytes;
}

/* About what a tree takes while it is made: an order, places of 16 bytes, and a node per three
 * points. */
static uint64_t expected_bytes(uint32_t points) {
    return (uint64_t)points * (4 + 16 + sizeof(struct sp_cloud_node) / 3);
}

bool sp_cloud_cache_get(struct sp_cloud_cache *cache, struct sp_volume *volume, uint64_t bytes_max,
                        struct sp_pool *pool, const struct sp_interrupt *interrupt,
                        const struct sp_cloud_tree **tree, struct sp_error *err) {
    const struct sp_elements_shape *shape = &sp_volume_elements(volume)->shape;
    struct sp_cloud_slot *slot = &cache->slots[0];
    *tree = NULL;
    if (shape->kind != SP_KIND_POINTS || shape->count < SP_CLOUD_TREE_MIN ||
        expected_bytes(shape->count) > bytes_max)
        return true;
    for (int i = 0; i < SP_CLOUD_SLOTS; i++) {
        if (cache->slots[i].volume == volume) {
            cache->slots[i].used = ++cache->clock;
            *tree = &cache->slots[i].tree;
            return true;
        }
        if (cache->slots[i].used < slot->used)
            slot = &cache->slots[i];
    }
    empty_slot(slot);
    if (!sp_cloud_tree_build(volume, pool, interrupt, &slot->tree, err))
        return false;
    slot->volume = sp_volume_ref(volume);
    slot->used = ++cache->clock;
    *tree = &slot->tree;
    return true;
}

const struct sp_cloud_colors *
sp_cloud_cache_get_colors(struct sp_cloud_cache *cache, const struct sp_cloud *cloud,
                          const struct sp_cloud_tree *tree, struct sp_volume *points,
                          struct sp_volume *colors, struct sp_pool *pool,
                          const struct sp_interrupt *interrupt, struct sp_error *err) {
    struct sp_cloud_colors *slot = &cache->colors[0];
    const bool by_length = cloud->color_vectors != NULL;
    for (int i = 0; i < SP_CLOUD_SLOTS; i++) {
        struct sp_cloud_colors *at = &cache->colors[i];
        if (at->points == points && at->colors == colors && at->by_length == by_length) {
            at->used = ++cache->clock;
            return at;
        }
        slot = at->used < slot->used ? at : slot;
    }
    empty_colors(slot);
    const uint64_t bytes = tree->count * sizeof *slot->numbers;
    float *numbers = malloc(bytes + sizeof *numbers);
    if (!numbers)
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the colours of points");
    if (!numbers || !sp_cloud_merge_colors(cloud, tree, pool, interrupt, numbers, err)) {
        free(numbers);
        return NULL;
    }
    *slot = (struct sp_cloud_colors){ .points = sp_volume_ref(points),
                                      .colors = sp_volume_ref(colors),
                                      .by_length = by_length,
                                      .numbers = numbers,
                                      .bytes = bytes,
                                      .id = ++cache->clock };
    slot->used = slot->id;
    return slot;
}
