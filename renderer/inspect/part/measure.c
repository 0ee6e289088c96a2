/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>

#include "base/vec.h"
#include "data/volume/grid.h"
#include "data/volume/volume.h"
#include "draw/layers/surface/extract.h"
#include "inspect/part/connect.h"
#include "sp/part.h"

/* The size of cell i of an axis, between samples i and i + 1. */
static double gap_of(const struct sp_grid *grid, unsigned axis, uint32_t i) {
    return i + 1 < grid->dims[axis]
               ? sp_grid_distance(grid, axis, i + 1) - sp_grid_distance(grid, axis, i)
               : grid->spacing[axis];
}

static double determinant(const struct sp_grid *grid) {
    const double(*d)[3] = grid->direction;
    return fabs(d[0][0] * (d[1][1] * d[2][2] - d[1][2] * d[2][1]) -
                d[0][1] * (d[1][0] * d[2][2] - d[1][2] * d[2][0]) +
                d[0][2] * (d[1][0] * d[2][1] - d[1][1] * d[2][0]));
}

static void add_volume(const struct sp_grid *grid, const struct sp_mask *mine,
                       struct sp_part_size *size) {
    const double unit = determinant(grid);
    for (uint32_t z = 0; z < grid->dims[2]; z++)
        for (uint32_t y = 0; y < grid->dims[1]; y++) {
            const uint64_t *row = sp_mask_row(mine, y, z);
            const bool is_border =
                y == 0 || y + 1 == grid->dims[1] || z == 0 || z + 1 == grid->dims[2];
            double length = 0;
            for (uint32_t w = 0; w < mine->words; w++)
                for (uint64_t left = row[w]; left; left &= left - 1) {
                    uint32_t x = w * 64 + (uint32_t)__builtin_ctzll(left);
                    length += sp_grid_local_spacing(grid, 0, x);
                    size->samples++;
                    size->is_open = size->is_open || is_border || x == 0 || x + 1 == grid->dims[0];
                }
            size->volume += unit * length * sp_grid_local_spacing(grid, 1, y) *
                            sp_grid_local_spacing(grid, 2, z);
        }
}

/* True if a corner of the cell belongs to the part. */
static bool touches(const struct sp_mask *mine, const uint32_t cell[3]) {
    for (int c = 0; c < 8; c++) {
        uint32_t x = cell[0] + (c & 1), y = cell[1] + (c >> 1 & 1), z = cell[2] + (c >> 2);
        if (x < mine->dims[0] && y < mine->dims[1] && z < mine->dims[2] &&
            sp_mask_has(mine, x, y, z))
            return true;
    }
    return false;
}

/* The world area of a piece of surface, from its vector area in index space. */
static double world_area(const struct sp_grid *grid, const uint32_t cell[3], const double area[3]) {
    struct sp_vec3 sum = { { 0 } };
    for (unsigned a = 0; a < 3; a++) {
        const unsigned b = (a + 1) % 3, c = (a + 2) % 3;
        struct sp_vec3 u, v;
        for (int r = 0; r < 3; r++) {
            u.v[r] = grid->direction[r][b] * gap_of(grid, b, cell[b]);
            v.v[r] = grid->direction[r][c] * gap_of(grid, c, cell[c]);
        }
        sum = sp_vec3_add(sum, sp_vec3_scale(sp_vec3_cross(u, v), area[a]));
    }
    return sp_vec3_length(sum);
}

static double sum_area(const struct sp_grid *grid, const struct sp_surface_points *points,
                       const struct sp_mask *mine) {
    double sum = 0;
    for (uint32_t b = 0; b < points->block_count; b++) {
        const struct sp_surface_block *block = &points->blocks[b];
        for (uint64_t i = block->first; i < block->first + block->count; i++) {
            uint32_t cell[3];
            double area[3];
            for (int a = 0; a < 3; a++) {
                cell[a] =
                    block->corner[a] + (uint32_t)((float)points->at[a][i] / SURFACE_PLACE_STEPS);
                area[a] = points->area[a][i] / (double)SURFACE_AREA_STEPS;
            }
            if (touches(mine, cell))
                sum += world_area(grid, cell, area);
        }
    }
    return sum;
}

static bool add_area(const struct sp_volume *volume, double value, const struct sp_mask *mine,
                     struct sp_pool *pool, struct sp_part_size *size, struct sp_error *err) {
    const struct sp_surface_job job = { .volume = volume, .value = value, .pool = pool };
    struct sp_surface_ranges ranges = { 0 };
    struct sp_surface_points points = { 0 };
    bool ok = sp_surface_ranges_init(&ranges, &job, err) &&
              sp_surface_extract(&points, &job, &ranges, SP_PART_AREA_BYTES, err);
    if (ok)
        size->area += sum_area(&sp_volume_info(volume)->grid, &points, mine);
    sp_surface_points_finish(&points);
    sp_surface_ranges_finish(&ranges);
    return ok;
}

bool sp_part_measure(const struct sp_volume *volume, const struct sp_part *part,
                     struct sp_part_size *size, struct sp_error *err) {
    const struct sp_volume_info *info = sp_volume_info(volume);
    struct sp_pool *pool = sp_pool_create(sp_volume_threads(), err);
    struct sp_mask all = { 0 }, mine = { 0 };
    *size = (struct sp_part_size){ 0 };
    if (!pool)
        return false;
    bool ok = sp_part_connect(info, sp_volume_voxels(volume), part->point, part->range, pool, &all,
                              &mine, &size->is_found, err);
    if (ok && size->is_found) {
        add_volume(&info->grid, &mine, size);
        /* Below the smallest sample and above the largest one there is no surface. */
        ok = add_area(volume, part->range[0], &mine, pool, size, err) &&
             (part->range[1] >= info->range[1] ||
              add_area(volume, part->range[1], &mine, pool, size, err));
    }
    sp_mask_finish(&all);
    sp_mask_finish(&mine);
    sp_pool_destroy(&pool);
    return ok;
}
