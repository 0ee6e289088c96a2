/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/postconv/shear_tile.h"

#include <math.h>

#include "splat/pieces.h"

enum {
    W = SP_WIDE,
    PX = W / 4,
    CHECK_EVERY = 4,
    COLUMNS = SHEAR_PITCH / W,
    GROUPS = SHEAR_PITCH / 16,
    BRICKS = SHEAR_SOURCE / SP_BRICK
};

/* One slice, as it meets the tile. */
struct slice {
    const struct sp_visible *list;
    uint32_t brick, step; /* number of the first brick of the slice, and bricks from row to row */
    uint32_t step_across;
    int in_brick;        /* slice of the brick */
    int low[2], high[2]; /* voxels that the tile needs, [low, high) */
    double per_voxel[2]; /* samples */
    int start;           /* the voxel at column 0 of the source */
    /* First pass, by vector of columns: the first voxel in the source, and for each lane the voxel
     * from there on and the weights of four voxels. */
    int base[COLUMNS];
    uint32_t bricks[GROUPS]; /* by 16 columns: bricks that they need, from the first one on */
    uint32_t dirty;          /* bricks whose columns of the source are not zero */
    _Alignas(64) int32_t index[COLUMNS][W];
    _Alignas(64) float weight[COLUMNS][4][W];
};

/* Weights of the four voxels around a place, `f` voxels past the second one. */
static inline void spline_weights(sp_wide f, sp_wide w[4]) {
    sp_wide g = 1.0f - f;
    w[0] = g * g * g * (1.0f / 6);
    w[1] = 2.0f / 3 - f * f * (1.0f - 0.5f * f);
    w[2] = 2.0f / 3 - g * g * (1.0f - 0.5f * g);
    w[3] = f * f * f * (1.0f / 6);
}

/* Finds the voxels that the tile needs; false if there are none. */
static bool find_box(const struct sp_shear_open_tile *t, double distance, struct slice *s) {
    const struct sp_shear *shear = t->shear;
    for (int a = 0; a < 2; a++) {
        double corner = a ? t->y : t->x, first = t->used[a][0], last = t->used[a][1] - 1;
        s->per_voxel[a] = shear->scale[a] / distance;
        double low = shear->eye[a] + (corner + first - shear->centre[a]) / s->per_voxel[a] - 2;
        double high = shear->eye[a] + (corner + last - shear->centre[a]) / s->per_voxel[a] + 3;
        int dim = (int)shear->level->grid.dims[shear->across[a]];
        s->low[a] = low < 0 ? 0 : low < dim ? (int)low : dim;
        s->high[a] = high < 0 ? 0 : high < dim ? (int)high + 1 : dim;
        s->high[a] = s->high[a] < dim ? s->high[a] : dim;
        if (s->low[a] >= s->high[a])
            return false;
    }
    return true;
}

/* Finds the weights of the first pass. */
static void weigh_columns(const struct sp_shear_open_tile *t, struct slice *s) {
    const struct sp_shear *shear = t->shear;
    s->start = s->low[0] / SP_BRICK * SP_BRICK - 2 * SP_BRICK;
    for (int b = t->used[0][0] / W; b * W < t->used[0][1]; b++) {
        double at = shear->eye[0] + (t->x + b * W - shear->centre[0]) / s->per_voxel[0] - s->start;
        double first = floor(at) - 1, most = SHEAR_SOURCE - 2 * W;
        sp_wide place = (float)(at - first) + sp_wide_count() * (float)(1 / s->per_voxel[0]);
        sp_wide whole = sp_wide_floor(place), w[4];
        /* Columns that meet no voxels read zeros. */
        bool is_far = first < 0 || first > most;
        s->base[b] = is_far ? 0 : (int)first;
        spline_weights(place - whole, w);
        sp_wide_int_store(s->index[b], sp_wide_to_int(whole) - 1);
        for (int k = 0; k < 4; k++)
            sp_wide_store(s->weight[b][k], is_far ? sp_wide_all(0) : w[k]);
    }
    int origin = s->low[0] / SP_BRICK, last = (s->high[0] - 1) / SP_BRICK - origin;
    for (int g = t->used[0][0] / 16; g * 16 < t->used[0][1]; g++) {
        double at = shear->eye[0] + (t->x + g * 16 - shear->centre[0]) / s->per_voxel[0];
        double low = floor((at - 1.01) / SP_BRICK) - origin;
        double high = floor((at + 15 / s->per_voxel[0] + 2.01) / SP_BRICK) - origin;
        low = low > 0 ? low : 0;
        high = high < last ? high : last;
        s->bricks[g] = low <= high ? (UINT32_C(2) << (int)high) - (UINT32_C(1) << (int)low) : 0;
    }
}

