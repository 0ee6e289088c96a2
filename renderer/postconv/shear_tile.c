/* SPDX-License-Identifier: Apache-2.0 */
#include "postconv/shear_tile.h"

#include <math.h>

#include "splat/pieces.h"

enum {
    W = SP_WIDE,
    PX = W / 4,
    CHECK_EVERY = 4,
    COLUMNS = SHEAR_PITCH / W,
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

/* Resamples one row of voxels along i. */
static void resample_row(const struct slice *s, const int columns[2],
                         const float (*from)[SHEAR_SOURCE], float (*to)[SHEAR_PITCH]) {
    for (int b = columns[0] / W; b * W < columns[1]; b++) {
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
    __m256 low = _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(class[0] -> color)),
                                      _mm_loadu_ps(class[4] -> color), 1);
    __m256 high = _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(class[8] -> color)),
                                       _mm_loadu_ps(class[12] -> color), 1);
    return (sp_wide)_mm512_insertf32x8(_mm512_castps256_ps512(low), high, 1);
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

/* Stores 16 values of a type without a table. */
static inline void store_values(const struct sp_pieces *pieces, const float *value,
                                float (*to)[SHEAR_SOURCE], int x) {
    for (int v = 0; v < SP_BRICK; v += W) {
        sp_wide plane[4];
        sp_pieces_planes(pieces, sp_wide_load(value + v), plane);
        for (int p = 0; p < 3; p++)
            sp_wide_store(&to[p][x + v], plane[p] * plane[3]);
        sp_wide_store(&to[3][x + v], plane[3]);
    }
}

/* Finds the classes of 16 entries of a type with a table. */
static inline void find_classes(const struct sp_class *table, const struct sp_visible *list,
                                uint64_t e, const struct sp_class *class[SP_BRICK]) {
    if (list->key_bytes == 1) {
        for (int i = 0; i < SP_BRICK; i++)
            class[i] = &table[((const uint8_t *)list->key)[e + (uint64_t)i]];
    } else if (list->key_bytes == 2) {
        for (int i = 0; i < SP_BRICK; i++)
            class[i] = &table[((const uint16_t *)list->key)[e + (uint64_t)i]];
    } else {
        for (int i = 0; i < SP_BRICK; i++)
            class[i] = &table[((const uint32_t *)list->key)[e + (uint64_t)i]];
    }
}

/* The same of fewer entries. */
static void find_some_classes(const struct sp_transfer *transfer, const struct sp_visible *list,
                              uint64_t e, int n, struct sp_class own[SP_BRICK]) {
    if (!transfer->pieces) {
        for (int i = 0; i < n; i++)
            own[i] = sp_transfer_class(transfer, sp_visible_key(list, e + (uint64_t)i));
        return;
    }
    float value[SP_BRICK] = { 0 };
    memcpy(value, (const float *)list->key + e, (size_t)n * sizeof *value);
    for (int v = 0; v < SP_BRICK; v += W)
        sp_pieces_classify(transfer->pieces, sp_wide_load(&value[v]), &own[v]);
}

/* The entries of one brick's slice that are left. */
struct cursor {
    uint64_t at, end;
    bool is_full; /* all voxels of the slice are there */
};

/* Classifies rows [row, row + SHEAR_BAND) of a brick's slice into columns [x, x + 16) of the
 * source. */
static void load_rows(const struct sp_shear *shear, struct cursor *c, int row,
                      float (*source)[4][SHEAR_SOURCE], int x) {
    const struct sp_visible *list = &shear->level->visible;
    const struct sp_transfer *transfer = &shear->level->transfer;
    struct sp_class own[SP_BRICK];
    const struct sp_class *class[SP_BRICK];
    if (c->is_full) {
        for (int r = 0; r < SHEAR_BAND; r++, c->at += SP_BRICK) {
            if (transfer->pieces) {
                store_values(transfer->pieces, (const float *)list->key + c->at, source[r], x);
                continue;
            }
            find_classes(transfer->table, list, c->at, class);
            store_classes(class, source[r], x);
        }
        return;
    }
    for (int r = 0; r < SHEAR_BAND; r++)
        for (int p = 0; p < 4; p++)
            memset(&source[r][p][x], 0, SP_BRICK * sizeof(float));
    int last = (row + SHEAR_BAND) * SP_BRICK;
    while (c->at < c->end && list->place[c->at] < last) {
        int n = 0;
        while (n < SP_BRICK && c->at + (uint64_t)n < c->end &&
               list->place[c->at + (uint64_t)n] < last)
            n++;
        find_some_classes(transfer, list, c->at, n, own);
        for (int i = 0; i < n; i++, c->at++) {
            int column = list->place[c->at] & 15;
            float(*to)[SHEAR_SOURCE] = source[(list->place[c->at] >> 4) - row];
            for (int p = 0; p < 3; p++)
                to[p][x + column] = own[i].color[p] * own[i].depth;
            to[3][x + column] = own[i].depth;
        }
    }
}

