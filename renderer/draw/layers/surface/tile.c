/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>

#include "data/volume/grid.h"
#include "draw/layers/surface/footprint.h"
#include "splat/exp2.h"

static const float full = SURFACE_FULL;

/* What is hidden is also known by cells of the tile. */
enum { CELL_X = SP_WIDE > 8 ? SP_WIDE : 8, CELL_Y = 8 };

static void init_cells(const struct sp_surface *s, const struct sp_surface_block *block,
                       struct sp_surface_cells *cells) {
    const struct sp_grid *grid = s->frame.grid;
    double start[3];
    cells->is_rectilinear = sp_grid_is_rectilinear(grid);
    for (unsigned a = 0; a < 3; a++) {
        const double inverse = 1 / grid->spacing[a];
        start[a] = sp_grid_distance(grid, a, block->corner[a]) * inverse;
        for (uint32_t i = 0; i <= SURFACE_BLOCK && cells->is_rectilinear; i++) {
            uint32_t k = block->corner[a] + i, last = grid->dims[a] - 1;
            double at = sp_grid_distance(grid, a, k < last ? k : last) * inverse;
            double next = sp_grid_distance(grid, a, k < last ? k + 1 : last) * inverse;
            cells->size[a][i] =
                (float)(sp_grid_local_spacing(grid, a, k < last ? k : last) * inverse);
            if (i < SURFACE_BLOCK) {
                cells->start[a][i] = (float)(at - start[a]);
                cells->gap[a][i] = (float)(next - at);
            }
        }
    }
    for (int r = 0; r < 3; r++) {
        const double *step = s->frame.step_hi[r];
        cells->base[r] = (float)(s->frame.base[r] + step[0] * start[0] + step[1] * start[1] +
                                 step[2] * start[2]);
    }
}

static void begin_sheet(struct sp_surface_scratch *scratch, int facing) {
    const int l = scratch->used[facing]++;
    memset(scratch->sheets[facing][l], 0, sizeof scratch->sheets[facing][l]);
}

/* Adds weights and depths to the sheets of one row, from column x on. */
static inline void add_to_sheets(struct sp_surface_scratch *scratch, int facing, int y, int x,
                                 sp_wide weight, sp_wide depth, float tolerance,
                                 const float normal[3], sp_wide_mask open) {
    for (int l = 0; l < SURFACE_SHEETS; l++) {
        struct sp_surface_sheet_row *row = &scratch->sheets[facing][l][y];
        if (l == scratch->used[facing])
            begin_sheet(scratch, facing);
        sp_wide w = sp_wide_load(row->weight + x), z = sp_wide_load(row->depth + x);
        sp_wide_mask take = open;
        if (l < SURFACE_SHEETS - 1) {
            sp_wide away = sp_wide_abs(depth * w - z);
            take = open & sp_wide_le(away, tolerance * w);
        }
        sp_wide add = sp_wide_keep(take, weight);
        sp_wide_store(row->weight + x, w + add);
        sp_wide_store(row->depth + x, z + add * depth);
        for (int r = 0; r < 3; r++)
            sp_wide_store(row->normal[r] + x, sp_wide_load(row->normal[r] + x) + add * normal[r]);
        open = open & ~take;
        if (!sp_wide_any(open))
            return;
    }
}

/* The depth behind which nothing of a box in the tile is seen. */
static inline float compute_end(const struct sp_surface_scratch *scratch, int x0, int y0, int x1,
                                int y1) {
    float end = -INFINITY;
    for (int y = y0 / CELL_Y; y * CELL_Y < y1; y++)
        for (int x = x0 / CELL_X; x * CELL_X < x1; x++)
            end = scratch->ends[y][x] > end ? scratch->ends[y][x] : end;
    return end;
}

/* The smaller product of a slope and the ends of a range of pixels, from a centre. */
static inline float least_along(float slope, int from, int to, float center) {
    float low = slope * ((float)from + 0.5f - center), high = slope * ((float)to - 0.5f - center);
    return low < high ? low : high;
}

/* Marks the cells that a footprint touches. */
static inline void mark_cells(struct sp_surface_scratch *scratch,
                              const struct sp_surface_footprints *f, int k) {
    const unsigned first = (unsigned)f->x0[k] / CELL_X, last = (unsigned)(f->x1[k] - 1) / CELL_X;
    const unsigned row = (2u << last) - (1u << first);
    for (int y = f->y0[k] / CELL_Y; y * CELL_Y < f->y1[k]; y++)
        scratch->changed |= row << 4 * y;
}

