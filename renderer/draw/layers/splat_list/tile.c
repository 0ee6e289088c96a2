/* SPDX-License-Identifier: Apache-2.0
 *
 * Compositing of splats, front to back:
 *
 *   colour += T·(1 − e^−τ)·c,   T *= e^−τ,   τ = depth · weight
 *
 * A pixel whose transmittance T is below 1/512 does not change any more. Pixels are processed in
 * cells of four columns and SP_WIDE/4 rows, which suit footprints of a few pixels better than rows
 * do.
 *
 * Among other layers, the splats of a pixel are composited into fragments in the same way: T and
 * the colour are those since its open fragment began.
 */
#include <math.h>
#include <string.h>

#include "draw/layers/splat_list/close.h"
#include "draw/layers/splat_list/kernels.h"
#include "draw/layers/splat_list/streak.h"
#include "splat/exp2.h"

enum {
    CELL_ROWS = SP_WIDE / 4,
    COLUMNS = SP_VOXEL_TILE / 4, /* of cells */
    CELLS = SP_VOXEL_PIXELS / SP_WIDE,
    CELL_FLOATS = 4 * SP_WIDE
};

/* Column and row of a cell's first pixel in the tile. They are read, which takes less time than
 * converting them. */
static const float steps[SP_VOXEL_TILE] = { 0,  1,  2,  3,  4,  5,  6,  7,  8,  9,  10,
                                            11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21,
                                            22, 23, 24, 25, 26, 27, 28, 29, 30, 31 };

static inline float column_of(int cell) {
    return steps[cell % COLUMNS * 4];
}

static inline float row_of(int cell) {
    return steps[cell / COLUMNS * CELL_ROWS];
}

/* Column and row of each lane in its cell. */
static inline sp_wide lane_columns(void) {
    return sp_wide_from_int(sp_wide_int_count() & 3);
}

static inline sp_wide lane_rows(void) {
    return sp_wide_from_int(sp_wide_int_count() >> 2);
}

void sp_voxel_start(struct sp_voxel_tile *tile, int x, int y, const int size[2], bool has_depth) {
    const sp_wide one = sp_wide_all(1);
    tile->x = x;
    tile->y = y;
    tile->open_count = 0;
    tile->has_depth = has_depth;
    tile->origin = NAN;
    if (has_depth)
        memset(tile->moments, 0, sizeof tile->moments);
    memset(tile->cells, 0, sizeof tile->cells);
    memset(tile->open, 0, sizeof tile->open);
    for (int cell = 0; cell < CELLS; cell++) {
        sp_wide right = lane_columns() + ((float)x + column_of(cell));
        sp_wide down = lane_rows() + ((float)y + row_of(cell));
        sp_wide_mask inside = sp_wide_lt(right, sp_wide_all((float)size[0])) &
                              sp_wide_lt(down, sp_wide_all((float)size[1]));
        sp_wide_store(tile->cells + cell * CELL_FLOATS, sp_wide_keep(inside, one));
        tile->open[cell / 64] |= (uint64_t)sp_wide_any(inside) << cell % 64;
        tile->open_count += sp_wide_any(inside);
    }
}

/* The cells that a box touches: columns [x0, x1], rows [y0, y1]. */
struct cells {
    int x0, y0, x1, y1;
};

static inline struct cells compute_cells(const struct sp_voxel_tile *tile,
                                         const struct sp_voxel_record *r) {
    int x0 = r->x0 - tile->x, y0 = r->y0 - tile->y;
    int x1 = r->x1 - 1 - tile->x, y1 = r->y1 - 1 - tile->y;
    x0 = x0 > 0 ? x0 : 0;
    y0 = y0 > 0 ? y0 : 0;
    x1 = x1 < SP_VOXEL_TILE ? x1 : SP_VOXEL_TILE - 1;
    y1 = y1 < SP_VOXEL_TILE ? y1 : SP_VOXEL_TILE - 1;
    return (struct cells){ x0 / 4, y0 / CELL_ROWS, x1 / 4, y1 / CELL_ROWS };
}

/* The cells of `c` that let light through, as bits of a word of tile->open, which has eight rows.
 */
