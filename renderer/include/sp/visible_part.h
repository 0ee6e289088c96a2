/* SPDX-License-Identifier: Apache-2.0
 *
 * The part of a volume that a view shows, for a client that brings it into the middle of the image.
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

/* A box along the axes of the grid, and a sphere with the same centre: the part lies in both. */
struct sp_visible_part {
    bool is_visible;   /* false: nothing is visible, and the box is that of the whole volume */
    double box[2][3];  /* lower and upper corner, fractions of the volume's extent, as in sp_clip */
    double center[3];  /* world */
    double half[3][3]; /* [axis of the grid]: from the centre to the middle of a face, world */
    double radius;     /* world units; at most the distance of a corner */
};

/* Finds what the visible layers of a view show: what the transfer function, its gradient axis, the
 * clip box and the clip planes leave of the volume and of the shell, and the surfaces. Isolated
 * samples with 0.1 % of the opacity of a layer at each end of an axis do not count. If the view
 * draws slices, they reach to the borders of the volume, and so does the part. The camera has no
 * influence. Reads at most 2 million samples for each of the three types of layer; 32 million if
 * fewer than 256 of those are visible. A few milliseconds; with a gradient axis or the second
 * reading, some tens of them. SP_ERR_MEMORY. Thread-safe. */
SP_API bool sp_view_compute_visible_part(const struct sp_view *view, const struct sp_volume *volume,
                                         struct sp_visible_part *part, struct sp_error *err);

#ifdef __cplusplus
}
#endif

#endif
