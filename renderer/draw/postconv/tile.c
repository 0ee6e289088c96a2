/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/postconv/tile.h"

#include <math.h>

#include "splat/slices.h"

/* Returns the cells of columns c0 … c1 in rows r0 … r1. */
static uint32_t cells_between(int c0, int r0, int c1, int r1) {
    enum { ROW = POSTCONV_CELLS_ACROSS };
    uint32_t row = (UINT32_C(2) << c1) - (UINT32_C(1) << c0), cells = 0;
    for (int r = r0; r <= r1; r++)
        cells |= row << (r * ROW);
    return cells;
}

/* Finds the range of the tile's pixels that each slice of a brick may reach: its corners and the
 * reach of a voxel around them. Returns a bit per slice that reaches any. */
static uint32_t bound_slices(const struct sp_postconv_open_tile *t,
                             const struct sp_postconv_brick *b, int32_t (*reached)[2][SP_BRICK]) {
    const struct sp_ewa_frame *f = sp_postconv_ewa(t->postconv, b);
    unsigned axis = t->postconv->axis, first = axis == 0, second = axis == 2 ? 1 : 2;
    const float box[2][2] = { { (float)(b->x0 - t->x), (float)(b->x1 - t->x) },
                              { (float)(b->y0 - t->y), (float)(b->y1 - t->y) } };
    uint32_t met = 0;
    for (int v = 0; v < SP_BRICK; v += W) {
        sp_wide slice = sp_wide_from_int(sp_wide_int_count() + v), nearest = sp_wide_all(INFINITY);
        sp_wide low[2], high[2], u[3];
        low[0] = low[1] = nearest;
        high[0] = high[1] = -nearest;
        for (int corner = 0; corner < 4; corner++) {
            for (int a = 0; a < 3; a++)
                u[a] = b->base[a] + (corner & 1 ? (SP_BRICK - 1) * f->step[a][first] : 0) +
                       (corner & 2 ? (SP_BRICK - 1) * f->step[a][second] : 0) +
                       f->step[a][axis] * slice;
            nearest = sp_wide_min(nearest, u[2]);
            sp_wide inv = sp_wide_all(f->scale);
            if (f->projection == SP_PERSPECTIVE)
                inv = f->scale * sp_wide_fast_inverse(sp_wide_max(u[2], sp_wide_all(f->near)));
            for (int i = 0; i < 2; i++) {
                low[i] = sp_wide_min(low[i], u[i] * inv);
                high[i] = sp_wide_max(high[i], u[i] * inv);
            }
        }
        sp_wide_mask whole = sp_wide_le(sp_wide_all(f->near), nearest);
        sp_wide_mask meets = sp_wide_le(sp_wide_all(0), sp_wide_all(0));
        for (int i = 0; i < 2; i++) {
            float centre = f->centre[i] - (float)(i ? t->y : t->x);
            sp_wide from = sp_wide_max(low[i] + (centre - b->reach[i]), sp_wide_all(box[i][0]));
            sp_wide to = sp_wide_min(high[i] + (centre + b->reach[i]), sp_wide_all(box[i][1] - 1));
            from = sp_wide_select(whole, from, sp_wide_all(box[i][0]));
            to = sp_wide_select(whole, to, sp_wide_all(box[i][1] - 1));
            from = sp_wide_max(from, sp_wide_all(0));
            to = sp_wide_min(to, sp_wide_all(POSTCONV_TILE - 1));
            meets = meets & sp_wide_le(from, to);
            sp_wide_int_store(&reached[i][0][v], sp_wide_to_int(from));
            sp_wide_int_store(&reached[i][1][v], sp_wide_to_int(to));
        }
        met |= sp_wide_mask_bits(meets) << v;
    }
    return met;
}

