/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/postconv/insert.h"
#include "draw/postconv/tile.h"
#include "frame/resolve.h"
#include "splat/exp2.h"

/* Weights of the samples from ⌊x/2^scale⌋ − 1 − filter->taps on, for pixel x. */
static void make_zoom(const struct sp_postconv_tables *tables, const struct sp_postconv_filter *f,
                      int scale, struct zoom *z) {
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

/* Fills the filter for vectors of pixels; it needs one more sample if a vector spans two. */
static void make_wide_zoom(const struct sp_postconv_tables *tables,
                           const struct sp_postconv_filter *f, int scale, struct zoom *z) {
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

/* Computes the blocks of samples that each block of pixels needs. */
static void compute_needs(struct sp_postconv_open_tile *t) {
    int scale = t->group.scale[0], reach = t->group.filter[0]->taps;
    for (int b = 0; b < POSTCONV_TILE / BLOCK; b++) {
        int first = (b * BLOCK >> scale) - 1 - reach + ORIGIN;
        int last = ((b * BLOCK + BLOCK - 1) >> scale) + 2 + reach + ORIGIN;
        t->needs[b] = (UINT32_C(2) << last / BLOCK) - (UINT32_C(1) << first / BLOCK);
    }
}

/* Computes the blocks of samples that matter to pixels [4·block, 4·block + 4) along an axis. */
static void compute_span(const struct sp_postconv_group *g, int axis, int block, int span[2]) {
    float start = g->offset[axis] + (float)(block * BLOCK) * g->per_px[axis];
    float before = g->offset[axis] - g->low[axis];
    span[0] = (int)(start - before) / BLOCK;
    span[1] = (int)(start + BLOCK * g->per_px[axis] + before) / BLOCK;
}

/* Marks the blocks of samples that matter to pixels that are not opaque. */
static void mark_wanted(struct sp_postconv_open_tile *t) {
    if (!t->has_dead)
        return;
    uint32_t columns[POSTCONV_TILE / BLOCK];
    int span[2];
    memset(t->wanted, 0, sizeof t->wanted);
    for (int b = 0; b < POSTCONV_TILE / BLOCK; b++) {
        compute_span(&t->group, 0, b, span);
        columns[b] = (UINT32_C(2) << span[1]) - (UINT32_C(1) << span[0]);
    }
    for (int r = 0; r < POSTCONV_TILE / BLOCK; r++) {
        uint32_t wanted = 0;
        for (uint32_t live = t->live[r]; live; live &= live - 1)
            wanted |= columns[__builtin_ctz(live)];
        compute_span(&t->group, 1, r, span);
        for (int q = span[0]; q <= span[1]; q++)
            t->wanted[q] |= wanted;
    }
}

/* Finds the blocks of samples that are needed, and makes the tables of the filters. */
static void start_filters(struct sp_postconv_open_tile *t) {
    const struct sp_postconv_group *g = &t->group;
    if (g->scale[0]) {
        compute_needs(t);
        make_wide_zoom(t->postconv->tables, g->filter[0], g->scale[0], t->zoom[0]);
    }
    if (g->scale[1])
        make_zoom(t->postconv->tables, g->filter[1], g->scale[1], t->zoom[1]);
}

bool sp_postconv_start_group(struct sp_postconv_open_tile *t, const struct sp_postconv_run *runs,
                             uint32_t count) {
    struct sp_postconv_group *g = &t->group;
    float range[2] = { runs[0].range[0], runs[0].range[1] };
    for (uint32_t i = 1; i < count; i++)
        range[1] = runs[i].range[1] > range[1] ? runs[i].range[1] : range[1];
    if (!sp_postconv_group_init(t->postconv, &t->postconv->bricks[runs[0].brick], range, g))
        return false;
    mark_wanted(t);
    start_filters(t);
    return true;
}

/* dilated[y] = the blocks of rows y − n … y + n, for rows [r0, r1). */
static void join_rows(const uint32_t *from, int r0, int r1, int n, int low, int high,
                      uint32_t *to) {
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

/* Filters one vector: Σ weight[k] · from[k · stride], in two independent sums. */
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

/* Returns the blocks of the tile that samples in `blocks` reach. */
static uint32_t blocks_reached(uint32_t blocks, const uint32_t needs[POSTCONV_TILE / BLOCK]) {
    uint32_t reached = 0;
    for (int b = 0; b < POSTCONV_TILE / BLOCK; b++)
        reached |= (blocks & needs[b] ? UINT32_C(1) : 0) << b;
    return reached;
}

/* Filters one row of blocks; samples are pixels. */
static inline void filter_row(const float *from, const float *weight, int n, uint32_t reached,
                              float *to) {
    for (; reached; reached &= reached - 1) {
        int at = __builtin_ctz(reached) * BLOCK * 4;
        for (int p = 0; p < VECTORS; p++)
            sp_wide_store(to + at + p * W, taps(from + at + p * W, 4, weight, n));
    }
}

/* The same with samples of 2^scale pixels; `from` is the sample at the tile's left edge. */
static inline void zoom_row(const float *from, const struct zoom *z, int n, uint32_t reached,
                            float *to) {
    int period = (1 << z->scale) - 1;
    for (; reached; reached &= reached - 1) {
        int x = __builtin_ctz(reached) * BLOCK;
        for (int p = 0; p < VECTORS; p++, x += PX) {
            const float *sample = from + 4 * (x >> z->scale);
            const float(*w)[W] = z->across[(x & period) / PX];
            sp_wide even = sp_quad_repeat(sp_quad_load(sample)) * sp_wide_load(w[0]),
                    odd = sp_wide_all(0);
            for (int k = 1; k + 1 < n; k += 2) {
                odd += sp_quad_repeat(sp_quad_load(sample + 4 * k)) * sp_wide_load(w[k]);
                even += sp_quad_repeat(sp_quad_load(sample + 4 * k + 4)) * sp_wide_load(w[k + 1]);
            }
            if (n % 2 == 0)
                odd += sp_quad_repeat(sp_quad_load(sample + 4 * n - 4)) * sp_wide_load(w[n - 1]);
            sp_wide_store(to + 4 * x, even + odd);
        }
    }
}

/* Calls with a number of taps, N, that the compiler knows. */
#define TAPS_CASE(k, call)                                                                         \
    case k: {                                                                                      \
        enum { N = k };                                                                            \
        call;                                                                                      \
        break;                                                                                     \
    }
#define WITH_TAPS(n, call)                                                                         \
    switch (n) {                                                                                   \
        TAPS_CASE(3, call)                                                                         \
        TAPS_CASE(5, call)                                                                         \
        TAPS_CASE(6, call)                                                                         \
        TAPS_CASE(7, call)                                                                         \
        TAPS_CASE(8, call)                                                                         \
        TAPS_CASE(9, call)                                                                         \
        TAPS_CASE(10, call)                                                                        \
        TAPS_CASE(11, call)                                                                        \
        TAPS_CASE(13, call)                                                                        \
    default: {                                                                                     \
        const int N = (n);                                                                         \
        call;                                                                                      \
    }                                                                                              \
    }

/* Filters rows across, into `across`, whose columns are pixels. */
static void filter_across(struct sp_postconv_open_tile *t, const float (*from)[POSTCONV_PITCH][4],
                          const uint32_t *blocks) {
    const struct sp_postconv_group *g = &t->group;
    const struct sp_postconv_filter *f = g->filter[0];
    const struct zoom *z = t->zoom[0];
    int j = g->scale[0];
    for (int y = t->row0; y < t->row1; y++) {
        t->crossed[y] = 0;
        if (!blocks[y])
            continue;
        float *to = t->scratch->across[y][0];
        uint32_t reached;
        if (j == 0) {
            reached =
                widen(blocks[y], f->taps) >> ORIGIN / BLOCK & ((1u << (POSTCONV_TILE / BLOCK)) - 1);
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

/* Clears the marked blocks of rows [begin, end). */
static void clear_blocks(float (*grid)[POSTCONV_PITCH][4], uint32_t *blocks, int begin, int end) {
    for (int y = begin; y < end; y++) {
        for (uint32_t m = blocks[y]; m; m &= m - 1)
            memset(grid[y][__builtin_ctz(m) * BLOCK], 0, BLOCK * 16);
        blocks[y] = 0;
    }
}

/* Filters along a diagonal, into `skew`; rows are then row0 … row1 of that. */
static void filter_diagonally(struct sp_postconv_open_tile *t) {
    const struct sp_postconv_filter *f = t->group.diagonal;
    int n = f->taps, stride = 4 * (POSTCONV_PITCH + t->group.sign);
    int low = t->row0 - n < 0 ? 0 : t->row0 - n;
    int high = t->row1 + n > POSTCONV_GRID ? POSTCONV_GRID : t->row1 + n;
    /* Blocks that the next filter reads; this keeps it inside the grid. */
    int left = ORIGIN - 2 - t->group.filter[0]->taps;
    int right = ORIGIN + (POSTCONV_TILE >> t->group.scale[0]) + 2 + t->group.filter[0]->taps;
    uint32_t needed = (UINT32_C(2) << right / BLOCK) - (UINT32_C(1) << left / BLOCK);
    join_rows(t->deposited, t->row0, t->row1, n, low, high, t->skewed);
    for (int y = low; y < high; y++) {
        t->skewed[y] = widen(t->skewed[y], n) & needed;
        /* Rows outside the grid are empty. */
        int first = y - n < 0 ? n - y : 0,
            last = y + n >= POSTCONV_GRID ? POSTCONV_GRID - 1 - y + n : 2 * n;
        for (uint32_t m = t->skewed[y]; m; m &= m - 1) {
            int x = __builtin_ctz(m) * BLOCK;
            for (int p = 0; p < VECTORS; p++)
                sp_wide_store(&t->scratch->skew[y][x][0] + p * W,
                              taps(&t->scratch->grid[y][x][0] + p * W + (first - n) * stride,
                                   stride, f->weight + first, last - first + 1));
        }
    }
    clear_blocks(t->scratch->grid, t->deposited, t->row0, t->row1);
    t->row0 = low;
    t->row1 = high;
}

/* (1 − exp(−d)) / d for d ≥ 0: the share of its own light that a sheet lets through. Most sheets
 * are thin; for them the series is exact enough. */
static inline sp_wide mean_transmittance(sp_wide d) {
    sp_wide series = 1.0f / 5040 - d * (1.0f / 40320);
    series = 1.0f / 120 - d * (1.0f / 720 - d * series);
    series = 1.0f - d * (0.5f - d * (1.0f / 6 - d * (1.0f / 24 - d * series)));
    sp_wide_mask thick = sp_wide_lt(sp_wide_all(1), d);
    if (!sp_wide_mask_bits(thick))
        return series;
    sp_wide e = sp_wide_exp2(d * -SP_LOG2E);
    return sp_wide_select(thick, (1.0f - e) * sp_wide_fast_inverse(sp_wide_max(d, sp_wide_all(1))),
                          series);
}

/* Composites W pixels of a row. */
static inline void composite_part(const struct sp_postconv_open_tile *t, int y, int x,
                                  const sp_wide p[4]) {
    /* A deposit narrower than its B-spline is negative at its edge. */
    sp_wide_mask any = sp_wide_lt(sp_wide_all(0), p[3]);
    if (!sp_wide_mask_bits(any))
        return;
    float(*done)[POSTCONV_TILE][POSTCONV_TILE] = t->scratch->done;
    sp_wide through = sp_wide_load(&done[3][y][x]), depth = sp_wide_max(p[3], sp_wide_all(0)), pass,
            f;
    if (t->postconv->linear) {
        pass = sp_wide_max(1.0f - depth, sp_wide_all(0));
        f = sp_wide_fast_inverse(sp_wide_max(depth, sp_wide_all(1)));
    } else {
        f = mean_transmittance(depth);
        pass = sp_wide_max(1.0f - depth * f, sp_wide_all(0));
    }
    f = sp_wide_keep(any, f * through);
    for (int c = 0; c < 3; c++)
        sp_wide_store(&done[c][y][x], sp_wide_load(&done[c][y][x]) + f * p[c]);
    sp_wide_store(&done[3][y][x], through * pass);
    if (t->postconv->places)
        sp_moments_add(&t->scratch->moment[0][y][x], &t->scratch->moment[1][y][x],
                       through - through * pass, sp_wide_all(t->place));
}

/* Composites the fragments before and in the layer, and what lies before the last of them. `p`
 * keeps what is left. */
static void composite_fragments(struct sp_postconv_open_tile *t, int y, int x, sp_wide p[4]) {
    const sp_wide begin = sp_wide_all((float)t->layer), end = begin + 1;
    sp_wide done = sp_wide_all(0), place = sp_wide_load(&t->inserted->place[y][x]);
    sp_wide_mask before = sp_wide_lt(place, end);
    while (sp_wide_any(before)) {
        sp_wide share = sp_wide_select(before, sp_wide_max(place - begin, done), done), part[4];
        sp_wide left = (1 - share) / (1 - done);
        for (int i = 0; i < 4; i++) {
            part[i] = p[i] * (1 - left);
            p[i] *= left;
        }
        composite_part(t, y, x, part);
        sp_postconv_composite_fragments(t, y, x, sp_wide_mask_bits(before));
        done = share;
        place = sp_wide_load(&t->inserted->place[y][x]);
        before = sp_wide_lt(place, end);
    }
}

static inline void composite(struct sp_postconv_open_tile *t, int y, int x, const sp_wide sums[4]) {
    sp_wide p[4];
    sp_quad_transpose(sums, p);
    if (t->inserted)
        composite_fragments(t, y, x, p);
    composite_part(t, y, x, p);
}

/* Sums weighted rows of `from` for the blocks of one row of pixels, and composites them or adds
 * them to the layer's sum. */
static inline void finish_blocks(struct sp_postconv_open_tile *t, int y, const float *from,
                                 const float *weight, int n, uint32_t blocks, bool last) {
    enum { STRIDE = POSTCONV_ROW * 4, STEP = W > BLOCK ? W / BLOCK : 1 };
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
        float *sum = &t->scratch->sum[y][b * BLOCK][0];
        for (int i = 0; i < 4; i++)
            sp_wide_store(sum + i * W, sp_wide_load(sum + i * W) + sums[i]);
        t->summed[y] |= group << b;
    }
}

static void finish_row(struct sp_postconv_open_tile *t, int y, const float *from,
                       const float *weight, int n, uint32_t blocks, bool last) {
    blocks &= (UINT32_C(1) << (POSTCONV_TILE / BLOCK)) - 1;
    if (last)
        WITH_TAPS(n, finish_blocks(t, y, from, weight, N, blocks, true))
    else
        finish_blocks(t, y, from, weight, n, blocks, false);
}

static void filter_down(struct sp_postconv_open_tile *t, bool last) {
    const struct sp_postconv_group *g = &t->group;
    const struct sp_postconv_filter *f = g->filter[1];
    int j = g->scale[1], n = 2 * f->taps + 1;
    uint32_t blocks[POSTCONV_GRID];
    if (j == 0) {
        int low = t->row0 - f->taps < ORIGIN ? ORIGIN : t->row0 - f->taps;
        int high =
            t->row1 + f->taps > ORIGIN + POSTCONV_TILE ? ORIGIN + POSTCONV_TILE : t->row1 + f->taps;
        join_rows(t->crossed, t->row0, t->row1, f->taps, low, high, blocks);
        for (int y = low; y < high; y++)
            finish_row(t, y - ORIGIN, t->scratch->across[y - f->taps][0], f->weight, n,
                       blocks[y] & t->live[(y - ORIGIN) / BLOCK], last);
        return;
    }
    /* The blocks that pixels between samples y and y + 1 need. */
    int begin = ORIGIN, end = ORIGIN + ((POSTCONV_TILE - 1) >> j) + 1;
    join_rows(t->crossed, t->row0, t->row1, f->taps + 2, begin, end, blocks);
    for (int y = 0; y < POSTCONV_TILE; y++) {
        int row = (y >> j) + ORIGIN;
        finish_row(t, y, t->scratch->across[row - 1 - f->taps][0],
                   t->zoom[1]->down[y & ((1 << j) - 1)], t->zoom[1]->taps,
                   blocks[row] & t->live[y / BLOCK], last);
    }
}

void sp_postconv_close_group(struct sp_postconv_open_tile *t, bool last) {
    if (t->row0 < t->row1) {
        const float(*from)[POSTCONV_PITCH][4] = (const float(*)[POSTCONV_PITCH][4])t->scratch->grid;
        const uint32_t *blocks = t->deposited;
        if (t->group.diagonal) {
            filter_diagonally(t);
            from = (const float(*)[POSTCONV_PITCH][4])t->scratch->skew;
            blocks = t->skewed;
        }
        filter_across(t, from, blocks);
        if (t->group.diagonal)
            clear_blocks(t->scratch->skew, t->skewed, t->row0, t->row1);
        else
            clear_blocks(t->scratch->grid, t->deposited, t->row0, t->row1);
        filter_down(t, last);
        for (int y = t->row0; y < t->row1; y++)
            for (uint32_t m = t->crossed[y]; m; m &= m - 1)
                memset(t->scratch->across[y][__builtin_ctz(m) * BLOCK], 0, BLOCK * 16);
    }
    t->row0 = POSTCONV_GRID;
    t->row1 = 0;
}

void sp_postconv_close_sum(struct sp_postconv_open_tile *t) {
    static const float one = 1;
    for (int y = 0; y < POSTCONV_TILE; y++) {
        uint32_t m = t->summed[y];
        if (!m)
            continue;
        finish_row(t, y, t->scratch->sum[y][0], &one, 1, m & t->live[y / BLOCK], true);
        for (; m; m &= m - 1)
            memset(t->scratch->sum[y][__builtin_ctz(m) * BLOCK], 0, BLOCK * 16);
        t->summed[y] = 0;
    }
}

/* Blocks of W pixels, from bits of their planes' elements. */
static inline uint32_t blocks_of(uint32_t elements) {
    if (W == 4)
        return elements ? 1 : 0;
    if (W == 16)
        elements |= elements >> 8;
    elements |= elements >> 4;
    return W == 16 ? elements & 15 : (elements & 3 ? 1 : 0) | (elements & 12 ? 2 : 0);
}

void sp_postconv_check_cells(struct sp_postconv_open_tile *t) {
    enum { ROWS = POSTCONV_CELL_HEIGHT / BLOCK };
    bool changed = false;
    for (int r = 0; r < POSTCONV_TILE / BLOCK; r++) {
        uint32_t live = 0;
        if (!t->live[r])
            continue;
        for (int x = 0; x < POSTCONV_TILE; x += W) {
            sp_wide most = sp_wide_load(&t->scratch->done[3][r * BLOCK][x]);
            for (int y = 1; y < BLOCK; y++)
                most = sp_wide_max(most, sp_wide_load(&t->scratch->done[3][r * BLOCK + y][x]));
            live |=
                blocks_of(sp_wide_mask_bits(sp_wide_le(sp_wide_all(SP_TRANSMITTANCE_MIN), most)))
                << x / BLOCK;
        }
        changed |= live != t->live[r];
        t->live[r] = live;
    }
    if (!changed)
        return;
    t->alive = 0;
    for (int r = 0; r < POSTCONV_TILE / BLOCK; r++)
        for (int c = 0; c < POSTCONV_CELLS_ACROSS; c++)
            if (t->live[r] >> (c * POSTCONV_CELL_WIDTH / BLOCK) &
                ((1 << POSTCONV_CELL_WIDTH / BLOCK) - 1))
                t->alive |= UINT32_C(1) << (r / ROWS * POSTCONV_CELLS_ACROSS + c);
    t->has_dead = true;
}

/* [0, 1] → 0 … 255, clamped. */
static inline sp_wide_int to_byte(sp_wide x) {
    x = sp_wide_clamp(x, 0, 1);
    return sp_wide_to_int(x * 255.0f + 0.5f);
}

/* Resolves a row to bytes, as sp_resolve_rgba8(). */
static void resolve_bytes(const struct sp_postconv_open_tile *t, int y, const float background[4],
                          unsigned char *out) {
    int32_t row[POSTCONV_TILE];
    for (int x = 0; x < POSTCONV_TILE; x += W) {
        sp_wide through = sp_wide_load(&t->scratch->done[3][y][x]), share = through * background[3];
        sp_wide alpha = 1.0f - through + share;
        sp_wide undo = sp_wide_keep(sp_wide_lt(sp_wide_all(1e-6f), alpha), 1.0f / alpha);
        sp_wide_bits pixels = (sp_wide_bits)to_byte(alpha) << 24;
        for (int c = 0; c < 3; c++) {
            sp_wide colour = sp_wide_load(&t->scratch->done[c][y][x]) + share * background[c];
            pixels |= (sp_wide_bits)to_byte(colour * undo) << 8 * c;
        }
        int32_t lanes[W];
        sp_wide_int_store(lanes, (sp_wide_int)pixels);
        for (int i = 0; i < W; i++)
            row[x + sp_postconv_pixel_at(i)] = lanes[i];
    }
    memcpy(out, row, (size_t)t->width * sizeof *row);
}

/* Writes the depth of row y of the tile. */
static void resolve_depth(const struct sp_postconv_open_tile *t, int y) {
    const struct sp_frame *frame = t->postconv->frame;
    const struct sp_postconv_scratch *s = t->scratch;
    const float origin = isnan(s->origin) ? 0 : s->origin;
    const size_t row = (size_t)(t->y + y);
    _Alignas(64) float sums[3][POSTCONV_TILE], place[2][POSTCONV_TILE];
    const float *const planes[3] = { sums[0], sums[1], sums[2] };
    const float *const places[2] = { place[0], place[1] };
    const float *from[3] = { s->done[3][y], s->moment[0][y], s->moment[1][y] };
    for (int k = 0; k < 3; k++)
        for (int x = 0; x < POSTCONV_TILE; x += W)
            for (int i = 0; i < W; i++)
                sums[k][x + sp_postconv_pixel_at(i)] = from[k][x + i];
    sp_layer_places_row(t->postconv->places, t->x, t->y + y, t->width, place[0], place[1]);
    for (int x = 0; x < t->width; x++)
        place[0][x] += origin * place[1][x];
    sp_depth_resolve(planes, places, (uint32_t)t->width,
                     sp_depth_row(frame, frame->depth, row) + t->x,
                     sp_depth_row(frame, frame->spread, row) + t->x);
}

void sp_postconv_resolve(const struct sp_postconv_open_tile *t) {
    struct sp_frame *frame = t->postconv->frame;
    const float *background = t->postconv->view->background;
    for (int y = 0; y < t->height; y++) {
        unsigned char *out =
            (unsigned char *)frame->pixels + (size_t)(t->y + y) * frame->stride_bytes;
        if (frame->depth)
            resolve_depth(t, y);
        if (frame->format == SP_RGBA8) {
            resolve_bytes(t, y, background, out + 4 * (size_t)t->x);
            continue;
        }
        _Alignas(64) float row[4][POSTCONV_TILE];
        for (int x = 0; x < POSTCONV_TILE; x++)
            for (int c = 0; c < 4; c++)
                row[(c + 1) % 4][x / W * W + sp_postconv_pixel_at(x % W)] =
                    t->scratch->done[c][y][x];
        const float *const p[4] = { row[0], row[1], row[2], row[3] };
        sp_resolve_rgbaf32(p, (uint32_t)t->width, background,
                           (float *)(void *)out + 4 * (size_t)t->x);
    }
}
