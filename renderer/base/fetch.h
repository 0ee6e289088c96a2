/* SPDX-License-Identifier: Apache-2.0
 *
 * Vector loads: neighbouring narrow integers, and loads in which each lane has its own index.
 */
#ifndef SP_BASE_FETCH_H
#define SP_BASE_FETCH_H

#include "base/quad.h"

/* Load SP_WIDE_SHORT neighbouring integers of a narrow type as unsigned 16-bit integers. The
 * functions of signed types add 2¹⁵ (int16) or 2⁷ (int8), which keeps the order of the values. */
static inline sp_wide_short sp_fetch_uint16(const uint16_t *p) {
    return sp_wide_short_load(p);
}

static inline sp_wide_short sp_fetch_int16(const int16_t *p) {
    return sp_wide_short_load((const uint16_t *)p) ^ 0x8000;
}

static inline sp_wide_short sp_fetch_uint8(const uint8_t *p) {
#if defined SP_WIDE_AVX512
    return (sp_wide_short)_mm512_cvtepu8_epi16(
        _mm256_loadu_si256((const __m256i *)(const void *)p));
#elif defined SP_WIDE_AVX2
    return (sp_wide_short)_mm256_cvtepu8_epi16(_mm_loadu_si128((const __m128i *)(const void *)p));
#elif defined SP_WIDE_SSE41
    return (sp_wide_short)_mm_cvtepu8_epi16(_mm_loadl_epi64((const __m128i *)(const void *)p));
#else
    sp_wide_short x;
    for (int i = 0; i < SP_WIDE_SHORT; i++)
        x[i] = p[i];
    return x;
#endif
}

static inline sp_wide_short sp_fetch_int8(const int8_t *p) {
    return sp_fetch_uint8((const uint8_t *)p) ^ 0x80;
}

/* Interleaves the lanes of a and b: out[0] holds the first halves of both, out[1] the second
 * halves. */
static inline void sp_fetch_alternate(sp_wide_short a, sp_wide_short b, sp_wide_short out[2]) {
#if defined SP_WIDE_AVX512
    static const uint16_t order[2][32] = {
        { 0, 32, 1, 33, 2,  34, 3,  35, 4,  36, 5,  37, 6,  38, 7,  39,
          8, 40, 9, 41, 10, 42, 11, 43, 12, 44, 13, 45, 14, 46, 15, 47 },
        { 16, 48, 17, 49, 18, 50, 19, 51, 20, 52, 21, 53, 22, 54, 23, 55,
          24, 56, 25, 57, 26, 58, 27, 59, 28, 60, 29, 61, 30, 62, 31, 63 }
    };
    for (int k = 0; k < 2; k++)
        out[k] = (sp_wide_short)_mm512_permutex2var_epi16((__m512i)a, _mm512_loadu_si512(order[k]),
                                                          (__m512i)b);
#elif defined SP_WIDE_AVX2
    __m256i low = _mm256_unpacklo_epi16((__m256i)a, (__m256i)b);
    __m256i high = _mm256_unpackhi_epi16((__m256i)a, (__m256i)b);
    out[0] = (sp_wide_short)_mm256_permute2x128_si256(low, high, 0x20);
    out[1] = (sp_wide_short)_mm256_permute2x128_si256(low, high, 0x31);
#else
    out[0] = __builtin_shufflevector(a, b, 0, 8, 1, 9, 2, 10, 3, 11);
    out[1] = __builtin_shufflevector(a, b, 4, 12, 5, 13, 6, 14, 7, 15);
#endif
}

/* Loads two neighbouring 16-bit values per lane, the first one into the low half of the lane. The
 * addresses need no alignment. With AVX2, separate loads are faster than a gather on most
 * processors. */
static inline sp_wide_int sp_fetch_pairs(const int16_t *from, sp_wide_int index) {
#if defined SP_WIDE_AVX512
    return (sp_wide_int)_mm512_i32gather_epi32((__m512i)index, from, 2);
#else
    int32_t at[SP_WIDE];
    sp_wide_int pairs;
    sp_wide_int_store(at, index);
    for (int i = 0; i < SP_WIDE; i++) {
        int32_t pair;
        memcpy(&pair, from + at[i], sizeof pair);
        pairs[i] = pair;
    }
    return pairs;
#endif
}

#if defined SP_WIDE_AVX512
/* Loads 8 bytes for each of two lanes. */
static inline __m128i sp_fetch_two(const int16_t *from, const int32_t at[2]) {
    int64_t second;
    memcpy(&second, from + at[1], sizeof second);
    return _mm_insert_epi64(_mm_loadu_si64(from + at[0]), second, 1);
}

static inline __m512i sp_fetch_join(__m128i a, __m128i b, __m128i c, __m128i d) {
    return _mm512_inserti64x4(_mm512_castsi256_si512(_mm256_set_m128i(b, a)),
                              _mm256_set_m128i(d, c), 1);
}
#endif

/* Loads four neighbouring 16-bit values per lane: the first two into out[0], the other two into
 * out[1]. With AVX-512, separate loads of 8 bytes are a little faster than gathers at least on
 * AMD's processors; those of 4 bytes are not. */
