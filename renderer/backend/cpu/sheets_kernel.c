/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/cpu/sheets.h"

#include <math.h>
#include <string.h>

#include "base/wide.h"
#include "frame/resolve.h"
#include "splat/exp2.h"
#include "tile/blend.h"

typedef float vec4 __attribute__((vector_size(16)));

enum {
    W = SP_WIDE,
    PX = W / 4,     /* pixels in a vector: red, green, blue, depth of each */
    CHUNK = 16,     /* voxels at a time */
    BLOCK = 4,      /* samples that a bit of a mask stands for */
    VECTORS = 16 / W, /* of a block */
    ORIGIN = SHEETS_MARGIN,
    CHECK_EVERY = 4
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
    const __m256i index = _mm256_add_epi32(_mm256_set_epi32(1, 1, 1, 1, 0, 0, 0, 0),
                                           _mm256_set1_epi32(2 * part));
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

/* 1/a for a > 0, to some 22 bits. */
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

/* ------------------------------------------------------------------ interpolation */

enum { MOST_TAPS = 2 * SHEETS_TAPS + 5 };

/* A filter and the interpolation after it, for pixels of 2^scale a sample. */
struct zoom {
    const struct sheets_filter *filter; /* NULL = not made */
    int scale, taps;                    /* samples of a pixel, or of a vector of them */
    float down[1 << (SHEETS_SCALES - 1)][MOST_TAPS]; /* by pixel modulo 2^scale */
    _Alignas(64) float across[1 << (SHEETS_SCALES - 1)][MOST_TAPS][W]; /* by vector likewise */
};

/* Weights of the samples from ⌊x/2^scale⌋ − 1 − filter->taps on, for pixel x. */
static void make_zoom(const struct sheets_tables *tables, const struct sheets_filter *f, int scale,
                      struct zoom *z) {
    if (z->filter == f && z->scale == scale)
        return;
    int n = 2 * f->taps + 1, period = 1 << scale;
    z->filter = f;
    z->scale = scale;
    z->taps = n + 3;
    memset(z->down, 0, sizeof z->down[0] * (size_t)period);
    for (int p = 0; p < period; p++)
        for (int i = 0; i < 4; i++)
            for (int k = 0; k < n; k++)
                z->down[p][i + k] += tables->between[scale][p][i] * f->weight[k];
}

/* The same for vectors of pixels: one more sample where a vector spans two. */
static void make_wide_zoom(const struct sheets_tables *tables, const struct sheets_filter *f,
                           int scale, struct zoom *z) {
    if (z->filter == f && z->scale == scale)
        return;
    make_zoom(tables, f, scale, z);
    int extra = (PX - 1) >> scale, vectors = (1 << scale) / PX;
    for (int v = 0; v < (vectors ? vectors : 1); v++) {
        memset(z->across[v], 0, sizeof z->across[v][0] * (size_t)(z->taps + extra));
        for (int i = 0; i < PX; i++) {
            int x = v * PX + i, sample = (x >> scale) - (v * PX >> scale);
            for (int k = 0; k < z->taps; k++)
                for (int c = 0; c < 4; c++)
                    z->across[v][k + sample][4 * i + c] = z->down[x & ((1 << scale) - 1)][k];
        }
    }
    z->taps += extra;
}

/* ------------------------------------------------------------------ one tile */

struct tile {
    const struct sheets *sheets;
    struct sheets_scratch *s;
    int x, y, width, height; /* px in the picture */
    uint32_t alive;          /* cells that are not opaque */
    uint32_t closed;
    bool is_open;  /* `group` has deposits */
    float pending; /* most depth that they can add to a pixel */
    struct sheets_group group;
    struct zoom *zoom[2];
    uint32_t needs[SHEETS_TILE / BLOCK]; /* by block of pixels: of samples; zoomed across */
    /* By row: blocks that are not zero. */
    uint32_t deposited[SHEETS_GRID], skewed[SHEETS_GRID], crossed[SHEETS_GRID], summed[SHEETS_TILE];
    int row0, row1; /* rows of `deposited` that are not empty */
};

/* Which blocks of samples each block of pixels needs. */
static void find_needs(struct tile *t) {
    int scale = t->group.scale[0], reach = t->group.filter[0]->taps;
    for (int b = 0; b < SHEETS_TILE / BLOCK; b++) {
        int first = (b * BLOCK >> scale) - 1 - reach + ORIGIN;
        int last = ((b * BLOCK + BLOCK - 1) >> scale) + 2 + reach + ORIGIN;
        t->needs[b] = (UINT32_C(2) << last / BLOCK) - (UINT32_C(1) << first / BLOCK);
    }
}

/* For the first run's footprints, and as many others as may be. */
static bool start_group(struct tile *t, const struct sheets_run *runs, uint32_t count) {
    struct sheets_group *g = &t->group;
    float range[2] = { runs[0].range[0], runs[0].range[1] };
    for (uint32_t i = 1; i < count; i++)
        range[1] = runs[i].range[1] > range[1] ? runs[i].range[1] : range[1];
    if (!sheets_group_make(t->sheets, &t->sheets->bricks[runs[0].brick], range, g))
        return false;
    if (g->scale[0])
        find_needs(t);
    if (g->scale[0])
        make_wide_zoom(t->sheets->tables, g->filter[0], g->scale[0], t->zoom[0]);
    if (g->scale[1])
        make_zoom(t->sheets->tables, g->filter[1], g->scale[1], t->zoom[1]);
    return true;
}

/* ------------------------------------------------------------------ deposit */

struct chunk {
    _Alignas(64) int32_t column[CHUNK], row[CHUNK]; /* of the voxel, 1/SHEETS_PHASES samples */
    _Alignas(64) float gain[CHUNK];
    _Alignas(64) float delta[3][CHUNK]; /* of the variance: xx, yy, xy, samples² */
    _Alignas(64) float to_eye[3][CHUNK];
    uint32_t own; /* voxels that no other tile has */
    _Alignas(64) struct sp_class class[CHUNK]; /* of each voxel, where a table does not do */
};

/* Neighbours in a list are neighbours in the picture; a voxel that adds to samples which the one
 * before is still writing would wait. So they are taken four apart. */
static const uint8_t chunk_order[CHUNK] = { 0, 4, 8, 12, 1, 5, 9, 13, 2, 6, 10, 14, 3, 7, 11, 15 };

/* Everything that a run's chunks share. */
struct run_frame {
    const struct sp_visible *list;
    const struct sp_transfer *transfer;
    float base[3], step[2][3]; /* u of place (0, 0) of the slice, and along its axes */
    /* Column and row, from the first that matters on, 1/SHEETS_PHASES samples. */
    float focal[2], centre[2];
    int32_t low[2], columns, rows; /* the first, and how many matter */
    int32_t own[4];                /* of the tile's own: first column and row, how many */
    float scale, ratio_max[2], gram[6]; /* products of the kernel's rows: 00, 11, 01, 02, 12, 22 */
    float variance[3], rest[3];
    float gain, near, range[2];
    bool perspective, is_part;
};

static void start_run(const struct tile *t, const struct sheets_run *run, bool all,
                      struct run_frame *r) {
    const struct sheets_brick *b = &t->sheets->bricks[run->brick];
    const struct sheets_level *level = &t->sheets->levels[b->level];
    const struct sp_ewa_frame *f = &level->ewa;
    const struct sheets_group *g = &t->group;
    unsigned axis = t->sheets->axis, first = axis == 0, second = axis == 2 ? 1 : 2;
    r->list = &level->level->visible;
    r->transfer = &level->level->transfer;
    r->perspective = f->projection == SP_PERSPECTIVE;
    r->near = f->near;
    /* Elsewhere than at its ends a range is the brick's own: what rounding puts outside is in. */
    bool is_first = run->range[0] <= b->range[0];
    r->range[0] = is_first ? 0 : run->range[0];
    r->range[1] = all ? INFINITY : g->range[1];
    r->is_part = !is_first || !all;
    static const int pairs[6][2] = { { 0, 0 }, { 1, 1 }, { 0, 1 }, { 0, 2 }, { 1, 2 }, { 2, 2 } };
    for (int k = 0; k < 6; k++) {
        const float *p = f->kernel[pairs[k][0]], *q = f->kernel[pairs[k][1]];
        r->gram[k] = p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
    }
    r->scale = f->scale;
    memcpy(r->ratio_max, f->ratio_max, sizeof r->ratio_max);
    for (int i = 0; i < 3; i++) {
        r->base[i] = b->base[i] + f->step[i][axis] * (float)run->slice;
        r->step[0][i] = f->step[i][first];
        r->step[1][i] = f->step[i][second];
    }
    int corner[2] = { t->x, t->y };
    for (int a = 0; a < 2; a++) {
        float first_sample = (f->centre[a] - (float)corner[a]) * g->per_px[a] + g->offset[a];
        r->focal[a] = f->scale * g->per_px[a] * SHEETS_PHASES;
        r->centre[a] = (first_sample - g->low[a]) * SHEETS_PHASES;
        r->low[a] = (int32_t)g->low[a] * SHEETS_PHASES;
        r->own[a] = (int32_t)((g->offset[a] - g->low[a]) * SHEETS_PHASES);
        r->own[2 + a] = (int32_t)((g->end[a] - g->offset[a]) * SHEETS_PHASES);
        r->variance[a] = b->scale * g->per_px[a] * g->per_px[a];
        r->rest[a] = b->lowpass2 * g->per_px[a] * g->per_px[a] - g->base[a];
    }
    r->columns = (int32_t)(g->high[0] - g->low[0]) * SHEETS_PHASES;
    r->rows = (int32_t)(g->high[1] - g->low[1]) * SHEETS_PHASES;
    r->variance[2] = b->scale * g->per_px[0] * g->per_px[1];
    r->rest[2] = -g->cross;
    r->gain = f->gain * g->per_px[0] * g->per_px[1];
}

/* Places of W of CHUNK entries, elements v … of the chunk. Lists may be read past their end. */
static inline sp_wide_int read_places(const uint8_t *from, int v) {
#if defined SP_WIDE_AVX512 || defined SP_WIDE_AVX2 || defined SP_WIDE_SSE41
    __m128i order = _mm_loadu_si128((const __m128i *)(const void *)chunk_order);
    __m128i all = _mm_shuffle_epi8(_mm_loadu_si128((const __m128i *)(const void *)from), order);
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
    sp_wide_int place;
    for (int i = 0; i < W; i++)
        place[i] = from[chunk_order[v + i]];
    return place;
#endif
}

/* Elements of a chunk that hold the first n entries. */
static inline uint32_t elements(uint32_t n) {
    /* Element 4·column + row holds entry 4·row + column. */
    uint32_t m = 0, full = n / 4, left = n % 4;
    for (uint32_t c = 0; c < 4; c++)
        m |= ((UINT32_C(1) << (full + (c < left))) - 1) << 4 * c;
    return m;
}

/* 0 ≤ a < end. */
static inline sp_wide_mask in_range(sp_wide_int a, int32_t end) {
    return sp_wide_int_lt(sp_wide_int_all(-1), a) & sp_wide_int_lt(a, sp_wide_int_all(end));
}

/* Where the voxels lie, and what their footprints are. Returns those that matter to the tile. */
static inline uint32_t place_chunk(const struct run_frame *r, const struct sheets_group *g,
                                   const uint8_t *places, uint32_t n, bool shaded,
                                   struct chunk *c) {
    c->own = 0;
    uint32_t inside = 0;
    for (int v = 0; v < CHUNK; v += W) {
        sp_wide_int at = read_places(places, v);
        sp_wide i0 = sp_wide_from_int(at & 15), i1 = sp_wide_from_int(at >> 4);
        sp_wide u[3];
        for (int a = 0; a < 3; a++)
            u[a] = r->base[a] + r->step[0][a] * i0 + r->step[1][a] * i1;
        sp_wide inv = sp_wide_all(1);
        if (r->perspective)
            inv = reciprocal(sp_wide_max(u[2], sp_wide_all(r->near)));
        sp_wide t0 = u[0] * inv, t1 = u[1] * inv;
        sp_wide x = r->focal[0] * t0 + r->centre[0], y = r->focal[1] * t1 + r->centre[1];
        /* From the first sample that matters on; whatever lies far outside does not fit. */
        sp_wide_int column = sp_wide_to_int(x), row = sp_wide_to_int(y);
        sp_wide_mask mask = sp_wide_le(sp_wide_all(r->near), u[2]) & in_range(column, r->columns) &
                            in_range(row, r->rows);
        if (r->is_part)
            mask = mask & sp_wide_le(sp_wide_all(r->range[0]), inv) &
                   sp_wide_lt(inv, sp_wide_all(r->range[1]));
        uint32_t in = sp_wide_mask_bits(mask);
        if (!in)
            continue;
        inside |= in << v;
        sp_wide_mask own = in_range(column - r->own[0], r->own[2]) &
                           in_range(row - r->own[1], r->own[3]);
        c->own |= sp_wide_mask_bits(own) << v;
        sp_wide_int_store(&c->column[v], column + r->low[0]);
        sp_wide_int_store(&c->row[v], row + r->low[1]);
        sp_wide fx = r->scale * inv, fx2 = fx * fx, lengths = sp_wide_all(1);
        if (r->perspective) {
            sp_wide most0 = sp_wide_all(r->ratio_max[0]), most1 = sp_wide_all(r->ratio_max[1]);
            t0 = sp_wide_max(sp_wide_min(t0, most0), -most0);
            t1 = sp_wide_max(sp_wide_min(t1, most1), -most1);
            lengths = square_root(1.0f + t0 * t0 + t1 * t1);
        } else {
            t0 = t1 = sp_wide_all(0);
        }
        /* (k0 − t0·k2)·(k0 − t0·k2) and so on, of the kernel's rows. */
        sp_wide v00 = r->gram[0] + t0 * (t0 * r->gram[5] - 2 * r->gram[3]);
        sp_wide v11 = r->gram[1] + t1 * (t1 * r->gram[5] - 2 * r->gram[4]);
        sp_wide v01 = r->gram[2] + t0 * (t1 * r->gram[5] - r->gram[4]) - t1 * r->gram[3];
        sp_wide_store(&c->gain[v], fx2 * lengths * r->gain);
        sp_wide_store(&c->delta[0][v], v00 * fx2 * r->variance[0] + r->rest[0]);
        sp_wide_store(&c->delta[1][v], v11 * fx2 * r->variance[1] + r->rest[1]);
        if (g->has_cross)
            sp_wide_store(&c->delta[2][v], v01 * fx2 * r->variance[2] + r->rest[2]);
        if (!shaded)
            continue;
        sp_wide far = sp_wide_all(0);
        if (r->perspective)
            far = -reciprocal(sp_wide_sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]));
        for (int a = 0; a < 3; a++)
            sp_wide_store(&c->to_eye[a][v],
                          r->perspective ? u[a] * far : sp_wide_all(a == 2 ? -1 : 0));
    }
    return inside & elements(n);
}

