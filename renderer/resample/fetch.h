/* SPDX-License-Identifier: Apache-2.0
 *
 * Loads from a different place for each lane.
 */
#ifndef SP_RESAMPLE_FETCH_H
#define SP_RESAMPLE_FETCH_H

#include "base/wide.h"

/* SP_WIDE neighbouring integers of a narrow type, as floats. */
#if defined SP_WIDE_AVX512
#define WIDEN(x, narrow) (sp_wide) _mm512_cvtepi32_ps(_mm512_cvt##narrow##_epi32(x))
#define LOAD_8(p) _mm_loadu_si128((const __m128i *)(const void *)(p))
#define LOAD_16(p) _mm256_loadu_si256((const __m256i *)(const void *)(p))
#elif defined SP_WIDE_AVX2
#define WIDEN(x, narrow) (sp_wide) _mm256_cvtepi32_ps(_mm256_cvt##narrow##_epi32(x))
#define LOAD_8(p) _mm_loadl_epi64((const __m128i *)(const void *)(p))
#define LOAD_16(p) _mm_loadu_si128((const __m128i *)(const void *)(p))
#elif defined SP_WIDE_SSE41
#define WIDEN(x, narrow) (sp_wide) _mm_cvtepi32_ps(_mm_cvt##narrow##_epi32(x))
#define LOAD_8(p) _mm_loadu_si32(p)
#define LOAD_16(p) _mm_loadl_epi64((const __m128i *)(const void *)(p))
#endif
#if defined WIDEN
#define SP_FETCH_NARROW(name, type, load, narrow)                                                  \
    static inline sp_wide name(const type *p) {                                                    \
        return WIDEN(load(p), narrow);                                                             \
    }
#else
#define SP_FETCH_NARROW(name, type, load, narrow)                                                  \
    static inline sp_wide name(const type *p) {                                                    \
        sp_wide x;                                                                                 \
        for (int i = 0; i < SP_WIDE; i++)                                                          \
            x[i] = (float)p[i];                                                                    \
        return x;                                                                                  \
    }
#endif
SP_FETCH_NARROW(sp_fetch_uint8, uint8_t, LOAD_8, epu8)
SP_FETCH_NARROW(sp_fetch_int8, int8_t, LOAD_8, epi8)
SP_FETCH_NARROW(sp_fetch_uint16, uint16_t, LOAD_16, epu16)
SP_FETCH_NARROW(sp_fetch_int16, int16_t, LOAD_16, epi16)
#undef SP_FETCH_NARROW

/* The 32 bits at each of the places, which need no alignment. */
static inline int32_t sp_fetch_word(const int16_t *place) {
    int32_t word;
    memcpy(&word, place, sizeof word);
    return word;
}

/* Two neighbouring 16-bit values per lane, the first in the low half. */
static inline sp_wide_int sp_fetch_pairs(const int16_t *from, const int32_t index[SP_WIDE]) {
#if defined SP_WIDE_AVX512
    return (sp_wide_int){ sp_fetch_word(from + index[0]),  sp_fetch_word(from + index[1]),
                          sp_fetch_word(from + index[2]),  sp_fetch_word(from + index[3]),
                          sp_fetch_word(from + index[4]),  sp_fetch_word(from + index[5]),
                          sp_fetch_word(from + index[6]),  sp_fetch_word(from + index[7]),
                          sp_fetch_word(from + index[8]),  sp_fetch_word(from + index[9]),
                          sp_fetch_word(from + index[10]), sp_fetch_word(from + index[11]),
                          sp_fetch_word(from + index[12]), sp_fetch_word(from + index[13]),
                          sp_fetch_word(from + index[14]), sp_fetch_word(from + index[15]) };
#elif defined SP_WIDE_AVX2
    return (sp_wide_int){ sp_fetch_word(from + index[0]), sp_fetch_word(from + index[1]),
                          sp_fetch_word(from + index[2]), sp_fetch_word(from + index[3]),
                          sp_fetch_word(from + index[4]), sp_fetch_word(from + index[5]),
                          sp_fetch_word(from + index[6]), sp_fetch_word(from + index[7]) };
#else
    return (sp_wide_int){ sp_fetch_word(from + index[0]), sp_fetch_word(from + index[1]),
                          sp_fetch_word(from + index[2]), sp_fetch_word(from + index[3]) };
#endif
}

/* The entries of the table at index[0], index[4], …, one after the other. */
static inline sp_wide sp_fetch_quads(const float (*table)[4], const int32_t *index) {
#if defined SP_WIDE_AVX512
    __m512 all = _mm512_castps128_ps512(_mm_load_ps(table[index[0]]));
    all = _mm512_insertf32x4(all, _mm_load_ps(table[index[4]]), 1);
    all = _mm512_insertf32x4(all, _mm_load_ps(table[index[8]]), 2);
    return (sp_wide)_mm512_insertf32x4(all, _mm_load_ps(table[index[12]]), 3);
#elif defined SP_WIDE_AVX2
    return (sp_wide)_mm256_insertf128_ps(_mm256_castps128_ps256(_mm_load_ps(table[index[0]])),
                                         _mm_load_ps(table[index[4]]), 1);
#else
    return sp_wide_load(table[index[0]]);
#endif
}

/* In each group of four lanes: lanes i, j, k and l of that group; SP_WIDE + n is lane n of b. */
#if defined SP_WIDE_AVX512
#define SHUFFLE(a, b, i, j, k, l)                                                                  \
    __builtin_shufflevector(a, b, i, j, k, l, i + 4, j + 4, k + 4, l + 4, i + 8, j + 8, k + 8,     \
                            l + 8, i + 12, j + 12, k + 12, l + 12)
#elif defined SP_WIDE_AVX2
#define SHUFFLE(a, b, i, j, k, l)                                                                  \
    __builtin_shufflevector(a, b, i, j, k, l, i + 4, j + 4, k + 4, l + 4)
#else
#define SHUFFLE(a, b, i, j, k, l) __builtin_shufflevector(a, b, i, j, k, l)
#endif

/* table[high] − table[low], entry by entry: out[c] has component c of each lane. */
static inline void sp_fetch_difference(const float (*table)[4], const int32_t high[SP_WIDE],
                                       const int32_t low[SP_WIDE], sp_wide out[4]) {
    sp_wide row[4]; /* row k: lanes k, k + 4, …, so that the transposed lanes are in order */
    for (int k = 0; k < 4; k++)
        row[k] = sp_fetch_quads(table, high + k) - sp_fetch_quads(table, low + k);
    sp_wide a = SHUFFLE(row[0], row[1], 0, SP_WIDE, 1, SP_WIDE + 1);
    sp_wide b = SHUFFLE(row[0], row[1], 2, SP_WIDE + 2, 3, SP_WIDE + 3);
    sp_wide c = SHUFFLE(row[2], row[3], 0, SP_WIDE, 1, SP_WIDE + 1);
    sp_wide d = SHUFFLE(row[2], row[3], 2, SP_WIDE + 2, 3, SP_WIDE + 3);
    out[0] = SHUFFLE(a, c, 0, 1, SP_WIDE, SP_WIDE + 1);
    out[1] = SHUFFLE(a, c, 2, 3, SP_WIDE + 2, SP_WIDE + 3);
    out[2] = SHUFFLE(b, d, 0, 1, SP_WIDE, SP_WIDE + 1);
    out[3] = SHUFFLE(b, d, 2, 3, SP_WIDE + 2, SP_WIDE + 3);
#undef SHUFFLE
}

#endif