static inline bool is_hidden(const struct sp_surface_scratch *scratch,
                             const struct sp_surface_footprints *f, int k) {
    float nearest = f->depth[k] - f->tolerance[k] +
                    least_along(f->slope[0][k], f->x0[k], f->x1[k], f->x[k]) +
                    least_along(f->slope[1][k], f->y0[k], f->y1[k], f->y[k]);
    return nearest >= compute_end(scratch, f->x0[k], f->y0[k], f->x1[k], f->y1[k]);
}

static inline void add_footprint(const struct sp_surface *s, struct sp_surface_scratch *scratch,
                                 const struct sp_surface_footprints *f, int k) {
    const sp_wide cut = sp_wide_all(s->frame.cut), count = sp_wide_count();
    const float normal[3] = { f->normal[0][k], f->normal[1][k], f->normal[2][k] };
    const int facing = f->back >> k & 1;
    if (is_hidden(scratch, f, k))
        return;
    mark_cells(scratch, f, k);
    for (int y = f->y0[k]; y < f->y1[k]; y++) {
        const float dy = (float)y + 0.5f - f->y[k];
        for (int x = f->x0[k]; x < f->x1[k]; x += SP_WIDE) {
            sp_wide dx = count + ((float)x + 0.5f - f->x[k]);
            sp_wide p = dx * (f->a[k] * dx + f->b[k] * dy) + f->c[k] * dy * dy;
            sp_wide depth = f->depth[k] + f->slope[0][k] * dx + f->slope[1][k] * dy;
            sp_wide_mask open =
                sp_wide_lt(p, cut) &
                sp_wide_lt(depth - f->tolerance[k], sp_wide_load(&scratch->hidden[y][x]));
            if (sp_wide_any(open))
                add_to_sheets(scratch, facing, y, x, f->peak[k] * sp_wide_exp2(-p), depth,
                              f->tolerance[k], normal, open);
        }
    }
}

/* Where clipping keeps a sheet of pixels whole. */
static inline sp_wide_mask is_whole(const struct sp_surface *s,
                                    const struct sp_surface_sheet_row *row, int x, int image_x,
                                    int image_y, sp_wide depth) {
    const sp_wide n[3] = { sp_wide_load(row->normal[0] + x), sp_wide_load(row->normal[1] + x),
                           sp_wide_load(row->normal[2] + x) };
    return sp_wide_lt(sp_wide_all(0.99f),
                      sp_surface_clip_share(s, image_x, image_y, depth + s->depth_first, n));
}

/* What opaque sheets hide at pixels: what is behind a complete one, or behind several that let all
 * rays in or all rays out together (resolve.c). Nothing will be added before `reached`. */
static inline sp_wide compute_hidden(const struct sp_surface *s,
                                     const struct sp_surface_scratch *scratch,
                                     const struct sp_fragment_tile *tile, int x, int y,
                                     float reached) {
    const sp_wide enough = sp_wide_all(full), tiny = sp_wide_all(1e-6f);
    const bool is_clipped = s->clip.count || s->cuts_near;
    sp_wide hidden = sp_wide_load(&scratch->hidden[y][x]);
    sp_wide crossed = sp_wide_all(0), last = sp_wide_all(-INFINITY);
    for (int facing = 0; facing < 2; facing++)
        for (int l = 0; l < scratch->used[facing]; l++) {
            const struct sp_surface_sheet_row *row = &scratch->sheets[facing][l][y];
            sp_wide w = sp_wide_load(row->weight + x);
            sp_wide z = sp_wide_load(row->depth + x) / sp_wide_max(w, tiny);
            sp_wide_mask is_full = sp_wide_lt(enough, w);
            crossed = facing ? crossed - w : crossed + w;
            last = sp_wide_select(sp_wide_lt(tiny, w), sp_wide_max(last, z), last);
            if (is_clipped && sp_wide_any(is_full))
                is_full = is_full & is_whole(s, row, x, tile->x + x, tile->y + y, z);
            hidden = sp_wide_select(is_full, sp_wide_min(z, hidden), hidden);
        }
    if (is_clipped)
        return hidden;
    sp_wide_mask is_full =
        sp_wide_lt(enough, sp_wide_abs(crossed)) & sp_wide_lt(last, sp_wide_all(reached));
    return sp_wide_select(is_full, sp_wide_min(last, hidden), hidden);
}

