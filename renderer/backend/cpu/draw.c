/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/cpu/draw.h"

#include <string.h>

#include "base/clock.h"
#include "tile/bin.h"
#include "tile/order.h"

enum {
    BLOCK = 2048,      /* voxels set up at a time */
    BATCH_BLOCKS = 64, /* blocks a batch: 131,072 records of 64 bytes */
    BAND_TILES = 2304, /* tiles a band, 36 KiB each: one band up to 1920 × 1080 */
    ENTRIES_MIN = 1 << 20,
    POLL_EVERY = 64, /* splats of a tile between two looks at the cancel flag */
};

_Static_assert((int)SP_COARSE_MAX < (int)SP_LEVELS, "a level for each value of coarse");

enum stage { CLASSIFY, SPLAT, BIN, TILE, RESOLVE, STAGES };

struct block {
    uint32_t count;   /* records written */
    double fragments; /* px of their footprints inside the picture */
};

/* Where a block begins in the order. */
struct cut {
    uint64_t run;
    uint32_t layer, skip; /* entries of the run that belong to the block before */
};

struct draw {
    const struct sp_backend_job *job;
    const struct cpu_kernels *kernels;
    struct sp_pool *pool;
    double stage_ms[STAGES];
    uint64_t splats;
    double fragments;

    struct sp_camera_frame camera;
    struct sp_ewa_frame ewa;
    struct sp_shade shade;
    const struct sp_shade *shading; /* &shade, or NULL */
    const struct sp_level *level;
    const struct sp_visible *list;

    struct sp_order order;
    struct cut *cuts;           /* a block of the whole order */
    enum sp_filter_mode filter; /* of all bricks, or ADAPTIVE: look in `filters` */
    uint8_t *filters;           /* enum sp_filter_mode a brick */

    struct sp_tile_grid grid;
    struct sp_splat *records; /* block b writes from b·BLOCK */
    struct block *blocks;
    struct sp_bins bins;
    uint64_t batch; /* the batch's first block */
};

static bool is_cancelled(const struct draw *d) {
    return sp_job_is_cancelled(d->job);
}

static double add_time(struct draw *d, enum stage stage, double since) {
    double now = sp_clock_ms();
    d->stage_ms[stage] += now - since;
    return now;
}

static struct sp_ewa_run make_run(const struct draw *d, const struct sp_run *run, uint32_t layer) {
    struct sp_ewa_run ewa = { .list = d->list,
                              .transfer = &d->level->transfer,
                              .shade = d->shading,
                              .first = d->list->first[run->brick],
                              .begin = run->begin,
                              .count = run->count,
                              .sheet = layer };
    sp_visible_corner(d->list, run->brick, ewa.brick);
    ewa.order = d->order.order ? d->order.order + ewa.first : NULL;
    ewa.mode =
        d->filter == SP_FILTER_ADAPTIVE ? (enum sp_filter_mode)d->filters[run->brick] : d->filter;
    return ewa;
}

/* Entries that are not in the order of the list come from all over the brick: asks for those of a
 * run while the one before it is set up. */
static void prefetch_run(const struct draw *d, const struct sp_run *run) {
    uint64_t first = d->list->first[run->brick];
    const uint16_t *order = d->order.order + first;
    for (uint32_t p = run->begin; p < (uint32_t)run->begin + run->count; p++) {
        __builtin_prefetch(&d->list->local[first + (d->order.order ? order[p] : p)]);
        __builtin_prefetch(&d->list->key[first + (d->order.order ? order[p] : p)]);
    }
}

/* Keeps those of n records behind the block's that some tile still wants. */
static void keep_wanted(const struct draw *d, struct sp_splat *records, uint32_t n,
                        struct block *block) {
    for (uint32_t i = 0, from = block->count; i < n; i++) {
        const struct sp_splat *s = &records[from + i];
        if (sp_bins_is_hidden(&d->grid, s))
            continue;
        float box = (float)(s->x1 - s->x0) * (float)(s->y1 - s->y0);
        block->fragments += (double)(box < s->area ? box : s->area);
        records[block->count++] = *s;
    }
}