/* Adds a brick's slices that the tile meets to the runs of their layers. */
static void add_runs(struct sp_postconv_open_tile *t, uint32_t number) {
    const struct sp_postconv *postconv = t->postconv;
    const struct sp_postconv_brick *b = &postconv->bricks[number];
    const struct sp_visible *list = &sp_postconv_level(postconv, b)->visible;
    const uint16_t *start = list->start[b->brick];
    _Alignas(64) int32_t reached[2][2][SP_BRICK];
    uint32_t corner[3];
    sp_visible_brick_corner(list->bricks, b->brick, corner);
    for (uint32_t met = bound_slices(t, b, reached); met; met &= met - 1) {
        int k = __builtin_ctz(met);
        if (start[k] == start[k + 1] || !(b->depth[k] > 0))
            continue;
        uint32_t layer = sp_slices_layer(postconv->layer, postconv->layers, b->level,
                                         corner[postconv->axis] + (uint32_t)k);
        t->scratch->runs[t->scratch->ends[layer]++] = (struct sp_postconv_run){
            .brick = number,
            .slice = (uint8_t)k,
            .begin = start[k],
            .end = start[k + 1],
            .range = { b->range[0], b->range[1] },
            .cells = cells_between(
                reached[0][0][k] / POSTCONV_CELL_WIDTH, reached[1][0][k] / POSTCONV_CELL_HEIGHT,
                reached[0][1][k] / POSTCONV_CELL_WIDTH, reached[1][1][k] / POSTCONV_CELL_HEIGHT)
        };
    }
}

/* Sorts the slices of the bricks that meet the tile by layer. */
static void sort_runs(struct sp_postconv_open_tile *t, uint32_t tile) {
    const struct sp_postconv *postconv = t->postconv;
    uint32_t *starts = t->scratch->starts, sum = 0;
    memset(starts, 0, (postconv->layers + (size_t)1) * sizeof *starts);
    for (uint32_t n = postconv->first[tile]; n < postconv->first[tile + 1]; n++) {
        const struct sp_postconv_brick *b = &postconv->bricks[postconv->met[n]];
        const struct sp_visible *list = &sp_postconv_level(postconv, b)->visible;
        const uint16_t *start = list->start[b->brick];
        uint32_t corner[3];
        sp_visible_brick_corner(list->bricks, b->brick, corner);
        for (int k = 0; k < SP_BRICK; k++)
            if (start[k] != start[k + 1] && b->depth[k] > 0)
                starts[sp_slices_layer(postconv->layer, postconv->layers, b->level,
                                       corner[postconv->axis] + (uint32_t)k)]++;
    }
    for (uint32_t l = 0; l <= postconv->layers; l++) {
        uint32_t count = starts[l];
        starts[l] = sum;
        sum += count;
    }
    memcpy(t->scratch->ends, starts, postconv->layers * sizeof *starts);
    for (uint32_t n = postconv->first[tile]; n < postconv->first[tile + 1]; n++)
        add_runs(t, postconv->met[n]);
}

/* Returns how much of a run the open group serves, as sp_postconv_group_fits(). */
static int fit_part(const struct sp_postconv_open_tile *t, const struct sp_postconv_run *run) {
    return t->is_open
               ? sp_postconv_group_fits(&t->group, &t->postconv->bricks[run->brick], run->range)
               : 0;
}

/* Drops the runs that meet only opaque cells, and moves the run with the farthest voxels to the
 * front. Returns how many are left. */
static uint32_t drop_opaque(const struct sp_postconv_open_tile *t, struct sp_postconv_run *runs,
                            uint32_t count) {
    uint32_t n = 0;
    for (uint32_t i = 0; i < count; i++) {
        if (!(runs[i].cells & t->alive))
            continue;
        runs[n] = runs[i];
        if (runs[n].range[0] < runs[0].range[0]) {
            struct sp_postconv_run first = runs[n];
            runs[n] = runs[0];
            runs[0] = first;
        }
        n++;
    }
    return n;
}

/* Adds those runs that no filter serves, and takes them from the list. */
static bool add_unfit(struct sp_postconv_open_tile *t, struct sp_postconv_run *runs,
                      uint32_t *count) {
    uint32_t left = 0, all = *count;
    for (uint32_t i = 0; i < all; i++) {
        if (t->postconv->bricks[runs[i].brick].is_unfit)
            sp_postconv_add_footprints(t, &runs[i]);
        else
            runs[left++] = runs[i];
    }
    *count = left;
    return left < all;
}

/* Prefetches the entries of a run, which are seldom in the cache. On coarse levels each has its own
 * class (classify/mip.h). */
