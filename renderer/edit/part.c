/* SPDX-License-Identifier: Apache-2.0
 *
 * A connected part: the samples in a range of values that a path through faces of samples in that
 * range connects with a point. With it go the samples beside it that are not in the range: they
 * hold the fading border of the part.
 */
#include <math.h>

#include "base/vec.h"
#include "edit/apply.h"
#include "edit/mask.h"
#include "volume/grid.h"
#include "volume/sample.h"

/* Samples beside a part that go with it: one goes away with a part that is removed, two stay with a
 * part that is kept. */
enum { GONE = 1, KEPT = 2 };
enum { NEAR = 2 }; /* samples from the point within which the part may begin */

struct part {
    const struct sp_edited *edited;
    const struct sp_edit *edit;
    struct sp_mask all;  /* samples in the range */
    struct sp_mask mine; /* of these, the part; then with the samples beside it */
    struct sp_mask before;
};

static void find_range(void *user, size_t begin, size_t end, unsigned worker) {
    const struct part *part = user;
    const struct sp_volume_info *info = part->edited->info;
    const uint32_t *dims = info->grid.dims;
    const double *range = part->edit->range;
    (void)worker;
    for (size_t row = begin; row < end; row++) {
        uint64_t *bits =
            sp_mask_row(&part->all, (uint32_t)(row % dims[1]), (uint32_t)(row / dims[1]));
        for (uint32_t x = 0; x < dims[0]; x++) {
            double value = sp_sample(part->edited->voxels, info->type, row * dims[0] + x);
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
static bool find_start(const struct part *part, uint32_t at[3]) {
    const struct sp_grid *grid = &part->edited->info->grid;
    struct sp_mat3 direction;
    double det, best = INFINITY, index[3];
    for (int r = 0; r < 3; r++)
        for (int a = 0; a < 3; a++)
            direction.m[r][a] = grid->direction[r][a];
    struct sp_mat3 to_axes = sp_mat3_inverse(&direction, &det);
    struct sp_vec3 along = sp_mat3_apply(
        &to_axes, sp_vec3_sub(sp_vec3_from(part->edit->point), sp_vec3_from(grid->origin)));
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
            !sp_mask_has(&part->all, to[0], to[1], to[2]) || distance >= best)
            continue;
        best = distance;
        for (int a = 0; a < 3; a++)
            at[a] = to[a];
    }
    return best < INFINITY;
}

/* Adds the samples beside the part that are not in the range. */
static void widen(struct part *part) {
    const uint32_t *dims = part->all.dims;
    int count = part->edit->keep == SP_KEEP_INSIDE ? KEPT : GONE;
    for (int i = 0; i < count; i++) {
        sp_mask_grow(&part->mine, &part->before, part->edited->pool);
        for (uint64_t w = 0; w < (uint64_t)dims[2] * dims[1] * part->all.words; w++)
            part->mine.bits[w] = part->before.bits[w] | (part->mine.bits[w] & ~part->all.bits[w]);
    }
}

static void remove_rows(void *user, size_t begin, size_t end, unsigned worker) {
    const struct part *part = user;
    const uint32_t *dims = part->all.dims;
    (void)worker;
    for (size_t row = begin; row < end; row++) {
        const uint64_t *bits =
            sp_mask_row(&part->mine, (uint32_t)(row % dims[1]), (uint32_t)(row / dims[1]));
        for (uint32_t x = 0; x < dims[0]; x++)
            if ((bits[x / 64] >> x % 64 & 1) != (part->edit->keep == SP_KEEP_INSIDE))
                sp_edited_keep(part->edited, row * dims[0] + x, 0);
    }
}

bool sp_edit_part(const struct sp_edited *edited, const struct sp_edit *edit,
                  struct sp_error *err) {
    const uint32_t *dims = edited->info->grid.dims;
    struct part part = { .edited = edited, .edit = edit };
    uint32_t at[3];
    bool ok = sp_mask_init(&part.all, dims, err) && sp_mask_init(&part.mine, dims, err) &&
              sp_mask_init(&part.before, dims, err);
    if (ok)
        sp_parallel_for(edited->pool, (size_t)dims[1] * dims[2], 64, find_range, &part);
    if (ok && find_start(&part, at)) {
        ok = sp_mask_connect(&part.all, at, &part.mine, err);
        if (ok) {
            widen(&part);
            sp_parallel_for(edited->pool, (size_t)dims[1] * dims[2], 64, remove_rows, &part);
        }
    }
    sp_mask_finish(&part.all);
    sp_mask_finish(&part.mine);
    sp_mask_finish(&part.before);
    return ok;
}