/* Adds voxel i of a chunk; returns whether there is anything to add. */
static inline bool deposit(const struct sheets_tables *tables, const struct chunk *c, int i,
                           const struct sp_class *class, bool cross,
                           float grid[SHEETS_GRID][SHEETS_PITCH][4]) {
    enum { STRIDE = SHEETS_PITCH * 4 };
    const float *sx = tables->spline[c->column[i] & (SHEETS_PHASES - 1)];
    const float *sy = tables->spline[c->row[i] & (SHEETS_PHASES - 1)];
    vec4 wx = load4(sx) + c->delta[0][i] * load4(sx + 4);
    vec4 wy = load4(sy) + c->delta[1][i] * load4(sy + 4);
    vec4 sums;
    memcpy(&sums, class, sizeof sums); /* red, green, blue, depth */
    float depth = sums[3] * c->gain[i];
    sums[3] = 1;
    sp_wide value = repeat(sums * depth);
    float *to = &grid[c->row[i] / SHEETS_PHASES - 1][c->column[i] / SHEETS_PHASES - 1][0];
    vec4 dx = wx, dy = wy;
    if (cross) {
        dx = c->delta[2][i] * load4(tables->slope[c->column[i] & (SHEETS_PHASES - 1)]);
        dy = load4(tables->slope[c->row[i] & (SHEETS_PHASES - 1)]);
    }
    for (int p = 0; p < VECTORS; p++) {
        sp_wide part = value * spread(wx, p), slant = cross ? value * spread(dx, p) : part;
        for (int y = 0; y < 4; y++) {
            sp_wide sum = sp_wide_load(to + y * STRIDE + p * W) + part * wy[y];
            sp_wide_store(to + y * STRIDE + p * W, cross ? sum + slant * dy[y] : sum);
        }
    }
    return depth > 0;
}

