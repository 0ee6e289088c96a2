/* SPDX-License-Identifier: Apache-2.0
 *
 * The colouring of a layer of vectors or points by other numbers than its own values: one number
 * per sample, which a range maps to the transfer function.
 *
 *   number n ─► first + (n − low)·scale ─► colour of the transfer function at that value
 *
 * The number `low` has the colour of the first point of the transfer function, and the upper end of
 * the range has the colour of the last point. The opacity still follows from the sample's own
 * value.
 */
#ifndef SP_CLASSIFY_COLORING_H
#define SP_CLASSIFY_COLORING_H

#include "sp/view.h"
#include "sp/volume.h"

struct sp_coloring {
    struct sp_volume *volume; /* has the numbers, borrowed; NULL = own values give the colours */
    bool by_length;           /* true: the lengths of its vectors; false: its samples or values */
    /* True if the volumes hold different parts or levels of wholes that may be larger than memory.
     * The number of a sample is then the mean of the numbers whose samples lie in it, or the number
     * of the coarser sample that contains it. */
    bool is_part;
    struct sp_whole_part drawn, own; /* the parts of the whole that both volumes hold */
    uint32_t dims[3];                /* of the drawn volume */
    double low, scale, first;
};

/* Fills *coloring for a layer that shows `drawn`. `colors`: the volume that layer->color_by names,
 * or a part of its samples. */
void sp_coloring_init(struct sp_coloring *coloring, const struct sp_layer *layer,
                      const struct sp_transfer_function *tf, struct sp_volume *drawn,
                      struct sp_volume *colors);

bool sp_coloring_equal(const struct sp_coloring *a, const struct sp_coloring *b);

/* Returns the value whose colour sample or point `at` has [data unit]. A number that is not finite
 * has the colour of the first point of the transfer function. The colouring must have a volume. */
double sp_coloring_value(const struct sp_coloring *coloring, uint64_t at);

#endif
