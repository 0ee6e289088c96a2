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
 * at w·δ. The share w is 1 for kernels whose depth is below SP_CLOSE_EXACT times their size and
 * falls to 0, the affine map, at SP_CLOSE_AFFINE, so that nothing jumps. Beside the image the
 * affine map has a limited Jacobian (ewa.h); the limit fades with 1 − w.
 *
 * Around: any other close kernel, for instance one that contains the eye or lies beside it. The
 * direction of a ray is (X, Y, 1), with X = (x − cx)/f.
 */
#ifndef SP_SPLAT_CLOSE_H
#define SP_SPLAT_CLOSE_H

#include <stdbool.h>
#include <stdint.h>
#include <string.h>

/* Depths of the centre of a kernel, as multiples of the kernel's size: nearer kernels are exact,
 * farther ones are affine. */
#define SP_CLOSE_EXACT 18.0f
#define SP_CLOSE_AFFINE 36.0f
/* Depths of trained Gaussians count this many times. The affine map is part of how they were
 * trained, so they leave it only where it is far off. */
#define SP_CLOSE_TRAINED 3.0f

enum {
    SP_CLOSE_FAR = 0,
    SP_CLOSE_AHEAD = 0x8000 /* and the share w in 32767ths; around: n·√S22 (sp_close_plane()) */
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

/* The first bits of a float from 1 on; `shift` bits are lost, and the last one is rounded. */
static inline uint32_t sp_close_pack(float number, int shift) {
    uint32_t bits;
    memcpy(&bits, &number, sizeof bits);
    return (bits - 0x3f800000u + (1u << (shift - 1))) >> shift;
}

static inline float sp_close_unpack(uint32_t stored, int shift) {
    const uint32_t bits = (stored << shift) + 0x3f800000u;
    float number;
    memcpy(&number, &bits, sizeof number);
    return number;
}

/* ρ² as stored: 1 to 2^32, with a relative error of at most 2^−12. */
static inline uint16_t sp_close_store(float square) {
    return (uint16_t)sp_close_pack(square < 1 ? 1 : square < 4e9f ? square : 4e9f, 12);
}

static inline float sp_close_square(uint16_t stored) {
    return sp_close_unpack(stored, 12);
}

/* The kind of a kernel around the eye: n·√S22 from 0 to 254, with an error of at most 2^−13 of 1 +
 * n·√S22. */
static inline uint16_t sp_close_around(float plane) {
    const uint32_t stored = sp_close_pack(plane < 254 ? 1 + plane : 255, 11);
    return (uint16_t)(stored > 0 ? stored : 1);
}

static inline float sp_close_plane(uint16_t kind) {
    return sp_close_unpack(kind, 11) - 1;
}

static inline bool sp_close_is_ahead(const struct sp_close *close) {
    return close->kind & SP_CLOSE_AHEAD;
}

static inline bool sp_close_is_around(const struct sp_close *close) {
    return close->kind != SP_CLOSE_FAR && !sp_close_is_ahead(close);
}

#endif
