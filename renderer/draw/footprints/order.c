/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/footprints/order.h"

#include <string.h>

/* Returns the index of a brick along an axis. */
static uint32_t brick_along(const struct sp_visible *list, uint32_t brick, unsigned axis) {
    uint32_t corner[3];
    sp_visible_brick_corner(list->bricks, brick, corner);
    return corner[axis];
}

/* Sorts the runs of a brick by layer. If `runs` is NULL, counts them in first[layer]; otherwise
 * writes them from there and advances first[layer]. */
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
            sp_slices_layer(layers, levels[0].grid.dims[axis], brick->level, corner + s);
        if (runs)
            runs[first[layer]] =
                (struct sp_run){ brick->brick, start[s], (uint16_t)(start[s + 1] - start[s]),
                                 brick->level, brick->is_enlarged };
        first[layer]++;
    }
}

bool sp_order_sheets(const struct sp_camera_transform *camera, const struct sp_level *levels,
                     const struct sp_detail *detail, unsigned axis, struct sp_arena *arena,
                     struct sp_order *order) {
    uint32_t count = levels[0].grid.dims[axis];
    uint32_t *sheets = sp_arena_alloc(arena, "order of sheets", count, sizeof *sheets);
    uint32_t *layers = sp_arena_alloc(arena, "layers of sheets", count, sizeof *layers);
    *order = (struct sp_order){ .layers = count };
    order->first = sp_arena_alloc(arena, "layers", count + (size_t)1, sizeof *order->first);
    if (arena->failed)
        return false;
    sp_slices_sort(camera, &levels[0].grid, axis, sheets);
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
    /* The second pass moved first[k] to the end of layer k, which is the begin of the next layer.
     */
    memmove(order->first + 1, order->first, count * sizeof *order->first);
    order->first[0] = 0;
    return true;
}