/* Elements of two vectors at from[index], index < 2·W. */
static inline sp_wide pick(const float *from, sp_wide_int index) {
#if defined SP_WIDE_AVX512
    return (sp_wide)_mm512_permutex2var_ps(_mm512_loadu_ps(from), (__m512i)index,
                                           _mm512_loadu_ps(from + W));
#elif defined SP_WIDE_AVX2
    __m256 low = _mm256_permutevar8x32_ps(_mm256_loadu_ps(from), (__m256i)index);
    __m256 high = _mm256_permutevar8x32_ps(_mm256_loadu_ps(from + W), (__m256i)index);
    return (sp_wide)_mm256_blendv_ps(
        low, high, (__m256)_mm256_cmpgt_epi32((__m256i)index, _mm256_set1_epi32(W - 1)));
#else
    return sp_wide_gather(from, index);
#endif
}

/* Resamples one row of voxels along i, into groups of 16 columns. */
static void resample_row(const struct slice *s, uint32_t groups, const float (*from)[SHEAR_SOURCE],
                         float (*to)[SHEAR_PITCH]) {
    for (; groups; groups &= groups - 1)
        for (int n = 0; n < 16 / W; n++) {
            int b = __builtin_ctz(groups) * (16 / W) + n;
            sp_wide_int index = sp_wide_int_load(s->index[b]);
            sp_wide w[4];
            for (int k = 0; k < 4; k++)
                w[k] = sp_wide_load(s->weight[b][k]);
            for (int p = 0; p < 4; p++) {
                const float *row = &from[p][s->base[b]];
                sp_wide sum = w[0] * pick(row, index);
                for (int k = 1; k < 4; k++)
                    sum += w[k] * pick(row, index + k);
                sp_wide_store(&to[p][b * W], sum);
            }
        }
}

/* The classes of PX voxels that are four apart. */
static inline sp_wide join(const struct sp_class *const *class) {
#if defined SP_WIDE_AVX512
    /* Masked loads, because insertions would share a port with the shuffles after them. */
    __m512 all = _mm512_broadcast_f32x4(_mm_loadu_ps(class[0] -> color));
    all = _mm512_mask_broadcast_f32x4(all, 0x00f0, _mm_loadu_ps(class[4] -> color));
    all = _mm512_mask_broadcast_f32x4(all, 0x0f00, _mm_loadu_ps(class[8] -> color));
    return (sp_wide)_mm512_mask_broadcast_f32x4(all, 0xf000, _mm_loadu_ps(class[12] -> color));
#elif defined SP_WIDE_AVX2
    return (sp_wide)_mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(class[0] -> color)),
                                         _mm_loadu_ps(class[4] -> color), 1);
#else
    return sp_wide_load(class[0] -> color);
#endif
}

