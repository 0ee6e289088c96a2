/* SPDX-License-Identifier: Apache-2.0
 *
 * The nearest neighbours of all points of a cloud, from a k-d tree: a plane divides each range of
 * points into halves, down to leaves of a few points. The points of a leaf are searched for
 * together:
 *
 *   leaf ─► the smallest range around it with 24 points or more ─► for each point, how far its
 *           18th neighbour can be ─► all points as near as that to the leaf ─► for each point,
 *           its 18 neighbours
 *
 * The tree is our own: nanoflann, which searches point by point, takes nine times the CPU time for
 * a million points at random, and cannot choose among neighbours at one distance.
 */
#ifndef SP_IMPORT_NEAREST_H
#define SP_IMPORT_NEAREST_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/parallel_for.h"

enum { IMPORT_NEAREST = 18 };

/* The points [count] are the caller's, and finite. */
struct import_nearest_tree {
    float (*positions)[3];
    float *values; /* which move with their positions */
    size_t count;
    struct import_nearest_plane {
        float at;
        int axis;
    } * planes; /* of node n; those inside it are 2·n and 2·n + 1, and 1 is the root; owned */
};

struct import_nearest {
    unsigned found; /* fewer than IMPORT_NEAREST only if there are no more */
    float square;   /* distance² of the nearest; none found: INFINITY */
    const float *neighbours[IMPORT_NEAREST]; /* in no order; which of equally distant ones is open
                                              */
};

void import_nearest_swap(const struct import_nearest_tree *tree, size_t a, size_t b);

/* Changes the order of the points so that they are a tree, the same for any number of threads.
 * Takes up to two bytes per point. False if memory ran out. */
bool import_nearest_build(struct import_nearest_tree *tree, struct sp_pool *pool);
void import_nearest_finish(struct import_nearest_tree *tree);

/* `done`: points whose neighbours were found since the last call. Both are called on all threads.
 */
struct import_nearest_visitor {
    void (*visit)(void *user, size_t point, const struct import_nearest *nearest);
    void (*report)(void *user, size_t done, unsigned worker);
    void *user;
};

/* Calls visit() for each point of the tree, on all threads. */
void import_nearest_each(const struct import_nearest_tree *tree, struct sp_pool *pool,
                         const struct import_nearest_visitor *visitor);

/* Returns the number of a point at exactly this position; SIZE_MAX = there is none. */
size_t import_nearest_at(const struct import_nearest_tree *tree, const float position[3]);

#endif