/* 1 << n of each lane, n in [0, 30]: by way of a float's exponent. */
static inline sp_wide_int power_of_two(sp_wide_int n) {
    return sp_wide_to_int((sp_wide)((n + 127) << 23));
}

/* Marks the blocks that a chunk's voxels reach: rows by fours. */
static inline void mark(struct tile *t, const struct chunk *c, uint32_t inside) {
    sp_wide_int columns = sp_wide_int_all(0), rows = columns;
    for (int v = 0; v < CHUNK; v += W) {
        sp_wide_int in = power_of_two(sp_wide_int_count() + v) & (int32_t)inside;
        sp_wide_int x = sp_wide_int_load(&c->column[v]) / SHEETS_PHASES - 1;
        sp_wide_int y = sp_wide_int_load(&c->row[v]) / SHEETS_PHASES - 1;
        sp_wide_int keep = (sp_wide_int)(in != 0);
        columns |= (power_of_two(x >> 2) | power_of_two((x + 3) >> 2)) & keep;
        rows |= (power_of_two(y >> 2) | power_of_two((y + 3) >> 2)) & keep;
    }
    uint32_t blocks = 0, quads = 0;
    for (int i = 0; i < W; i++) {
        blocks |= (uint32_t)columns[i];
        quads |= (uint32_t)rows[i];
    }
    int first = 4 * __builtin_ctz(quads), last = 4 * (31 - __builtin_clz(quads)) + 4;
    t->row0 = first < t->row0 ? first : t->row0;
    t->row1 = last > t->row1 ? last : t->row1;
    for (; quads; quads &= quads - 1) {
        uint32_t *row = &t->deposited[4 * __builtin_ctz(quads)];
        for (int k = 0; k < 4; k++)
            row[k] |= blocks;
    }
}

/* The loop over a chunk's voxels, for one width of keys. */
static inline uint32_t deposit_keys(const struct tile *t, const struct chunk *c, uint32_t inside,
                                const struct run_frame *r, uint64_t first, uint32_t key_bytes,
                                bool cross) {
    const struct sp_class *table = r->transfer->table;
    const uint8_t *key1 = (const uint8_t *)r->list->key + first;
    const uint16_t *key2 = (const uint16_t *)r->list->key + first;
    const uint32_t *key4 = (const uint32_t *)r->list->key + first;
    uint32_t count = 0;
    for (uint32_t m = inside; m; m &= m - 1) {
        int i = __builtin_ctz(m), k = chunk_order[i];
        uint32_t key = key_bytes == 1 ? key1[k] : key_bytes == 2 ? key2[k] : key4[k];
        count += deposit(t->sheets->tables, c, i, &table[key], cross, t->s->grid) & c->own >> i;
    }
    return count;
}

/* Adds a chunk whose classes are the table's; returns how many voxels of the tile have any depth. */
static uint32_t deposit_chunk(const struct tile *t, const struct chunk *c, uint32_t inside,
                          const struct run_frame *r, uint64_t first) {
    if (r->list->key_bytes == 1)
        return deposit_keys(t, c, inside, r, first, 1, false);
    if (r->list->key_bytes == 2)
        return deposit_keys(t, c, inside, r, first, 2, false);
    return deposit_keys(t, c, inside, r, first, 4, false);
}

/* The same where the group has variance across. */
static uint32_t deposit_chunk_across(const struct tile *t, const struct chunk *c, uint32_t inside,
                                 const struct run_frame *r, uint64_t first) {
    return deposit_keys(t, c, inside, r, first, r->list->key_bytes, true);
}

/* The same for a chunk that has classes of its own. */
static uint32_t deposit_classes(const struct tile *t, const struct chunk *c, uint32_t inside) {
    uint32_t count = 0;
    for (uint32_t m = inside; m; m &= m - 1) {
        int i = __builtin_ctz(m);
        bool any = t->group.has_cross
                       ? deposit(t->sheets->tables, c, i, &c->class[i], true, t->s->grid)
                       : deposit(t->sheets->tables, c, i, &c->class[i], false, t->s->grid);
        count += any & c->own >> i;
    }
    return count;
}