/* Stores a row of 16 classes as planes: emission and depth. */
static inline void store_classes(const struct sp_class *const class[SP_BRICK],
                                 float (*to)[SHEAR_SOURCE], int x) {
    for (int v = 0; v < SP_BRICK; v += W) {
        sp_wide part[4], plane[4];
        for (int k = 0; k < 4; k++)
            part[k] = join(&class[v + k]);
#if defined SP_WIDE_AVX512
        __m512 a = _mm512_unpacklo_ps((__m512)part[0], (__m512)part[1]);
        __m512 b = _mm512_unpackhi_ps((__m512)part[0], (__m512)part[1]);
        __m512 c = _mm512_unpacklo_ps((__m512)part[2], (__m512)part[3]);
        __m512 d = _mm512_unpackhi_ps((__m512)part[2], (__m512)part[3]);
        plane[0] = (sp_wide)_mm512_shuffle_ps(a, c, 0x44);
        plane[1] = (sp_wide)_mm512_shuffle_ps(a, c, 0xee);
        plane[2] = (sp_wide)_mm512_shuffle_ps(b, d, 0x44);
        plane[3] = (sp_wide)_mm512_shuffle_ps(b, d, 0xee);
#elif defined SP_WIDE_AVX2
        __m256 a = _mm256_unpacklo_ps((__m256)part[0], (__m256)part[1]);
        __m256 b = _mm256_unpackhi_ps((__m256)part[0], (__m256)part[1]);
        __m256 c = _mm256_unpacklo_ps((__m256)part[2], (__m256)part[3]);
        __m256 d = _mm256_unpackhi_ps((__m256)part[2], (__m256)part[3]);
        plane[0] = (sp_wide)_mm256_shuffle_ps(a, c, 0x44);
        plane[1] = (sp_wide)_mm256_shuffle_ps(a, c, 0xee);
        plane[2] = (sp_wide)_mm256_shuffle_ps(b, d, 0x44);
        plane[3] = (sp_wide)_mm256_shuffle_ps(b, d, 0xee);
#else
        for (int p = 0; p < 4; p++)
            plane[p] = (sp_wide){ part[0][p], part[1][p], part[2][p], part[3][p] };
#endif
        for (int p = 0; p < 3; p++)
            sp_wide_store(&to[p][x + v], plane[p] * plane[3]);
        sp_wide_store(&to[3][x + v], plane[3]);
    }
}

/* Stores 16 values of a type without a table; shown: 1 = visible, 0 = not, for each value. */
static inline void store_values(const struct sp_pieces *pieces, const float *value,
                                const float *shown, float (*to)[SHEAR_SOURCE], int x) {
    for (int v = 0; v < SP_BRICK; v += W) {
        sp_wide plane[4];
        sp_pieces_planes(pieces, sp_wide_load(value + v), plane);
        plane[3] *= sp_wide_load(shown + v);
        for (int p = 0; p < 3; p++)
            sp_wide_store(&to[p][x + v], plane[p] * plane[3]);
        sp_wide_store(&to[3][x + v], plane[3]);
    }
}

/* Stores the classes of 16 entries from e on. The keys come from words, so that one load serves
 * several of them, and classes need not wait for an array of addresses. */
static inline void store_entries(const struct sp_class *table, const struct sp_visible *list,
                                 uint64_t e, uint32_t key_bytes, float (*to)[SHEAR_SOURCE], int x) {
    const struct sp_class *class[SP_BRICK];
    uint64_t word[SP_BRICK * 4 / sizeof(uint64_t)];
    const int per_word = (int)(sizeof *word / key_bytes);
    const int reverse = __BYTE_ORDER__ == __ORDER_BIG_ENDIAN__ ? per_word - 1 : 0;
    const uint64_t mask = UINT64_MAX >> (64 - 8 * key_bytes);
    memcpy(word, (const char *)list->key + e * key_bytes, SP_BRICK * key_bytes);
#pragma GCC unroll 16
    for (int i = 0; i < SP_BRICK; i++) {
        int shift = 8 * (int)key_bytes * (i % per_word ^ reverse);
        class[i] = &table[word[i / per_word] >> shift & mask];
    }
    store_classes(class, to, x);
}

