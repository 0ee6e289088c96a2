/* SPDX-License-Identifier: Apache-2.0
 *
 * A quad is a vector of four floats, such as the red, green, blue and optical depth of one pixel. A
 * wide vector (wide.h) has SP_WIDE floats, so it holds SP_WIDE / 4 quads.
 */
#ifndef SP_BASE_QUAD_H
#define SP_BASE_QUAD_H

#include "base/wide.h"

typedef float sp_quad __attribute__((vector_size(16)));

static inline sp_quad sp_quad_load(const float *p) {
    sp_quad a;
    memcpy(&a, p, sizeof a);
    return a;
}

/* Repeats the four floats in each group of four lanes. */
static inline sp_wide sp_quad_repeat(sp_quad a) {
#if defined SP_WIDE_AVX512
    return (sp_wide)_mm512_broadcast_f32x4((__m128)a);
#elif defined SP_WIDE_AVX2
    return (sp_wide)_mm256_set_m128((__m128)a, (__m128)a);
#else
    return a;
#endif
}

/* Group n of the result repeats element SP_WIDE / 4 · part + n of a four times. */
static inline sp_wide sp_quad_spread(sp_quad a, int part) {
#if defined SP_WIDE_AVX512
    (void)part;
    const __m512i index = _mm512_set_epi32(3, 3, 3, 3, 2, 2, 2, 2, 1, 1, 1, 1, 0, 0, 0, 0);
    return (sp_wide)_mm512_permutexvar_ps(index, _mm512_castps128_ps512((__m128)a));
#elif defined SP_WIDE_AVX2
    const __m256i index =
        _mm256_add_epi32(_mm256_set_epi32(1, 1, 1, 1, 0, 0, 0, 0), _mm256_set1_epi32(2 * part));
    return (sp_wide)_mm256_permutevar8x32_ps(_mm256_castps128_ps256((__m128)a), index);
#else
    return sp_wide_all(a[part]);
#endif
}

/* Shuffles each group of four lanes of a and b as __builtin_shufflevector() does. With AVX-512 only
 * lanes of a. */
#if defined SP_WIDE_AVX512
#define SP_QUAD_SHUFFLE(a, b, i, j, k, l)                                                          \
    (sp_wide) _mm512_permute_ps((__m512)(a), (i) | (j) << 2 | (k) << 4 | (l) << 6)
#elif defined SP_WIDE_AVX2
#define SP_QUAD_SHUFFLE(a, b, i, j, k, l)                                                          \
    __builtin_shufflevector(a, b, i, j, k, l, i + 4, j + 4, k + 4, l + 4)
#else
#define SP_QUAD_SHUFFLE(a, b, i, j, k, l) __builtin_shufflevector(a, b, i, j, k, l)
#endif

/* For each group of four lanes: SP_QUAD_MIX interleaves the first (lo) or last (hi) two elements of
 * a and b; SP_QUAD_JOIN appends the first (0x44) or last (0xee) two elements of b to the same
 * elements of a. They are intrinsics because gcc splits portable shuffles into scalar code where
 * lanes are read one by one. */
#if defined SP_WIDE_AVX512
#define SP_QUAD_MIX(half, a, b) (sp_wide) _mm512_unpack##half##_ps((__m512)(a), (__m512)(b))
#define SP_QUAD_JOIN(a, b, part) (sp_wide) _mm512_shuffle_ps((__m512)(a), (__m512)(b), part)
#elif defined SP_WIDE_AVX2
#define SP_QUAD_MIX(half, a, b) (sp_wide) _mm256_unpack##half##_ps((__m256)(a), (__m256)(b))
#define SP_QUAD_JOIN(a, b, part) (sp_wide) _mm256_shuffle_ps((__m256)(a), (__m256)(b), part)
#else
#define SP_QUAD_FIRST_lo 0
#define SP_QUAD_FIRST_hi 2
#define SP_QUAD_MIX(half, a, b)                                                                    \
    SP_QUAD_SHUFFLE(a, b, SP_QUAD_FIRST_##half, SP_QUAD_FIRST_##half + SP_WIDE,                    \
                    SP_QUAD_FIRST_##half + 1, SP_QUAD_FIRST_##half + 1 + SP_WIDE)
#define SP_QUAD_JOIN(a, b, part)                                                                   \
    SP_QUAD_SHUFFLE(a, b, (part)&3, (part) >> 2 & 3, ((part)&3) + SP_WIDE,                         \
                    ((part) >> 2 & 3) + SP_WIDE)
#endif

/* Transposes each group of four lanes: element n of p[m] becomes element m of out[n]. */
static inline void sp_quad_transpose(const sp_wide p[4], sp_wide out[4]) {
    sp_wide a = SP_QUAD_MIX(lo, p[0], p[1]), b = SP_QUAD_MIX(hi, p[0], p[1]);
    sp_wide c = SP_QUAD_MIX(lo, p[2], p[3]), d = SP_QUAD_MIX(hi, p[2], p[3]);
    out[0] = SP_QUAD_JOIN(a, c, 0x44);
    out[1] = SP_QUAD_JOIN(a, c, 0xee);
    out[2] = SP_QUAD_JOIN(b, d, 0x44);
    out[3] = SP_QUAD_JOIN(b, d, 0xee);
}

#endif