/* log2 of a > 0, as sp_log2(). */
static inline sp_wide log2_of(sp_wide a) {
    sp_wide_int bits = (sp_wide_int)a, power = (bits - 0x3f3504f3) >> 23;
    sp_wide m = (sp_wide)(bits - (power << 23));
    sp_wide s = (m - 1.0f) * reciprocal(m + 1.0f), q = s * s;
    return sp_wide_from_int(power) +
           s * (2.88539008f + q * (0.961796694f + q * (0.577078016f + q * 0.412198583f)));
}

static inline sp_wide dot3(const float a[3], const sp_wide b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* Unit vectors of packed gradients, in camera space; 0 where there is none. */
static inline void unpack_normals(const struct sp_shade *shade, sp_wide_int packed, sp_wide n[3]) {
    sp_wide u = sp_wide_from_int((packed & 2047) - SP_GRADIENT_STEPS) * (1.0f / SP_GRADIENT_STEPS);
    sp_wide v =
        sp_wide_from_int((packed >> 11 & 2047) - SP_GRADIENT_STEPS) * (1.0f / SP_GRADIENT_STEPS);
    sp_wide w = 1.0f - sp_wide_abs(u) - sp_wide_abs(v), none = sp_wide_all(0);
    sp_wide fold = sp_wide_max(-w, none);
    u += sp_wide_select(sp_wide_lt(u, none), fold, -fold);
    v += sp_wide_select(sp_wide_lt(v, none), fold, -fold);
    sp_wide scale = reciprocal(sp_wide_sqrt(u * u + v * v + w * w));
    scale = sp_wide_keep(sp_wide_int_lt(sp_wide_int_all(0), packed >> 22 & 1023), scale);
    sp_wide world[3] = { u * scale, v * scale, w * scale };
    for (int a = 0; a < 3; a++)
        n[a] = dot3(shade->to_camera[a], world);
}

/* What W voxels' colours are multiplied by, and what is added: sp_shade_direction(). */
static inline void light(const struct sp_shade *shade, const sp_wide n[3], const sp_wide to_eye[3],
                         sp_wide lit[3], sp_wide shine[3]) {
    sp_wide none = sp_wide_all(0);
    sp_wide_mask has_side = sp_wide_lt(none, n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    for (int c = 0; c < 3; c++) {
        lit[c] = sp_wide_all(shade->ambient);
        shine[c] = none;
    }
    for (int i = 0; i < shade->light_count; i++) {
        const float *l = shade->lights[i].direction, *strength = shade->lights[i].color;
        sp_wide facing = sp_wide_select(has_side, sp_wide_abs(dot3(l, n)), sp_wide_all(1));
        sp_wide along = none, length2 = none;
        for (int a = 0; a < 3; a++) {
            sp_wide h = l[a] + to_eye[a];
            along += h * n[a];
            length2 += h * h;
        }
        sp_wide_mask glints = has_side & sp_wide_lt(sp_wide_all(1e-12f), length2) &
                              sp_wide_lt(sp_wide_all(1e-6f), sp_wide_abs(along));
        sp_wide square = along * along * reciprocal(sp_wide_max(length2, sp_wide_all(1e-12f)));
        sp_wide glint = sp_wide_keep(
            glints, sp_wide_exp2(0.5f * shade->exponent *
                                 log2_of(sp_wide_max(square, sp_wide_all(1e-30f)))));
        for (int c = 0; c < 3; c++) {
            lit[c] += shade->diffuse * strength[c] * facing;
            shine[c] += shade->specular * strength[c] * glint;
        }
    }
}

/* Classes of a chunk's voxels where they are more than an entry of the table. */
static void classify_chunk(const struct tile *t, const struct run_frame *r, uint64_t first,
                           uint32_t inside, struct chunk *c) {
    const struct sp_shade *shade = t->sheets->shade;
    bool has_normals = shade || r->transfer->scale;
    _Alignas(64) int32_t packed[CHUNK] = { 0 };
    for (uint32_t m = inside; m; m &= m - 1) {
        int i = __builtin_ctz(m);
        uint64_t e = first + chunk_order[i];
        if (has_normals)
            packed[i] = (int32_t)sp_visible_normal(r->list, e);
        c->class[i] = sp_transfer_class_at(r->transfer, sp_visible_key(r->list, e),
                                           (uint32_t)packed[i]);
    }
    for (int v = 0; shade && v < CHUNK; v += W) {
        sp_wide n[3], to_eye[3], in[4], lit[4], shine[4];
        unpack_normals(shade, sp_wide_int_load(&packed[v]), n);
        for (int a = 0; a < 3; a++)
            to_eye[a] = sp_wide_load(&c->to_eye[a][v]);
        light(shade, n, to_eye, in, shine);
        in[3] = sp_wide_all(1);
        planes(in, lit);
        in[0] = shine[0];
        in[1] = shine[1];
        in[2] = shine[2];
        in[3] = sp_wide_all(0);
        planes(in, shine);
        /* Element 4·L + k of the planes is part L of vector k. */
        for (int k = 0; k < 4; k++) {
            float factor[W], added[W];
            sp_wide_store(factor, lit[k]);
            sp_wide_store(added, shine[k]);
            for (int l = 0; l < PX; l++) {
                float *class = c->class[v + 4 * l + k].color;
                for (int a = 0; a < 3; a++)
                    class[a] = class[a] * factor[4 * l + a] + added[4 * l + a];
            }
        }
    }
}

/* Adds the voxels of a run, or those in the group's range alone. */
static void add_run(struct tile *t, const struct sheets_run *run, bool all) {
    struct run_frame r;
    start_run(t, run, all, &r);
    uint64_t first = r.list->first[t->sheets->bricks[run->brick].brick];
    bool has_table = r.transfer->table && !r.transfer->scale && !t->sheets->shade;
    uint32_t count = 0;
    for (uint64_t e = first + run->begin; e < first + run->end; e += CHUNK) {
        uint64_t left = first + run->end - e;
        struct chunk c;
        uint32_t inside = place_chunk(&r, &t->group, r.list->place + e,
                                      left < CHUNK ? (uint32_t)left : CHUNK, t->sheets->shade, &c);
        if (!inside)
            continue;
        mark(t, &c, inside);
        if (!has_table) {
            classify_chunk(t, &r, e, inside, &c);
            count += deposit_classes(t, &c, inside);
        } else if (t->group.has_cross) {
            count += deposit_chunk_across(t, &c, inside, &r, e);
        } else {
            count += deposit_chunk(t, &c, inside, &r, e);
        }
    }
    t->s->splats += count;
    t->s->fragments += (double)count * (double)t->group.area;
}

/* Adds footprints to the layer's sum one by one: those that no filter serves. */
static void add_footprint(struct tile *t, const struct sp_splat *splat, float cut) {
    int x0 = splat->x0 - t->x, y0 = splat->y0 - t->y, x1 = splat->x1 - t->x, y1 = splat->y1 - t->y;
    x0 = x0 < 0 ? 0 : x0 / BLOCK * BLOCK;
    y0 = y0 < 0 ? 0 : y0;
    x1 = x1 > SHEETS_TILE ? SHEETS_TILE : x1;
    y1 = y1 > SHEETS_TILE ? SHEETS_TILE : y1;
    if (x0 >= x1 || y0 >= y1)
        return;
    vec4 sums = { splat->emission[0], splat->emission[1], splat->emission[2], splat->depth };
    sp_wide value = repeat(sums);
    uint32_t blocks = (UINT32_C(2) << (x1 - 1) / BLOCK) - (UINT32_C(1) << x0 / BLOCK);
    for (int y = y0; y < y1; y++) {
        float dy = (float)(y + t->y) + 0.5f - splat->y;
        for (int x = x0; x < x1; x += BLOCK)
            for (int p = 0; p < VECTORS; p++) {
                float left = (float)(x + p * PX + t->x) + 0.5f - splat->x;
                sp_wide dx = left + sp_wide_from_int(sp_wide_int_count() >> 2);
                sp_wide e = (splat->a * dx + splat->b * dy) * dx + splat->c * dy * dy;
                sp_wide weight = sp_wide_keep(sp_wide_le(e, sp_wide_all(cut)), sp_wide_exp2(-e));
                float *to = &t->s->sum[y][x][0] + p * W;
                sp_wide_store(to, sp_wide_load(to) + weight * value);
            }
        t->summed[y] |= blocks;
    }
    int right = splat->x < (float)(t->x + SHEETS_TILE) && splat->x >= (float)t->x;
    if (right && splat->y < (float)(t->y + SHEETS_TILE) && splat->y >= (float)t->y) {
        t->s->splats++;
        t->s->fragments += (double)splat->area;
    }
}

static void add_footprints(struct tile *t, const struct sheets_run *run) {
    enum { COUNT = 64 };
    const struct sheets_brick *b = &t->sheets->bricks[run->brick];
    const struct sheets_level *level = &t->sheets->levels[b->level];
    struct sp_splat splats[COUNT];
    struct sp_splats out = { .splat = splats };
    const struct sp_visible *list = &level->level->visible;
    uint16_t local[COUNT];
    struct sp_ewa_run r = { .list = list,
                            .local = local,
                            .transfer = &level->level->transfer,
                            .shade = t->sheets->shade,
                            .first = list->first[b->brick],
                            .mode = (enum sp_filter_mode)b->mode };
    sp_visible_corner(list, b->brick, r.brick);
    for (uint32_t at = run->begin; at < run->end; at += COUNT) {
        r.begin = at;
        r.count = run->end - at < COUNT ? run->end - at : COUNT;
        sp_visible_locals(list, b->brick, NULL, r.begin, r.count, local);
        uint32_t n = sp_ewa_set_up(&level->ewa, &r, &out);
        for (uint32_t i = 0; i < n; i++)
            add_footprint(t, &splats[i], level->ewa.cut);
    }
}

/* ------------------------------------------------------------------ filter */

/* dilated[y] = the blocks of rows y − n … y + n, for rows [r0, r1). */
static void join_rows(const uint32_t *from, int r0, int r1, int n, int low, int high, uint32_t *to) {
    for (int y = low; y < high; y++) {
        uint32_t m = 0;
        int begin = y - n < r0 ? r0 : y - n, end = y + n + 1 > r1 ? r1 : y + n + 1;
        for (int k = begin; k < end; k++)
            m |= from[k];
        to[y] = m;
    }
}

static inline uint32_t widen(uint32_t blocks, int samples) {
    int n = (samples + BLOCK - 1) / BLOCK;
    for (int i = 0; i < n; i++)
        blocks |= blocks << 1 | blocks >> 1;
    return blocks;
}

/* One vector: Σ weight[k] · from[k · stride], in two sums that do not wait for each other. */
static inline sp_wide taps(const float *from, int stride, const float *weight, int n) {
    sp_wide even = sp_wide_load(from) * weight[0], odd = sp_wide_all(0);
    for (int k = 1; k + 1 < n; k += 2) {
        odd += sp_wide_load(from + k * stride) * weight[k];
        even += sp_wide_load(from + (k + 1) * stride) * weight[k + 1];
    }
    if (n % 2 == 0)
        odd += sp_wide_load(from + (n - 1) * stride) * weight[n - 1];
    return even + odd;
}

/* Blocks of the tile that samples in `blocks` reach. */
static uint32_t blocks_reached(uint32_t blocks, const uint32_t needs[SHEETS_TILE / BLOCK]) {
    uint32_t reached = 0;
    for (int b = 0; b < SHEETS_TILE / BLOCK; b++)
        reached |= (blocks & needs[b] ? UINT32_C(1) : 0) << b;
    return reached;
}

/* One row of blocks, a pixel a sample. */
static inline void filter_row(const float *from, const float *weight, int n, uint32_t reached,
                              float *to) {
    for (; reached; reached &= reached - 1) {
        int at = __builtin_ctz(reached) * BLOCK * 4;
        for (int p = 0; p < VECTORS; p++)
            sp_wide_store(to + at + p * W, taps(from + at + p * W, 4, weight, n));
    }
}

/* The same with samples of 2^scale pixels; `from` is that of the tile's left edge. */
static inline void zoom_row(const float *from, const struct zoom *z, int n, uint32_t reached,
                            float *to) {
    int period = (1 << z->scale) - 1;
    for (; reached; reached &= reached - 1) {
        int x = __builtin_ctz(reached) * BLOCK;
        for (int p = 0; p < VECTORS; p++, x += PX) {
            const float *sample = from + 4 * (x >> z->scale);
            const float(*w)[W] = z->across[(x & period) / PX];
            sp_wide even = repeat(load4(sample)) * sp_wide_load(w[0]), odd = sp_wide_all(0);
            for (int k = 1; k + 1 < n; k += 2) {
                odd += repeat(load4(sample + 4 * k)) * sp_wide_load(w[k]);
                even += repeat(load4(sample + 4 * k + 4)) * sp_wide_load(w[k + 1]);
            }
            if (n % 2 == 0)
                odd += repeat(load4(sample + 4 * n - 4)) * sp_wide_load(w[n - 1]);
            sp_wide_store(to + 4 * x, even + odd);
        }
    }
}

/* Loops over taps whose number the compiler knows. */
#define WITH_TAPS(n, call)                                                                         \
    switch (n) {                                                                                   \
    case 3: { enum { N = 3 }; call; break; }                                                       \
    case 5: { enum { N = 5 }; call; break; }                                                       \
    case 6: { enum { N = 6 }; call; break; }                                                       \
    case 7: { enum { N = 7 }; call; break; }                                                       \
    case 8: { enum { N = 8 }; call; break; }                                                       \
    case 9: { enum { N = 9 }; call; break; }                                                       \
    case 10: { enum { N = 10 }; call; break; }                                                     \
    case 11: { enum { N = 11 }; call; break; }                                                     \
    case 13: { enum { N = 13 }; call; break; }                                                     \
    default: { const int N = (n); call; }                                                          \
    }

/* Filters rows across, into `across`, whose columns are pixels. */
static void filter_across(struct tile *t, const float (*from)[SHEETS_PITCH][4],
                          const uint32_t *blocks) {
    const struct sheets_group *g = &t->group;
    const struct sheets_filter *f = g->filter[0];
    const struct zoom *z = t->zoom[0];
    int j = g->scale[0];
    for (int y = t->row0; y < t->row1; y++) {
        t->crossed[y] = 0;
        if (!blocks[y])
            continue;
        float *to = t->s->across[y][0];
        uint32_t reached;
        if (j == 0) {
            reached = widen(blocks[y], f->taps) >> ORIGIN / BLOCK &
                      ((1u << (SHEETS_TILE / BLOCK)) - 1);
            const float *row = from[y][ORIGIN - f->taps];
            WITH_TAPS(2 * f->taps + 1, filter_row(row, f->weight, N, reached, to));
        } else {
            reached = blocks_reached(blocks[y], t->needs);
            const float *row = from[y][ORIGIN - 1 - f->taps];
            WITH_TAPS(z->taps, zoom_row(row, z, N, reached, to));
        }
        t->crossed[y] = reached;
    }
}

/* Empties the rows' marked blocks. */
static void clear_blocks(float (*grid)[SHEETS_PITCH][4], uint32_t *blocks, int begin, int end) {
    for (int y = begin; y < end; y++) {
        for (uint32_t m = blocks[y]; m; m &= m - 1)
            memset(grid[y][__builtin_ctz(m) * BLOCK], 0, BLOCK * 16);
        blocks[y] = 0;
    }
}

/* Filters along a diagonal, into `skew`; rows are then row0 … row1 of that. */
static void filter_diagonally(struct tile *t) {
    const struct sheets_filter *f = t->group.diagonal;
    int n = f->taps, stride = 4 * (SHEETS_PITCH + t->group.sign);
    int low = t->row0 - n < 0 ? 0 : t->row0 - n;
    int high = t->row1 + n > SHEETS_GRID ? SHEETS_GRID : t->row1 + n;
    /* Blocks that the next filter reads: so nothing beside the grid is. */
    int left = ORIGIN - 1 - t->group.filter[0]->taps;
    int right = ORIGIN + (SHEETS_TILE >> t->group.scale[0]) + 2 + t->group.filter[0]->taps;
    uint32_t needed = (UINT32_C(2) << right / BLOCK) - (UINT32_C(1) << left / BLOCK);
    join_rows(t->deposited, t->row0, t->row1, n, low, high, t->skewed);
    for (int y = low; y < high; y++) {
        t->skewed[y] = widen(t->skewed[y], n) & needed;
        /* Rows outside the grid hold nothing. */
        int first = y - n < 0 ? n - y : 0, last = y + n >= SHEETS_GRID ? SHEETS_GRID - 1 - y + n : 2 * n;
        for (uint32_t m = t->skewed[y]; m; m &= m - 1) {
            int x = __builtin_ctz(m) * BLOCK;
            for (int p = 0; p < VECTORS; p++)
                sp_wide_store(&t->s->skew[y][x][0] + p * W,
                      taps(&t->s->grid[y][x][0] + p * W + (first - n) * stride, stride,
                           f->weight + first, last - first + 1));
        }
    }
    clear_blocks(t->s->grid, t->deposited, t->row0, t->row1);
    t->row0 = low;
    t->row1 = high;
}

/* The pixel of a group of W at element i of its planes. */
static inline int pixel_at(int i) {
    return i % 4 * PX + i / 4;
}

/* Composites W pixels of a row. */
static inline void composite(const struct tile *t, int y, int x, const sp_wide sums[4]) {
    sp_wide p[4];
    planes(sums, p);
    if (!sp_wide_mask_bits(sp_wide_lt(sp_wide_all(0), p[3])))
        return;
    float(*done)[SHEETS_TILE][SHEETS_TILE] = t->s->done;
    sp_wide through = sp_wide_load(&done[3][y][x]), depth = sp_wide_max(p[3], sp_wide_all(0)), pass, f;
    if (t->sheets->linear) {
        pass = sp_wide_max(1.0f - depth, sp_wide_all(0));
        f = reciprocal(sp_wide_max(depth, sp_wide_all(1)));
    } else {
        sp_wide e = sp_wide_exp2(depth * -SP_LOG2E);
        sp_wide series = 1.0f - depth * (0.5f - depth * (1.0f / 6));
        f = sp_wide_select(sp_wide_lt(depth, sp_wide_all(0.01f)), series,
                           (1.0f - e) * reciprocal(sp_wide_max(depth, sp_wide_all(0.01f))));
        pass = sp_wide_max(1.0f - depth * f, sp_wide_all(0));
    }
    f *= through;
    for (int c = 0; c < 3; c++)
        sp_wide_store(&done[c][y][x], sp_wide_load(&done[c][y][x]) + f * p[c]);
    sp_wide_store(&done[3][y][x], through * pass);
}

/* Rows of `from` weighted, for the blocks of one row of pixels: into the picture, or the layer's
 * sum. */
static inline void finish_blocks(struct tile *t, int y, const float *from, const float *weight,
                                 int n, uint32_t blocks, bool last) {
    enum { STRIDE = SHEETS_ROW * 4, STEP = W > BLOCK ? W / BLOCK : 1 };
    const uint32_t group = (UINT32_C(1) << STEP) - 1;
    while (blocks) {
        int b = __builtin_ctz(blocks) / STEP * STEP;
        blocks &= ~(group << b);
        sp_wide sums[4];
        for (int i = 0; i < 4; i++)
            sums[i] = sp_wide_load(from + b * BLOCK * 4 + i * W) * weight[0];
        for (int k = 1; k < n; k++)
            for (int i = 0; i < 4; i++)
                sums[i] += sp_wide_load(from + b * BLOCK * 4 + i * W + k * STRIDE) * weight[k];
        if (last) {
            composite(t, y, b * BLOCK, sums);
            continue;
        }
        float *sum = &t->s->sum[y][b * BLOCK][0];
        for (int i = 0; i < 4; i++)
            sp_wide_store(sum + i * W, sp_wide_load(sum + i * W) + sums[i]);
        t->summed[y] |= group << b;
    }
}

static void finish_row(struct tile *t, int y, const float *from, const float *weight, int n,
                       uint32_t blocks, bool last) {
    blocks &= (UINT32_C(1) << (SHEETS_TILE / BLOCK)) - 1;
    if (last)
        WITH_TAPS(n, finish_blocks(t, y, from, weight, N, blocks, true))
    else
        finish_blocks(t, y, from, weight, n, blocks, false);
}

static uint32_t alive_blocks(const struct tile *t, int y) {
    uint32_t cells = t->alive >> (y / SHEETS_CELL_HEIGHT * SHEETS_CELLS_ACROSS) & 15, m = 0;
    for (int c = 0; c < SHEETS_CELLS_ACROSS; c++)
        if (cells >> c & 1)
            m |= UINT32_C(15) << (4 * c);
    return m;
}

static void filter_down(struct tile *t, bool last) {
    const struct sheets_group *g = &t->group;
    const struct sheets_filter *f = g->filter[1];
    int j = g->scale[1], n = 2 * f->taps + 1;
    uint32_t blocks[SHEETS_GRID];
    if (j == 0) {
        int low = t->row0 - f->taps < ORIGIN ? ORIGIN : t->row0 - f->taps;
        int high = t->row1 + f->taps > ORIGIN + SHEETS_TILE ? ORIGIN + SHEETS_TILE : t->row1 + f->taps;
        join_rows(t->crossed, t->row0, t->row1, f->taps, low, high, blocks);
        for (int y = low; y < high; y++)
            finish_row(t, y - ORIGIN, t->s->across[y - f->taps][0], f->weight, n,
                       blocks[y] & alive_blocks(t, y - ORIGIN), last);
        return;
    }
    /* What pixels between samples y and y + 1 see. */
    int begin = ORIGIN, end = ORIGIN + ((SHEETS_TILE - 1) >> j) + 1;
    join_rows(t->crossed, t->row0, t->row1, f->taps + 2, begin, end, blocks);
    for (int y = 0; y < SHEETS_TILE; y++) {
        int row = (y >> j) + ORIGIN;
        finish_row(t, y, t->s->across[row - 1 - f->taps][0],
                   t->zoom[1]->down[y & ((1 << j) - 1)], t->zoom[1]->taps,
                   blocks[row] & alive_blocks(t, y), last);
    }
}

/* Filters what was deposited, and composites it if it is the last group of its layer. */
static void close_group(struct tile *t, bool last) {
    if (t->row0 < t->row1) {
        const float(*from)[SHEETS_PITCH][4] = (const float(*)[SHEETS_PITCH][4])t->s->grid;
        const uint32_t *blocks = t->deposited;
        if (t->group.diagonal) {
            filter_diagonally(t);
            from = (const float(*)[SHEETS_PITCH][4])t->s->skew;
            blocks = t->skewed;
        }
        filter_across(t, from, blocks);
        if (t->group.diagonal)
            clear_blocks(t->s->skew, t->skewed, t->row0, t->row1);
        else
            clear_blocks(t->s->grid, t->deposited, t->row0, t->row1);
        filter_down(t, last);
        for (int y = t->row0; y < t->row1; y++)
            for (uint32_t m = t->crossed[y]; m; m &= m - 1)
                memset(t->s->across[y][__builtin_ctz(m) * BLOCK], 0, BLOCK * 16);
    }
    t->row0 = SHEETS_GRID;
    t->row1 = 0;
}

static void composite_sum(struct tile *t) {
    static const float one = 1;
    for (int y = 0; y < SHEETS_TILE; y++) {
        uint32_t m = t->summed[y];
        if (!m)
            continue;
        finish_row(t, y, t->s->sum[y][0], &one, 1, m & alive_blocks(t, y), true);
        for (; m; m &= m - 1)
            memset(t->s->sum[y][__builtin_ctz(m) * BLOCK], 0, BLOCK * 16);
        t->summed[y] = 0;
    }
}

/* Which cells are not opaque. */
static void check_cells(struct tile *t) {
    for (int r = 0; r < SHEETS_TILE / SHEETS_CELL_HEIGHT; r++)
        for (int c = 0; c < SHEETS_CELLS_ACROSS; c++) {
            uint32_t bit = UINT32_C(1) << (r * SHEETS_CELLS_ACROSS + c);
            if (!(t->alive & bit))
                continue;
            sp_wide most = sp_wide_all(0);
            for (int y = 0; y < SHEETS_CELL_HEIGHT; y++)
                for (int x = 0; x < SHEETS_CELL_WIDTH; x += W)
                    most = sp_wide_max(most, sp_wide_load(&t->s->done[3][r * SHEETS_CELL_HEIGHT + y]
                                                       [c * SHEETS_CELL_WIDTH + x]));
            if (!sp_wide_mask_bits(sp_wide_le(sp_wide_all(SP_TRANSMITTANCE_MIN), most)))
                t->alive &= ~bit;
        }
}

/* ------------------------------------------------------------------ the tile's runs */

static uint32_t cells_of(const struct tile *t, const struct sheets_brick *b) {
    int x0 = b->x0 - t->x, y0 = b->y0 - t->y, x1 = b->x1 - 1 - t->x, y1 = b->y1 - 1 - t->y;
    x0 = x0 < 0 ? 0 : x0 / SHEETS_CELL_WIDTH;
    y0 = y0 < 0 ? 0 : y0 / SHEETS_CELL_HEIGHT;
    x1 = x1 >= SHEETS_TILE ? SHEETS_CELLS_ACROSS - 1 : x1 / SHEETS_CELL_WIDTH;
    y1 = y1 >= SHEETS_TILE ? SHEETS_TILE / SHEETS_CELL_HEIGHT - 1 : y1 / SHEETS_CELL_HEIGHT;
    uint32_t row = (UINT32_C(2) << x1) - (UINT32_C(1) << x0), cells = 0;
    for (int y = y0; y <= y1; y++)
        cells |= row << (y * SHEETS_CELLS_ACROSS);
    return cells;
}

/* Sorts the slices of the bricks that meet the tile by layer. */
static void sort_runs(struct tile *t, uint32_t tile) {
    const struct sheets *s = t->sheets;
    uint32_t *starts = t->s->starts;
    memset(starts, 0, (s->layers + (size_t)1) * sizeof *starts);
    for (int pass = 0; pass < 2; pass++) {
        for (uint32_t n = s->first[tile]; n < s->first[tile + 1]; n++) {
            const struct sheets_brick *b = &s->bricks[s->met[n]];
            const struct sheets_level *level = &s->levels[b->level];
            const uint16_t *start = level->level->visible.start[b->brick];
            uint32_t corner[3];
            sp_visible_corner(&level->level->visible, b->brick, corner);
            uint32_t cells = pass ? cells_of(t, b) : 0;
            for (int k = 0; k < SP_BRICK; k++) {
                if (start[k] == start[k + 1] || !(b->depth[k] > 0))
                    continue;
                uint32_t layer = level->layer[corner[s->axis] + (uint32_t)k];
                if (pass)
                    t->s->runs[starts[layer]++] =
                        (struct sheets_run){ .brick = s->met[n], .slice = (uint8_t)k, .begin = start[k],
                                             .end = start[k + 1],
                                             .depth = b->depth[k],
                                             .range = { b->range[0], b->range[1] },
                                             .cells = cells };
                else
                    starts[layer]++;
            }
        }
        uint32_t sum = 0;
        for (uint32_t l = 0; !pass && l <= s->layers; l++) {
            uint32_t count = starts[l];
            starts[l] = sum;
            sum += count;
        }
    }
    memmove(starts + 1, starts, s->layers * sizeof *starts);
    starts[0] = 0;
}

/* Most that any pixel can get of the depth of a layer's runs. */
static float bound_depth(const struct tile *t, const struct sheets_run *runs, uint32_t count) {
    float most = 0;
    for (uint32_t i = 0; i < count; i++)
        most = runs[i].cells & t->alive && runs[i].depth > most ? runs[i].depth : most;
    return most;
}

/* Composites what is pending. */
static void flush(struct tile *t) {
    if (!t->is_open)
        return;
    close_group(t, true);
    t->is_open = false;
    t->pending = 0;
}

/* Drops the runs that only meet opaque cells, and says whether what is pending has a filter for all
 * the others. The one with the farthest voxels comes first. */
static bool sift(struct tile *t, struct sheets_run *runs, uint32_t *count) {
    uint32_t n = 0;
    bool fits = t->is_open;
    for (uint32_t i = 0; i < *count; i++) {
        if (!(runs[i].cells & t->alive))
            continue;
        fits = fits && !t->sheets->bricks[runs[i].brick].is_unfit &&
               sheets_group_fits(&t->group, &t->sheets->bricks[runs[i].brick], runs[i].range) ==
                   2;
        runs[n] = runs[i];
        if (runs[n].range[0] < runs[0].range[0]) {
            struct sheets_run first = runs[n];
            runs[n] = runs[0];
            runs[0] = first;
        }
        n++;
    }
    *count = n;
    return fits;
}

/* Adds those runs that no filter serves, and takes them from the list. */
static bool add_unfit(struct tile *t, struct sheets_run *runs, uint32_t *count) {
    uint32_t left = 0, all = *count;
    for (uint32_t i = 0; i < all; i++) {
        if (t->sheets->bricks[runs[i].brick].is_unfit)
            add_footprints(t, &runs[i]);
        else
            runs[left++] = runs[i];
    }
    *count = left;
    return left < all;
}

/* Adds the runs of a layer, group by group, the farthest voxels first; `runs` is used up. Thin
 * layers are composited together: see sheets.thin. */
static void draw_layer(struct tile *t, struct sheets_run *runs, uint32_t count) {
    float depth = bound_depth(t, runs, count);
    bool fits = sift(t, runs, &count);
    if (!fits || !(t->sheets->thin > 0 && t->pending + depth <= t->sheets->thin))
        flush(t);
    bool several = add_unfit(t, runs, &count);
    while (count) {
        uint32_t left = 0;
        if (!t->is_open)
            t->is_open = start_group(t, runs, count);
        for (uint32_t i = 0; i < count; i++) {
            int part = sheets_group_fits(&t->group, &t->sheets->bricks[runs[i].brick],
                                         runs[i].range);
            if (i == 0 && part == 0)
                continue; /* cannot be: the group was made for it */
            if (part)
                add_run(t, &runs[i], part == 2);
            if (part == 2)
                continue;
            runs[left] = runs[i];
            if (part)
                runs[left].range[0] = t->group.range[1];
            left++;
        }
        several |= left > 0;
        if (several) {
            close_group(t, false);
            t->is_open = false;
        }
        sift(t, runs, &left);
        count = left;
    }
    if (several) {
        composite_sum(t);
        t->is_open = false;
        t->pending = 0;
    } else {
        t->pending += depth;
    }
    if (++t->closed % CHECK_EVERY == 0)
        check_cells(t);
}

/* [0, 1] → 0 … 255, beyond it the nearest. */
static inline sp_wide_int to_byte(sp_wide x) {
    x = sp_wide_min(sp_wide_max(x, sp_wide_all(0)), sp_wide_all(1));
    return sp_wide_to_int(x * 255.0f + 0.5f);
}

/* A row of bytes: sp_resolve_rgba8(). */
static void resolve_bytes(const struct tile *t, int y, const float background[4],
                          unsigned char *out) {
    int32_t row[SHEETS_TILE];
    for (int x = 0; x < SHEETS_TILE; x += W) {
        sp_wide through = sp_wide_load(&t->s->done[3][y][x]), share = through * background[3];
        sp_wide alpha = 1.0f - through + share;
        sp_wide undo = sp_wide_keep(sp_wide_lt(sp_wide_all(1e-6f), alpha), 1.0f / alpha);
        sp_wide_bits pixels = (sp_wide_bits)to_byte(alpha) << 24;
        for (int c = 0; c < 3; c++) {
            sp_wide colour = sp_wide_load(&t->s->done[c][y][x]) + share * background[c];
            pixels |= (sp_wide_bits)to_byte(colour * undo) << 8 * c;
        }
        int32_t lanes[W];
        sp_wide_int_store(lanes, (sp_wide_int)pixels);
        for (int i = 0; i < W; i++)
            row[x + pixel_at(i)] = lanes[i];
    }
    memcpy(out, row, (size_t)t->width * sizeof *row);
}

static void resolve(const struct tile *t) {
    struct sp_frame *frame = t->sheets->job->frame;
    const float *background = t->sheets->job->view->background;
    for (int y = 0; y < t->height; y++) {
        unsigned char *out =
            (unsigned char *)frame->pixels + (size_t)(t->y + y) * frame->stride_bytes;
        if (frame->format == SP_RGBA8) {
            resolve_bytes(t, y, background, out + 4 * (size_t)t->x);
            continue;
        }
        _Alignas(64) float row[4][SHEETS_TILE];
        for (int x = 0; x < SHEETS_TILE; x++)
            for (int c = 0; c < 4; c++)
                row[(c + 1) % 4][x / W * W + pixel_at(x % W)] = t->s->done[c][y][x];
        const float *const p[4] = { row[0], row[1], row[2], row[3] };
        sp_resolve_rgbaf32(p, (uint32_t)t->width, background,
                           (float *)(void *)out + 4 * (size_t)t->x);
    }
}

void sheets_tile(const struct sheets *sheets, struct sheets_scratch *scratch, uint32_t number) {
    const struct sp_frame *frame = sheets->job->frame;
    struct zoom zoom[2];
    zoom[0].filter = zoom[1].filter = NULL;
    struct tile t = { .sheets = sheets,
                      .zoom = { &zoom[0], &zoom[1] },
                      .s = scratch,
                      .x = (int)(number % (uint32_t)sheets->columns) * SHEETS_TILE,
                      .y = (int)(number / (uint32_t)sheets->columns) * SHEETS_TILE,
                      .row0 = SHEETS_GRID };
    int right = (int)frame->width - t.x, below = (int)frame->height - t.y;
    t.width = right < SHEETS_TILE ? right : SHEETS_TILE;
    t.height = below < SHEETS_TILE ? below : SHEETS_TILE;
    memset(scratch->done, 0, sizeof scratch->done);
    for (int y = 0; y < t.height; y++)
        for (int x = 0; x < SHEETS_TILE; x++)
            if (x / W * W + pixel_at(x % W) < t.width)
                scratch->done[3][y][x] = 1;
    t.alive = UINT32_MAX;
    check_cells(&t);
    sort_runs(&t, number);
    for (uint32_t l = 0; l < sheets->layers && t.alive; l++) {
        uint32_t begin = scratch->starts[l], end = scratch->starts[l + 1];
        if (begin == end)
            continue;
        if (sp_job_is_cancelled(sheets->job))
            break;
        draw_layer(&t, scratch->runs + begin, end - begin);
    }
    flush(&t);
    resolve(&t);
}