static inline void sp_fetch_quads(const int16_t *from, sp_wide_int index, sp_wide_int out[2]) {
#if defined SP_WIDE_AVX512
    const __m512i even =
        _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
    const __m512i odd = _mm512_or_si512(even, _mm512_set1_epi32(1));
    int32_t at[SP_WIDE];
    sp_wide_int_store(at, index);
    __m512i low = sp_fetch_join(sp_fetch_two(from, at), sp_fetch_two(from, at + 2),
                                sp_fetch_two(from, at + 4), sp_fetch_two(from, at + 6));
    __m512i high = sp_fetch_join(sp_fetch_two(from, at + 8), sp_fetch_two(from, at + 10),
                                 sp_fetch_two(from, at + 12), sp_fetch_two(from, at + 14));
    out[0] = (sp_wide_int)_mm512_permutex2var_epi32(low, even, high);
    out[1] = (sp_wide_int)_mm512_permutex2var_epi32(low, odd, high);
#else
    out[0] = sp_fetch_pairs(from, index);
    out[1] = sp_fetch_pairs(from + 2, index);
#endif
}

/* Subtracts pairs of 16-bit values element by element. The differences must fit into signed 16
 * bits. */
static inline sp_wide_int sp_fetch_difference(sp_wide_int a, sp_wide_int b) {
    return (sp_wide_int)((sp_wide_short)a - (sp_wide_short)b);
}

/* Returns the dot product of each pair with the pair of weights in the same lane. */
static inline sp_wide_int sp_fetch_dot(sp_wide_int pair, sp_wide_int weights) {
#if defined SP_WIDE_AVX512
    return (sp_wide_int)_mm512_madd_epi16((__m512i)pair, (__m512i)weights);
#elif defined SP_WIDE_AVX2
    return (sp_wide_int)_mm256_madd_epi16((__m256i)pair, (__m256i)weights);
#elif defined SP_WIDE_SSE41
    return (sp_wide_int)_mm_madd_epi16((__m128i)pair, (__m128i)weights);
#else
    return (pair << 16 >> 16) * (weights << 16 >> 16) + (pair >> 16) * (weights >> 16);
#endif
}

/* One table entry of four components per lane. part[k] has the components of lane k. With eight
 * lanes, the components of lane k + 4 follow. With sixteen, lanes k + 8 and k + 12 follow too. */
struct sp_entries {
    sp_wide part[4];
};

/* Separate loads are faster than gathers, with AVX2 on most processors and with AVX-512 at least on
 * those of AMD. */
static inline struct sp_entries sp_fetch_entries(const float (*table)[4], sp_wide_int index) {
    struct sp_entries entries;
    int32_t at[SP_WIDE];
    sp_wide_int_store(at, index);
    for (int k = 0; k < 4; k++) {
#if defined SP_WIDE_AVX512
        __m512 part = _mm512_castps128_ps512(_mm_load_ps(table[at[k]]));
        part = _mm512_insertf32x4(part, _mm_load_ps(table[at[k + 4]]), 1);
        part = _mm512_insertf32x4(part, _mm_load_ps(table[at[k + 8]]), 2);
        entries.part[k] = (sp_wide)_mm512_insertf32x4(part, _mm_load_ps(table[at[k + 12]]), 3);
#elif defined SP_WIDE_AVX2
        __m128 low = _mm_load_ps(table[at[k]]), high = _mm_load_ps(table[at[k + 4]]);
        entries.part[k] = (sp_wide)_mm256_set_m128(high, low);
#else
        entries.part[k] = sp_wide_load(table[at[k]]);
#endif
    }
    return entries;
}

/* Repeats lane k of each group of four lanes four times. */
static inline sp_wide sp_fetch_spread(sp_wide share, int k) {
    switch (k) {
    case 0:
        return SP_QUAD_SHUFFLE(share, share, 0, 0, 0, 0);
    case 1:
        return SP_QUAD_SHUFFLE(share, share, 1, 1, 1, 1);
    case 2:
        return SP_QUAD_SHUFFLE(share, share, 2, 2, 2, 2);
    default:
        return SP_QUAD_SHUFFLE(share, share, 3, 3, 3, 3);
    }
}

/* Computes for each component c: out[c] = share[0]·(entries[1] − entries[0]) + share[1]·(entries[2]
 * − entries[1]). */
static inline void sp_fetch_sum(const struct sp_entries entries[3], const sp_wide share[2],
                                sp_wide out[4]) {
    sp_wide sum[4];
    for (int k = 0; k < 4; k++) {
        sp_wide middle = entries[1].part[k];
        sum[k] = sp_fetch_spread(share[0], k) * (middle - entries[0].part[k]) +
                 sp_fetch_spread(share[1], k) * (entries[2].part[k] - middle);
    }
    sp_quad_transpose(sum, out);
}

/* Computes for each component: out = to − from. */
static inline void sp_fetch_change(const struct sp_entries *from, const struct sp_entries *to,
                                   sp_wide out[4]) {
    sp_wide change[4];
    for (int k = 0; k < 4; k++)
        change[k] = to->part[k] - from->part[k];
    sp_quad_transpose(change, out);
}

#endif
