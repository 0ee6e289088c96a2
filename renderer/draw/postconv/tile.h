/* SPDX-License-Identifier: Apache-2.0
 *
 * One tile while it is drawn: what tile.c (runs by layer), deposit.c (voxels → samples),
 * filter.c (samples → pixels) and insert.c (fragments of other layers) share. Compiled once per
 * instruction set (base/isa.h).
 */
#ifndef SP_POSTCONV_TILE_H
#define SP_POSTCONV_TILE_H

#include <string.h>

#include "base/isa.h"
#include "base/wide.h"
#include "draw/postconv/postconv.h"

typedef float vec4 __attribute__((vector_size(16))); /* red, green, blue, optical depth */

enum {
    W = SP_WIDE,
    PX = W / 4,       /* pixels per vector: red, green, blue, depth of each */
    CHUNK = 16,       /* voxels at a time */
    BLOCK = 4,        /* samples per bit of a mask */
    VECTORS = 16 / W, /* of a block */
    ORIGIN = POSTCONV_MARGIN,
    CHECK_EVERY = 2,
    POSTCONV_WANTED = 32 /* at least POSTCONV_GRID / BLOCK; a lookup in registers needs 32 */
};

static inline vec4 load4(const float *p) {
    vec4 a;
    memcpy(&a, p, sizeof a);
    return a;
}

/* The same four floats for each pixel of a vector. */
static inline sp_wide repeat(vec4 a) {
#if defined SP_WIDE_AVX512
    return (sp_wide)_mm512_broadcast_f32x4((__m128)a);
#elif defined SP_WIDE_AVX2
    return (sp_wide)_mm256_set_m128((__m128)a, (__m128)a);
#else
    return a;
#endif
}

