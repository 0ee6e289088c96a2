/* SPDX-License-Identifier: Apache-2.0 */
#include "inspect/part/connect.h"

#include <math.h>

#include "base/vec.h"
#include "data/volume/grid.h"
#include "data/volume/sample.h"

enum { NEAR = 2 }; /* samples from the point within which the part may begin */

struct search {
    const struct sp_volume_info *info;
    const void *voxels;
    const double *point, *range;
    struct sp_mask *all;
};

static void mark_range(void *user, size_t begin, size_t end, unsigned worker) {
    const struct search *part = user;
    const struct sp_volume_info *info = part->info;
    const uint32_t *dims = info->grid.dims;
    const double *range = part->range;
    (void)worker;
    for (size_t row = begin; row < end; row++) {
        uint64_t *bits =
            sp_mask_row(part->all, (uint32_t)(row % dims[1]), (uint32_t)(row / dims[1]));
        for (uint32_t x = 0; x < dims[0]; x++) {
            double value = sp_sample(part->voxels, info->type, row * dims[0] + x);
            if (value >= range[0] && value <= range[1])
                bits[x / 64] |= UINT64_C(1) << x % 64;
        }
    }
}

/* The index of the sample nearest to a distance along an axis. */
static double nearest_index(const struct sp_grid *grid, unsigned axis, double distance) {
    uint32_t low = 0, high = grid->dims[axis] - 1;
    if (!grid->coordinates[axis])
        return round(distance / grid->spacing[axis]);
    while (low < high) { /* the first sample beyond which the middle of the gap lies */
        uint32_t middle = low + (high - low) / 2;
        double end =
            0.5 * (sp_grid_distance(grid, axis, middle) + sp_grid_distance(grid, axis, middle + 1));
        if (end < distance)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

/* Finds the sample of the range that is nearest to the point; false = none is near. */
static bool find_start(const struct search *part, uint32_t at[3]) {
    const struct sp_grid *grid = &part->info->grid;
    double det, best = INFINITY, index[3];
    struct sp_mat3 direction = sp_grid_directions(grid);
    struct sp_mat3 to_axes = sp_mat3_inverse(&direction, &det);
    struct sp_vec3 along =
        sp_mat3_apply(&to_axes, sp_vec3_sub(sp_vec3_from(part->point), sp_vec3_from(grid->origin)));
    for (unsigned a = 0; a < 3; a++)
        index[a] = nearest_index(grid, a, along.v[a]);
    enum { SIDE = 2 * NEAR + 1 };
    for (int i = 0; i < SIDE * SIDE * SIDE; i++) {
        const int move[3] = { i % SIDE - NEAR, i / SIDE % SIDE - NEAR, i / SIDE / SIDE - NEAR };
        uint32_t to[3];
        double distance = 0;
        for (int a = 0; a < 3; a++) {
            double x = index[a] + move[a];
            to[a] = x >= 0 && x < grid->dims[a] ? (uint32_t)x : UINT32_MAX;
            distance += move[a] * move[a] * grid->spacing[a] * grid->spacing[a];
        }
        if (to[0] == UINT32_MAX || to[1] == UINT32_MAX || to[2] == UINT32_MAX ||
            !sp_mask_has(part->all, to[0], to[1], to[2]) || distance >= best)
            continue;
        best = distance;
        for (int a = 0; a < 3; a++)
            at[a] = to[a];
    }
    return best < INFINITY;
}

bool sp_part_connect(const struct sp_volume_info *info, const void *voxels, const double point[3],
                     const double range[2], struct sp_pool *pool, struct sp_mask *all,
                     struct sp_mask *mine, bool *is_found, struct sp_error *err) {
    const uint32_t *dims = info->grid.dims;
    struct search search = { info, voxels, point, range, all };
    uint32_t at[3];
    *is_found = false;
    if (!sp_mask_init(all, dims, err) || !sp_mask_init(mine, dims, err))
        return false;
    sp_parallel_for(pool, (size_t)dims[1] * dims[2], 64, mark_range, &search);
    *is_found = find_start(&search, at);
    return !*is_found || sp_mask_connect(all, at, mine, err);
}
