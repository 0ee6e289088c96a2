/* SPDX-License-Identifier: Apache-2.0
 *
 * SIMD on SP_WIDE floats: written once, compiled once per instruction set (isa.h). The compiler's
 * portable vectors provide the arithmetic (+ − * / & | ~); functions provide the rest. A vector has
 * four floats in the reference, with SSE and with NEON, eight with AVX2, sixteen with AVX-512.
 *
 * Loads and stores need no alignment. A mask comes from a comparison (sp_wide_lt …) and is combined
 * with & | ~. It has one bit per lane with AVX-512, and 0 or −1 in each lane elsewhere.
 */
#ifndef SP_BASE_WIDE_H
#define SP_BASE_WIDE_H

#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#if defined SP_ISA && defined __AVX2__
#include <immintrin.h>
#elif defined SP_ISA && defined __SSE4_1__
#include <smmintrin.h> /* immintrin.h doubles the time that a small file compiles */
#endif

#if defined SP_ISA && defined __AVX512F__
#define SP_WIDE_AVX512 1
#elif defined SP_ISA && defined __AVX2__
#define SP_WIDE_AVX2 1
#elif defined SP_ISA && defined __SSE4_1__
#define SP_WIDE_SSE41 1
#endif

#if defined SP_WIDE_AVX512
enum { SP_WIDE = 16 };
#elif defined SP_WIDE_AVX2
enum { SP_WIDE = 8 };
#else
enum { SP_WIDE = 4 };
#endif

typedef float sp_wide __attribute__((vector_size(SP_WIDE * 4)));
typedef int32_t sp_wide_int __attribute__((vector_size(SP_WIDE * 4)));
typedef uint32_t sp_wide_bits __attribute__((vector_size(SP_WIDE * 4)));
#if defined SP_WIDE_AVX512
typedef __mmask16 sp_wide_mask;
#else
typedef sp_wide_int sp_wide_mask; /* 0 or −1 in each lane */
#endif

static inline sp_wide sp_wide_all(float x) {
    return x - (sp_wide){ 0 };
}

static inline sp_wide_int sp_wide_int_all(int32_t x) {
    return x - (sp_wide_int){ 0 };
}

/* 0, 1, 2, … */
static inline sp_wide_int sp_wide_int_count(void) {
#if defined SP_WIDE_AVX512
    return (sp_wide_int){ 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15 };
#elif defined SP_WIDE_AVX2
    return (sp_wide_int){ 0, 1, 2, 3, 4, 5, 6, 7 };
#else
    return (sp_wide_int){ 0, 1, 2, 3 };
#endif
}

static inline sp_wide sp_wide_from_int(sp_wide_int a) {
    return __builtin_convertvector(a, sp_wide);
}

/* Rounds towards zero. A lane beyond the range of int32_t becomes an unspecified number. */
static inline sp_wide_int sp_wide_to_int(sp_wide a) {
#if defined SP_WIDE_AVX512
    return (sp_wide_int)_mm512_cvttps_epi32((__m512)a);
#elif defined SP_WIDE_AVX2
    return (sp_wide_int)_mm256_cvttps_epi32((__m256)a);
#else
    return __builtin_convertvector(a, sp_wide_int);
#endif
}

static inline sp_wide sp_wide_count(void) {
    return sp_wide_from_int(sp_wide_int_count());
}

static inline sp_wide sp_wide_load(const float *p) {
    sp_wide a;
    memcpy(&a, p, sizeof a);
    return a;
}

static inline void sp_wide_store(float *p, sp_wide a) {
    memcpy(p, &a, sizeof a);
}

static inline sp_wide_int sp_wide_int_load(const int32_t *p) {
    sp_wide_int a;
    memcpy(&a, p, sizeof a);
    return a;
}

static inline void sp_wide_int_store(int32_t *p, sp_wide_int a) {
    memcpy(p, &a, sizeof a);
}

/* Comparisons: false where a lane is NaN. */
#if defined SP_WIDE_AVX512
static inline sp_wide_mask sp_wide_lt(sp_wide a, sp_wide b) {
    return _mm512_cmp_ps_mask((__m512)a, (__m512)b, _CMP_LT_OQ);
}

static inline sp_wide_mask sp_wide_le(sp_wide a, sp_wide b) {
    return _mm512_cmp_ps_mask((__m512)a, (__m512)b, _CMP_LE_OQ);
}

