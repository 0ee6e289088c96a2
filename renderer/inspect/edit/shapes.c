/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>

#include "base/vec.h"
#include "data/volume/grid.h"
#include "inspect/edit/apply.h"

/* A cut: its shape, ready for samples. Distances are world units, above 0 on the side that stays.
 */
struct cut {
    struct sp_edited *edited;
    const struct sp_edit *edit;
    struct sp_vec3 normal;  /* plane: unit length */
    double offset;          /* plane */
    double low[3], high[3]; /* box: distances along the axes of the grid from sample 0 */
    struct sp_vec3 step[3]; /* from sample to sample (their mean) */
};

static void init_cut(struct cut *cut, struct sp_edited *edited, const struct sp_edit *edit) {
    const struct sp_grid *grid = &edited->info->grid;
    double largest =
        fmax(fabs(edit->normal[0]), fmax(fabs(edit->normal[1]), fabs(edit->normal[2])));
    *cut = (struct cut){ .edited = edited, .edit = edit };
    for (unsigned a = 0; a < 3; a++) {
        double extent[2];
        sp_grid_extent(grid, a, extent);
        cut->low[a] = extent[0] + edit->box[0][a] * (extent[1] - extent[0]);
        cut->high[a] = extent[0] + edit->box[1][a] * (extent[1] - extent[0]);
        for (int r = 0; r < 3; r++)
            cut->step[a].v[r] = grid->direction[r][a] * grid->spacing[a];
        cut->normal.v[a] = largest > 0 ? edit->normal[a] / largest : 0; /* of any length */
    }
    double length = sp_vec3_length(cut->normal);
    if (length > 0) {
        cut->normal = sp_vec3_scale(cut->normal, 1 / length);
        cut->offset = edit->offset / largest / length;
    }
}

/* Samples per world unit across a face with that normal: a cut fades over one sample. */
static double sharpness(const struct cut *cut, struct sp_vec3 normal) {
    double square = 0;
    for (int a = 0; a < 3; a++) {
        double rise = sp_vec3_dot(cut->step[a], normal);
        square += rise * rise;
    }
    return 1 / sqrt(square);
}

/* How far a sample lies inside the shape [samples]. */
static double depth_in(const struct cut *cut, const double along[3], struct sp_vec3 world) {
    const struct sp_edit *edit = cut->edit;
    double least = INFINITY;
    if (edit->type == SP_EDIT_PLANE)
        return (sp_vec3_dot(cut->normal, world) - cut->offset) * sharpness(cut, cut->normal);
    if (edit->type == SP_EDIT_SPHERE) {
        struct sp_vec3 away = sp_vec3_sub(world, sp_vec3_from(edit->center));
        double distance = sp_vec3_length(away);
        struct sp_vec3 normal =
            distance > 0 ? sp_vec3_scale(away, 1 / distance) : (struct sp_vec3){ { 1, 0, 0 } };
        return (edit->radius - distance) * sharpness(cut, normal);
    }
    for (int a = 0; a < 3; a++) {
        double spacing = cut->edited->info->grid.spacing[a];
        /* A face at the border of the volume does not cut. */
        if (edit->box[0][a] > 0)
            least = fmin(least, (along[a] - cut->low[a]) / spacing);
        if (edit->box[1][a] < 1)
            least = fmin(least, (cut->high[a] - along[a]) / spacing);
    }
    return least;
}

static void cut_rows(void *user, size_t begin, size_t end, unsigned worker) {
    const struct cut *cut = user;
    const struct sp_grid *grid = &cut->edited->info->grid;
    const struct sp_edit *edit = cut->edit;
    bool keeps_inside = edit->type == SP_EDIT_PLANE || edit->keep == SP_KEEP_INSIDE;
    uint64_t holes = 0;
    (void)worker;
    for (size_t row = begin; row < end; row++) {
        const uint32_t y = (uint32_t)(row % grid->dims[1]), z = (uint32_t)(row / grid->dims[1]);
        double along[3] = { 0, sp_grid_distance(grid, 1, y), sp_grid_distance(grid, 2, z) };
        for (uint32_t x = 0; x < grid->dims[0]; x++) {
            struct sp_vec3 world = sp_vec3_from(grid->origin);
            along[0] = sp_grid_distance(grid, 0, x);
            for (int r = 0; r < 3; r++)
                for (int a = 0; a < 3; a++)
                    world.v[r] += grid->direction[r][a] * along[a];
            double depth = depth_in(cut, along, world);
            double share = 0.5 + (keeps_inside ? depth : -depth);
            if (share < 1)
                holes += sp_edited_keep(cut->edited, row * grid->dims[0] + x, fmax(share, 0));
        }
    }
    atomic_fetch_add(&cut->edited->holes, holes);
}

void sp_edit_cut(struct sp_edited *edited, const struct sp_edit *edit) {
    const uint32_t *dims = edited->info->grid.dims;
    struct cut cut;
    init_cut(&cut, edited, edit);
    sp_parallel_for(edited->pool, (size_t)dims[1] * dims[2], 64, cut_rows, &cut);
}