static inline uint64_t mask_open_cells(const struct sp_voxel_tile *tile, const struct cells *c,
                                       int word) {
    const int first = c->y0 - 8 * word, last = c->y1 - 8 * word;
    const uint64_t columns = (2u << c->x1) - (1u << c->x0);
    const uint64_t rows =
        UINT64_MAX << (first > 0 ? 8 * first : 0) & UINT64_MAX >> (last < 7 ? 56 - 8 * last : 0);
    return tile->open[word] & rows & columns * UINT64_C(0x0101010101010101);
}

/* 2^x for x in [−126, 126], with a relative error below 4e-6; anything elsewhere. */
static inline sp_wide exp2_within(sp_wide x) {
    const float round_up = 12582912.0f; /* 1.5·2^23: adding it leaves an integer */
    sp_wide shifted = x + round_up, f = x - (shifted - round_up);
    sp_wide p = ((9.60096e-3f * f + 5.591619e-2f) * f + 2.4023707e-1f) * f + 6.9312215e-1f;
    p = p * f + 1;
    return (sp_wide)((sp_wide_bits)p + ((sp_wide_bits)shifted << 23));
}

/* The same with a relative error below 2e-7, for one more multiplication. */
static inline sp_wide exp2_finely_within(sp_wide x) {
    const float round_up = 12582912.0f;
    sp_wide shifted = x + round_up, f = x - (shifted - round_up);
    sp_wide p = ((1.32187e-3f * f + 9.6717e-3f) * f + 5.550893e-2f) * f + 2.4022238e-1f;
    p = (p * f + 6.9314686e-1f) * f + 1;
    return (sp_wide)((sp_wide_bits)p + ((sp_wide_bits)shifted << 23));
}

/* What passes an optical depth. */
static inline sp_wide attenuate(const struct sp_voxel_frame *f, sp_wide depth) {
    return f->linear ? 1 - sp_wide_min(depth, sp_wide_all(1))
                     : exp2_within(sp_wide_max(-SP_LOG2E * depth, sp_wide_all(-126)));
}

/* What passes a Gaussian, by its weight. Most of a translucent layer are shallow, where the first
 * terms of the series suffice: absolute error below 3e-6. */
static inline sp_wide pass_gaussian(const struct sp_voxel_frame *f, const struct sp_voxel_record *r,
                                    sp_wide weight) {
    const float shallow = 0.35f;
    sp_wide t = r->depth * weight;
    if (f->linear || r->depth > shallow)
        return attenuate(f, t);
    return 1 - t * (1 - t * (0.5f - t * (1.0f / 6 - t * (1.0f / 24 - t * (1.0f / 120)))));
}

/* p of the pixels at (dx, dy) from the centre. */
static inline sp_wide compute_power(const struct sp_voxel_record *r, sp_wide dx, sp_wide dy) {
    return (r->a * dx + r->b * dy) * dx + r->c * dy * dy;
}

/* right, down: of the pixels' centres, from the image's corner. */
static inline sp_wide_mask cover_box(const struct sp_voxel_record *r, sp_wide right, sp_wide down) {
    return sp_wide_lt(sp_wide_all((float)r->x0), right) &
           sp_wide_lt(right, sp_wide_all((float)r->x1)) &
           sp_wide_lt(sp_wide_all((float)r->y0), down) &
           sp_wide_lt(down, sp_wide_all((float)r->y1));
}

static inline float pass_flat(const struct sp_voxel_frame *f, const struct sp_voxel_record *r) {
    return f->linear ? 1 - (r->depth < 1 ? r->depth : 1) : sp_exp2(-SP_LOG2E * r->depth);
}

/* The fragments that splats still join, by pixel in the order of a tile's cells. */
struct open_fragments {
    struct sp_fragment_tile *to;               /* gets them when they are complete */
    bool has_walls;                            /* it had fragments of other layers */
    float apart;                               /* as in the frame [world unit] */
    _Alignas(64) float first[SP_VOXEL_PIXELS]; /* depth of the first splat */
    float reach[SP_VOXEL_PIXELS];              /* splats that join differ less from it */
    float depth[SP_VOXEL_PIXELS];              /* Σ of depths times opacity */
    float before[SP_VOXEL_PIXELS];             /* transmittance in front of the fragment */
    float wall[SP_VOXEL_PIXELS];               /* no splat behind this depth joins it */
};