/* Element PX · part + n for pixel n. */
static inline sp_wide spread(vec4 a, int part) {
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

/* Transposes four vectors of pixels into red, green, blue, depth of W pixels. */
static inline void planes(const sp_wide p[4], sp_wide out[4]) {
#if defined SP_WIDE_AVX512
    __m512 a = _mm512_unpacklo_ps((__m512)p[0], (__m512)p[1]);
    __m512 b = _mm512_unpackhi_ps((__m512)p[0], (__m512)p[1]);
    __m512 c = _mm512_unpacklo_ps((__m512)p[2], (__m512)p[3]);
    __m512 d = _mm512_unpackhi_ps((__m512)p[2], (__m512)p[3]);
    out[0] = (sp_wide)_mm512_shuffle_ps(a, c, 0x44);
    out[1] = (sp_wide)_mm512_shuffle_ps(a, c, 0xee);
    out[2] = (sp_wide)_mm512_shuffle_ps(b, d, 0x44);
    out[3] = (sp_wide)_mm512_shuffle_ps(b, d, 0xee);
#elif defined SP_WIDE_AVX2
    __m256 a = _mm256_unpacklo_ps((__m256)p[0], (__m256)p[1]);
    __m256 b = _mm256_unpackhi_ps((__m256)p[0], (__m256)p[1]);
    __m256 c = _mm256_unpacklo_ps((__m256)p[2], (__m256)p[3]);
    __m256 d = _mm256_unpackhi_ps((__m256)p[2], (__m256)p[3]);
    out[0] = (sp_wide)_mm256_shuffle_ps(a, c, 0x44);
    out[1] = (sp_wide)_mm256_shuffle_ps(a, c, 0xee);
    out[2] = (sp_wide)_mm256_shuffle_ps(b, d, 0x44);
    out[3] = (sp_wide)_mm256_shuffle_ps(b, d, 0xee);
#else
    sp_wide a = __builtin_shufflevector(p[0], p[1], 0, 4, 1, 5);
    sp_wide b = __builtin_shufflevector(p[0], p[1], 2, 6, 3, 7);
    sp_wide c = __builtin_shufflevector(p[2], p[3], 0, 4, 1, 5);
    sp_wide d = __builtin_shufflevector(p[2], p[3], 2, 6, 3, 7);
    out[0] = __builtin_shufflevector(a, c, 0, 1, 4, 5);
    out[1] = __builtin_shufflevector(a, c, 2, 3, 6, 7);
    out[2] = __builtin_shufflevector(b, d, 0, 1, 4, 5);
    out[3] = __builtin_shufflevector(b, d, 2, 3, 6, 7);
#endif
}

/* √a for a > 0, to some 14 bits and more. */
static inline sp_wide square_root(sp_wide a) {
#if defined SP_WIDE_AVX512
    return a * (sp_wide)_mm512_rsqrt14_ps((__m512)a);
#else
    return sp_wide_sqrt(a);
#endif
}

/* Returns 1/a for a > 0, to about 22 bits. */
static inline sp_wide reciprocal(sp_wide a) {
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

enum { MOST_TAPS = 2 * POSTCONV_TAPS + 6 };

/* A filter combined with the interpolation after it, for samples of 2^scale pixels. */
struct zoom {
    const struct sp_postconv_filter *filter; /* NULL = not made */
    int scale, taps;                         /* samples of a pixel, or of a vector of them */
    float down[1 << (POSTCONV_SCALES - 1)][MOST_TAPS]; /* by pixel modulo 2^scale */
    _Alignas(64) float across[1 << (POSTCONV_SCALES - 1)][MOST_TAPS][W]; /* by vector likewise */
};

struct sp_postconv_open_tile {
    const struct sp_postconv *postconv;
    struct sp_postconv_scratch *scratch;
    int x, y, width, height;              /* px in the image */
    uint32_t alive;                       /* bit per cell that is not opaque */
    uint32_t live[POSTCONV_TILE / BLOCK]; /* the same per block of 4 × 4 pixels */
    bool has_dead;                        /* some blocks are opaque */
    int layer; /* the sheet that is drawn, counted from where the volume begins */
    struct sp_postconv_inserted *inserted; /* NULL = no fragments */
    uint32_t closed;
    bool is_open; /* `group` has deposits */
    struct sp_postconv_group group;
    struct zoom *zoom[2];
    uint32_t needs[POSTCONV_TILE / BLOCK]; /* by block of pixels: of samples; zoomed across */
    /* By row: bit per block that is not zero. */
    uint32_t deposited[POSTCONV_GRID], skewed[POSTCONV_GRID], crossed[POSTCONV_GRID],
        summed[POSTCONV_TILE];
    int row0, row1; /* range of rows of `deposited` that are not empty */
    /* Per four rows of the grid: blocks where a voxel matters to pixels that are not opaque. Valid
     * if has_dead. */
    _Alignas(64) uint32_t wanted[POSTCONV_WANTED];
};

/* Opens a group: chooses filters for the first run's footprints, which may serve other runs too.
 * False if there are no filters. */
bool sp_postconv_start_group(struct sp_postconv_open_tile *tile, const struct sp_postconv_run *runs,
                             uint32_t count);

/* Deposits all voxels of a run, or only those in the group's range. */
void sp_postconv_add_run(struct sp_postconv_open_tile *tile, const struct sp_postconv_run *run,
                         bool all);

/* Adds the footprints of the voxels of a run that are not drawn yet to the layer's sum, one by one.
 */
void sp_postconv_add_footprints(struct sp_postconv_open_tile *tile,
                                const struct sp_postconv_run *run);

/* Filters the deposits. The last group of a layer is composited at once; other groups are added to
 * the layer's sum, which sp_postconv_close_sum() composites. */
void sp_postconv_close_group(struct sp_postconv_open_tile *tile, bool last);
void sp_postconv_close_sum(struct sp_postconv_open_tile *tile);

/* Finds the cells that have become opaque. */
void sp_postconv_check_cells(struct sp_postconv_open_tile *tile);

/* Finds the first fragments of a tile's pixels; tile->inserted stays NULL if there are none. */
void sp_postconv_open_fragments(struct sp_postconv_open_tile *tile);

/* Composites the next fragments of the pixels in `bits` of the vector at (x, y). */
void sp_postconv_take_fragments(struct sp_postconv_open_tile *tile, int y, int x, unsigned bits);

/* Composites those that are left. */
void sp_postconv_finish_fragments(struct sp_postconv_open_tile *tile);

/* The pixel of a group of W at element i of its planes. */
static inline int sp_postconv_pixel_at(int i) {
    return i % 4 * PX + i / 4;
}

/* Writes the tile into the frame. */
void sp_postconv_resolve(const struct sp_postconv_open_tile *tile);

#endif