/* Adds row `y` of the tile from four rows of the ring, or stores it. */
static void resample_column(const struct sp_shear_open_tile *t, int y, int row, float f,
                            bool is_first) {
    const int left = t->used[0][0], right = t->used[0][1];
    const float g = 1 - f;
    const float w[4] = { g * g * g / 6, 2.0f / 3 - f * f * (1 - f / 2),
                         2.0f / 3 - g * g * (1 - g / 2), f * f * f / 6 };
    for (int p = 0; p < 4; p++) {
        const float *from[4];
        for (int k = 0; k < 4; k++)
            from[k] = t->scratch->ring[(row + k) & (SHEAR_RING - 1)][p];
        float *to = t->scratch->grid[y][p];
        for (int x = left; x < right; x += W) {
            sp_wide sum = w[0] * sp_wide_load(from[0] + x) + w[1] * sp_wide_load(from[1] + x);
            sum += w[2] * sp_wide_load(from[2] + x) + w[3] * sp_wide_load(from[3] + x);
            sp_wide_store(to + x, is_first ? sum : sp_wide_load(to + x) + sum);
        }
    }
}

/* Asks for a slice's entries, which the next slice will need. */
static inline void fetch(const struct sp_visible *list, uint64_t first) {
#if defined SP_WIDE_AVX512 || defined SP_WIDE_AVX2 || defined SP_WIDE_SSE41
    const char *key = (const char *)list->key + first * list->key_bytes;
    for (uint32_t i = 0; i < SP_BRICK * SP_BRICK * list->key_bytes; i += 64)
        _mm_prefetch(key + i, _MM_HINT_T1);
#else
    (void)list;
    (void)first;
#endif
}

/* Loads one row of bricks and resamples its rows into the ring. */
static void load_bricks(const struct sp_shear_open_tile *t, const struct slice *s, int band) {
    struct sp_shear_scratch *scratch = t->scratch;
    const struct sp_shear *shear = t->shear;
    struct cursor cursors[BRICKS];
    uint64_t count = 0;
    int first = s->low[0] / SP_BRICK, bricks = (s->high[0] - 1) / SP_BRICK - first + 1;
    double y = shear->centre[1] + (band * SP_BRICK - shear->eye[1]) * s->per_voxel[1] - t->y -
               shear->margin;
    for (int n = 0; n < bricks; n++) {
        int column = first + n;
        uint32_t b = s->brick + (uint32_t)column * s->step_across + (uint32_t)band * s->step;
        const uint16_t *start = s->list->start[b];
        uint64_t at = s->list->first[b];
        cursors[n] = (struct cursor){ at + start[s->in_brick], at + start[s->in_brick + 1], false };
        uint64_t own = cursors[n].end - cursors[n].at;
        cursors[n].is_full = own == SP_BRICK * SP_BRICK;
        int next = s->in_brick + shear->side;
        if (cursors[n].is_full && next >= 0 && next < SP_BRICK)
            fetch(s->list, at + start[next]);
        count += own;
        /* Voxels count in the tile that has the brick's corner. */
        double x = shear->centre[0] + (column * SP_BRICK - shear->eye[0]) * s->per_voxel[0] - t->x -
                   shear->margin;
        bool is_own = x >= 0 && x < shear->tile[0] && y >= 0 && y < shear->tile[1];
        scratch->splats += is_own ? own : 0;
    }
    for (int row = 0; row < SP_BRICK; row += SHEAR_BAND) {
        for (int n = 0; count && n < bricks; n++)
            load_rows(shear, &cursors[n], row, scratch->source, (first + n) * SP_BRICK - s->start);
        for (int j = 0; j < SHEAR_BAND; j++) {
            int at = (band * SP_BRICK + row + j) & (SHEAR_RING - 1);
            if (count)
                resample_row(s, t->used[0], (const float(*)[SHEAR_SOURCE])scratch->source[j],
                             scratch->ring[at]);
            else
                memset(scratch->ring[at], 0, sizeof scratch->ring[0]);
        }
    }
}

