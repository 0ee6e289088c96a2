/* SPDX-License-Identifier: Apache-2.0
 *
 * From a voxel and a view to a splat: the EWA footprint of the voxel (Zwicker et al. 2001, eq. 21
 * and 22). README.md of this folder explains the terms.
 *
 *   voxel i ─► u = C·i + u₀ ─► x = (cx + f·u0/u2, cy + f·u1/u2)          camera and ray space
 *   kernel  V'' = K Kᵀ, K = σ·C in camera space (C = W·direction·spacing), for any direction matrix
 *   M = first two rows of J·K,   V̂ = M Mᵀ            footprint variance [px²], J the Jacobian
 *   V̂ + h²I ─► conic, box, and the optical depth at the centre
 *   τ = g·v·|det J| / (2π √det(V̂ + h²I)) / (1 − e^{−r²/2})
 *
 * With the rows k0, k1, k2 of K, perspective:  m_i = (f/u2)·(k_i − (u_i/u2)·k2), and
 * |det J| = f²·√(1 + (u0/u2)² + (u1/u2)²)/u2²;  orthographic: m_i = s·k_i, |det J| = s².
 * The determinant is computed as |m0 × m1|² + h²(V00 + V11) + h⁴, a sum of positive terms, because
 * V00·V11 − V01² cancels for long thin footprints.
 *
 * All lengths are divided by the edge of a cube with a cell's volume, so that single precision
 * suffices for any world unit. Then v = 1 and g has no unit.
 *
 * Close-ups: the affine approximation is the first-order expansion at the voxel's centre. To keep
 * it from diverging, u_i/u2 in J is limited to the image's frustum plus a margin (SP_EWA_MARGIN,
 * SP_EWA_SLACK); this changes only voxels whose centre lies outside the image. Voxels nearer than
 * the near plane or a thousandth of a cell are not drawn. Footprints are clipped to the image,
 * depths are limited to SP_DEPTH_MAX, and splats with a value that is not finite are not drawn.
 * Layers of splats have other formulas close to the eye (close.h).
 *
 * Along the ray, for slabs and clipping: with m2, the third row of J·K, the depth of the kernel on
 * the ray of a pixel at d from the centre has a normal distribution with
 *
 *   mean μ(d) = x2 + s·d,  s = (V̂ + h²I)⁻¹ (V02, V12),      variance V22 − (V02, V12)·s
 *
 * A half-space n·t ≥ o, whose value at the voxel is e = n·t_k − o, keeps the share Φ((e + k·d)/w):
 *
 *   k = (V̂ + h²I)⁻¹ c,  c_i = m_i·Kᵀn,  w² = |Kᵀn|² − c·k
 *
 * This is the probability of lying inside, given the pixel, so that the low-pass filter also
 * applies to the plane's edge.
 *
 * Other filter modes scale or replace rows of these formulas: `swan` multiplies m0 and m1 so that
 * the smaller variance is h²; `none` draws a flat rectangle of max(1.6 voxels, 1 px) per axis. The
 * cubic kernel (cubic.h) has its own standard deviation and profile, and the same formulas.
 */
#ifndef SP_SPLAT_EWA_H
#define SP_SPLAT_EWA_H

#include <stdbool.h>
#include <stdint.h>

#include "base/isa.h"
#include "classify/visible.h"
#include "splat/adaptive.h"
#include "splat/cubic.h"
#include "splat/ewa_frame.h"
#include "splat/shade.h"

/* The largest optical depth of one splat at its centre. A depth of 20 is already opaque. */
#define SP_DEPTH_MAX 1e6f

/* One splat, ready to be added to the pixels of its box:
 *
 *   weight(dx, dy) = 2^−p, p = a·dx² + b·dx·dy + c·dy²     where p is at most the frame's `cut`
 *   cubic kernel: F(ρ)/F(0) with (ρ/t)² = p/cut
 *
 * (dx, dy) leads from the splat's centre to a pixel's centre. */
struct sp_splat {
    float x, y;             /* centre, px */
    float a, b, c;          /* ½·log2 e times the conic's xx, 2·xy and yy; flat: 0 */
    float depth;            /* optical depth τ at the centre; post: its length over L */
    float emission[3];      /* colour · depth; post: gradient · depth */
    float value;            /* post: scalar · depth */
    uint32_t sheet;         /* number of the splat's layer, front to back */
    int16_t x0, y0, x1, y1; /* box in px, half open, inside the image, not empty */
    float area;             /* px inside the cutoff, without clipping to the image */
    uint32_t cuts; /* number of planes that cut it: as many elements of its sp_cut are used */
    uint32_t unused;
};

/* The output of the set-up: parallel arrays with one element per splat, borrowed. */
struct sp_splats {
    struct sp_splat *splat;
    struct sp_span *span; /* NULL = not needed */
    struct sp_cut *cut;   /* NULL = nothing is clipped */
};

/* Returns the arrays from element n on. */
static inline struct sp_splats sp_splats_from(const struct sp_splats *all, size_t n) {
    return (struct sp_splats){ all->splat + n, all->span ? all->span + n : NULL,
                               all->cut ? all->cut + n : NULL };
}

/* Some entries of one brick: the places [begin, begin + count) of the brick's order. */
struct sp_ewa_run {
    const struct sp_visible *list;
    const uint16_t *local; /* [count]: sp_visible_locals() of the run */
    const struct sp_transfer *transfer;
    const struct sp_shade *shade; /* NULL = none */
    uint32_t brick[3];            /* index of its first voxel */
    uint64_t first;               /* list entry of the brick's entry 0 */
    const uint16_t *order;        /* of the brick: entry at each place; NULL = identity */
    uint32_t begin, count;
    uint32_t sheet;           /* number of the layer, front to back */
    enum sp_filter_mode mode; /* of the brick; not ADAPTIVE */
};

/* Sets up the splats of a run in order, except splats that touch none of the rows being drawn.
 * Returns the number of splats written, at most run->count. */
uint32_t sp_ewa_set_up(const struct sp_ewa_frame *frame, const struct sp_ewa_run *run,
                       const struct sp_splats *out);

#endif
