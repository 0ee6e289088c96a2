/* SPDX-License-Identifier: Apache-2.0
 *
 * Kernels close to the eye. The affine map of outline.h is exact at the centre of a footprint; its
 * error elsewhere grows with the size of the kernel over its distance, and has no bound. Close
 * kernels are therefore integrated along the rays of the pixels.
 *
 * With the names of ewa.h, Σ = K Kᵀ and the low-pass filter h²(u2/f)² along both axes of the image,
 * S = Σ⁻¹, and ρ = √(uᵀS u), the distance of the eye from the centre in standard deviations, a ray
 * of the direction d from the eye has
 *
 *   t = dᵀS u/√(dᵀS d)    distance of the kernel's largest value [standard deviations]
 *   q = ρ² − t²           squared distance of the ray from the centre
 *   ∫ = |d|/√(dᵀS d) · e^{−q/2} · Φ(t − n·√(dᵀS d))    beyond the near plane at the depth n, but
 *                                                      for a constant factor
 *
 * Trained Gaussians have e^{−q/2}·Φ instead of the integral. There are two kinds of records:
 *
 * Ahead: the kernel lies beyond the near plane, so that Φ is 1. With the exponent p of the affine
 * map at the offset δ = (dx, dy) from the centre, the exact exponent is
 *
 *   p/D(δ),   D = B² + 2p/(ρ²·log2 e),   B = 1 + (S u)·(dx, dy, 0)·u2/(f·ρ²)
 *
 * and the integral changes with √(E/D), where E is |d|² over that of the centre. D and E are taken
 * at w·δ. The share w is 1 for kernels nearer than SP_CLOSE_EXACT and falls to 0, the affine map,
 * at SP_CLOSE_AFFINE, so that nothing jumps inside the image. Kernels whose centre lies beside the
 * image have w = 1 up to SP_CLOSE_AFFINE, where they become affine at once: in views of 120 degrees
 * and more a pixel at the border may change by 30 of 255.
 *
 * Around: any other close kernel, for instance one that contains the eye or lies beside it. The
 * direction of a ray is (X, Y, 1), with X = (x − cx)/f.
 */
#ifndef SP_SPLAT_CLOSE_H
#define SP_SPLAT_CLOSE_H

#include <stdbool.h>
#include <stdint.h>
#include <string.h>

/* Distances of the eye from the centre of a kernel, as multiples of the kernel's size: nearer
 * kernels are exact, farther ones are affine. */
#define SP_CLOSE_EXACT 12.0f
#define SP_CLOSE_AFFINE 24.0f
/* Distances of trained Gaussians count this many times. The affine map is part of how they were
 * trained, so they leave it only where it is far off. */
#define SP_CLOSE_TRAINED 2.0f

enum {
    SP_CLOSE_FAR = 0,
    SP_CLOSE_AHEAD = 0x8000, /* and the share w in 32767ths */
    SP_CLOSE_PLANE = 256     /* around: 1 + n·√S22 in steps of 1/SP_CLOSE_PLANE */
};

/* What the footprint of a close kernel needs beside the fields of its outline. Around: dᵀS d/S22 =
 * a·X² + b·X·Y + c·Y² + x·X + y·Y + 1 and dᵀS u/√S22 = more[0]·X + more[1]·Y + area, with the
 * fields of the outline; the gain is the constant factor times e^{(s − ρ²)/2}, where s is ρ² as
 * stored. */
struct sp_close {
    float more[2];   /* ahead: slope of B at w = 1 [1/px] */
    uint16_t kind;   /* see above */
    uint16_t square; /* ρ² (sp_close_square()) */
};

/* ρ² as stored: 1 to 2^32, with a relative error below 2^−11. */
static inline uint16_t sp_close_store(float square) {
    uint32_t bits;
    square = square < 1 ? 1 : square < 4e9f ? square : 4e9f;
    memcpy(&bits, &square, sizeof bits);
    return (uint16_t)((bits - 0x3f800000u) >> 12);
}

static inline float sp_close_square(uint16_t stored) {
    const uint32_t bits = ((uint32_t)stored << 12) + 0x3f800000u;
    float square;
    memcpy(&square, &bits, sizeof square);
    return square;
}

static inline bool sp_close_is_ahead(const struct sp_close *close) {
    return close->kind & SP_CLOSE_AHEAD;
}

static inline bool sp_close_is_around(const struct sp_close *close) {
    return close->kind != SP_CLOSE_FAR && !sp_close_is_ahead(close);
}

#endif
