/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/cloud/cache.h"

#include <stdlib.h>

#include "data/volume/volume.h"
#include "draw/layers/cloud/colors.h"

static void finish_tree(void *pointer) {
    struct sp_cloud_slot *slot = pointer;
    sp_cloud_tree_finish(&slot->tree);
}

static uint64_t tree_bytes(const void *pointer) {
    const struct sp_cloud_slot *slot = pointer;
    return slot->tree.bytes;
}

static void finish_colors(void *pointer) {
    struct sp_cloud_colors *slot = pointer;
    free(slot->numbers);
}

static uint64_t color_bytes(const void *pointer) {
    const struct sp_cloud_colors *slot = pointer;
    return slot->bytes;
}

static const struct sp_slots trees = { SP_CLOUD_SLOTS, sizeof(struct sp_cloud_slot), finish_tree,
                                       tree_bytes };
static const struct sp_slots numbers = { SP_CLOUD_SLOTS, sizeof(struct sp_cloud_colors),
                                         finish_colors, color_bytes };

void sp_cloud_evict(struct sp_cloud_cache *cache, const struct sp_volume *volume) {
    sp_slots_evict(&trees, cache->slots, volume);
    sp_slots_evict(&numbers, cache->colors, volume);
}

uint64_t sp_cloud_bytes(const struct sp_cloud_cache *cache, const struct sp_volume *volume) {
    return sp_slots_bytes(&trees, cache->slots, volume) +
           sp_slots_bytes(&numbers, cache->colors, volume);
}

/* About the memory of a tree while it is made: an order, places of 16 bytes, and a node per three
 * points. */
static uint64_t expected_bytes(uint32_t points) {
    return (uint64_t)points * (4 + 16 + sizeof(struct sp_cloud_node) / 3);
}

bool sp_cloud_cache_get(struct sp_cloud_cache *cache, struct sp_volume *volume, uint64_t bytes_max,
                        struct sp_pool *pool, const struct sp_interrupt *interrupt,
                        const struct sp_cloud_tree **tree, struct sp_error *err) {
    const struct sp_elements_shape *shape = &sp_volume_elements(volume)->shape;
    *tree = NULL;
    if (shape->kind != SP_KIND_POINTS || shape->count < SP_CLOUD_TREE_MIN ||
        expected_bytes(shape->count) > bytes_max)
        return true;
    struct sp_cloud_slot *slot = sp_slots_newest(&trees, cache->slots, volume);
    if (!slot) {
        slot = sp_slots_acquire(&trees, cache->slots, UINT64_MAX, NULL);
        if (!sp_cloud_tree_build(volume, pool, interrupt, &slot->tree, err))
            return false;
        slot->base.volume = sp_volume_ref(volume);
    }
    slot->base.used = ++cache->clock;
    *tree = &slot->tree;
    return true;
}

const struct sp_cloud_colors *
sp_cloud_cache_get_colors(struct sp_cloud_cache *cache, const struct sp_cloud *cloud,
                          const struct sp_cloud_tree *tree, struct sp_volume *points,
                          struct sp_volume *colors, struct sp_pool *pool,
                          const struct sp_interrupt *interrupt, struct sp_error *err) {
    const bool by_length = cloud->color_vectors != NULL;
    for (int i = 0; i < SP_CLOUD_SLOTS; i++) {
        struct sp_cloud_colors *at = &cache->colors[i];
        if (at->base.volume == points && at->base.colors == colors && at->by_length == by_length) {
            at->base.used = ++cache->clock;
            return at;
        }
    }
    struct sp_cloud_colors *slot = sp_slots_acquire(&numbers, cache->colors, UINT64_MAX, NULL);
    slot->bytes = tree->count * sizeof *slot->numbers;
    slot->numbers = malloc(slot->bytes + sizeof *slot->numbers);
    if (!slot->numbers)
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the colours of points");
    if (!slot->numbers ||
        !sp_cloud_merge_colors(cloud, tree, pool, interrupt, slot->numbers, err)) {
        sp_slots_empty(&numbers, slot);
        return NULL;
    }
    slot->base = (struct sp_slot){ sp_volume_ref(points), sp_volume_ref(colors), ++cache->clock };
    slot->by_length = by_length;
    slot->id = slot->base.used;
    return slot;
}