/* Finds what is hidden in the cells that have changed. */
static void update_hidden(const struct sp_surface *s, struct sp_surface_scratch *scratch,
                          const struct sp_fragment_tile *tile, float reached) {
    const int columns = s->frame.size[0] - tile->x, rows = s->frame.size[1] - tile->y;
    for (unsigned left = scratch->changed; left; left &= left - 1) {
        const int cell = __builtin_ctz(left), cx = cell & 3, cy = cell >> 2;
        sp_wide end = sp_wide_all(-INFINITY);
        for (int y = cy * CELL_Y; y < (cy + 1) * CELL_Y && y < rows; y++)
            for (int x = cx * CELL_X; x < (cx + 1) * CELL_X && x < columns; x += SP_WIDE) {
                sp_wide hidden = compute_hidden(s, scratch, tile, x, y, reached);
                sp_wide_store(&scratch->hidden[y][x], hidden);
                end = sp_wide_select(sp_wide_first(columns - x), sp_wide_max(hidden, end), end);
            }
        scratch->ends[cy][cx] = sp_wide_largest(end);
    }
    scratch->changed = 0;
}

static void clear(struct sp_surface_scratch *scratch) {
    scratch->used[0] = scratch->used[1] = 0;
    scratch->changed = 0;
    for (int y = 0; y < SP_FRAGMENT_TILE; y++)
        for (int x = 0; x < SURFACE_STRIDE; x++)
            scratch->hidden[y][x] = INFINITY;
    for (int y = 0; y < SP_FRAGMENT_TILE / CELL_Y; y++)
        for (int x = 0; x < SP_FRAGMENT_TILE / CELL_X; x++)
            scratch->ends[y][x] = INFINITY;
}

/* The part of a block's box that lies in the tile. */
static void clip_box(const struct sp_splat *record, const struct sp_fragment_tile *tile,
                     int box[4]) {
    const int ends[4] = { record->x0 - tile->x, record->y0 - tile->y, record->x1 - tile->x,
                          record->y1 - tile->y };
    for (int i = 0; i < 4; i++)
        box[i] = ends[i] < 0 ? 0 : ends[i] < SP_FRAGMENT_TILE ? ends[i] : SP_FRAGMENT_TILE;
}

static void add_block(const struct sp_surface *s, struct sp_surface_scratch *scratch,
                      uint32_t number, const int corner[2]) {
    struct sp_surface_cells cells;
    const struct sp_surface_block *block = sp_surface_block_at(s, number, &cells.points);
    cells.area_step = sp_surface_area_step(s, cells.points);
    init_cells(s, block, &cells);
    for (uint32_t i = 0; i < block->count; i += SP_WIDE) {
        struct sp_surface_footprints f;
        const uint32_t left = block->count - i;
        sp_surface_set_up(s, &cells, block->first + i, left < SP_WIDE ? (int)left : SP_WIDE, corner,
                          &f);
        for (unsigned seen = f.seen; seen; seen &= seen - 1)
            add_footprint(s, scratch, &f, __builtin_ctz(seen));
    }
}

void sp_surface_tile(const struct sp_surface *s, struct sp_surface_scratch *scratch,
                     struct sp_fragment_tile *tile) {
    const uint32_t number = (uint32_t)(tile->y / SP_TILE * s->columns + tile->x / SP_TILE);
    const uint32_t begin = s->bins.first[number], end = s->bins.first[number + 1];
    const int corner[2] = { tile->x, tile->y };
    const float slack = s->tolerance * s->reach;
    const int image[2] = { s->frame.size[0] - tile->x, s->frame.size[1] - tile->y };
    const int size[2] = { image[0] < SP_TILE ? image[0] : SP_TILE,
                          image[1] < SP_TILE ? image[1] : SP_TILE };
    float farthest = INFINITY;
    if (begin == end || s->opacity <= 0)
        return;
    clear(scratch);
    for (uint32_t e = begin; e < end; e++) {
        const struct sp_splat *record = &s->blocks[s->bins.entries[e]];
        const float depth = record->depth - s->depth_first - slack;
        int box[4];
        if (depth > farthest)
            break;
        clip_box(record, tile, box);
        if (depth > compute_end(scratch, box[0], box[1], box[2], box[3]))
            continue;
        add_block(s, scratch, record->sheet, corner);
        if (s->is_opaque) {
            update_hidden(s, scratch, tile, record->depth - s->depth_first);
            farthest = compute_end(scratch, 0, 0, size[0], size[1]);
        }
    }
    sp_surface_resolve(s, scratch, tile);
}
