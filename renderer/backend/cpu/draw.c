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

    uint32_t *slices; /* by order; sheet k is slice slices[k] */
    uint64_t *before; /* [sheets + 1] visible voxels in sheets 0 … k−1 */

    struct sp_tile_grid grid;
    struct sp_splat *records; /* block b writes from b·BLOCK */
    struct block *blocks;
    struct sp_bins bins;
    uint64_t batch; /* place of the batch's first voxel in the order */
};

static bool is_cancelled(const struct draw *d) {
    return sp_job_is_cancelled(d->job);
}

static double add_time(struct draw *d, enum stage stage, double since) {
    double now = sp_clock_ms();
    d->stage_ms[stage] += now - since;
    return now;
}

/* The sheet that the voxel at `place` in the order lies in. */
static uint32_t find_sheet(const struct draw *d, uint64_t place) {
    uint32_t low = 0, high = d->list->slices;
    while (high - low > 1) {
        uint32_t middle = low + (high - low) / 2;
        if (d->before[middle] <= place)
            low = middle;
        else
            high = middle;
    }
    return low;
}

/* Sets up the batch's voxels of one block and keeps the splats that some tile still wants. */
static void set_up_block(struct draw *d, uint64_t place, uint64_t stop, struct sp_splat *records,
                         struct block *block) {
    *block = (struct block){ 0 };
    struct sp_ewa_run run = { .list = d->list,
                              .transfer = &d->level->transfer,
                              .shade = d->shading };
    for (uint32_t k = find_sheet(d, place); place < stop; k++) {
        uint64_t end = d->before[k + 1] < stop ? d->before[k + 1] : stop;
        run.sheet = k;
        run.slice = d->slices[k];
        run.begin = d->list->first[run.slice] + (place - d->before[k]);
        run.count = (uint32_t)(end - place);
        uint32_t n = d->kernels->set_up(&d->ewa, &run, records + block->count);
        place = end;
        for (uint32_t i = 0, from = block->count; i < n; i++) {
            const struct sp_splat *s = &records[from + i];
            if (sp_bins_is_hidden(&d->grid, s))
                continue;
            float box = (float)(s->x1 - s->x0) * (float)(s->y1 - s->y0);
            block->fragments += (double)(box < s->area ? box : s->area);
            records[block->count++] = *s;
        }
    }
}

static void splat_blocks(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    struct draw *d = user;
    for (size_t b = begin; b < end; b++) {
        uint64_t place = d->batch + b * BLOCK, stop = place + BLOCK;
        if (is_cancelled(d))
            d->blocks[b] = (struct block){ 0 };
        else
            set_up_block(d, place, stop < d->list->count ? stop : d->list->count,
                         d->records + b * BLOCK, &d->blocks[b]);
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

static bool allocate(struct draw *d, struct sp_arena *arena, struct sp_error *err) {
    d->grid.columns = (d->ewa.size[0] + SP_TILE - 1) / SP_TILE;
    d->grid.rows = band_rows(d);
    uint32_t tiles = (uint32_t)(d->grid.columns * d->grid.rows);
    uint32_t most = tiles * BLOCK; /* entries of one block whose footprints cover everything */
    d->bins = (struct sp_bins){ .capacity = most > ENTRIES_MIN ? most : ENTRIES_MIN };
    d->slices = sp_arena_alloc(arena, "order of sheets", d->list->slices, sizeof *d->slices);
    d->before =
        sp_arena_alloc(arena, "sizes of sheets", d->list->slices + (size_t)1, sizeof *d->before);
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

static bool choose_filters(struct draw *d, struct sp_arena *arena, const struct sp_grid *grid,
                           struct sp_error *err) {
    if (d->job->view->filter.mode != SP_FILTER_ADAPTIVE)
        return true;
    struct sp_adaptive adaptive;
    sp_adaptive_init(&adaptive, &d->camera, grid, d->job->view);
    uint8_t *modes = sp_arena_alloc(arena, "filter modes", sp_adaptive_count(grid), 1);
    if (!modes)
        return fail_memory(arena, err);
    d->ewa.mode = sp_adaptive_fill(&adaptive, modes);
    d->ewa.blocks = modes;
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
    d->list = &d->level->lists[axis];
    const struct sp_grid *grid = &d->level->grid;
    sp_ewa_frame_init(&d->ewa, &d->camera, grid, view, axis);
    if (!allocate(d, &state->arena, err) || !choose_filters(d, &state->arena, grid, err))
        return false;
    if (classify.normals) {
        sp_shade_init(&d->shade, &d->camera, &view->shading);
        d->shading = &d->shade;
    }
    sp_order_slices(&d->camera, grid, axis, d->slices);
    d->before[0] = 0;
    for (uint32_t k = 0; k < d->list->slices; k++) {
        uint32_t s = d->slices[k];
        d->before[k + 1] = d->before[k] + d->list->first[s + 1] - d->list->first[s];
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
    for (d->batch = 0; d->batch < d->list->count; d->batch += (uint64_t)BLOCK * BATCH_BLOCKS) {
        if (is_cancelled(d) || all_saturated(d))
            break;
        uint64_t blocks = (d->list->count - d->batch + BLOCK - 1) / BLOCK;
        uint32_t count = (uint32_t)(blocks < BATCH_BLOCKS ? blocks : BATCH_BLOCKS);
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