static inline sp_wide_mask sp_wide_eq(sp_wide a, sp_wide b) {
    return _mm512_cmp_ps_mask((__m512)a, (__m512)b, _CMP_EQ_OQ);
}

static inline sp_wide_mask sp_wide_int_lt(sp_wide_int a, sp_wide_int b) {
    return _mm512_cmplt_epi32_mask((__m512i)a, (__m512i)b);
}

static inline sp_wide_mask sp_wide_int_eq(sp_wide_int a, sp_wide_int b) {
    return _mm512_cmpeq_epi32_mask((__m512i)a, (__m512i)b);
}
#else
static inline sp_wide_mask sp_wide_lt(sp_wide a, sp_wide b) {
    return a < b;
}

static inline sp_wide_mask sp_wide_le(sp_wide a, sp_wide b) {
    return a <= b;
}

static inline sp_wide_mask sp_wide_eq(sp_wide a, sp_wide b) {
    return a == b;
}

static inline sp_wide_mask sp_wide_int_lt(sp_wide_int a, sp_wide_int b) {
    return a < b;
}

static inline sp_wide_mask sp_wide_int_eq(sp_wide_int a, sp_wide_int b) {
    return a == b;
}
#endif

/* Masks the first n lanes; n may be negative or more than SP_WIDE. */
static inline sp_wide_mask sp_wide_first(int n) {
    return sp_wide_int_lt(sp_wide_int_count(), sp_wide_int_all(n));
}

/* True if any lane of the mask is set. */
static inline bool sp_wide_any(sp_wide_mask mask) {
#if defined SP_WIDE_AVX512
    return mask != 0;
#elif defined SP_WIDE_AVX2
    return _mm256_movemask_ps((__m256)mask) != 0;
#elif defined SP_WIDE_SSE41
    return _mm_movemask_ps((__m128)mask) != 0;
#else
    typedef int64_t halves __attribute__((vector_size(16)));
    halves h = (halves)mask;
    return (h[0] | h[1]) != 0;
#endif
}

/* Bit k is lane k of the mask. */
static inline unsigned sp_wide_mask_bits(sp_wide_mask mask) {
#if defined SP_WIDE_AVX512
    return mask;
#elif defined SP_WIDE_AVX2
    return (unsigned)_mm256_movemask_ps((__m256)mask);
#elif defined SP_WIDE_SSE41
    return (unsigned)_mm_movemask_ps((__m128)mask);
#else
    unsigned bits = 0;
    for (int i = 0; i < SP_WIDE; i++)
        bits |= (mask[i] ? 1u : 0u) << i;
    return bits;
#endif
}

/* Selects the lanes of a where the mask is set, and the lanes of b elsewhere. */
static inline sp_wide sp_wide_select(sp_wide_mask mask, sp_wide a, sp_wide b) {
#if defined SP_WIDE_AVX512
    return (sp_wide)_mm512_mask_blend_ps(mask, (__m512)b, (__m512)a);
#elif defined SP_WIDE_AVX2
    return (sp_wide)_mm256_blendv_ps((__m256)b, (__m256)a, (__m256)mask);
#elif defined SP_WIDE_SSE41
    return (sp_wide)_mm_blendv_ps((__m128)b, (__m128)a, (__m128)mask);
#else
    return (sp_wide)(((sp_wide_int)a & mask) | ((sp_wide_int)b & ~mask));
#endif
}

/* The same with x in each lane instead of a. */
static inline sp_wide_int sp_wide_int_select_all(sp_wide_mask mask, int32_t x, sp_wide_int b) {
#if defined SP_WIDE_AVX512
    return (sp_wide_int)_mm512_mask_broadcastd_epi32((__m512i)b, mask, _mm_cvtsi32_si128(x));
#else
    return (sp_wide_int)sp_wide_select(mask, (sp_wide)sp_wide_int_all(x), (sp_wide)b);
#endif
}

/* Keeps the lanes of a where the mask is set; the other lanes become 0. */
static inline sp_wide sp_wide_keep(sp_wide_mask mask, sp_wide a) {
#if defined SP_WIDE_AVX512
    return (sp_wide)_mm512_maskz_mov_ps(mask, (__m512)a);
#else
    return (sp_wide)((sp_wide_int)a & mask);
#endif
}

