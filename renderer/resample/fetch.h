/* SPDX-License-Identifier: Apache-2.0
 *
 * Loads from a different place for each lane.
 */
#ifndef SP_RESAMPLE_FETCH_H
#define SP_RESAMPLE_FETCH_H

#include "base/wide.h"

/* SP_WIDE_SHORT neighbouring integers of a narrow type. Those with a sign are raised by the largest
 * power of two, so that their order stays. */
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

/* Writes the first SP_WIDE lanes, or eight if that is more, of a and of b in turns. */
static inline void sp_fetch_alternate(sp_wide_short a, sp_wide_short b, uint16_t *out) {
#if defined SP_WIDE_AVX512
    static const uint16_t order[32] = { 0,  32, 1,  33, 2,  34, 3,  35, 4,  36, 5,
                                        37, 6,  38, 7,  39, 8,  40, 9,  41, 10, 42,
                                        11, 43, 12, 44, 13, 45, 14, 46, 15, 47 };
    __m512i turns = _mm512_permutex2var_epi16((__m512i)a, _mm512_loadu_si512(order), (__m512i)b);
    _mm512_storeu_si512(out, turns);
#else
    for (int i = 0; i < 8; i++) {
        out[2 * i] = a[i];
        out[2 * i + 1] = b[i];
    }
#endif
}

/* Two neighbouring 16-bit values per lane, the first in the low half. The places need no alignment.
 * With AVX2, separate loads are faster than a gather on most processors. */
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

/* The sum of two differences between entries of a table, each times its share:
 *
 *   out[c] = share[0]·(table[at[1]][c] − table[at[0]][c]) + share[1]·(table[at[2]][c] −
 * table[at[1]][c])
 */
#if defined SP_WIDE_AVX512
static inline void sp_fetch_differences(const float (*table)[4], const sp_wide_int at[3],
                                        const sp_wide share[2], sp_wide out[4]) {
    const __m512i even =
        _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
    const __m512i odd = _mm512_or_si512(even, _mm512_set1_epi32(1));
    __m512 sum[2][2]; /* [half of the entry][half of the lanes]: component 0 or 2, then 1 or 3, per
                         lane */
    for (int h = 0; h < 2; h++) {
        const __m512i twice =
            _mm512_add_epi32(_mm512_srli_epi32(even, 2), _mm512_set1_epi32(8 * h));
        __m512 parts[2] = { _mm512_permutexvar_ps(twice, (__m512)share[0]),
                            _mm512_permutexvar_ps(twice, (__m512)share[1]) };
        __m256i place[3];
        for (int k = 0; k < 3; k++)
            place[k] = _mm256_slli_epi32(h ? _mm512_extracti64x4_epi64((__m512i)at[k], 1)
                                           : _mm512_castsi512_si256((__m512i)at[k]),
                                         1);
        for (int c = 0; c < 2; c++) {
            __m512 entry[3];
            for (int k = 0; k < 3; k++)
                entry[k] =
                    _mm512_castpd_ps(_mm512_i32gather_pd(place[k], (const char *)table + 8 * c, 8));
            sum[c][h] = _mm512_mul_ps(parts[0], _mm512_sub_ps(entry[1], entry[0]));
            sum[c][h] = _mm512_fmadd_ps(parts[1], _mm512_sub_ps(entry[2], entry[1]), sum[c][h]);
        }
    }
    for (int c = 0; c < 2; c++) {
        out[2 * c] = (sp_wide)_mm512_permutex2var_ps(sum[c][0], even, sum[c][1]);
        out[2 * c + 1] = (sp_wide)_mm512_permutex2var_ps(sum[c][0], odd, sum[c][1]);
    }
}
#else
#if defined SP_WIDE_AVX2
/* Lanes 0 and 4 of each array, four times each; the entries of the table there. */
static inline sp_wide sp_fetch_spread(const float *share) {
    return (sp_wide)_mm256_set_m128(_mm_set1_ps(share[4]), _mm_set1_ps(share[0]));
}

static inline sp_wide sp_fetch_entries(const float (*table)[4], const int32_t *index) {
    return (sp_wide)_mm256_set_m128(_mm_load_ps(table[index[4]]), _mm_load_ps(table[index[0]]));
}
#define SHUFFLE(a, b, i, j, k, l)                                                                  \
    __builtin_shufflevector(a, b, i, j, k, l, i + 4, j + 4, k + 4, l + 4)
#else
static inline sp_wide sp_fetch_spread(const float *share) {
    return sp_wide_all(share[0]);
}

static inline sp_wide sp_fetch_entries(const float (*table)[4], const int32_t *index) {
    return sp_wide_load(table[index[0]]);
}
#define SHUFFLE(a, b, i, j, k, l) __builtin_shufflevector(a, b, i, j, k, l)
#endif

static inline void sp_fetch_differences(const float (*table)[4], const sp_wide_int at[3],
                                        const sp_wide share[2], sp_wide out[4]) {
    int32_t place[3][SP_WIDE];
    float part[2][SP_WIDE];
    sp_wide row[4]; /* row k: lanes k and k + 4, so that the transposed lanes are in order */
    for (int k = 0; k < 3; k++)
        sp_wide_int_store(place[k], at[k]);
    for (int k = 0; k < 2; k++)
        sp_wide_store(part[k], share[k]);
    for (int k = 0; k < 4; k++) {
        sp_wide middle = sp_fetch_entries(table, place[1] + k);
        row[k] = sp_fetch_spread(part[0] + k) * (middle - sp_fetch_entries(table, place[0] + k));
        row[k] += sp_fetch_spread(part[1] + k) * (sp_fetch_entries(table, place[2] + k) - middle);
    }
    sp_wide a = SHUFFLE(row[0], row[1], 0, SP_WIDE, 1, SP_WIDE + 1);
    sp_wide b = SHUFFLE(row[0], row[1], 2, SP_WIDE + 2, 3, SP_WIDE + 3);
    sp_wide c = SHUFFLE(row[2], row[3], 0, SP_WIDE, 1, SP_WIDE + 1);
    sp_wide d = SHUFFLE(row[2], row[3], 2, SP_WIDE + 2, 3, SP_WIDE + 3);
    out[0] = SHUFFLE(a, c, 0, 1, SP_WIDE, SP_WIDE + 1);
    out[1] = SHUFFLE(a, c, 2, 3, SP_WIDE + 2, SP_WIDE + 3);
    out[2] = SHUFFLE(b, d, 0, 1, SP_WIDE, SP_WIDE + 1);
    out[3] = SHUFFLE(b, d, 2, 3, SP_WIDE + 2, SP_WIDE + 3);
}
#undef SHUFFLE
#endif

#endif