/* Where in a tile of fragments a pixel of a cell lies. */
static inline int pixel_of(int cell, int i) {
    return (cell / COLUMNS * CELL_ROWS + i / 4) * SP_VOXEL_TILE + cell % COLUMNS * 4 + i % 4;
}

/* Finds the walls behind fragments that begin at `depth` in some pixels of a cell: splats before
 * and behind a triangle must not become one fragment. */
static void update_walls(struct open_fragments *open, unsigned pixels, float depth, int cell) {
    for (; pixels; pixels &= pixels - 1) {
        const int i = __builtin_ctz(pixels), pixel = pixel_of(cell, i);
        const struct sp_fragment *list = open->to->list[pixel];
        float *wall = &open->wall[cell * SP_WIDE + i];
        *wall = INFINITY;
        for (int k = open->to->count[pixel] - 1; k >= 0 && list[k].depth > depth; k--)
            if (list[k].alpha >= SP_VOXEL_WALL)
                *wall = list[k].depth;
    }
}

/* Adds the open fragments of some pixels of a cell to their lists. */
static void complete(const struct sp_voxel_tile *tile, struct open_fragments *open, unsigned pixels,
                     int cell) {
    const float *light = tile->cells + cell * CELL_FLOATS;
    for (; pixels; pixels &= pixels - 1) {
        const int i = __builtin_ctz(pixels), at = cell * SP_WIDE + i;
        const int pixel = pixel_of(cell, i);
        const struct sp_fragment fragment = {
            .depth = open->depth[at] / (1 - light[i]),
            .color = { light[SP_WIDE + i], light[2 * SP_WIDE + i], light[3 * SP_WIDE + i] },
            .alpha = 1 - light[i],
        };
        sp_fragment_add(open->to, pixel, &fragment);
        open->before[at] *= light[i];
        open->reach[at] = open->apart * (1 + 0.5f * open->to->count[pixel]) / open->before[at];
    }
}

/* Before a splat covers pixels of a cell, completes the fragments that it is too far from, and
 * begins others. `light`: what the planes of the cell hold. Returns the transmittance in front of
 * the fragments. */
static inline sp_wide begin_fragments(struct sp_voxel_tile *tile, struct open_fragments *open,
                                      float depth, sp_wide_mask covered, int cell,
                                      sp_wide light[4]) {
    const int at = cell * SP_WIDE;
    sp_wide first = sp_wide_load(open->first + at);
    sp_wide_mask began = sp_wide_lt(light[0], sp_wide_all(1));
    sp_wide_mask is_near = sp_wide_lt(sp_wide_abs(first - depth), sp_wide_load(open->reach + at));
    if (open->has_walls)
        is_near &= sp_wide_lt(sp_wide_all(depth), sp_wide_load(open->wall + at));
    sp_wide_mask ends = covered & began & ~is_near;
    if (sp_wide_any(ends)) {
        complete(tile, open, sp_wide_mask_bits(ends), cell);
        light[0] = sp_wide_select(ends, sp_wide_all(1), light[0]);
        for (int k = 1; k < 4; k++)
            light[k] = sp_wide_select(ends, sp_wide_all(0), light[k]);
        sp_wide_store(open->depth + at, sp_wide_keep(~ends, sp_wide_load(open->depth + at)));
    }
    sp_wide_mask begins = covered & ~(began & is_near);
    sp_wide_store(open->first + at, sp_wide_select(begins, sp_wide_all(depth), first));
    if (open->has_walls && sp_wide_any(begins))
        update_walls(open, sp_wide_mask_bits(begins), depth, cell);
    return sp_wide_load(open->before + at);
}

