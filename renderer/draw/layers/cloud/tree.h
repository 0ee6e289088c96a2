/* SPDX-License-Identifier: Apache-2.0
 *
 * Levels of detail of points: an octree in which each cell has one merged point that represents all
 * points inside (Laur and Hanrahan 1991). Far away, or while a view moves, the merged point is
 * drawn instead of the points.
 *
 *   cell ─┬─ up to eight cells of half the side ─┬─ …        merged point of a cell:
 *         │                                      │             position  mean, weighted by volume
 *         └─ …                                   └─ points     value     the same
 *                                                              volume    sum
 *                                                              variance  of kernels and places
 */
#ifndef SP_CLOUD_TREE_H
#define SP_CLOUD_TREE_H

#include "draw/layers/cloud/tree_cells.h"

/* A merged point is classified as if its values were spread evenly around their mean.
 * SP_CLOUD_SHARES equal parts of this distribution are classified at their middles [standard
 * deviations from the mean]. */
enum { SP_CLOUD_SHARES = 4 };
static const float sp_cloud_share_at[SP_CLOUD_SHARES] = { -1.299038f, -0.433013f, 0.433013f,
                                                          1.299038f };

enum { SP_CLOUD_BINS = 4096 }; /* bins of the values of a tree */

/* A cell and its merged point. A node is one cache line, because frames read nodes that lie far
 * apart in memory. */
struct sp_cloud_node {
    _Alignas(64) struct sp_cloud_cell cell;
    float position[3], factor[6], value, volume; /* of the merged point, as in struct sp_elements */
    /* Bounds of the merged point and all points inside. */
    union {
        struct {
            uint32_t low : 12, high : 12; /* bins of their values */
            uint32_t spread : 8;          /* of their values (sp_cloud_spread()) */
        };
        uint32_t values; /* the three as one word, for shaders/cloud.glsl */
    };
    uint16_t reach;     /* at least their distance from the merged point (sp_cloud_bound()) */
    uint16_t deviation; /* at least the deviation of their kernels along any line; likewise */
};

_Static_assert(sizeof(struct sp_cloud_node) == 64, "one line of the cache");

struct sp_cloud_tree {
    struct sp_cloud_node *nodes; /* [count], owned; the first one has all points */
    uint32_t count;
    uint32_t *order; /* points, leaf by leaf, without points that are never drawn; owned */
    double low, bin; /* bin k begins at the value low + k·bin; the last bin has all larger values */
    uint64_t bytes;
};

/* Returns a bound, which is stored as the upper half of a float so that a node fits one cache
 * line. */
static inline float sp_cloud_bound(uint16_t bound) {
    const union {
        uint32_t bits;
        float value;
    } all = { .bits = (uint32_t)bound << 16 };
    return all.value;
}

static inline uint32_t sp_cloud_bin(const struct sp_cloud_tree *tree, float value) {
    const double at = tree->bin > 0 ? ((double)value - tree->low) / tree->bin : 0;
    return (uint32_t)(at > 0 ? at < SP_CLOUD_BINS ? at : SP_CLOUD_BINS - 1 : 0);
}

static inline float sp_cloud_spread_step(const struct sp_cloud_tree *tree) {
    return (float)(tree->bin / 510);
}

/* Returns the standard deviation of the values inside a node, weighted by volume. It is at most
 * half of the range of these values and is stored in 255 steps. */
static inline float sp_cloud_spread(const struct sp_cloud_tree *tree,
                                    const struct sp_cloud_node *node) {
    return (float)(node->spread * (node->high - node->low + 1)) * sp_cloud_spread_step(tree);
}

/* Builds the tree of a volume of points. The tree is the same for any number of threads.
 * SP_ERR_MEMORY, SP_ERR_CANCELLED; the tree is then empty. */
bool sp_cloud_tree_build(const struct sp_volume *volume, struct sp_pool *pool,
                         const struct sp_interrupt *interrupt, struct sp_cloud_tree *tree,
                         struct sp_error *err);
void sp_cloud_tree_finish(struct sp_cloud_tree *tree);

#endif