/* Sets up the voxels of one block. */
static void set_up_block(const struct draw *d, const struct cut *cut, struct sp_splat *records,
                         struct block *block) {
    uint64_t runs = d->order.first[d->order.layers];
    uint32_t layer = cut->layer, left = BLOCK, skip = cut->skip;
    *block = (struct block){ 0 };
    for (uint64_t r = cut->run; r < runs && left > 0; r++, skip = 0) {
        while (r >= d->order.first[layer + 1])
            layer++;
        struct sp_ewa_run run = make_run(d, &d->order.runs[r], layer);
        run.begin += skip;
        run.count -= skip;
        run.count = run.count < left ? run.count : left;
        left -= run.count;
        if (left > 0 && r + 1 < runs)
            prefetch_run(d, &d->order.runs[r + 1]);
        keep_wanted(d, records, d->kernels->set_up(&d->ewa, &run, records + block->count), block);
    }
}

static void splat_blocks(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    struct draw *d = user;
    for (size_t b = begin; b < end; b++) {
        if (is_cancelled(d))
            d->blocks[b] = (struct block){ 0 };
        else
            set_up_block(d, &d->cuts[d->batch + b], d->records + b * BLOCK, &d->blocks[b]);
    }
}

static void count_blocks(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    struct draw *d = user;
    for (size_t b = begin; b < end; b++)
        sp_bins_count(&d->bins, (uint32_t)b, &d->grid, d->records + b * BLOCK, d->blocks[b].count);
}

struct fill {
    struct draw *draw;
    uint32_t first; /* block */
};

static void fill_blocks(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    const struct fill *fill = user;
    struct draw *d = fill->draw;
    for (size_t i = begin; i < end; i++) {
        uint32_t b = fill->first + (uint32_t)i;
        sp_bins_fill(&d->bins, b, &d->grid, d->records + (size_t)b * BLOCK, d->blocks[b].count,
                     b * BLOCK);
    }
}

static void add_tiles(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    struct draw *d = user;
    for (size_t t = begin; t < end; t++) {
        struct sp_tile *tile = &d->grid.tiles[t];
        uint32_t stop = d->bins.first[t + 1];
        for (uint32_t e = d->bins.first[t]; e < stop && !tile->saturated; e++) {
            if (e % POLL_EVERY == 0 && is_cancelled(d))
                return;
            const struct sp_splat *s = &d->records[d->bins.entries[e]];
            if (tile->sheet != SP_NO_SHEET && tile->sheet != s->sheet)
                d->kernels->sheet_close(tile);
            if (!tile->saturated)
                d->kernels->sheet_add(tile, s, d->ewa.cut);
        }
    }
}

/* Bins and adds the batch's blocks [0, count), as many at a time as the entries have room for: a
 * footprint may cover every tile. */
static void add_batch(struct draw *d, uint32_t count) {
    double clock = sp_clock_ms();
    sp_parallel_for(d->pool, count, 1, count_blocks, d);
    for (uint32_t begin = 0, end; begin < count && !is_cancelled(d); begin = end) {
        uint64_t total = 0;
        for (end = begin; end < count; end++) {
            total += sp_bins_block_total(&d->bins, end);
            if (end > begin && total > d->bins.capacity)
                break;
        }
        sp_bins_start(&d->bins, begin, end);
        struct fill fill = { .draw = d, .first = begin };
        sp_parallel_for(d->pool, end - begin, 1, fill_blocks, &fill);
        clock = add_time(d, BIN, clock);
        sp_parallel_for(d->pool, d->bins.tiles, 1, add_tiles, d);
        clock = add_time(d, TILE, clock);
    }
}

static void resolve_tiles(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    struct draw *d = user;
    struct sp_frame *frame = d->job->frame;
    const float *background = d->job->view->background;
    for (size_t t = begin; t < end; t++) {
        struct sp_tile *tile = &d->grid.tiles[t];
        d->kernels->sheet_close(tile);
        int left = (int)frame->width - tile->x, below = (int)frame->height - tile->y;
        uint32_t n = (uint32_t)(left < SP_TILE ? left : SP_TILE);
        for (int row = 0; row < SP_TILE && row < below; row++) {
            const float *const planes[4] = { tile->done[0][row], tile->done[1][row],
                                             tile->done[2][row], tile->done[3][row] };
            unsigned char *out =
                (unsigned char *)frame->pixels + (size_t)(tile->y + row) * frame->stride_bytes;
            if (frame->format == SP_RGBAF32)
                d->kernels->resolve_rgbaf32(planes, n, background,
                                            (float *)(void *)out + 4 * (size_t)tile->x);
            else
                d->kernels->resolve_rgba8(planes, n, background, out + 4 * (size_t)tile->x);
        }
    }
}