/* The pixels of a cell that let light through. */
static inline sp_wide_mask mask_open(const struct sp_voxel_tile *tile,
                                     const struct open_fragments *open, int cell) {
    sp_wide through = sp_wide_load(tile->cells + cell * CELL_FLOATS);
    if (open)
        through *= sp_wide_load(open->before + cell * SP_WIDE);
    return sp_wide_le(sp_wide_all(SP_TRANSMITTANCE_MIN), through);
}

static inline void close_cell(struct sp_voxel_tile *tile, int cell) {
    tile->open[cell / 64] &= ~(UINT64_C(1) << cell % 64);
    tile->open_count--;
}

/* Composites a splat onto the covered pixels of a cell. There may be none: asking would take
 * longer, because the branch is hard to predict. `blended`: the share of the streaks' colour; NULL
 * = none. `moved`: depth of the splat less the tile's origin; NULL = the image has no depth.
 * `open`: NULL = the tile has no fragments. The function is always inlined: a call per splat takes
 * 5 % of the time of a frame. */
static inline __attribute__((always_inline)) void
composite(struct sp_voxel_tile *tile, struct open_fragments *open, const struct sp_voxel_frame *f,
          const struct sp_voxel_record *r, sp_wide pass, const sp_wide *blended, const float *moved,
          sp_wide_mask covered, int cell) {
    float *planes = tile->cells + cell * CELL_FLOATS;
    const float depth = r->u2 * (float)f->ewa.unit;
    sp_wide before = sp_wide_all(1), light[4];
    for (int k = 0; k < 4; k++)
        light[k] = sp_wide_load(planes + k * SP_WIDE);
    if (open)
        before = begin_fragments(tile, open, depth, covered, cell, light);
    sp_wide left = sp_wide_select(covered, light[0] * pass, light[0]), share = light[0] - left;
    if (open) {
        float *sum = open->depth + cell * SP_WIDE;
        sp_wide_store(sum, sp_wide_load(sum) + share * depth);
    }
    if (moved) {
        float *moment = tile->moments + cell * (CELL_FLOATS / 2);
        sp_moments_add(moment, moment + SP_WIDE, share, sp_wide_all(*moved));
    }
    sp_wide_store(planes, left);
    for (int k = 0; k < 3; k++) {
        sp_wide color = sp_wide_all(r->color[k]);
        if (blended)
            color += *blended * (f->streaks.color[k] - r->color[k]);
        sp_wide_store(planes + (k + 1) * SP_WIDE, light[k + 1] + share * color);
    }
    if (!sp_wide_any(sp_wide_le(sp_wide_all(SP_TRANSMITTANCE_MIN), left * before)))
        close_cell(tile, cell);
}

static inline void add_gaussian(struct sp_voxel_tile *tile, struct open_fragments *open,
                                const struct sp_voxel_frame *f, const struct sp_voxel_record *r,
                                const float *moved) {
    struct cells c = compute_cells(tile, r);
    const sp_wide cut = sp_wide_all(f->ewa.cut);
    const sp_wide dx0 = lane_columns() + ((float)tile->x + 0.5f - r->x);
    const sp_wide dy0 = lane_rows() + ((float)tile->y + 0.5f - r->y);
    for (int word = c.y0 / 8; word <= c.y1 / 8; word++)
        for (uint64_t bits = mask_open_cells(tile, &c, word); bits; bits &= bits - 1) {
            const int cell = 64 * word + __builtin_ctzll(bits);
            const sp_wide dx = dx0 + column_of(cell), dy = dy0 + row_of(cell);
            sp_wide power = compute_power(r, dx, dy);
            sp_wide_mask covered = sp_wide_le(power, cut) & mask_open(tile, open, cell);
            sp_wide pass = pass_gaussian(f, r, exp2_within(-power));
            composite(tile, open, f, r, pass, NULL, moved, covered, cell);
        }
}

/* What passes a trained Gaussian of that weight; *covered loses the pixels that it does not reach.
 */
static inline sp_wide pass_trained(const struct sp_voxel_record *r, sp_wide weight,
                                   sp_wide_mask *covered) {
    sp_wide opacity = r->depth * weight;
    *covered &= sp_wide_le(sp_wide_all(SP_TRAINED_OPACITY_MIN), opacity);
    return 1 - sp_wide_min(opacity, sp_wide_all(SP_TRAINED_OPACITY_MAX));
}

