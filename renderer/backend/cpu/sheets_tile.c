/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/cpu/sheets_tile.h"
#include "tile/order.h"

static uint32_t cells_of(const struct sheets_open_tile *t, const struct sheets_brick *b) {
    int x0 = b->x0 - t->x, y0 = b->y0 - t->y, x1 = b->x1 - 1 - t->x, y1 = b->y1 - 1 - t->y;
    x0 = x0 < 0 ? 0 : x0 / SHEETS_CELL_WIDTH;
    y0 = y0 < 0 ? 0 : y0 / SHEETS_CELL_HEIGHT;
    x1 = x1 >= SHEETS_TILE ? SHEETS_CELLS_ACROSS - 1 : x1 / SHEETS_CELL_WIDTH;
    y1 = y1 >= SHEETS_TILE ? SHEETS_TILE / SHEETS_CELL_HEIGHT - 1 : y1 / SHEETS_CELL_HEIGHT;
    uint32_t row = (UINT32_C(2) << x1) - (UINT32_C(1) << x0), cells = 0;
    for (int y = y0; y <= y1; y++)
        cells |= row << (y * SHEETS_CELLS_ACROSS);
    return cells;
}

/* Sorts the slices of the bricks that meet the tile by layer. */
static void sort_runs(struct sheets_open_tile *t, uint32_t tile) {
    const struct sheets *s = t->sheets;
    uint32_t *starts = t->s->starts;
    memset(starts, 0, (s->layers + (size_t)1) * sizeof *starts);
    for (int pass = 0; pass < 2; pass++) {
        for (uint32_t n = s->first[tile]; n < s->first[tile + 1]; n++) {
            const struct sheets_brick *b = &s->bricks[s->met[n]];
            const struct sp_level *level = sheets_level(s, b);
            const uint16_t *start = level->visible.start[b->brick];
            uint32_t corner[3];
            sp_visible_corner(&level->visible, b->brick, corner);
            uint32_t cells = pass ? cells_of(t, b) : 0;
            for (int k = 0; k < SP_BRICK; k++) {
                if (start[k] == start[k + 1] || !(b->depth[k] > 0))
                    continue;
                uint32_t layer =
                    sp_order_layer(s->layer, s->layers, b->level, corner[s->axis] + (uint32_t)k);
                if (pass)
                    t->s->runs[starts[layer]++] =
                        (struct sheets_run){ .brick = s->met[n],
                                             .slice = (uint8_t)k,
                                             .begin = start[k],
                                             .end = start[k + 1],
                                             .depth = b->depth[k],
                                             .range = { b->range[0], b->range[1] },
                                             .cells = cells };
                else
                    starts[layer]++;
            }
        }
        uint32_t sum = 0;
        for (uint32_t l = 0; !pass && l <= s->layers; l++) {
            uint32_t count = starts[l];
            starts[l] = sum;
            sum += count;
        }
    }
    memmove(starts + 1, starts, s->layers * sizeof *starts);
    starts[0] = 0;
}

/* Most that any pixel can get of the depth of a layer's runs. */
static float bound_depth(const struct sheets_open_tile *t, const struct sheets_run *runs,
                         uint32_t count) {
    float most = 0;
    for (uint32_t i = 0; i < count; i++)
        most = runs[i].cells & t->alive && runs[i].depth > most ? runs[i].depth : most;
    return most;
}

/* Composites what is pending. */
static void flush(struct sheets_open_tile *t) {
    if (!t->is_open)
        return;
    sheets_close_group(t, true);
    t->is_open = false;
    t->pending = 0;
}

/* How much of a run the open group serves: sheets_group_fits(). */
static int fit_part(const struct sheets_open_tile *t, const struct sheets_run *run) {
    return t->is_open ? sheets_group_fits(&t->group, &t->sheets->bricks[run->brick], run->range)
                      : 0;
}

/* Drops the runs that only meet opaque cells, and says whether what is pending has a filter for all
 * the others. The one with the farthest voxels comes first. */