/* Stores rows of 16 entries each. */
static inline void store_rows(const struct sp_transfer *transfer, const struct sp_visible *list,
                              uint64_t e, uint32_t key_bytes, float (*source)[4][SHEAR_SOURCE],
                              int x) {
    for (int r = 0; r < SHEAR_BAND; r++)
        store_entries(transfer->table, list, e + (uint64_t)(r * SP_BRICK), key_bytes, source[r], x);
}

/* Finds the classes of entries [at, end), at their places from `first` on; none elsewhere. */
static inline void find_some_classes(const struct sp_class *table, const struct sp_visible *list,
                                     uint64_t at, uint64_t end, uint32_t key_bytes, int first,
                                     const struct sp_class *class[SHEAR_BAND * SP_BRICK]) {
    static const struct sp_class none = { { 0 }, 0 };
    const uint8_t *place = list->place, *key1 = list->key;
    const uint16_t *key2 = list->key;
    const uint32_t *key4 = list->key;
    for (int i = 0; i < SHEAR_BAND * SP_BRICK; i++)
        class[i] = &none;
    for (; at < end; at++)
        class[place[at] - first] = &table[key_bytes == 1   ? key1[at]
                                          : key_bytes == 2 ? key2[at]
                                                           : key4[at]];
}

/* The same of values, for a type without a table. */
static void find_values(const struct sp_visible *list, uint64_t at, uint64_t end, int first,
                        float value[SHEAR_BAND * SP_BRICK], float shown[SHEAR_BAND * SP_BRICK]) {
    memset(value, 0, SHEAR_BAND * SP_BRICK * sizeof *value);
    memset(shown, 0, SHEAR_BAND * SP_BRICK * sizeof *shown);
    for (; at < end; at++) {
        memcpy(&value[list->place[at] - first], (const float *)list->key + at, sizeof *value);
        shown[list->place[at] - first] = 1;
    }
}

/* The entries of one brick's slice that are left. */
struct cursor {
    uint64_t at, end;
    bool is_full; /* all voxels of the slice are there */
};

/* The same as load_rows() for slices of which some voxels are listed. */
static void load_some_rows(const struct sp_transfer *transfer, const struct sp_visible *list,
                           struct cursor *c, int row, float (*source)[4][SHEAR_SOURCE], int x) {
    const struct sp_class *class[SHEAR_BAND * SP_BRICK];
    float value[SHEAR_BAND * SP_BRICK], shown[SHEAR_BAND * SP_BRICK];
    int first = row * SP_BRICK, last = first + SHEAR_BAND * SP_BRICK;
    uint32_t rows = 0;
    uint64_t at = c->at;
    for (; c->at < c->end && list->place[c->at] < last; c->at++)
        rows |= UINT32_C(1) << ((list->place[c->at] - first) >> SP_BRICK_SHIFT);
    if (transfer->pieces)
        find_values(list, at, c->at, first, value, shown);
    else if (list->key_bytes == 1)
        find_some_classes(transfer->table, list, at, c->at, 1, first, class);
    else if (list->key_bytes == 2)
        find_some_classes(transfer->table, list, at, c->at, 2, first, class);
    else
        find_some_classes(transfer->table, list, at, c->at, 4, first, class);
    for (int r = 0; r < SHEAR_BAND; r++) {
        int i = r * SP_BRICK;
        if (rows >> r & 1 && transfer->pieces)
            store_values(transfer->pieces, &value[i], &shown[i], source[r], x);
        else if (rows >> r & 1)
            store_classes(&class[i], source[r], x);
        else
            for (int p = 0; p < 4; p++)
                memset(&source[r][p][x], 0, SP_BRICK * sizeof(float));
    }
}

/* Classifies rows [row, row + SHEAR_BAND) of a brick's slice into columns [x, x + 16) of the
 * source. */