static inline void add_trained(struct sp_voxel_tile *tile, struct open_fragments *open,
                               const struct sp_voxel_frame *f, const struct sp_voxel_record *r,
                               const float *moved) {
    struct cells c = compute_cells(tile, r);
    const sp_wide dx0 = lane_columns() + ((float)tile->x + 0.5f - r->x);
    const sp_wide dy0 = lane_rows() + ((float)tile->y + 0.5f - r->y);
    for (int word = c.y0 / 8; word <= c.y1 / 8; word++)
        for (uint64_t bits = mask_open_cells(tile, &c, word); bits; bits &= bits - 1) {
            const int cell = 64 * word + __builtin_ctzll(bits);
            const sp_wide dx = dx0 + column_of(cell), dy = dy0 + row_of(cell);
            sp_wide power = sp_wide_min(compute_power(r, dx, dy), sp_wide_all(126));
            sp_wide_mask covered = mask_open(tile, open, cell);
            sp_wide pass = pass_trained(r, exp2_finely_within(-power), &covered);
            composite(tile, open, f, r, pass, NULL, moved, covered, cell);
        }
}

/* Adds a splat close to the eye. Not inline: most frames have none. */
static __attribute__((noinline)) void
add_close(struct sp_voxel_tile *tile, struct open_fragments *open, const struct sp_voxel_frame *f,
          const struct sp_voxel_record *r, const float *moved) {
    struct cells c = compute_cells(tile, r);
    const struct sp_voxel_close close = sp_voxel_close_begin(f, r);
    const float x = close.is_ahead ? r->x : 0, y = close.is_ahead ? r->y : 0;
    const sp_wide x0 = lane_columns() + ((float)tile->x + 0.5f - x);
    const sp_wide y0 = lane_rows() + ((float)tile->y + 0.5f - y);
    for (int word = c.y0 / 8; word <= c.y1 / 8; word++)
        for (uint64_t bits = mask_open_cells(tile, &c, word); bits; bits &= bits - 1) {
            const int cell = 64 * word + __builtin_ctzll(bits);
            const sp_wide right = x0 + column_of(cell), down = y0 + row_of(cell);
            sp_wide_mask covered = mask_open(tile, open, cell);
            const sp_wide weight = sp_voxel_close_weigh(&close, right, down, &covered);
            sp_wide pass =
                f->is_trained ? pass_trained(r, weight, &covered) : attenuate(f, r->depth * weight);
            if (sp_wide_any(covered))
                composite(tile, open, f, r, pass, NULL, moved, covered, cell);
        }
}

/* What passes the splat of a layer of vectors, and the share of the streaks' colour, at (along,
 * across) and the power of that place. */
static inline sp_wide pass_streak(const struct sp_voxel_frame *f, const struct sp_voxel_record *r,
                                  sp_wide along, sp_wide across, sp_wide power, sp_wide *blended) {
    const float contrast = (float)r->contrast * (1.0f / 255);
    sp_wide weight = exp2_within(-sp_wide_min(power, sp_wide_all(126))),
            intensity = sp_streak_intensity(r, along, across);
    *blended = sp_wide_all(0);
    if (f->streaks.blends) {
        /* The window has twice the variance of the kernel, so that streaks of neighbours join. */
        sp_wide window = sp_wide_sqrt(weight);
        *blended = window * (SP_STREAK_MEAN + contrast * (intensity - SP_STREAK_MEAN));
    } else {
        weight *= 1 - contrast + contrast * (1 / SP_STREAK_MEAN) * intensity;
    }
    return attenuate(f, r->depth * weight);
}

static inline sp_wide power_of_streak(sp_wide along, sp_wide across) {
    return (0.5f * SP_LOG2E) * (along * along + across * across);
}

