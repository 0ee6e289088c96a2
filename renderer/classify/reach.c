/* SPDX-License-Identifier: Apache-2.0 */
#include "classify/reach.h"

#include <math.h>
#include <stdlib.h>

#include "classify/visible_ranges.h"
#include "data/volume/grid.h"

enum { CELLS = SP_BRICK / SP_CELL };

struct work {
    const struct sp_level *level;
    const struct sp_classify_job *job;
    const void *voxels;
    struct sp_visible_ranges ranges;
    uint32_t dims[3]; /* in cells: the cells of all bricks, also beyond the volume */
    struct sp_range *from, *to;
    unsigned axis;     /* of the pass */
    uint32_t *ends[2]; /* by cell along it: first and last that two kernels reach */
    uint64_t *cells;
};

static struct sp_range join(struct sp_range a, struct sp_range b) {
    return (struct sp_range){ a.low < b.low ? a.low : b.low, a.high > b.high ? a.high : b.high };
}

/* Ranges of the cells of one row of cells along axis 0. */
static void measure_row(const struct work *w, uint32_t y, uint32_t z) {
    const uint32_t *dims = w->level->grid.dims;
    struct sp_range *row = w->from + ((size_t)z * w->dims[1] + y) * w->dims[0];
    for (uint32_t x = 0; x < w->dims[0]; x++)
        row[x] = (struct sp_range){ INFINITY, -INFINITY };
    for (uint32_t i2 = z * SP_CELL; i2 < (z + 1) * SP_CELL && i2 < dims[2]; i2++)
        for (uint32_t i1 = y * SP_CELL; i1 < (y + 1) * SP_CELL && i1 < dims[1]; i1++)
            for (uint32_t i0 = 0; i0 < dims[0]; i0 += SP_BRICK) {
                uint32_t keys[SP_BRICK], n = dims[0] - i0 < SP_BRICK ? dims[0] - i0 : SP_BRICK;
                uint8_t unused[SP_BRICK];
                sp_transfer_keys(&w->level->transfer, w->voxels,
                                 ((size_t)i2 * dims[1] + i1) * dims[0] + i0, n, keys, unused);
                for (uint32_t i = 0; i < n; i++) {
                    float v = sp_transfer_value(&w->level->transfer, keys[i]);
                    if (isfinite(v)) {
                        struct sp_range *cell = &row[(i0 + i) >> SP_CELL_SHIFT];
                        *cell = join(*cell, (struct sp_range){ v, v });
                    }
                }
            }
}

static void measure_rows(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    const struct work *w = user;
    for (size_t i = begin; i < end && !sp_classify_cancelled(w->job, NULL); i++)
        measure_row(w, (uint32_t)(i % w->dims[1]), (uint32_t)(i / w->dims[1]));
}

/* One plane of cells (of equal z, or for axis 2 of equal y): each takes the ranges of those around
 * it along the axis. */
static void widen_planes(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    const struct work *w = user;
    size_t stride[3] = { 1, w->dims[0], (size_t)w->dims[0] * w->dims[1] };
    unsigned across = w->axis == 2 ? 1 : 2, other = w->axis == 0 ? 1 : 0;
    for (size_t p = begin; p < end && !sp_classify_cancelled(w->job, NULL); p++)
        for (uint32_t q = 0; q < w->dims[other]; q++) {
            size_t line = p * stride[across] + q * stride[other];
            for (uint32_t i = 0; i < w->dims[w->axis]; i++) {
                struct sp_range range = { INFINITY, -INFINITY };
                for (uint32_t k = w->ends[0][i]; k <= w->ends[1][i]; k++)
                    range = join(range, w->from[line + k * stride[w->axis]]);
                w->to[line + i * stride[w->axis]] = range;
            }
        }
}

static void mark_bricks(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    const struct work *w = user;
    for (size_t b = begin; b < end && !sp_classify_cancelled(w->job, NULL); b++) {
        uint32_t corner[3];
        uint64_t bits = 0;
        sp_visible_brick_corner(w->level->visible.bricks, (uint32_t)b, corner);
        for (uint32_t i = 0; i < CELLS * CELLS * CELLS; i++) {
            size_t x = corner[0] / SP_CELL + (i & 3), y = corner[1] / SP_CELL + (i >> 2 & 3),
                   z = corner[2] / SP_CELL + (i >> 4);
            struct sp_range r = w->from[(z * w->dims[1] + y) * w->dims[0] + x];
            if (sp_visible_ranges_overlap(&w->ranges, (double)r.low, (double)r.high))
                bits |= UINT64_C(1) << i;
        }
        w->cells[b] = bits;
    }
}