static void prefetch_run(const struct sp_postconv_open_tile *t, const struct sp_postconv_run *run) {
    enum { LINE = 64 };
    const struct sp_postconv_brick *b = &t->postconv->bricks[run->brick];
    const struct sp_level *level = sp_postconv_level(t->postconv, b);
    const struct sp_visible *list = &level->visible;
    uint64_t first = list->first[b->brick] + run->begin;
    uint32_t count = run->end - run->begin;
    const char *keys = (const char *)list->key + first * list->key_bytes;
    for (uint32_t i = 0; i < count; i += LINE)
        __builtin_prefetch(list->place + first + i);
    for (uint32_t i = 0; i < count * list->key_bytes; i += LINE)
        __builtin_prefetch(keys + i);
    if (b->level == 0)
        return;
    const char *classes = (const char *)(level->transfer.table + first);
    for (size_t i = 0; i < count * sizeof *level->transfer.table; i += LINE)
        __builtin_prefetch(classes + i);
}

/* Composites the runs of a layer group by group, the farthest voxels first. Overwrites `runs`. */
static void draw_layer(struct sp_postconv_open_tile *t, struct sp_postconv_run *runs,
                       uint32_t count) {
    count = drop_opaque(t, runs, count);
    bool several = add_unfit(t, runs, &count);
    while (count) {
        uint32_t left = 0;
        t->is_open = sp_postconv_start_group(t, runs, count);
        /* A cancelled frame is never shown, and a layer may have thousands of runs. */
        for (uint32_t i = 0; i < count && !sp_interrupt_is_cancelled(&t->postconv->interrupt);
             i++) {
            if (i + 1 < count)
                prefetch_run(t, &runs[i + 1]);
            int part = fit_part(t, &runs[i]);
            if (i == 0 && part == 0) {
                /* compute_box() checks many distances, but not every one. */
                sp_postconv_add_footprints(t, &runs[i]);
                several = true;
                continue;
            }
            if (part)
                sp_postconv_add_run(t, &runs[i], part == 2);
            if (part == 2)
                continue;
            runs[left] = runs[i];
            if (part)
                runs[left].range[0] = t->group.range[1];
            left++;
        }
        several |= left > 0;
        sp_postconv_close_group(t, !several);
        t->is_open = false;
        count = drop_opaque(t, runs, left);
    }
    if (several)
        sp_postconv_close_sum(t);
    if (++t->closed % CHECK_EVERY == 0)
        sp_postconv_check_cells(t);
}

void sp_postconv_tile(const struct sp_postconv *postconv, struct sp_postconv_scratch *scratch,
                      uint32_t number) {
    const struct sp_frame *frame = postconv->frame;
    struct zoom zoom[2];
    zoom[0].filter = zoom[1].filter = NULL;
    struct sp_postconv_open_tile t = {
        .postconv = postconv,
        .zoom = { &zoom[0], &zoom[1] },
        .scratch = scratch,
        .x = (int)(number % (uint32_t)postconv->columns) * POSTCONV_TILE,
        .y = (int)(number / (uint32_t)postconv->columns) * POSTCONV_TILE,
        .row0 = POSTCONV_GRID
    };
    int right = (int)frame->width - t.x, below = (int)frame->height - t.y;
    t.width = right < POSTCONV_TILE ? right : POSTCONV_TILE;
    t.height = below < POSTCONV_TILE ? below : POSTCONV_TILE;
    memset(scratch->done, 0, sizeof scratch->done);
    if (postconv->places)
        memset(scratch->moment, 0, sizeof scratch->moment);
    scratch->origin = NAN;
    for (int y = 0; y < t.height; y++)
        for (int x = 0; x < POSTCONV_TILE; x++)
            if (x / W * W + sp_postconv_pixel_at(x % W) < t.width)
                scratch->done[3][y][x] = 1;
    t.alive = UINT32_MAX;
    memset(t.live, 0xff, sizeof t.live);
    sp_postconv_open_fragments(&t);
    sp_postconv_check_cells(&t);
    sort_runs(&t, number);
    for (uint32_t l = 0; l < postconv->layers && t.alive; l++) {
        uint32_t begin = scratch->starts[l], end = scratch->ends[l];
        if (begin == end)
            continue;
        if (sp_interrupt_is_cancelled(&postconv->interrupt))
            break;
        t.layer = (int)l;
        if (postconv->places)
            t.place = sp_postconv_place(scratch, postconv->places->at[l]);
        draw_layer(&t, scratch->runs + begin, end - begin);
    }
    sp_postconv_finish_fragments(&t);
    sp_postconv_resolve(&t);
}
