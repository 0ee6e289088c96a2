/* SPDX-License-Identifier: Apache-2.0
 *
 * The error that a user sees while the view moves: the mean square difference between what the
 * screen shows and the whole frame of the view that the hand asks for at that moment.
 *
 *   error = A · (width − 1)  +  B · speed · age
 *
 *   width   of what is drawn as one, in px of the full image: full side / side of the frame; at mip
 *           level n the root of the sum of its square and of that of three times 2^n voxels:
 *           averaging also changes opacities
 *   speed   of the image, px of the full image per second
 *   age     latency + 1.5 · time between frames: while a frame is drawn nothing of it is shown, and
 *           then it is shown for as long; in the mean for half of that. The latency is the same
 *           for all sizes, and left out
 *
 * Both terms are linear, because most of the error is at edges: an edge that is off by twice as
 * many pixels has twice as many wrong ones. A and B are fitted to CT scans at 512 x 512 px; at
 * other sizes both terms change by the same factor. A client that warps frames by depth sees a
 * ninth of the error of age, and a 27th where a shift, a rotation or a change of size of the whole
 * image explains the motion (schedule/motion.h).
 */
#ifndef SRV_SCHEDULE_ERROR_MODEL_H
#define SRV_SCHEDULE_ERROR_MODEL_H

#include <math.h>
#include <stdint.h>

#include "schedule/motion.h"

#define SRV_ERROR_WIDTH 2.2e-4 /* A */
#define SRV_ERROR_AGE 9.5e-4   /* B */
#define SRV_ERROR_AGE_WARPED 1.05e-4
#define SRV_ERROR_PLANAR (1 / 3.) /* of B, with warp, for motion without parallax */
#define SRV_ERROR_MIP 3           /* width of what a mip level draws, in its voxels */
#define SRV_ERROR_DRAFT 1e-4      /* of a draft that is a frame of full size: 40 dB */

/* Returns the error that a millisecond between frames adds, for a full image of this height. */
static inline double srv_error_per_ms(const struct srv_speed *speed, bool warps, uint32_t height) {
    const double parallax = speed->parallax < speed->motion ? speed->parallax : speed->motion;
    const double warped = parallax + SRV_ERROR_PLANAR * (speed->motion - parallax);
    const double per_s = warps ? SRV_ERROR_AGE_WARPED * warped : SRV_ERROR_AGE * speed->motion;
    return 1.5 * per_s * height / 1000;
}

/* Returns the error of a frame whose pixels have this width. voxel_px: width of a voxel, px of the
 * full image; 0 = not known, assumed to be a pixel of the frame. */
static inline double srv_error_of_width(double width, unsigned mip_level, double voxel_px) {
    const double merged = SRV_ERROR_MIP * (voxel_px > 0 ? voxel_px : width) * (1u << mip_level);
    return SRV_ERROR_WIDTH * ((mip_level > 0 ? hypot(width, merged) : width) - 1);
}

#endif