static bool sift(struct sheets_open_tile *t, struct sheets_run *runs, uint32_t *count) {
    uint32_t n = 0;
    bool fits = true;
    for (uint32_t i = 0; i < *count; i++) {
        if (!(runs[i].cells & t->alive))
            continue;
        fits = fits && !t->sheets->bricks[runs[i].brick].is_unfit && fit_part(t, &runs[i]) == 2;
        runs[n] = runs[i];
        if (runs[n].range[0] < runs[0].range[0]) {
            struct sheets_run first = runs[n];
            runs[n] = runs[0];
            runs[0] = first;
        }
        n++;
    }
    *count = n;
    return fits;
}

/* Adds those runs that no filter serves, and takes them from the list. */
static bool add_unfit(struct sheets_open_tile *t, struct sheets_run *runs, uint32_t *count) {
    uint32_t left = 0, all = *count;
    for (uint32_t i = 0; i < all; i++) {
        if (t->sheets->bricks[runs[i].brick].is_unfit)
            sheets_add_footprints(t, &runs[i]);
        else
            runs[left++] = runs[i];
    }
    *count = left;
    return left < all;
}

/* Adds the runs of a layer, group by group, the farthest voxels first; `runs` is used up. Thin
 * layers are composited together: see sheets.thin. */
static void draw_layer(struct sheets_open_tile *t, struct sheets_run *runs, uint32_t count) {
    float depth = bound_depth(t, runs, count);
    bool fits = sift(t, runs, &count);
    if (!fits || !(t->sheets->thin > 0 && t->pending + depth <= t->sheets->thin))
        flush(t);
    bool several = add_unfit(t, runs, &count);
    while (count) {
        uint32_t left = 0;
        t->is_open = t->is_open || sheets_start_group(t, runs, count);
        for (uint32_t i = 0; i < count; i++) {
            int part = fit_part(t, &runs[i]);
            if (i == 0 && part == 0) {
                /* find_box() looked closely, but not at every distance. */
                sheets_add_footprints(t, &runs[i]);
                several = true;
                continue;
            }
            if (part)
                sheets_add_run(t, &runs[i], part == 2);
            if (part == 2)
                continue;
            runs[left] = runs[i];
            if (part)
                runs[left].range[0] = t->group.range[1];
            left++;
        }
        several |= left > 0;
        if (several) {
            sheets_close_group(t, false);
            t->is_open = false;
        }
        sift(t, runs, &left);
        count = left;
    }
    if (several) {
        sheets_close_sum(t);
        t->is_open = false;
        t->pending = 0;
    } else {
        t->pending += depth;
    }
    if (++t->closed % CHECK_EVERY == 0)
        sheets_check_cells(t);
}

void sheets_tile(const struct sheets *sheets, struct sheets_scratch *scratch, uint32_t number) {
    const struct sp_frame *frame = sheets->job->frame;
    struct zoom zoom[2];
    zoom[0].filter = zoom[1].filter = NULL;
    struct sheets_open_tile t = { .sheets = sheets,
                                  .zoom = { &zoom[0], &zoom[1] },
                                  .s = scratch,
                                  .x = (int)(number % (uint32_t)sheets->columns) * SHEETS_TILE,
                                  .y = (int)(number / (uint32_t)sheets->columns) * SHEETS_TILE,
                                  .row0 = SHEETS_GRID };
    int right = (int)frame->width - t.x, below = (int)frame->height - t.y;
    t.width = right < SHEETS_TILE ? right : SHEETS_TILE;
    t.height = below < SHEETS_TILE ? below : SHEETS_TILE;
    memset(scratch->done, 0, sizeof scratch->done);
    for (int y = 0; y < t.height; y++)
        for (int x = 0; x < SHEETS_TILE; x++)
            if (x / W * W + sheets_pixel_at(x % W) < t.width)
                scratch->done[3][y][x] = 1;
    t.alive = UINT32_MAX;
    sheets_check_cells(&t);
    sort_runs(&t, number);
    for (uint32_t l = 0; l < sheets->layers && t.alive; l++) {
        uint32_t begin = scratch->starts[l], end = scratch->starts[l + 1];
        if (begin == end)
            continue;
        if (sp_job_is_cancelled(sheets->job))
            break;
        draw_layer(&t, scratch->runs + begin, end - begin);
    }
    flush(&t);
    sheets_resolve(&t);
}