/* A cell along a rectilinear axis: where its samples lie, and their largest spacing. */
struct span {
    double low, high, spacing;
};

static struct span measure_span(const struct sp_grid *grid, unsigned axis, uint32_t cell) {
    uint32_t first = cell * SP_CELL, end = first + SP_CELL;
    end = end < grid->dims[axis] ? end : grid->dims[axis];
    struct span s = { sp_grid_distance(grid, axis, first), sp_grid_distance(grid, axis, end - 1),
                      0 };
    for (uint32_t i = first; i < end; i++)
        s.spacing = fmax(s.spacing, sp_grid_local_spacing(grid, axis, i));
    return s;
}

/* The farthest cell on one side of `cell` whose kernels meet its own. */
static uint32_t find_end(const struct sp_grid *grid, unsigned axis, double reach, uint32_t cell,
                         int step, double largest) {
    struct span own = measure_span(grid, axis, cell);
    uint32_t cells = (grid->dims[axis] + SP_CELL - 1) / SP_CELL, end = cell;
    for (uint32_t k = cell + (uint32_t)step; k < cells; k += (uint32_t)step) { /* wraps below 0 */
        struct span other = measure_span(grid, axis, k);
        double gap = step > 0 ? other.low - own.high : own.low - other.high;
        if (gap > reach * (own.spacing + largest))
            break;
        if (gap <= reach * (own.spacing + other.spacing))
            end = k;
    }
    return end;
}

void sp_reach_ends(const struct sp_grid *grid, unsigned axis, double reach, uint32_t count,
                   uint32_t *first, uint32_t *last) {
    uint32_t dims = grid->dims[axis], cells = (dims + SP_CELL - 1) / SP_CELL;
    double around = ceil(2 * reach / SP_CELL), largest = 0;
    for (uint32_t i = 0; grid->coordinates[axis] && i < dims; i++)
        largest = fmax(largest, sp_grid_local_spacing(grid, axis, i));
    for (uint32_t i = 0; i < count; i++) {
        if (i >= cells) { /* beyond the volume */
            first[i] = last[i] = i;
        } else if (grid->coordinates[axis]) {
            first[i] = find_end(grid, axis, reach, i, -1, largest);
            last[i] = find_end(grid, axis, reach, i, 1, largest);
        } else {
            first[i] = around < i ? i - (uint32_t)around : 0;
            last[i] = around < cells - 1 - i ? i + (uint32_t)around : cells - 1;
        }
    }
}

static void run_passes(struct work *w) {
    sp_parallel_for(w->job->pool, (size_t)w->dims[1] * w->dims[2], 8, measure_rows, w);
    for (w->axis = 0; w->axis < 3; w->axis++) {
        sp_reach_ends(&w->level->grid, w->axis, w->job->reach, w->dims[w->axis], w->ends[0],
                      w->ends[1]);
        sp_parallel_for(w->job->pool, w->dims[w->axis == 2 ? 1 : 2], 1, widen_planes, w);
        struct sp_range *widened = w->to;
        w->to = w->from;
        w->from = widened;
    }
    sp_parallel_for(w->job->pool, sp_visible_bricks(&w->level->visible), 16, mark_bricks, w);
}

bool sp_reach_fill(const struct sp_level *level, const struct sp_volume *volume,
                   const struct sp_classify_job *job, uint64_t *cells, struct sp_error *err) {
    struct work w = {
        .level = level, .job = job, .voxels = sp_volume_voxels(volume), .cells = cells
    };
    size_t count = 1, longest = 0;
    sp_visible_ranges_init_keys(&w.ranges, &level->transfer.tf, sp_transfer_base(&level->transfer));
    for (int a = 0; a < 3; a++) {
        count *= w.dims[a] = level->visible.bricks[a] * CELLS;
        longest = w.dims[a] > longest ? w.dims[a] : longest;
    }
    struct sp_range *ranges = malloc(2 * count * sizeof *ranges);
    uint32_t *ends = malloc(2 * longest * sizeof *ends);
    bool ok = ranges && ends;
    if (ok) {
        w.from = ranges;
        w.to = ranges + count;
        w.ends[0] = ends;
        w.ends[1] = ends + longest;
        run_passes(&w);
        ok = !sp_classify_cancelled(job, err);
    } else {
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the ranges of %zu cells", count);
    }
    free(ranges);
    free(ends);
    return ok;
}
