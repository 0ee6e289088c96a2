/* SPDX-License-Identifier: Apache-2.0
 *
 * Voxel + view → splat: the EWA footprint of one voxel (Zwicker et al. 2001, eq. 21 and 22, in the
 * notation of the project's mathematics page).
 *
 *   voxel i ─► u = C·i + u₀ ─► x = (cx + f·u0/u2, cy + f·u1/u2)                     camera, ray
 * space kernel  V'' = K Kᵀ, K = σ·C in camera space (C = W·direction·spacing), any direction matrix
 *   M = first two rows of J·K     V̂ = M Mᵀ       footprint variance [px²]
 *   V̂ + h²I ─► conic, box, depth at the centre τ = g·v·|det J| / (2π √det(V̂ + h²I)) / (1 −
 * e^{−r²/2})
 *
 * With rows k0, k1, k2 of K, perspective:  m_i = (f/u2)·(k_i − (u_i/u2)·k2), and
 * |det J| = f²·√(1 + (u0/u2)² + (u1/u2)²)/u2²;  orthographic: m_i = s·k_i, |det J| = s².
 * The determinant is taken as |m0 × m1|² + h²(V00 + V11) + h⁴, a sum of positive terms, because
 * V00·V11 − V01² cancels for long thin footprints.
 *
 * All lengths are divided by the edge of a cube that has a cell's volume, so that single precision
 * holds whatever the world's unit is; then v = 1 and g has no unit.
 *
 * Close-ups. The affine approximation is the first-order expansion at the voxel's centre; it is
 * bounded where it would run away: u_i/u2 in J is held inside the picture's frustum plus a margin
 * (SP_EWA_MARGIN, SP_EWA_SLACK), which only touches voxels whose centre lies outside the picture,
 * and voxels nearer than the near plane or a thousandth of a cell are not drawn. Footprints are
 * clipped to the picture, depths to SP_DEPTH_MAX, and whatever is not finite is not drawn.
 */
#ifndef SP_SPLAT_EWA_H
#define SP_SPLAT_EWA_H

#include <stdint.h>

#include "classify/visible.h"
#include "splat/adaptive.h"
#include "splat/camera.h"
#include "splat/shade.h"

#define SP_EWA_MARGIN 1.3f /* the frustum's tangents times this … */
#define SP_EWA_SLACK 0.3f  /* … plus this bound u0/u2 and u1/u2 in the Jacobian */
#define SP_DEPTH_MAX 1e6f  /* optical depth of one splat at its centre; opaque from 20 on */
#define SP_VARIANCE_MIN                                                                            \
    1e-6f /* px², the least low-pass: keeps a footprint without one invertible */

/* One splat, ready to be added to the pixels of its box:
 * weight(dx, dy) = 2^−(a·dx² + b·dx·dy + c·dy²) where the exponent is at most the frame's `cut`,
 * with dx, dy from the centre to a pixel's centre. */
struct sp_splat {
    float x, y;             /* centre, px */
    float a, b, c;          /* ½·log2 e times the conic's xx, 2·xy and yy */
    float depth;            /* optical depth τ at the centre */
    float emission[3];      /* colour · depth */
    uint32_t sheet;         /* its sheet's place in the order front to back */
    int16_t x0, y0, x1, y1; /* box in px, half open, inside the picture, not empty */
    float area;             /* px inside the cutoff, without clipping to the picture */
    uint32_t unused[3];
};

/* Constants of a frame. */
struct sp_ewa_frame {
    enum sp_projection projection;
    float step[3][3];              /* C: column a = camera-space step along index axis a */
    double step_hi[3][3], base[3]; /* C again, and u of voxel (0,0,0) */
    float kernel[3][3];            /* rows of K */
    float scale;                   /* f, or s times the unit */
    float centre[2];
    float ratio_max[2]; /* bound of u0/u2, u1/u2 in the Jacobian */
    float near;
    float lowpass2;    /* h² [px²], at least SP_VARIANCE_MIN */
    float radius, cut; /* r, and ½·log2 e·r² */
    float gain;        /* depth of a class → τ: v/(L·2π·(1 − e^{−r²/2})) */
    int size[2];       /* of the picture, px */
    int rows[2];       /* [first, end) of the picture's rows that are being drawn */
};

/* Fills everything but rows (= the whole picture). The view is valid. */
void sp_ewa_frame_init(struct sp_ewa_frame *frame, const struct sp_camera_frame *camera,
                       const struct sp_grid *grid, const struct sp_view *view);

/* Entries of one brick: places [begin, begin + count) of its order. */
struct sp_ewa_run {
    const struct sp_visible *list;
    const struct sp_transfer *transfer;
    const struct sp_shade *shade; /* NULL = none */
    uint32_t brick[3];            /* index of its first voxel */
    uint64_t first;               /* list entry of the brick's entry 0 */
    const uint16_t *order;        /* of the brick: entry at each place; NULL = identity */
    uint32_t begin, count;
    uint32_t sheet;           /* the layer's place, front to back */
    enum sp_filter_mode mode; /* of the brick; not ADAPTIVE */
};

/* Sets up the run's splats that touch the rows being drawn, in order; returns how many were
 * written, at most run->count. */
uint32_t sp_ewa_set_up(const struct sp_ewa_frame *frame, const struct sp_ewa_run *run,
                       struct sp_splat *out);

#endif