/* a < b ? a : b, and a > b ? a : b; b where a lane is NaN. */
static inline sp_wide sp_wide_min(sp_wide a, sp_wide b) {
#if defined SP_WIDE_AVX512
    return (sp_wide)_mm512_min_ps((__m512)a, (__m512)b);
#elif defined SP_WIDE_AVX2
    return (sp_wide)_mm256_min_ps((__m256)a, (__m256)b);
#elif defined SP_WIDE_SSE41
    return (sp_wide)_mm_min_ps((__m128)a, (__m128)b);
#else
    return sp_wide_select(a < b, a, b);
#endif
}

static inline sp_wide sp_wide_max(sp_wide a, sp_wide b) {
#if defined SP_WIDE_AVX512
    return (sp_wide)_mm512_max_ps((__m512)a, (__m512)b);
#elif defined SP_WIDE_AVX2
    return (sp_wide)_mm256_max_ps((__m256)a, (__m256)b);
#elif defined SP_WIDE_SSE41
    return (sp_wide)_mm_max_ps((__m128)a, (__m128)b);
#else
    return sp_wide_select(a > b, a, b);
#endif
}

/* Limits x to [low, high]. NaN becomes low. */
static inline sp_wide sp_wide_clamp(sp_wide x, float low, float high) {
    return sp_wide_min(sp_wide_max(x, sp_wide_all(low)), sp_wide_all(high));
}

static inline sp_wide sp_wide_abs(sp_wide a) {
    return (sp_wide)((sp_wide_int)a & 0x7fffffff);
}

/* a ≥ 0 with the sign of b. */
static inline sp_wide sp_wide_copysign(sp_wide a, sp_wide b) {
    return (sp_wide)((sp_wide_bits)a | ((sp_wide_bits)b & 0x80000000u));
}

/* a·b + c; rounded once if the instruction set has FMA. */
static inline sp_wide sp_wide_fma(sp_wide a, sp_wide b, sp_wide c) {
#if defined SP_WIDE_AVX512
    return (sp_wide)_mm512_fmadd_ps((__m512)a, (__m512)b, (__m512)c);
#elif defined SP_WIDE_AVX2
    return (sp_wide)_mm256_fmadd_ps((__m256)a, (__m256)b, (__m256)c);
#else
    return a * b + c; /* NEON: the compiler contracts it */
#endif
}

static inline sp_wide sp_wide_sqrt(sp_wide a) {
#if defined SP_WIDE_AVX512
    return (sp_wide)_mm512_sqrt_ps((__m512)a);
#elif defined SP_WIDE_AVX2
    return (sp_wide)_mm256_sqrt_ps((__m256)a);
#elif defined SP_WIDE_SSE41
    return (sp_wide)_mm_sqrt_ps((__m128)a);
#else
    sp_wide root;
    for (int i = 0; i < SP_WIDE; i++)
        root[i] = __builtin_sqrtf(a[i]);
    return root;
#endif
}

/* 1/a for normal a, with a relative error below 2⁻²². */
static inline sp_wide sp_wide_inverse(sp_wide a) {
#if defined SP_WIDE_AVX512 /* a division of 16 lanes takes as long as twenty multiplications */
    sp_wide x = (sp_wide)_mm512_rcp14_ps((__m512)a);
    return x + x * (1 - a * x);
#else
    return 1 / a;
#endif
}

/* 1/√a for normal a > 0, with a relative error below 2⁻²². */
static inline sp_wide sp_wide_inverse_sqrt(sp_wide a) {
#if defined SP_WIDE_AVX512
    sp_wide x = (sp_wide)_mm512_rsqrt14_ps((__m512)a);
    return x + 0.5f * x * (1 - a * x * x);
#else
    return 1 / sp_wide_sqrt(a);
#endif
}

/* √a for a > 0, exact to at least about 14 bits. */
static inline sp_wide sp_wide_fast_sqrt(sp_wide a) {
#if defined SP_WIDE_AVX512
    return a * (sp_wide)_mm512_rsqrt14_ps((__m512)a);
#else
    return sp_wide_sqrt(a);
#endif
}

/* 1/a for a > 0, exact to about 22 bits. */
static inline sp_wide sp_wide_fast_inverse(sp_wide a) {
#if defined SP_WIDE_AVX512
    sp_wide r = (sp_wide)_mm512_rcp14_ps((__m512)a);
#elif defined SP_WIDE_AVX2
    sp_wide r = (sp_wide)_mm256_rcp_ps((__m256)a);
#elif defined SP_WIDE_SSE41
    sp_wide r = (sp_wide)_mm_rcp_ps((__m128)a);
#else
    sp_wide r = 1.0f / a;
#endif
    return r * (2.0f - a * r);
}