static inline void add_streak(struct sp_voxel_tile *tile, struct open_fragments *open,
                              const struct sp_voxel_frame *f, const struct sp_voxel_record *r,
                              const float *moved) {
    struct cells c = compute_cells(tile, r);
    const sp_wide dx0 = lane_columns() + ((float)tile->x + 0.5f - r->x);
    const sp_wide dy0 = lane_rows() + ((float)tile->y + 0.5f - r->y);
    for (int word = c.y0 / 8; word <= c.y1 / 8; word++)
        for (uint64_t bits = mask_open_cells(tile, &c, word); bits; bits &= bits - 1) {
            const int cell = 64 * word + __builtin_ctzll(bits);
            const sp_wide dx = dx0 + column_of(cell), dy = dy0 + row_of(cell);
            sp_wide blended;
            sp_wide along = r->a * dx + r->b * dy, across = r->c * dx + r->d * dy;
            sp_wide power = power_of_streak(along, across);
            sp_wide_mask covered =
                sp_wide_le(power, sp_wide_all(f->ewa.cut)) & mask_open(tile, open, cell);
            if (!sp_wide_any(covered))
                continue;
            sp_wide pass = pass_streak(f, r, along, across, power, &blended);
            composite(tile, open, f, r, pass, &blended, moved, covered, cell);
        }
}

static inline void add_flat(struct sp_voxel_tile *tile, struct open_fragments *open,
                            const struct sp_voxel_frame *f, const struct sp_voxel_record *r,
                            const float *moved) {
    struct cells c = compute_cells(tile, r);
    const sp_wide pass = sp_wide_all(pass_flat(f, r));
    const sp_wide right = lane_columns() + ((float)tile->x + 0.5f);
    const sp_wide down = lane_rows() + ((float)tile->y + 0.5f);
    for (int word = c.y0 / 8; word <= c.y1 / 8; word++)
        for (uint64_t bits = mask_open_cells(tile, &c, word); bits; bits &= bits - 1) {
            const int cell = 64 * word + __builtin_ctzll(bits);
            sp_wide_mask covered = cover_box(r, right + column_of(cell), down + row_of(cell)) &
                                   mask_open(tile, open, cell);
            if (sp_wide_any(covered))
                composite(tile, open, f, r, pass, NULL, moved, covered, cell);
        }
}

static inline void add_records(struct sp_voxel_tile *tile, struct open_fragments *open,
                               const struct sp_voxel_frame *frame,
                               const struct sp_voxel_record *records, const uint32_t *entries,
                               uint32_t count, bool has_depth) {
    enum { AHEAD = 8 };
    for (uint32_t e = 0; e < count && tile->open_count; e++) {
        if (e + AHEAD < count)
            __builtin_prefetch(&records[entries[e + AHEAD]]);
        const struct sp_voxel_record *r = &records[entries[e]];
        const float depth = r->u2 * (float)frame->ewa.unit;
        if (has_depth && isnan(tile->origin))
            tile->origin = depth;
        const float d = depth - tile->origin, *moved = has_depth ? &d : NULL;
        if (frame->has_streaks)
            add_streak(tile, open, frame, r, moved);
        else if (r->close.kind != SP_CLOSE_FAR)
            add_close(tile, open, frame, r, moved);
        else if (frame->is_trained)
            add_trained(tile, open, frame, r, moved);
        else if (frame->mode == SP_FILTER_NONE)
            add_flat(tile, open, frame, r, moved);
        else
            add_gaussian(tile, open, frame, r, moved);
    }
}

void sp_voxel_add(struct sp_voxel_tile *tile, const struct sp_voxel_frame *frame,
                  const struct sp_voxel_record *records, const uint32_t *entries, uint32_t count) {
    if (tile->has_depth)
        add_records(tile, NULL, frame, records, entries, count, true);
    else
        add_records(tile, NULL, frame, records, entries, count, false);
}