static bool fail_memory(const struct sp_arena *arena, struct sp_error *err) {
    return sp_fail(err, SP_ERR_MEMORY, "", "no memory for the frame's %s",
                   arena->failed ? arena->failed : "data");
}

static int band_rows(const struct draw *d) {
    int rows = BAND_TILES / d->grid.columns;
    int needed = (d->ewa.size[1] + SP_TILE - 1) / SP_TILE;
    return rows < 1 ? 1 : rows < needed ? rows : needed;
}

/* Blocks of the whole order. */
static uint64_t count_all(const struct draw *d) {
    return (d->list->count + BLOCK - 1) / BLOCK;
}

/* Finds where every block begins. */
static void cut_order(struct draw *d) {
    uint64_t run = 0, blocks = 0;
    uint32_t skip = 0; /* entries of the run in hand until the next block begins */
    for (uint32_t layer = 0; layer < d->order.layers; layer++)
        for (; run < d->order.first[layer + 1]; run++) {
            uint32_t count = d->order.runs[run].count;
            for (; skip < count; skip += BLOCK)
                d->cuts[blocks++] = (struct cut){ run, layer, skip };
            skip -= count;
        }
}

static bool allocate(struct draw *d, struct sp_arena *arena, struct sp_error *err) {
    d->grid.columns = (d->ewa.size[0] + SP_TILE - 1) / SP_TILE;
    d->grid.rows = band_rows(d);
    uint32_t tiles = (uint32_t)(d->grid.columns * d->grid.rows);
    uint32_t most = tiles * BLOCK; /* entries of one block whose footprints cover everything */
    d->bins = (struct sp_bins){ .capacity = most > ENTRIES_MIN ? most : ENTRIES_MIN };
    d->cuts = sp_arena_alloc(arena, "cuts", count_all(d), sizeof *d->cuts);
    d->grid.tiles = sp_arena_alloc(arena, "tiles", tiles, sizeof *d->grid.tiles);
    d->records = sp_arena_alloc(arena, "splats", (size_t)BLOCK * BATCH_BLOCKS, sizeof *d->records);
    d->blocks = sp_arena_alloc(arena, "blocks", BATCH_BLOCKS, sizeof *d->blocks);
    d->bins.counts =
        sp_arena_alloc(arena, "bin counts", (size_t)tiles * BATCH_BLOCKS, sizeof *d->bins.counts);
    d->bins.first = sp_arena_alloc(arena, "bins", tiles + (size_t)1, sizeof *d->bins.first);
    d->bins.entries =
        sp_arena_alloc(arena, "bin entries", d->bins.capacity, sizeof *d->bins.entries);
    return !arena->failed || fail_memory(arena, err);
}

static bool choose_filters(struct draw *d, struct sp_arena *arena, struct sp_error *err) {
    const struct sp_grid *grid = &d->level->grid;
    d->filter = d->job->view->filter.mode;
    if (d->filter != SP_FILTER_ADAPTIVE)
        return true;
    struct sp_adaptive adaptive;
    sp_adaptive_init(&adaptive, &d->camera, grid, d->job->view);
    d->filters = sp_arena_alloc(arena, "filter modes", sp_adaptive_count(grid), 1);
    if (!d->filters)
        return fail_memory(arena, err);
    d->filter = sp_adaptive_fill(&adaptive, d->filters);
    return true;
}

