/* SPDX-License-Identifier: Apache-2.0
 *
 * The part of a volume that a view shows. A client uses it to centre the visible part in the image.
 */
#ifndef SP_VISIBLE_PART_H
#define SP_VISIBLE_PART_H

#include <stdbool.h>

#include "sp/api.h"
#include "sp/status.h"
#include "sp/view.h"
#include "sp/volume.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A box along the axes of the grid and a sphere with the same centre. The visible part lies inside
 * both. */
struct sp_visible_part {
    bool is_visible;  /* false: nothing is visible, and the box holds the whole volume */
    double box[2][3]; /* lower and upper corner, fractions of the volume's extent, as in sp_clip */
    double center[3]; /* world */
    /* [axis of the grid]: world vector from the centre to the middle of a face */
    double half[3][3];
    double radius; /* of the sphere, world units; at most the distance from the centre to a corner
                      of the box */
};

/* Computes the part that the visible layers of a view show. For the volume and the shell, the
 * transfer function, its gradient axis, the clip box and the clip planes decide what is visible;
 * surfaces are added. Outliers are ignored: 0.1 % of the opacity of a layer at each end of an axis.
 * If the view draws slices, the part is the whole volume, because slices reach its borders. The
 * camera has no influence. Reads at most 2 million samples for each of the three layer types, or 32
 * million if fewer than 256 of those are visible. Takes a few milliseconds; with a gradient axis or
 * the second pass, tens of milliseconds. SP_ERR_MEMORY. Thread-safe. */
SP_API bool sp_view_compute_visible_part(const struct sp_view *view, const struct sp_volume *volume,
                                         struct sp_visible_part *part, struct sp_error *err);

#ifdef __cplusplus
}
#endif

#endif