/* Rounds down. Beyond ±2³¹ the result is unspecified without SSE4.1. */
static inline sp_wide sp_wide_floor(sp_wide a) {
#if defined SP_WIDE_AVX512
    return (sp_wide)_mm512_floor_ps((__m512)a);
#elif defined SP_WIDE_AVX2
    return (sp_wide)_mm256_floor_ps((__m256)a);
#elif defined SP_WIDE_SSE41
    return (sp_wide)_mm_floor_ps((__m128)a);
#else
    sp_wide whole = sp_wide_from_int(sp_wide_to_int(a));
    return whole - sp_wide_keep(sp_wide_lt(a, whole), sp_wide_all(1));
#endif
}

/* table[index] for each lane. */
static inline sp_wide sp_wide_gather(const float *table, sp_wide_int index) {
#if defined SP_WIDE_AVX512
    return (sp_wide)_mm512_i32gather_ps((__m512i)index, table, 4);
#elif defined SP_WIDE_AVX2
    return (sp_wide)_mm256_i32gather_ps(table, (__m256i)index, 4);
#else
    sp_wide a;
    for (int i = 0; i < SP_WIDE; i++)
        a[i] = table[index[i]];
    return a;
#endif
}

/* table[index] for each lane, index in [0, count). At least SP_WIDE elements of the table must be
 * readable. */
static inline sp_wide sp_wide_look_up(const float *table, uint32_t count, sp_wide_int index) {
#if defined SP_WIDE_AVX512
    if (count <= SP_WIDE)
        return (sp_wide)_mm512_permutexvar_ps((__m512i)index, _mm512_loadu_ps(table));
#elif defined SP_WIDE_AVX2
    if (count <= SP_WIDE)
        return (sp_wide)_mm256_permutevar8x32_ps(_mm256_loadu_ps(table), (__m256i)index);
#endif
    (void)count;
    return sp_wide_gather(table, index);
}

/* Tests bit `bit` of words[word] for each lane. Bit k of the result is lane k. With AVX-512 the
 * words must be aligned. */
static inline uint32_t sp_wide_test_bits(const uint32_t words[32], sp_wide_int bit,
                                         sp_wide_int word) {
#if defined SP_WIDE_AVX512
    __m512i blocks = _mm512_permutex2var_epi32(_mm512_load_si512(words), (__m512i)word,
                                               _mm512_load_si512(words + 16));
    return _mm512_test_epi32_mask(_mm512_srlv_epi32(blocks, (__m512i)bit), _mm512_set1_epi32(1));
#elif defined SP_WIDE_AVX2
    __m256i quad = _mm256_and_si256((__m256i)word, _mm256_set1_epi32(32 - 1));
    __m256i blocks = _mm256_i32gather_epi32((const int *)words, quad, 4);
    blocks = _mm256_slli_epi32(_mm256_srlv_epi32(blocks, (__m256i)bit), 31);
    return (uint32_t)_mm256_movemask_ps((__m256)blocks);
#else
    uint32_t bits = 0;
    for (int i = 0; i < SP_WIDE; i++)
        bits |= (words[word[i] & (32 - 1)] >> (bit[i] & 31) & 1) << i;
    return bits;
#endif
}

/* Lane i of the result is from[order[v + i]]; v is a multiple of SP_WIDE. */
static inline sp_wide_int sp_wide_int_pick(const uint8_t from[16], const uint8_t order[16], int v) {
#if defined SP_WIDE_AVX512 || defined SP_WIDE_AVX2 || defined SP_WIDE_SSE41
    __m128i at = _mm_loadu_si128((const __m128i *)(const void *)order);
    __m128i all = _mm_shuffle_epi8(_mm_loadu_si128((const __m128i *)(const void *)from), at);
#endif
#if defined SP_WIDE_AVX512
    (void)v;
    return (sp_wide_int)_mm512_cvtepu8_epi32(all);
#elif defined SP_WIDE_AVX2
    return (sp_wide_int)_mm256_cvtepu8_epi32(v ? _mm_srli_si128(all, 8) : all);
#elif defined SP_WIDE_SSE41
    int32_t four;
    memcpy(&four, (const uint8_t *)&all + v, sizeof four);
    return (sp_wide_int)_mm_cvtepu8_epi32(_mm_cvtsi32_si128(four));
#else
    sp_wide_int a;
    for (int i = 0; i < SP_WIDE; i++)
        a[i] = from[order[v + i]];
    return a;
#endif
}

