/* SPDX-License-Identifier: Apache-2.0
 *
 * Microflakes: the distribution of the normals inside a coarse cell (after Heitz, Dupuy, Crassin,
 * Dachsbacher: The SGGX Microflake Distribution, SIGGRAPH 2015).
 *
 * Lighting a mean normal differs from the mean of lit normals. Two-sided light from l gives the
 * mean of |n·l|, which is the projected area of the cell's microflakes. The mean follows from six
 * directions:
 *
 *   a_i = mean of |n·w_i|     w_i: the six axes of an icosahedron, world space
 *   S = Σ a_i² (5/4 w_i w_iᵀ − 1/4)        mean of |n·l| ≈ √(lᵀ S l)
 *
 * wᵀSw is a_i² on each axis, because the squared cosines between axes are 1/5. So the root is exact
 * on the axes. The root is exact in all directions for a single normal (S = n nᵀ) and for evenly
 * spread normals (S = ¼). The mean of eight means is the mean of all parts: each level is made from
 * the next finer one, independent of light and eye.
 *
 * A part without a gradient has no normal; the field "share with a normal" is the share of the cell
 * that has a normal.
 *
 *   word 0: | 8 bits a_3 | a_2 | a_1 | a_0 |      word 1: | 0 | share with a normal | a_5 | a_4 |
 */
#ifndef SP_CLASSIFY_MICROFLAKES_H
#define SP_CLASSIFY_MICROFLAKES_H

#include <math.h>
#include <stdint.h>

#include "classify/gradient.h"

enum { SP_MICROFLAKES_STEPS = 255, SP_MICROFLAKES_AXES = 6 };

/* Of the axes (0, ±m, M), (±m, M, 0), (M, 0, ±m), in this order. */
#define SP_MICROFLAKES_MINOR 0.525731112f
#define SP_MICROFLAKES_MAJOR 0.850650808f

struct sp_microflakes {
    uint32_t word[2];
};

/* Weighted sums over the parts of a cell. */
struct sp_microflakes_sum {
    float area[SP_MICROFLAKES_AXES], sided; /* over parts with a normal: Σ weight·|n·w|, Σ weight */
};

/* Adds a voxel by its packed gradient. */
static inline void sp_microflakes_add_normal(struct sp_microflakes_sum *sum, uint32_t packed,
                                             float weight) {
    float n[3];
    if (!packed)
        return;
    sp_gradient_unpack(packed, n);
    static const int plane[3][2] = { { 1, 2 }, { 0, 1 }, { 2, 0 } }; /* of each pair of axes */
    for (int a = 0; a < 3; a++) {
        float minor = n[plane[a][0]] * SP_MICROFLAKES_MINOR,
              major = n[plane[a][1]] * SP_MICROFLAKES_MAJOR;
        sum->area[2 * a] += weight * fabsf(major + minor);
        sum->area[2 * a + 1] += weight * fabsf(major - minor);
    }
    sum->sided += weight;
}

/* Adds a finer cell. */
static inline void sp_microflakes_add(struct sp_microflakes_sum *sum,
                                      struct sp_microflakes microflakes, float weight) {
    const float step = 1.0f / SP_MICROFLAKES_STEPS;
    weight *= (float)(microflakes.word[1] >> 16 & 255) * step;
    for (int i = 0; i < SP_MICROFLAKES_AXES; i++)
        sum->area[i] += weight * step * (float)(microflakes.word[i >> 2] >> 8 * (i & 3) & 255);
    sum->sided += weight;
}

/* Packs the sums of parts whose weights add up to `weight`. */
static inline struct sp_microflakes sp_microflakes_pack(const struct sp_microflakes_sum *sum,
                                                        float weight) {
    struct sp_microflakes microflakes = { { 0 } };
    float scale = sum->sided > 0 ? SP_MICROFLAKES_STEPS / sum->sided : 0;
    float share = weight > 0 ? fminf(sum->sided / weight, 1) * SP_MICROFLAKES_STEPS : 0;
    for (int i = 0; i < SP_MICROFLAKES_AXES; i++) {
        float steps = fminf(sum->area[i] * scale, SP_MICROFLAKES_STEPS);
        microflakes.word[i >> 2] |= (uint32_t)(steps + 0.5f) << 8 * (i & 3);
    }
    microflakes.word[1] |= (uint32_t)(share + 0.5f) << 16;
    return microflakes;
}

#endif