/* Everything between the view and the first batch. */
static bool prepare(struct draw *d, struct cpu_state *state, struct sp_error *err) {
    const struct sp_view *view = d->job->view;
    sp_camera_frame_init(&d->camera, &view->camera, view->size);
    unsigned axis = sp_order_axis(&d->camera, &sp_volume_info(d->job->volume)->grid);
    struct sp_classify_job classify = { .tf = &view->transfer_function,
                                        .level = d->job->coarse,
                                        .axis = axis,
                                        .normals = view->shading.mode == SP_SHADING_PHONG,
                                        .bytes_max = state->cache.limit_bytes,
                                        .pool = d->pool,
                                        .cancel = d->job->cancel };
    const struct sp_classification *classification =
        cpu_cache_get(&state->cache, d->job->volume, &classify, err);
    if (!classification)
        return false;
    d->level = &classification->levels[d->job->coarse];
    d->list = &d->level->visible;
    sp_ewa_frame_init(&d->ewa, &d->camera, &d->level->grid, view);
    if (!sp_order_sheets(&d->camera, d->level, axis, &state->arena, &d->order))
        return fail_memory(&state->arena, err);
    if (!allocate(d, &state->arena, err) || !choose_filters(d, &state->arena, err))
        return false;
    cut_order(d);
    if (classify.normals) {
        sp_shade_init(&d->shade, &d->camera, &view->shading);
        d->shading = &d->shade;
    }
    return true;
}

static bool all_saturated(const struct draw *d) {
    for (uint32_t t = 0; t < d->bins.tiles; t++)
        if (!d->grid.tiles[t].saturated)
            return false;
    return true;
}

/* Draws the rows of tiles from picture row y on. */
static void draw_band(struct draw *d, int y) {
    int left = (d->ewa.size[1] - y + SP_TILE - 1) / SP_TILE;
    d->grid.rows = left < d->grid.rows ? left : d->grid.rows;
    d->grid.y = d->ewa.rows[0] = y;
    int end = y + d->grid.rows * SP_TILE;
    d->ewa.rows[1] = end < d->ewa.size[1] ? end : d->ewa.size[1];
    d->bins.tiles = (uint32_t)(d->grid.columns * d->grid.rows);
    for (int r = 0; r < d->grid.rows; r++)
        for (int c = 0; c < d->grid.columns; c++)
            sp_tile_init(&d->grid.tiles[r * d->grid.columns + c], c * SP_TILE, y + r * SP_TILE,
                         d->ewa.size);
    uint64_t blocks = count_all(d);
    for (d->batch = 0; d->batch < blocks; d->batch += BATCH_BLOCKS) {
        if (is_cancelled(d) || all_saturated(d))
            break;
        uint64_t rest = blocks - d->batch;
        uint32_t count = (uint32_t)(rest < BATCH_BLOCKS ? rest : BATCH_BLOCKS);
        double clock = sp_clock_ms();
        sp_parallel_for(d->pool, count, 1, splat_blocks, d);
        for (uint32_t b = 0; b < count; b++) {
            d->splats += d->blocks[b].count;
            d->fragments += d->blocks[b].fragments;
        }
        add_time(d, SPLAT, clock);
        add_batch(d, count);
    }
    double clock = sp_clock_ms();
    sp_parallel_for(d->pool, d->bins.tiles, 4, resolve_tiles, d);
    add_time(d, RESOLVE, clock);
}

static void write_stats(const struct draw *d, struct sp_frame_stats *stats) {
    static const char *const names[STAGES] = { "classify", "splat", "bin", "tile", "resolve" };
    stats->coarse = d->job->coarse;
    stats->visible_voxels = d->list->count;
    stats->splats = d->splats;
    stats->fragments = (uint64_t)d->fragments;
    stats->stage_count = STAGES;
    for (int i = 0; i < STAGES; i++)
        stats->stages[i] = (struct sp_stage_time){ names[i], d->stage_ms[i] };
}

bool cpu_draw(struct cpu_state *state, const struct sp_backend_job *job, struct sp_error *err) {
    struct draw d = { .job = job, .kernels = &state->kernels, .pool = state->pool };
    double clock = sp_clock_ms();
    sp_arena_reset(&state->arena);
    if (!prepare(&d, state, err))
        return false;
    add_time(&d, CLASSIFY, clock);
    int step = d.grid.rows * SP_TILE;
    for (int y = 0; y < d.ewa.size[1] && !is_cancelled(&d); y += step)
        draw_band(&d, y);
    if (is_cancelled(&d))
        return sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
    write_stats(&d, &job->frame->stats);
    return true;
}