static void load_rows(const struct sp_shear *shear, struct cursor *c, int row,
                      float (*source)[4][SHEAR_SOURCE], int x) {
    const struct sp_visible *list = &shear->level->visible;
    const struct sp_transfer *transfer = &shear->level->transfer;
    static const float all[SP_BRICK] = { 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1 };
    uint64_t at = c->at;
    if (!c->is_full) {
        load_some_rows(transfer, list, c, row, source, x);
        return;
    }
    c->at += SHEAR_BAND * SP_BRICK;
    if (transfer->pieces)
        for (int r = 0; r < SHEAR_BAND; r++, at += SP_BRICK)
            store_values(transfer->pieces, (const float *)list->key + at, all, source[r], x);
    else if (list->key_bytes == 1)
        store_rows(transfer, list, at, 1, source, x);
    else if (list->key_bytes == 2)
        store_rows(transfer, list, at, 2, source, x);
    else
        store_rows(transfer, list, at, 4, source, x);
}

/* Adds four rows of the ring to row `y` of the grid. */
static void resample_column(struct sp_shear_open_tile *t, int y, int row, float f) {
    const float g = 1 - f;
    const float w[4] = { g * g * g / 6, 2.0f / 3 - f * f * (1 - f / 2),
                         2.0f / 3 - g * g * (1 - g / 2), f * f * f / 6 };
    uint32_t groups =
        t->filled[row >> SP_BRICK_SHIFT & 1] | t->filled[(row + 3) >> SP_BRICK_SHIFT & 1];
    groups &= t->needed[y / SHEAR_BLOCK];
    t->touched[y / SHEAR_BLOCK] |= groups;
    const float *from[4];
    for (int k = 0; k < 4; k++)
        from[k] = t->scratch->ring[(row + k) & (SHEAR_RING - 1)][0];
    float *to = t->scratch->grid[y][0];
    for (; groups; groups &= groups - 1) {
        int first = __builtin_ctz(groups) * 16;
        for (int x = first; x < 4 * SHEAR_PITCH; x += SHEAR_PITCH)
            for (int v = x; v < x + 16; v += W) {
                sp_wide sum = w[0] * sp_wide_load(from[0] + v) + w[1] * sp_wide_load(from[1] + v);
                sum += w[2] * sp_wide_load(from[2] + v) + w[3] * sp_wide_load(from[3] + v);
                sp_wide_store(to + v, sp_wide_load(to + v) + sum);
            }
    }
}

/* Clears groups of columns of half of the ring. */
static void clear_ring(struct sp_shear_open_tile *t, int half, uint32_t groups) {
    t->filled[half] &= ~groups;
    for (; groups; groups &= groups - 1)
        for (int j = 0; j < SP_BRICK; j++)
            for (int p = 0; p < 4; p++)
                memset(&t->scratch->ring[half * SP_BRICK + j][p][__builtin_ctz(groups) * 16], 0,
                       16 * sizeof(float));
}

/* Groups of columns that need a row of bricks. */
static uint32_t groups_of_band(const struct sp_shear_open_tile *t, const struct slice *s,
                               int band) {
    double y =
        t->shear->centre[1] + (band * SP_BRICK - 2 - t->shear->eye[1]) * s->per_voxel[1] - t->y;
    double end = y + (SP_BRICK + 3) * s->per_voxel[1] + 1;
    uint32_t groups = 0;
    y = y > t->used[1][0] ? y : t->used[1][0];
    end = end < t->used[1][1] - 1 ? end : t->used[1][1] - 1;
    for (int b = (int)y / SHEAR_BLOCK; b <= (int)end / SHEAR_BLOCK && y <= end; b++)
        groups |= t->needed[b];
    return groups;
}

/* The entries of a brick in the slice; none if they are transparent. */
static struct cursor find_entries(const struct slice *s, uint32_t brick) {
    const uint16_t *start = s->list->start[brick];
    uint64_t at = s->list->first[brick];
    struct cursor c = { at + start[s->in_brick], at + start[s->in_brick + 1], false };
    c.is_full = c.end - c.at == SP_BRICK * SP_BRICK;
    return c;
}

