/* SPDX-License-Identifier: Apache-2.0 */
#include "tile/order.h"

static struct sp_mat3 directions(const struct sp_grid *grid) {
    struct sp_mat3 m;
    for (int r = 0; r < 3; r++)
        for (int a = 0; a < 3; a++)
            m.m[r][a] = grid->direction[r][a];
    return m;
}

/* Unit normal of the slices along `axis`, on the side of rising index. */
static struct sp_vec3 slice_normal(const struct sp_mat3 *d, unsigned axis) {
    struct sp_vec3 column[3];
    for (int a = 0; a < 3; a++)
        column[a] = (struct sp_vec3){ { d->m[0][a], d->m[1][a], d->m[2][a] } };
    struct sp_vec3 n =
        sp_vec3_normalize(sp_vec3_cross(column[(axis + 1) % 3], column[(axis + 2) % 3]));
    return sp_vec3_dot(n, column[axis]) < 0 ? sp_vec3_scale(n, -1) : n;
}

static struct sp_vec3 forward(const struct sp_camera_frame *camera) {
    return sp_vec3_from(camera->w.m[2]);
}

unsigned sp_order_axis(const struct sp_camera_frame *camera, const struct sp_grid *grid) {
    struct sp_mat3 d = directions(grid);
    double best = -1;
    unsigned axis = 2;
    for (int a = 2; a >= 0; a--) {
        double facing = fabs(sp_vec3_dot(slice_normal(&d, (unsigned)a), forward(camera)));
        if (facing > best) {
            best = facing;
            axis = (unsigned)a;
        }
    }
    return axis;
}

/* The eye's index along the axis, not rounded; infinitely far for parallel rays. */
static double eye_index(const struct sp_camera_frame *camera, const struct sp_grid *grid,
                        unsigned axis) {
    struct sp_mat3 d = directions(grid);
    struct sp_vec3 n = slice_normal(&d, axis);
    if (camera->projection == SP_ORTHOGRAPHIC)
        return sp_vec3_dot(n, forward(camera)) > 0 ? -INFINITY : INFINITY;
    struct sp_vec3 away = sp_vec3_sub(camera->eye, sp_vec3_from(grid->origin));
    struct sp_vec3 along = { { d.m[0][axis], d.m[1][axis], d.m[2][axis] } };
    return sp_vec3_dot(n, away) / (sp_vec3_dot(n, along) * grid->spacing[axis]);
}

void sp_order_slices(const struct sp_camera_frame *camera, const struct sp_grid *grid,
                     unsigned axis, uint32_t *slices) {
    double eye = eye_index(camera, grid, axis);
    int64_t count = grid->dims[axis], n = 0;
    /* `above` counts up from the first slice at or beyond the eye, `below` down from the other. */
    int64_t above = eye > 0 ? (eye < (double)count ? (int64_t)ceil(eye) : count) : 0;
    int64_t below = above - 1;
    while (n < count) {
        int up = below < 0 || (above < count && (double)above - eye <= eye - (double)below);
        slices[n++] = (uint32_t)(up ? above++ : below--);
    }
}
