/* SPDX-License-Identifier: Apache-2.0
 *
 * Picking: what the ray through a point of the image hits. It is computed on the CPU from the
 * samples, for the layers that are visible.
 *
 * Every sample fills its cell, which reaches from the middle of one gap to the middle of the next.
 * The volume fills it with the extinction of the transfer function at the sample's value (and its
 * gradient magnitude, if that counts). A shell does the same in the cells of its voxels; where the
 * opacity reaches `high`, it is opaque. A surface adds its opacity wherever the ray crosses it: the
 * trilinear interpolation of the samples has its value there, to rounding. The optical depth of the
 * ray is the exact sum over what it crosses:
 *
 *   τ(t) = Σ extinction(cell) · length of the ray in the cell − Σ ln(1 − opacity(surface))
 *   opacity(t) = 1 − e^−τ(t)
 *
 * Kernel, filter and compositing have no influence; the near plane and the clip do.
 */
#ifndef SP_PICK_H
#define SP_PICK_H

#include <stdbool.h>

#include "sp/api.h"
#include "sp/view.h"
#include "sp/volume.h"

#ifdef __cplusplus
extern "C" {
#endif

struct sp_pick {
    double opacity;     /* of the whole ray, [0, 1] */
    bool is_hit;        /* the opacity reaches 0.5; the fields below are set only then */
    double position[3]; /* world position where the opacity reaches 0.5 */
    double value;       /* of the surface that is hit, else of the sample whose cell contains that
                           position [data unit] */
};

/* Follows the ray through point `at` of an image of `size` px. `at` is in px from the upper left
 * corner, x to the right, y down, finite; (0.5, 0.5) is the centre of the first pixel. The view
 * must be valid (sp_view_validate()). Takes at most dims[0] + dims[1] + dims[2] steps, and twice as
 * many with surfaces. Thread-safe. */
SP_API void sp_pick_at(const struct sp_volume *volume, const struct sp_view *view,
                       const uint32_t size[2], const double at[2], struct sp_pick *pick);

#ifdef __cplusplus
}
#endif

#endif
