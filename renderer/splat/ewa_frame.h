/* SPDX-License-Identifier: Apache-2.0
 *
 * The constants of all footprints of one frame and mip level. ewa.h has the formulas.
 */
#ifndef SP_SPLAT_EWA_FRAME_H
#define SP_SPLAT_EWA_FRAME_H

#include <stdbool.h>
#include <stdint.h>

#include "classify/visible.h"
#include "splat/camera.h"
#include "splat/extent.h"

/* The Jacobian clamps u0/u2 and u1/u2 to the frustum's tangents times the margin, plus the slack.
 */
#define SP_EWA_MARGIN 1.3f
#define SP_EWA_SLACK 0.3f
/* Smallest variance of the low-pass filter [px²]. It keeps the variance matrix invertible in modes
 * without a low-pass filter. */
#define SP_VARIANCE_MIN 1e-6f

/* The constants of a frame and level. */
struct sp_ewa_frame {
    enum sp_projection projection;
    const struct sp_grid *grid;    /* of the level that is drawn */
    double unit;                   /* edge of a cube with a cell's volume, world units: a "cell" */
    float step[3][3];              /* C: column a = camera-space step along index axis a */
    double step_hi[3][3], base[3]; /* C in double precision, and u of voxel (0, 0, 0) */
    float kernel[3][3];            /* rows of K */
    float scale;                   /* f, or s times the unit */
    float centre[2];
    double diameter;    /* of the volume, cells */
    float ratio_max[2]; /* bound of u0/u2, u1/u2 in the Jacobian */
    float near;
    float lowpass2;    /* h² [px²], at least SP_VARIANCE_MIN */
    bool post;         /* splats carry the scalar, not a colour */
    float sigma;       /* of the kernel, voxels */
    float radius, cut; /* r, and ½·log2 e·r² */
    float gain;        /* factor from the depth of a class to τ, without the footprint: unit/L */
    float peak; /* centre value of a footprint of unit variance: 1/(2π·(1 − e^{−r²/2})) */
    float flat; /* filter none: half of 1.6 voxels, in standard deviations */
    struct sp_clip_frame clip;
    int size[2]; /* of the image, px */
    int rows[2]; /* [first, end) of the image's rows that are being drawn */
};

/* Fills the constants: `rows` is the whole image and `clip` has no planes. `filter` replaces the
 * filter of the view; both must be valid. The grid is borrowed. */
void sp_ewa_frame_init(struct sp_ewa_frame *frame, const struct sp_camera_transform *camera,
                       const struct sp_grid *grid, const struct sp_view *view,
                       const struct sp_filter *filter);

/* The voxels of one brick: u = base + Σ step·at[axis][i]; kernel column `axis` is multiplied by
 * size[axis][i]. */
struct sp_ewa_brick {
    float base[3];
    const float *at[3];        /* from the brick's first voxel; evenly spaced: 0, 1, 2, … */
    const float *size[3];      /* local spacing over the axis's; evenly spaced: 1 */
    float own[3][2][SP_BRICK]; /* storage of rectilinear axes: the struct must not be moved */
};

void sp_ewa_brick_init(struct sp_ewa_brick *brick, const struct sp_ewa_frame *frame,
                       const uint32_t first[3]);

/* True if one clip plane of the frame removes the kernels of all voxels of the brick at `first`;
 * sp_extent_cut() would then remove each of them. The test is conservative: false does not mean
 * that a voxel is left. */
bool sp_ewa_brick_is_clipped(const struct sp_ewa_frame *frame, const uint32_t first[3]);

/* Computes u of the voxel at `local` (visible.h) of the brick. */
static inline void sp_ewa_brick_place(const struct sp_ewa_brick *brick,
                                      const struct sp_ewa_frame *frame, uint16_t local,
                                      float u[3]) {
    float x = brick->at[0][local & 15], y = brick->at[1][local >> 4 & 15],
          z = brick->at[2][local >> 8];
    for (int r = 0; r < 3; r++)
        u[r] =
            brick->base[r] + frame->step[r][0] * x + frame->step[r][1] * y + frame->step[r][2] * z;
}

/* Returns x2, the distance from the eye (orthographic: from the eye's plane) [cells]. */
float sp_ewa_distance(const struct sp_ewa_frame *frame, const float u[3]);

#endif
