/* SPDX-License-Identifier: Apache-2.0
 *
 * Makes the cells of a tree on all threads. One pass sorts the points into the cells of the first
 * four levels. Then each thread divides some of the cells of the fourth level into smaller ones. If
 * a cell has too many points for one thread, all threads first sort its points by four more levels.
 *
 *   cells ─► top (all above the parts) │ inside part 0 │ inside part 1 │ …
 */
#ifndef SP_CLOUD_TREE_CELLS_H
#define SP_CLOUD_TREE_CELLS_H

#include "base/interrupt.h"
#include "base/parallel_for.h"
#include "sp/volume.h"

/* A cell with points. The cells inside a cell lie side by side in memory; a leaf has no cells
 * inside. */
struct sp_cloud_cell {
    uint32_t first; /* range of the cells inside; leaf: range of `order` */
    uint32_t count : 31, is_leaf : 1;
    float side; /* world units */
};

/* A subtree that one thread makes. */
struct sp_cloud_part {
    uint32_t root;         /* its root cell, one of the top cells */
    uint32_t first, count; /* the cells inside */
    uint32_t level;
    uint32_t made;   /* where the cells inside begin in the list of the thread */
    unsigned worker; /* number of the thread */
};

struct sp_cloud_cells {
    struct sp_cloud_cell *cells; /* [count]; the first one has all points */
    uint32_t *order;             /* points that can be drawn, leaf by leaf */
    struct sp_cloud_part *parts;
    uint32_t count, part_count;
    uint32_t top_count; /* cells above the parts and their roots, which come first */
};

/* Makes the cells of a volume of points. The result is the same for any number of threads. The
 * caller frees the three arrays with free(). SP_ERR_MEMORY. After a cancellation, returns true and
 * the cells are incomplete. */
bool sp_cloud_cells_make(const struct sp_volume *volume, struct sp_pool *pool,
                         const struct sp_interrupt *interrupt, struct sp_cloud_cells *cells,
                         struct sp_error *err);

#endif
