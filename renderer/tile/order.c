/* SPDX-License-Identifier: Apache-2.0 */
#include "tile/order.h"

#include <string.h>

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

/* Index of a brick along an axis. */
static uint32_t brick_along(const struct sp_visible *list, uint32_t brick, unsigned axis) {
    uint32_t corner[3];
    sp_visible_corner(list, brick, corner);
    return corner[axis];
}

/* The runs of a brick by layer. runs NULL: counts them in first[layer]; else puts them there and
 * counts on. */
static void add_brick(const struct sp_level *levels, const struct sp_detail_brick *brick,
                      unsigned axis, const uint32_t *layers, uint64_t *first, struct sp_run *runs) {
    const struct sp_visible *list = &levels[brick->level].visible;
    const uint16_t *start = list->start[brick->brick];
    if (list->first[brick->brick] == list->first[brick->brick + 1])
        return;
    uint32_t corner = brick_along(list, brick->brick, axis);
    for (uint32_t s = 0; s < SP_BRICK; s++) {
        if (start[s] == start[s + 1])
            continue;
        uint32_t layer =
            sp_order_layer(layers, levels[0].grid.dims[axis], brick->level, corner + s);
        if (runs)
            runs[first[layer]] =
                (struct sp_run){ brick->brick, start[s], (uint16_t)(start[s + 1] - start[s]),
                                 brick->level, brick->is_enlarged };
        first[layer]++;
    }
}

bool sp_order_sheets(const struct sp_camera_frame *camera, const struct sp_level *levels,
                     const struct sp_detail *detail, unsigned axis, struct sp_arena *arena,
                     struct sp_order *order) {
    uint32_t count = levels[0].grid.dims[axis];
    uint32_t *sheets = sp_arena_alloc(arena, "order of sheets", count, sizeof *sheets);
    uint32_t *layers = sp_arena_alloc(arena, "layers of sheets", count, sizeof *layers);
    *order = (struct sp_order){ .layers = count };
    order->first = sp_arena_alloc(arena, "layers", count + (size_t)1, sizeof *order->first);
    if (arena->failed)
        return false;
    sp_order_slices(camera, &levels[0].grid, axis, sheets);
    for (uint32_t k = 0; k < count; k++)
        layers[sheets[k]] = k;
    memset(order->first, 0, (count + (size_t)1) * sizeof *order->first);
    for (uint32_t i = 0; i < detail->count; i++)
        add_brick(levels, &detail->bricks[i], axis, layers, order->first, NULL);
    uint64_t sum = 0;
    for (uint32_t k = 0; k <= count; k++) {
        uint64_t runs = order->first[k];
        order->first[k] = sum;
        sum += runs;
    }
    order->runs = sp_arena_alloc(arena, "runs", sum, sizeof *order->runs);
    if (arena->failed)
        return false;
    for (uint32_t i = 0; i < detail->count; i++)
        add_brick(levels, &detail->bricks[i], axis, layers, order->first, order->runs);
    /* Now first[k] is the end of layer k, which is the begin of the next. */
    memmove(order->first + 1, order->first, count * sizeof *order->first);
    order->first[0] = 0;
    return true;
}
