/* SPDX-License-Identifier: Apache-2.0 */
#include "tile/order.h"

#include "volume/grid.h"

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

/* The eye's distance along the axis from sample 0; infinitely far for parallel rays. */
static double eye_distance(const struct sp_camera_frame *camera, const struct sp_grid *grid,
                           unsigned axis) {
    struct sp_mat3 d = directions(grid);
    struct sp_vec3 n = slice_normal(&d, axis);
    if (camera->projection == SP_ORTHOGRAPHIC)
        return sp_vec3_dot(n, forward(camera)) > 0 ? -INFINITY : INFINITY;
    struct sp_vec3 away = sp_vec3_sub(camera->eye, sp_vec3_from(grid->origin));
    struct sp_vec3 along = { { d.m[0][axis], d.m[1][axis], d.m[2][axis] } };
    return sp_vec3_dot(n, away) / sp_vec3_dot(n, along);
}

void sp_order_slices(const struct sp_camera_frame *camera, const struct sp_grid *grid,
                     unsigned axis, uint32_t *slices) {
    double eye = eye_distance(camera, grid, axis);
    /* `above` counts up from the first slice at or beyond the eye, `below` down from the other. */
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

/* Slices of bricks that are not empty. */
static uint64_t count_runs(const struct sp_visible *visible) {
    uint32_t bricks = sp_visible_bricks(visible);
    uint64_t n = 0;
    for (uint32_t b = 0; b < bricks; b++)
        for (int s = 0; visible->first[b] < visible->first[b + 1] && s < SP_BRICK; s++)
            n += visible->start[b][s] < visible->start[b][s + 1];
    return n;
}

/* Lists what the bricks have of one slice; returns how many runs. */
static uint64_t list_runs(const struct sp_visible *visible, unsigned axis, uint32_t slice,
                          struct sp_run *runs) {
    uint32_t begin[3] = { 0, 0, 0 }, end[3], s = slice % SP_BRICK;
    for (int a = 0; a < 3; a++)
        end[a] = visible->bricks[a];
    begin[axis] = slice >> SP_BRICK_SHIFT;
    end[axis] = begin[axis] + 1;
    uint64_t n = 0;
    for (uint32_t b2 = begin[2]; b2 < end[2]; b2++)
        for (uint32_t b1 = begin[1]; b1 < end[1]; b1++)
            for (uint32_t b0 = begin[0]; b0 < end[0]; b0++) {
                uint32_t b = b0 + visible->bricks[0] * (b1 + visible->bricks[1] * b2);
                const uint16_t *start = &visible->start[b][s];
                if (visible->first[b] < visible->first[b + 1] && start[0] < start[1])
                    runs[n++] = (struct sp_run){ b, start[0], (uint16_t)(start[1] - start[0]) };
            }
    return n;
}

bool sp_order_sheets(const struct sp_camera_frame *camera, const struct sp_level *level,
                     unsigned axis, struct sp_arena *arena, struct sp_order *order) {
    uint32_t layers = level->grid.dims[axis];
    uint32_t *sheets = sp_arena_alloc(arena, "order of sheets", layers, sizeof *sheets);
    *order = (struct sp_order){ .layers = layers };
    order->first = sp_arena_alloc(arena, "layers", layers + (size_t)1, sizeof *order->first);
    order->runs = sp_arena_alloc(arena, "runs", count_runs(&level->visible), sizeof *order->runs);
    if (arena->failed)
        return false;
    sp_order_slices(camera, &level->grid, axis, sheets);
    uint64_t n = 0;
    for (uint32_t k = 0; k < layers; k++) {
        order->first[k] = n;
        n += list_runs(&level->visible, axis, sheets[k], order->runs + n);
    }
    order->first[layers] = n;
    return true;
}
