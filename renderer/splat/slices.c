/* SPDX-License-Identifier: Apache-2.0 */
#include "splat/slices.h"

#include <math.h>

#include "data/volume/grid.h"

/* Returns the unit normal of the slices along `axis`, towards rising index. */
static struct sp_vec3 slice_normal(const struct sp_mat3 *d, unsigned axis) {
    struct sp_vec3 column[3];
    for (int a = 0; a < 3; a++)
        column[a] = (struct sp_vec3){ { d->m[0][a], d->m[1][a], d->m[2][a] } };
    struct sp_vec3 n =
        sp_vec3_normalize(sp_vec3_cross(column[(axis + 1) % 3], column[(axis + 2) % 3]));
    return sp_vec3_dot(n, column[axis]) < 0 ? sp_vec3_scale(n, -1) : n;
}

static struct sp_vec3 forward(const struct sp_camera_transform *camera) {
    return sp_vec3_from(camera->w.m[2]);
}

unsigned sp_slices_major_axis(const struct sp_camera_transform *camera,
                              const struct sp_grid *grid) {
    struct sp_mat3 d = sp_grid_directions(grid);
    double best = -1;
    unsigned axis = 2;
    for (unsigned a = 3; a-- > 0;) {
        double facing = fabs(sp_vec3_dot(slice_normal(&d, a), forward(camera)));
        if (facing > best) {
            best = facing;
            axis = a;
        }
    }
    return axis;
}

/* Returns the eye's distance along the axis from sample 0; infinite for parallel rays. */
static double eye_distance(const struct sp_camera_transform *camera, const struct sp_grid *grid,
                           unsigned axis) {
    struct sp_mat3 d = sp_grid_directions(grid);
    struct sp_vec3 n = slice_normal(&d, axis);
    if (camera->projection == SP_ORTHOGRAPHIC)
        return sp_vec3_dot(n, forward(camera)) > 0 ? -INFINITY : INFINITY;
    struct sp_vec3 away = sp_vec3_sub(camera->eye, sp_vec3_from(grid->origin));
    struct sp_vec3 along = { { d.m[0][axis], d.m[1][axis], d.m[2][axis] } };
    return sp_vec3_dot(n, away) / sp_vec3_dot(n, along);
}

void sp_slices_sort(const struct sp_camera_transform *camera, const struct sp_grid *grid,
                    unsigned axis, uint32_t *slices) {
    double eye = eye_distance(camera, grid, axis);
    /* `above` counts up from the first slice at or beyond the eye, `below` counts down from the
     * slice before it. */
    uint32_t count = grid->dims[axis], above = 0, below;
    while (above < count && sp_grid_distance(grid, axis, above) < eye)
        above++;
    below = above;
    for (uint32_t n = 0; n < count; n++) {
        bool up =
            below == 0 || (above < count && sp_grid_distance(grid, axis, above) - eye <=
                                                eye - sp_grid_distance(grid, axis, below - 1));
        slices[n] = up ? above++ : --below;
    }
}
