/* SPDX-License-Identifier: Apache-2.0
 *
 * What gives the colours of a layer of vectors or points, if not the values of its samples: other
 * numbers, one per sample, which a range maps to the transfer function.
 *
 *   number n ─► first + (n − low)·scale ─► colour of the transfer function at that value
 *
 * `low` gets the colour of the first point of the transfer function, and the upper end of the range
 * that of the last one. The opacity stays that of the sample's own value.
 */
#ifndef SP_CLASSIFY_COLORING_H
#define SP_CLASSIFY_COLORING_H

#include "sp/view.h"
#include "sp/volume.h"

struct sp_coloring {
    struct sp_volume *volume; /* has the numbers, borrowed; NULL = own values give the colours */
    bool by_length;           /* true: the lengths of its vectors; false: its samples or values */
    /* Both volumes have other samples of the same whole, which is larger than memory: the number of
     * a sample is the mean of those that lie in it, or that of the coarser one that it lies in. */
    bool is_part;
    struct sp_whole_part drawn, own; /* where they lie */
    uint32_t dims[3];                /* of the shown volume */
    double low, scale, first;
};

/* Finds the colouring of a layer of `shown`. `colors`: the volume that layer->color_by names, or
 * some of its samples. */
void sp_coloring_init(struct sp_coloring *coloring, const struct sp_layer *layer,
                      const struct sp_transfer_function *tf, struct sp_volume *drawn,
                      struct sp_volume *colors);

bool sp_coloring_equal(const struct sp_coloring *a, const struct sp_coloring *b);

/* The value whose colour sample or point `at` has. A number that is not finite gets that of the
 * first point of the transfer function. The colouring must have a volume. */
double sp_coloring_value(const struct sp_coloring *coloring, uint64_t at);

#endif