/* Counts the voxels of a brick in the tile that has the brick's corner. */
static uint64_t own_voxels(const struct sp_shear_open_tile *t, const struct slice *s, int column,
                           int row, const struct cursor *c) {
    const struct sp_shear *shear = t->shear;
    const int corner[2] = { column, row };
    for (int a = 0; a < 2; a++) {
        double x = shear->centre[a] + (corner[a] - shear->eye[a]) * s->per_voxel[a] -
                   (a ? t->y : t->x) - shear->margin;
        if (!(x >= 0 && x < shear->tile[a]))
            return 0;
    }
    return c->end - c->at;
}

/* Loads one row of bricks and resamples its rows into a half of the ring, in groups of columns that
 * need it. */
static void load_bricks(struct sp_shear_open_tile *t, struct slice *s, int band) {
    struct sp_shear_scratch *scratch = t->scratch;
    struct cursor cursors[BRICKS];
    uint32_t wanted = groups_of_band(t, s, band), present = 0, needed = 0, groups = 0;
    int first = s->low[0] / SP_BRICK, bricks = (s->high[0] - 1) / SP_BRICK - first + 1;
    for (int n = 0; n < bricks; n++) {
        uint32_t brick =
            s->brick + (uint32_t)(first + n) * s->step_across + (uint32_t)band * s->step;
        cursors[n] = find_entries(s, brick);
        present |= (cursors[n].at < cursors[n].end ? UINT32_C(1) : 0) << n;
    }
    for (int g = t->used[0][0] / 16; g * 16 < t->used[0][1]; g++)
        if (wanted >> g & 1 && s->bricks[g] & present) {
            groups |= UINT32_C(1) << g;
            needed |= s->bricks[g];
        }
    clear_ring(t, band & 1, t->filled[band & 1] & ~groups);
    t->filled[band & 1] = groups;
    for (uint32_t m = needed & ~present & s->dirty; m; m &= m - 1)
        for (int r = 0; r < 4 * SHEAR_BAND; r++)
            memset(&scratch->source[0][r][(first + __builtin_ctz(m)) * SP_BRICK - s->start], 0,
                   SP_BRICK * sizeof(float));
    s->dirty = (s->dirty & ~needed) | (needed & present);
    needed &= present;
    for (uint32_t m = needed; m; m &= m - 1) {
        int n = __builtin_ctz(m);
        scratch->splats += own_voxels(t, s, (first + n) * SP_BRICK, band * SP_BRICK, &cursors[n]);
    }
    for (int row = 0; groups && row < SP_BRICK; row += SHEAR_BAND) {
        for (uint32_t m = needed; m; m &= m - 1) {
            int n = __builtin_ctz(m);
            load_rows(t->shear, &cursors[n], row, scratch->source,
                      (first + n) * SP_BRICK - s->start);
        }
        for (int j = 0; j < SHEAR_BAND; j++)
            resample_row(s, groups, (const float(*)[SHEAR_SOURCE])scratch->source[j],
                         scratch->ring[(band * SP_BRICK + row + j) & (SHEAR_RING - 1)]);
    }
}