/* Writes the depth of `count` pixels of row y. light: their transmittances. */
static void resolve_depth(const struct sp_voxel_tile *tile, int y, uint32_t count,
                          const float *light, const struct sp_frame *image) {
    const size_t row = (size_t)(tile->y + y);
    float moment[2][SP_VOXEL_TILE], place[2][SP_VOXEL_TILE];
    const float *const planes[3] = { light, moment[0], moment[1] };
    const float *const places[2] = { place[0], place[1] };
    for (int x = 0; x < SP_VOXEL_TILE; x += 4) {
        const float *cell = tile->moments + (y / CELL_ROWS * COLUMNS + x / 4) * (CELL_FLOATS / 2);
        for (int k = 0; k < 2; k++)
            memcpy(&moment[k][x], cell + k * SP_WIDE + y % CELL_ROWS * 4, 4 * sizeof(float));
    }
    for (int x = 0; x < SP_VOXEL_TILE; x += SP_WIDE) {
        sp_wide_store(place[0] + x, sp_wide_all(isnan(tile->origin) ? 0 : tile->origin));
        sp_wide_store(place[1] + x, sp_wide_all(1));
    }
    sp_depth_resolve(planes, places, count, sp_depth_row(image, image->depth, row) + tile->x,
                     sp_depth_row(image, image->spread, row) + tile->x);
}

void sp_voxel_resolve(const struct sp_voxel_tile *tile, const float background[4],
                      struct sp_frame *image) {
    int width = (int)image->width - tile->x, height = (int)image->height - tile->y;
    uint32_t count = (uint32_t)(width < SP_VOXEL_TILE ? width : SP_VOXEL_TILE);
    for (int y = 0; y < SP_VOXEL_TILE && y < height; y++) {
        float planes[4][SP_VOXEL_TILE];
        const float *const rows[4] = { planes[0], planes[1], planes[2], planes[3] };
        for (int x = 0; x < SP_VOXEL_TILE; x += 4) {
            const float *cell = tile->cells + (y / CELL_ROWS * COLUMNS + x / 4) * CELL_FLOATS;
            for (int k = 0; k < 4; k++)
                memcpy(&planes[k][x], cell + k * SP_WIDE + y % CELL_ROWS * 4, 4 * sizeof(float));
        }
        unsigned char *out =
            (unsigned char *)image->pixels + (size_t)(tile->y + y) * image->stride_bytes;
        if (image->format == SP_RGBAF32)
            sp_resolve_rgbaf32(rows, count, background, (float *)(void *)out + 4 * tile->x);
        else
            sp_resolve_rgba8(rows, count, background, out + 4 * tile->x);
        if (image->depth)
            resolve_depth(tile, y, count, planes[0], image);
    }
}

/* No fragment is open; tile: at its start. */
static void start_fragments(struct open_fragments *open, struct sp_voxel_tile *tile,
                            const struct sp_voxel_frame *frame, struct sp_fragment_tile *to) {
    open->to = to;
    open->has_walls = false;
    open->apart = frame->apart * (float)frame->ewa.unit;
    memset(open->first, 0, sizeof open->first);
    memset(open->depth, 0, sizeof open->depth);
    for (int at = 0; at < SP_VOXEL_PIXELS; at++) {
        const int cell = at / SP_WIDE, i = at % SP_WIDE;
        const int count = to->count[pixel_of(cell, i)];
        open->reach[at] = open->apart * (1 + 0.5f * (float)count);
        open->wall[at] = INFINITY;
        open->has_walls |= count > 0;
    }
    for (int i = 0; i < SP_VOXEL_PIXELS; i += SP_WIDE) { /* pixels outside have no fragments */
        sp_wide_store(open->before + i, sp_wide_load(tile->cells + 4 * i));
        sp_wide_store(tile->cells + 4 * i, sp_wide_all(1));
    }
}

void sp_voxel_merge(struct sp_fragment_tile *to, const struct sp_voxel_frame *frame,
                    const struct sp_voxel_record *records, const uint32_t *entries,
                    uint32_t count) {
    struct sp_voxel_tile tile;
    struct open_fragments open;
    if (!count)
        return;
    sp_voxel_start(&tile, to->x, to->y, frame->ewa.size, false);
    start_fragments(&open, &tile, frame, to);
    add_records(&tile, &open, frame, records, entries, count, false);
    for (int cell = 0; cell < CELLS; cell++) {
        sp_wide through = sp_wide_load(tile.cells + cell * CELL_FLOATS);
        sp_wide_mask began = sp_wide_lt(through, sp_wide_all(1));
        complete(&tile, &open, sp_wide_mask_bits(began), cell);
    }
}
