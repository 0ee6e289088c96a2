/* SPDX-License-Identifier: Apache-2.0
 *
 * Plans the order in which parts of the volume and pieces of slices are drawn, from front to back.
 */
#ifndef SP_SLICES_PLAN_H
#define SP_SLICES_PLAN_H

#include "data/volume/interpolate.h"
#include "sp/view.h"

enum { SP_SLICE_PLANES_MAX = 3, SP_COMPOSE_STEPS_MAX = 8 + 7 };

/* A plane in distances along the axes of the grid (data/volume/interpolate.h): dot(normal,
 * distances) = offset. */
struct sp_slice_cut {
    double normal[3], offset;
    int axis; /* the axis that is perpendicular to the slice; −1 = the slice is oblique */
};

/* A part of the volume, or a piece of slice number `plane`. sides[i] says on which side of plane i,
 * i < plane, the piece lies: −1 below, 1 above. */
struct sp_compose_step {
    bool is_slice;
    unsigned plane;
    int sides[SP_SLICE_PLANES_MAX];
    struct sp_clip clip; /* the clip of the part; of a piece: the box around it */
};

struct sp_compose_plan {
    unsigned planes, steps;
    struct sp_slice_cut cuts[SP_SLICE_PLANES_MAX];
    struct sp_compose_step step[SP_COMPOSE_STEPS_MAX];
};

/* Makes the plan of a view. Slices that miss the volume and empty parts are left out. */
void sp_compose_plan_init(struct sp_compose_plan *plan, const struct sp_interpolator *grid,
                          const struct sp_view *view);

#endif
