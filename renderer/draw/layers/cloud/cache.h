/* SPDX-License-Identifier: Apache-2.0
 *
 * The levels of detail of points that a backend caches: trees, and the numbers that give the
 * colours of their merged points.
 */
#ifndef SP_CLOUD_CACHE_H
#define SP_CLOUD_CACHE_H

#include "data/volume/slots.h"
#include "draw/layers/cloud/kernels.h"
#include "sp/view.h"

/* Volumes with fewer points have no tree. */
#define SP_CLOUD_TREE_MIN 100000u

/* The trees that a backend caches; the least recently used is replaced first. */
enum { SP_CLOUD_SLOTS = SP_LAYERS_MAX }; /* so that all layers of a view keep their trees */
struct sp_cloud_cache {
    struct sp_cloud_slot {
        struct sp_slot base;
        struct sp_cloud_tree tree;
    } slots[SP_CLOUD_SLOTS];
    /* Numbers that give the colours of merged points (colors.h). */
    struct sp_cloud_colors {
        struct sp_slot base;
        bool by_length;
        float *numbers; /* by node of the tree, owned */
        uint64_t bytes;
        uint64_t id; /* serial number, unique in the cache */
    } colors[SP_CLOUD_SLOTS];
    uint64_t clock;
};

/* Sets *tree to the volume's tree. The tree belongs to the cache; it is valid until SP_CLOUD_SLOTS
 * other trees are requested or the volume is evicted. *tree is NULL if the volume needs no tree, or
 * if the tree would not fit into `bytes_max`. False with *err set: SP_ERR_MEMORY,
 * SP_ERR_CANCELLED. */
bool sp_cloud_cache_get(struct sp_cloud_cache *cache, struct sp_volume *volume, uint64_t bytes_max,
                        struct sp_pool *pool, const struct sp_interrupt *interrupt,
                        const struct sp_cloud_tree **tree, struct sp_error *err);
/* Returns the numbers of merged points for a layer of `points` whose colours come from `colors`.
 * They are valid until SP_CLOUD_SLOTS others are requested or one of the volumes is evicted. NULL
 * with *err set: errors as above. */
const struct sp_cloud_colors *
sp_cloud_cache_get_colors(struct sp_cloud_cache *cache, const struct sp_cloud *cloud,
                          const struct sp_cloud_tree *tree, struct sp_volume *points,
                          struct sp_volume *colors, struct sp_pool *pool,
                          const struct sp_interrupt *interrupt, struct sp_error *err);

/* Evict the trees of the volume and the numbers that come from it, or return their bytes; NULL = of
 * all volumes. */
void sp_cloud_evict(struct sp_cloud_cache *cache, const struct sp_volume *volume);
uint64_t sp_cloud_bytes(const struct sp_cloud_cache *cache, const struct sp_volume *volume);

#endif