/* Clears the columns of the source that bricks do not fill. */
static void clear_around(const struct slice *s, struct sp_shear_scratch *scratch) {
    int filled = (s->high[0] - 1) / SP_BRICK * SP_BRICK + SP_BRICK - s->start;
    for (int r = 0; r < SHEAR_BAND; r++)
        for (int p = 0; p < 4; p++) {
            memset(scratch->source[r][p], 0, 2 * SP_BRICK * sizeof(float));
            memset(&scratch->source[r][p][filled], 0,
                   (size_t)(SHEAR_SOURCE - filled) * sizeof(float));
        }
}

/* Adds a slice to the grid; the first one of a layer overwrites it. */
static void add_slice(struct sp_shear_open_tile *t, uint32_t k, double distance, bool is_first) {
    const struct sp_shear *shear = t->shear;
    struct sp_shear_scratch *scratch = t->scratch;
    struct slice s = { .list = &shear->level->visible, .in_brick = (int)(k % SP_BRICK) };
    const uint32_t strides[3] = { 1, s.list->bricks[0], s.list->bricks[0] * s.list->bricks[1] };
    s.brick = k / SP_BRICK * strides[shear->axis];
    s.step_across = strides[shear->across[0]];
    s.step = strides[shear->across[1]];
    int y = t->used[1][0], rows = t->used[1][1];
    if (!find_box(t, distance, &s)) {
        if (is_first)
            memset(scratch->grid[y], 0, (size_t)(rows - y) * sizeof scratch->grid[0]);
        return;
    }
    weigh_columns(t, &s);
    clear_around(&s, scratch);
    int band = s.low[1] / SP_BRICK, last = (s.high[1] - 1) / SP_BRICK;
    int begin = band * SP_BRICK, end = (last + 1) * SP_BRICK, loaded = begin;
    for (int j = begin - 4; j < begin; j++)
        memset(scratch->ring[j & (SHEAR_RING - 1)], 0, sizeof scratch->ring[0]);
    for (; y < rows; y++) {
        double at = shear->eye[1] + (t->y + y - shear->centre[1]) / s.per_voxel[1];
        int row = (int)floor(at) - 1;
        if (row + 3 < begin || row >= end) {
            if (is_first)
                memset(scratch->grid[y], 0, sizeof scratch->grid[0]);
            continue;
        }
        for (; loaded < row + 4; loaded += SP_BRICK, band++) {
            if (band <= last)
                load_bricks(t, &s, band);
            else
                memset(scratch->ring[loaded & (SHEAR_RING - 1)], 0,
                       SP_BRICK * sizeof scratch->ring[0]);
        }
        resample_column(t, y, row, (float)(at - floor(at)), is_first);
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
        /* In samples of the tile, as far as filters reach. */
        double corner = (a ? t->y : t->x) + shear->margin;
        low = fmax(t->live[a][0], floor(low - corner) - shear->margin);
        high = fmin(t->live[a][1], ceil(high - corner) + 1 + shear->margin);
        if (!(low < high))
            return false;
        int first = (int)low / unit * unit, last = ((int)high + unit - 1) / unit * unit;
        t->done[a][0] = first + (a ? shear->margin : 0);
        t->done[a][1] = last + (a ? shear->margin : 0);
        first = (first + shear->margin - SHEAR_BLOCK) / unit * unit;
        last = (last + shear->margin + SHEAR_BLOCK + unit - 1) / unit * unit;
        t->filtered[a][0] = first;
        t->filtered[a][1] = last < size ? last : size;
        t->used[a][0] = first > unit ? first - unit : 0;
        t->used[a][1] = last + unit < size ? last + unit : size;
    }
    return true;
}

void sp_shear_tile(const struct sp_shear *shear, struct sp_shear_scratch *scratch, uint32_t tile) {
    struct sp_shear_open_tile t = {
        .shear = shear,
        .scratch = scratch,
        .x = (int)(tile % (uint32_t)shear->columns) * shear->tile[0] - shear->margin,
        .y = (int)(tile / (uint32_t)shear->columns) * shear->tile[1] - shear->margin,
        .columns = shear->tile[0] + 2 * shear->margin
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
            add_slice(&t, shear->slices[n], fabs(shear->slices[n] - shear->eye[2]), n == begin);
        sp_shear_close_layer(&t);
        if (++closed % CHECK_EVERY == 0 && !sp_shear_is_visible(&t))
            break;
    }
    sp_shear_finish_tile(&t);
}