/* Adds a slice to the grid. */
static void add_slice(struct sp_shear_open_tile *t, uint32_t k, double distance) {
    const struct sp_shear *shear = t->shear;
    struct slice s = { .list = &shear->level->visible, .in_brick = (int)(k % SP_BRICK) };
    const uint32_t strides[3] = { 1, s.list->bricks[0], s.list->bricks[0] * s.list->bricks[1] };
    s.brick = k / SP_BRICK * strides[shear->axis];
    s.step_across = strides[shear->across[0]];
    s.step = strides[shear->across[1]];
    if (!find_box(t, distance, &s))
        return;
    weigh_columns(t, &s);
    memset(t->scratch->source, 0, sizeof t->scratch->source);
    clear_ring(t, 0, t->filled[0]);
    clear_ring(t, 1, t->filled[1]);
    int band = s.low[1] / SP_BRICK, last = (s.high[1] - 1) / SP_BRICK;
    int begin = band * SP_BRICK, end = (last + 1) * SP_BRICK, loaded = begin;
    for (int y = t->used[1][0]; y < t->used[1][1]; y++) {
        double at = shear->eye[1] + (t->y + y - shear->centre[1]) / s.per_voxel[1];
        int row = (int)floor(at) - 1;
        if (row + 3 < begin || row >= end)
            continue;
        for (; loaded < row + 4; loaded += SP_BRICK, band++) {
            if (band <= last)
                load_bricks(t, &s, band);
            else
                clear_ring(t, band & 1, t->filled[band & 1]);
        }
        resample_column(t, y, row, (float)(at - floor(at)));
    }
}

/* Finds which samples a layer's slices reach; false if none of the tile. */
static bool find_reached(struct sp_shear_open_tile *t, uint32_t begin, uint32_t end) {
    const struct sp_shear *shear = t->shear;
    for (int a = 0; a < 2; a++) {
        const int unit = a ? SHEAR_BLOCK : 16, size = shear->tile[a] + 2 * shear->margin;
        double low = INFINITY, high = -INFINITY, dim = shear->level->grid.dims[shear->across[a]];
        for (uint32_t n = begin; n < end; n++) {
            double s = shear->scale[a] / fabs(shear->slices[n] - shear->eye[2]);
            low = fmin(low, shear->centre[a] + (-2 - shear->eye[a]) * s);
            high = fmax(high, shear->centre[a] + (dim + 1 - shear->eye[a]) * s);
        }
        low = fmax(0, floor(low - (a ? t->y : t->x)));
        high = fmin(size, ceil(high - (a ? t->y : t->x)) + 1);
        if (!(low < high))
            return false;
        t->used[a][0] = (int)low / unit * unit;
        t->used[a][1] = ((int)high + unit - 1) / unit * unit;
    }
    return true;
}

void sp_shear_tile(const struct sp_shear *shear, struct sp_shear_scratch *scratch, uint32_t tile) {
    struct sp_shear_open_tile t = {
        .shear = shear,
        .scratch = scratch,
        .x = (int)(tile % (uint32_t)shear->columns) * shear->tile[0] - shear->margin,
        .y = (int)(tile / (uint32_t)shear->columns) * shear->tile[1] - shear->margin,
        .columns = shear->tile[0] + 2 * shear->margin,
        .reach = shear->margin / SHEAR_BLOCK
    };
    unsigned closed = 0;
    sp_shear_start_tile(&t);
    for (uint32_t l = 0; l < shear->postconv->layers; l++) {
        uint32_t begin = shear->first[l], end = shear->first[l + 1];
        double distance = 0;
        if (begin == end || !find_reached(&t, begin, end))
            continue;
        if (sp_interrupt_is_cancelled(&shear->postconv->interrupt))
            break;
        for (uint32_t n = begin; n < end; n++)
            distance += fabs(shear->slices[n] - shear->eye[2]) / (end - begin);
        if (!(fabs(distance / t.distance - 1) < 0.02))
            sp_shear_make_weights(&t, distance);
        for (uint32_t n = begin; n < end; n++)
            add_slice(&t, shear->slices[n], fabs(shear->slices[n] - shear->eye[2]));
        sp_shear_close_layer(&t);
        if (++closed % CHECK_EVERY == 0 && !sp_shear_is_visible(&t))
            break;
    }
    for (int half = 0; half < 2; half++) /* the next tile expects zeros */
        clear_ring(&t, half, t.filled[half]);
    sp_shear_finish_tile(&t);
}
