/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/splat_list/clip.h"

#include <math.h>

#include "base/vec.h"
#include "data/volume/grid.h"

bool sp_voxel_clips(const struct sp_clip *clip) {
    for (int a = 0; a < 3; a++)
        if (clip->box[0][a] > 0 || clip->box[1][a] < 1)
            return true;
    return clip->plane_count > 0;
}

bool sp_voxel_clip_equal(const struct sp_clip *a, const struct sp_clip *b) {
    if (a->plane_count != b->plane_count)
        return false;
    for (int i = 0; i < 3; i++)
        if (a->box[0][i] != b->box[0][i] || a->box[1][i] != b->box[1][i])
            return false;
    for (uint32_t p = 0; p < a->plane_count; p++) {
        const struct sp_clip_plane *q = &a->planes[p], *r = &b->planes[p];
        if (q->offset != r->offset || q->normal[0] != r->normal[0] ||
            q->normal[1] != r->normal[1] || q->normal[2] != r->normal[2])
            return false;
    }
    return true;
}

/* Number of samples of an axis whose distance is below `bound`, or at most `bound`. */
static uint32_t count_below(const struct sp_grid *grid, unsigned a, double bound, bool or_at) {
    uint32_t low = 0, high = grid->dims[a];
    while (low < high) {
        uint32_t middle = (low + high) / 2;
        double at = sp_grid_distance(grid, a, middle);
        if (at < bound || (or_at && at == bound))
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

/* The samples of an axis inside the clip box. */
static struct sp_voxel_interval clip_axis(const struct sp_clip *clip, const struct sp_grid *grid,
                                          unsigned a) {
    double extent[2];
    sp_grid_extent(grid, a, extent);
    double length = extent[1] - extent[0];
    struct sp_voxel_interval i = { 0, grid->dims[a] };
    if (clip->box[0][a] > 0)
        i.begin = count_below(grid, a, extent[0] + clip->box[0][a] * length, false);
    if (clip->box[1][a] < 1)
        i.end = count_below(grid, a, extent[0] + clip->box[1][a] * length, true);
    i.end = i.end < i.begin ? i.begin : i.end;
    return i;
}

/* A plane by distances along the axes: Σ along·distance ≥ least. */
struct plane {
    double along[3], least;
};

static struct plane convert_plane(const struct sp_clip_plane *from, const struct sp_grid *grid) {
    double largest =
        fmax(fabs(from->normal[0]), fmax(fabs(from->normal[1]), fabs(from->normal[2])));
    struct plane p = { .least = from->offset / largest };
    for (int r = 0; r < 3; r++) {
        double n = from->normal[r] / largest;
        p.least -= n * grid->origin[r];
        for (int a = 0; a < 3; a++)
            p.along[a] += n * grid->direction[r][a];
    }
    return p;
}

/* Cuts a row whose other distances add up to `sum`. */
static void cut_row(const struct plane *p, const struct sp_grid *grid, double sum,
                    struct sp_voxel_interval *row) {
    double bound = (p->least - sum) / p->along[0];
    uint32_t at;
    if (isfinite(bound) && p->along[0] > 0) {
        at = count_below(grid, 0, bound, false);
        row->begin = at > row->begin ? at : row->begin;
    } else if (isfinite(bound) && p->along[0] < 0) {
        at = count_below(grid, 0, bound, true);
        row->end = at < row->end ? at : row->end;
    } else if (!(sum >= p->least)) {
        row->end = row->begin;
    }
    row->end = row->end < row->begin ? row->begin : row->end;
}

void sp_voxel_clip_rows(const struct sp_clip *clip, const struct sp_grid *grid,
                        struct sp_voxel_interval *intervals) {
    struct sp_voxel_interval box[3];
    struct plane planes[SP_CLIP_PLANES_MAX];
    for (unsigned a = 0; a < 3; a++)
        box[a] = clip_axis(clip, grid, a);
    for (uint32_t i = 0; i < clip->plane_count; i++)
        planes[i] = convert_plane(&clip->planes[i], grid);
    for (uint32_t z = 0; z < grid->dims[2]; z++)
        for (uint32_t y = 0; y < grid->dims[1]; y++) {
            struct sp_voxel_interval *row = intervals + (uint64_t)z * grid->dims[1] + y;
            bool is_inside =
                z >= box[2].begin && z < box[2].end && y >= box[1].begin && y < box[1].end;
            *row = is_inside ? box[0] : (struct sp_voxel_interval){ 0, 0 };
            for (uint32_t i = 0; i < clip->plane_count && row->begin < row->end; i++)
                cut_row(&planes[i], grid,
                        planes[i].along[1] * sp_grid_distance(grid, 1, y) +
                            planes[i].along[2] * sp_grid_distance(grid, 2, z),
                        row);
        }
}