/* Returns the bitwise OR of all lanes. */
static inline int32_t sp_wide_int_or(sp_wide_int a) {
#if defined SP_WIDE_AVX512
    return _mm512_reduce_or_epi32((__m512i)a);
#else
    int32_t bits = 0;
    for (int i = 0; i < SP_WIDE; i++)
        bits |= a[i];
    return bits;
#endif
}

/* Returns the largest lane. */
static inline float sp_wide_largest(sp_wide a) {
    float largest = a[0];
    for (int i = 1; i < SP_WIDE; i++)
        largest = a[i] > largest ? a[i] : largest;
    return largest;
}

/* Vectors of unsigned 16-bit integers, as wide as sp_wide. */
enum { SP_WIDE_SHORT = 2 * SP_WIDE };
typedef uint16_t sp_wide_short __attribute__((vector_size(SP_WIDE_SHORT * 2)));

static inline sp_wide_short sp_wide_short_all(int x) {
    return (uint16_t)x - (sp_wide_short){ 0 };
}

static inline sp_wide_short sp_wide_short_load(const uint16_t *p) {
    sp_wide_short a;
    memcpy(&a, p, sizeof a);
    return a;
}

static inline void sp_wide_short_store(uint16_t *p, sp_wide_short a) {
    memcpy(p, &a, sizeof a);
}

/* Functions of two vectors, lane by lane. */
#if defined SP_WIDE_AVX512
#define SP_WIDE_SHORT_CALL(name) (sp_wide_short) _mm512_##name##_epu16((__m512i)a, (__m512i)b)
#elif defined SP_WIDE_AVX2
#define SP_WIDE_SHORT_CALL(name) (sp_wide_short) _mm256_##name##_epu16((__m256i)a, (__m256i)b)
#elif defined SP_WIDE_SSE41
#define SP_WIDE_SHORT_CALL(name) (sp_wide_short) _mm_##name##_epu16((__m128i)a, (__m128i)b)
#endif
#if defined SP_WIDE_SHORT_CALL
#define SP_WIDE_SHORT_FUNCTION(function, name, formula)                                            \
    static inline sp_wide_short sp_wide_short_##function(sp_wide_short a, sp_wide_short b) {       \
        return SP_WIDE_SHORT_CALL(name);                                                           \
    }
#else
#define SP_WIDE_SHORT_FUNCTION(function, name, formula)                                            \
    static inline sp_wide_short sp_wide_short_##function(sp_wide_short a, sp_wide_short b) {       \
        for (int i = 0; i < SP_WIDE_SHORT; i++)                                                    \
            a[i] = (uint16_t)(formula);                                                            \
        return a;                                                                                  \
    }
#endif
SP_WIDE_SHORT_FUNCTION(scale, mulhi, (uint32_t)a[i] * b[i] >> 16)      /* a·b/65536, down */
SP_WIDE_SHORT_FUNCTION(average, avg, ((uint32_t)a[i] + b[i] + 1) >> 1) /* (a + b)/2, up */
SP_WIDE_SHORT_FUNCTION(min, min, a[i] < b[i] ? a[i] : b[i])
SP_WIDE_SHORT_FUNCTION(max, max, a[i] > b[i] ? a[i] : b[i])
SP_WIDE_SHORT_FUNCTION(subtract, subs, a[i] > b[i] ? a[i] - b[i] : 0) /* not below 0 */
#undef SP_WIDE_SHORT_FUNCTION
#undef SP_WIDE_SHORT_CALL

/* Stores the low 16 bits of each lane. */
static inline void sp_wide_int_store_short(uint16_t *p, sp_wide_int a) {
#if defined SP_WIDE_AVX512
    _mm256_storeu_si256((__m256i *)(void *)p, _mm512_cvtepi32_epi16((__m512i)a));
#else
    typedef uint16_t narrow __attribute__((vector_size(SP_WIDE * 2)));
    narrow low = __builtin_convertvector(a, narrow);
    memcpy(p, &low, sizeof low);
#endif
}

#endif
