/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/cpu/general.h"

#include <math.h>
#include <string.h>

#include "data/volume/missing.h"
#include "data/volume/volume.h"
#include "draw/footprints/bin.h"
#include "draw/footprints/depth.h"
#include "draw/footprints/insert.h"
#include "draw/footprints/order.h"
#include "draw/footprints/post.h"
#include "draw/footprints/tile_depth.h"
#include "splat/slices.h"

enum {
    BLOCK = SP_BRICK_VOXELS, /* voxels that are set up together: at least the voxels of one run */
    BATCH_BLOCKS = 32,       /* blocks per batch: 131,072 records of 64 bytes */
    BAND_TILES = 2304, /* tiles per band, 32 KiB each: an image up to 1920 × 1080 has one band */
    ENTRIES_MIN = 1 << 20,
    POLL_EVERY = 64, /* splats of a tile between two polls of the cancel flag */
    PIECE = 256,     /* records between two polls while records are sorted into tiles */
    AHEAD = 6,       /* splats of a tile that are prefetched */
};
/* Largest memory for the sums of open slabs: of a band, and of one row of tiles. */
#define BAND_BYTES ((size_t)128 << 20)
#define ROW_BYTES ((size_t)512 << 20)

#define SPLAT_RANGE (1.0 / 16) /* cells; single splats are sorted by distance in these steps */

/* Consecutive runs of the order, and the records made from them. */
struct block {
    uint64_t run; /* its first run */
    uint32_t runs, layer;
    uint32_t count;   /* records written */
    double fragments; /* px of their footprints inside the image */
};

/* A frame on the general path. */
struct draw {
    struct cpu_frame *frame;
    const struct cpu_kernels *kernels;
    struct sp_pool *pool;
    uint64_t splats;
    double fragments;               /* px */
    const struct sp_shade *shading; /* of voxels; NULL = none, or pixels are shaded instead */

    struct sp_order order;
    double nearest; /* where the first layer begins, if layers are ranges of distance [cells] */
    struct sp_blend blend;
    struct sp_post post;
    struct sp_insert insert;
    struct sp_layer_places places; /* only if the frame has depth */

    struct sp_tile_grid grid;
    struct sp_splats records; /* block b writes from b·BLOCK */
    struct block *blocks;
    struct sp_bins bins;
};

static bool is_cancelled(const struct draw *d) {
    return cpu_frame_is_cancelled(d->frame);
}

/* Cuts the runs from *run on into blocks; returns their number. Where blocks end depends on the
 * order alone. */
static uint32_t make_batch(struct draw *d, uint64_t *run, uint32_t *layer) {
    uint64_t end = d->order.first[d->order.layers];
    uint32_t count = 0;
    for (; count < BATCH_BLOCKS && *run < end; count++) {
        while (*run >= d->order.first[*layer + 1])
            (*layer)++;
        struct block *b = &d->blocks[count];
        *b = (struct block){ .run = *run, .layer = *layer };
        for (uint32_t n = 0; *run < end && n + d->order.runs[*run].count <= BLOCK; (*run)++) {
            n += d->order.runs[*run].count;
            b->runs++;
        }
    }
    return count;
}

/* Prefetches the entries of a run while the run before it is set up: entries of different bricks
 * are far apart in memory. */
static void prefetch_run(const struct draw *d, const struct sp_run *run) {
    enum { LINE = 16 }; /* entries per cache line, roughly */
    const struct sp_visible *list = &d->frame->parts[run->level].level->visible;
    uint64_t first = list->first[run->brick];
    const uint16_t *order = d->order.order ? d->order.order + first : NULL;
    uint32_t end = (uint32_t)run->begin + run->count;
    for (uint32_t p = run->begin; p < end; p += order ? 1 : LINE) {
        uint64_t e = first + (order ? order[p] : p);
        __builtin_prefetch(&list->place[e]);
        __builtin_prefetch((const uint8_t *)list->key + e * list->key_bytes);
        if (list->normal)
            __builtin_prefetch((const uint8_t *)list->normal + e * list->normal_bytes);
    }
}

/* Keeps the seen records of the `n` new ones from `from` on: drops records that lie only behind
 * opaque tiles. */
static void keep_seen(struct draw *d, struct block *block, size_t from, uint32_t n) {
    const struct sp_splats *r = &d->records;
    size_t to = from;
    for (size_t i = from; i < from + n; i++) {
        const struct sp_splat *s = &r->splat[i];
        if (sp_bins_is_hidden(&d->grid, s))
            continue;
        float box = (float)(s->x1 - s->x0) * (float)(s->y1 - s->y0);
        block->fragments += (double)(box < s->area ? box : s->area);
        r->splat[to] = *s;
        if (r->span)
            r->span[to] = r->span[i];
        if (r->cut && s->cuts)
            r->cut[to] = r->cut[i];
        to++;
    }
    block->count += (uint32_t)(to - from);
}

static void set_up_block(struct draw *d, size_t b) {
    struct block *block = &d->blocks[b];
    uint16_t local[BLOCK];
    struct sp_ewa_run run = { .local = local, .shade = d->shading, .sheet = block->layer };
    for (uint64_t k = block->run; k < block->run + block->runs && !is_cancelled(d); k++) {
        const struct sp_run *from = &d->order.runs[k];
        while (k >= d->order.first[run.sheet + 1])
            run.sheet++;
        const struct sp_level_frame *part = &d->frame->parts[from->level];
        const uint8_t *modes = part->modes[from->is_enlarged];
        run.list = &part->level->visible;
        run.transfer = &part->level->transfer;
        run.mode =
            modes ? (enum sp_filter_mode)modes[from->brick] : d->frame->job->view->filter.mode;
        sp_visible_brick_corner(run.list->bricks, from->brick, run.brick);
        run.first = run.list->first[from->brick];
        run.order = d->order.order ? d->order.order + run.first : NULL;
        run.begin = from->begin;
        run.count = from->count;
        sp_visible_locals(run.list, from->brick, run.order, run.begin, run.count, local);
        if (k + 1 < block->run + block->runs)
            prefetch_run(d, from + 1);
        size_t at = b * BLOCK + block->count;
        struct sp_splats out = sp_splats_from(&d->records, at);
        keep_seen(d, block, at, d->kernels->set_up(&part->ewa[from->is_enlarged], &run, &out));
    }
}

static void splat_blocks(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    struct draw *d = user;
    for (size_t b = begin; b < end && !is_cancelled(d); b++)
        set_up_block(d, b);
}

/* Advances to the next piece of a block's records and polls the cancel flag: each record may touch
 * every tile. */
static bool next_piece(const struct draw *d, const struct block *block, uint32_t *at, uint32_t *n) {
    *at += *n;
    uint32_t left = block->count - *at;
    *n = left < PIECE ? left : PIECE;
    return *n && !is_cancelled(d);
}

static void count_blocks(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    struct draw *d = user;
    for (size_t b = begin; b < end; b++) {
        sp_bins_clear(&d->bins, (uint32_t)b);
        for (uint32_t at = 0, n = 0; next_piece(d, &d->blocks[b], &at, &n);)
            sp_bins_count(&d->bins, (uint32_t)b, &d->grid, d->records.splat + b * BLOCK + at, n);
    }
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
        for (uint32_t at = 0, n = 0; next_piece(d, &d->blocks[b], &at, &n);)
            sp_bins_fill(&d->bins, b, &d->grid, d->records.splat + (size_t)b * BLOCK + at, n,
                         b * BLOCK + at);
    }
}

/* Prefetches the record of entry e: the records of a tile are far apart in memory. */
static inline void prefetch_record(const struct draw *d, uint32_t e) {
    uint32_t n = d->bins.entries[e];
    __builtin_prefetch(&d->records.splat[n]);
    if (d->records.span)
        __builtin_prefetch(&d->records.span[n]);
}

static void add_tiles(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    struct draw *d = user;
    for (size_t t = begin; t < end && !is_cancelled(d); t++) {
        struct sp_tile *tile = &d->grid.tiles[t];
        uint32_t stop = d->bins.first[t + 1];
        for (uint32_t e = d->bins.first[t]; e < stop && !tile->saturated; e++) {
            if (e % POLL_EVERY == 0 && is_cancelled(d))
                break;
            if (e + AHEAD < stop)
                prefetch_record(d, e + AHEAD);
            d->kernels->add[d->blend.mode](tile, &d->blend, &d->records, d->bins.entries[e]);
        }
    }
}

/* Bins and adds the batch's blocks [0, count). One footprint may cover every tile; therefore each
 * step takes only as many blocks as the entries can hold. */
static void add_batch(struct draw *d, uint32_t count) {
    double clock = sp_job_clock_ms(d->frame->job);
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
        clock = cpu_frame_add_time(d->frame, CPU_BIN, clock);
        if (is_cancelled(d))
            return; /* some entries were not written */
        sp_parallel_for(d->pool, d->bins.tiles, 1, add_tiles, d);
        clock = cpu_frame_add_time(d->frame, CPU_TILE, clock);
    }
}

/* Writes the depth of the first n pixels of a row of the tile. */
static void resolve_depth(const struct draw *d, const struct sp_tile *tile, int row, uint32_t n) {
    const struct sp_frame *frame = d->frame->job->frame;
    const size_t y = (size_t)(tile->y + row);
    float place[2][SP_TILE];
    const float *const places[2] = { place[0], place[1] };
    const float *const planes[3] = { tile->done[0][row], tile->depth->moment[0][row],
                                     tile->depth->moment[1][row] };
    const float origin = isnan(tile->depth->origin) ? 0 : tile->depth->origin;
    sp_layer_places_row(&d->places, tile->x, tile->y + row, (int)n, place[0], place[1]);
    for (uint32_t i = 0; i < n; i++)
        place[0][i] += origin * place[1][i];
    d->kernels->resolve_depth(planes, places, n, sp_depth_row(frame, frame->depth, y) + tile->x,
                              sp_depth_row(frame, frame->spread, y) + tile->x);
}

static void resolve_tiles(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    struct draw *d = user;
    struct sp_frame *frame = d->frame->job->frame;
    const float *background = d->frame->job->view->background;
    for (size_t t = begin; t < end && !is_cancelled(d); t++) {
        struct sp_tile *tile = &d->grid.tiles[t];
        d->kernels->tile_close(tile, &d->blend);
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
            if (tile->depth)
                resolve_depth(d, tile, row, n);
        }
    }
}

/* Returns the bytes for the sums of one tile. */
static size_t sums_bytes(const struct sp_blend *blend) {
    return (size_t)blend->slots * blend->planes * SP_TILE_AREA * sizeof(float);
}

static int band_rows(const struct draw *d) {
    size_t tiles = BAND_BYTES / sums_bytes(&d->blend);
    int rows = (int)(tiles < BAND_TILES ? tiles : BAND_TILES) / d->grid.columns;
    int needed = sp_fragments_rows(d->frame->fragments, SP_TILE, d->frame->ewa->size[1]) / SP_TILE;
    return rows < 1 ? 1 : rows < needed ? rows : needed;
}

static void allocate_tiles(struct draw *d, struct sp_arena *arena, uint32_t tiles) {
    size_t layers = (size_t)tiles * d->blend.slots;
    size_t floats = (size_t)d->blend.slots * d->blend.planes * SP_TILE_AREA;
    float *sums = sp_arena_alloc(arena, "sums", tiles, floats * sizeof *sums);
    struct sp_box *dirty = sp_arena_alloc(arena, "layers of tiles", layers, sizeof *dirty);
    d->grid.tiles = sp_arena_alloc(arena, "tiles", tiles, sizeof *d->grid.tiles);
    for (uint32_t t = 0; !arena->failed && t < tiles; t++) {
        d->grid.tiles[t].sums = sums + t * floats;
        d->grid.tiles[t].dirty = dirty + (size_t)t * d->blend.slots;
        d->grid.tiles[t].insert = d->blend.insert ? sp_arena_alloc(arena, "fragments of tiles", 1,
                                                                   sizeof *d->grid.tiles[t].insert)
                                                  : NULL;
        d->grid.tiles[t].depth = d->blend.places ? sp_arena_alloc(arena, "depths of tiles", 1,
                                                                  sizeof *d->grid.tiles[t].depth)
                                                 : NULL;
    }
}

static bool allocate(struct draw *d, struct sp_arena *arena, struct sp_error *err) {
    enum { RECORDS = BLOCK * BATCH_BLOCKS };
    d->grid.rows = band_rows(d);
    uint32_t tiles = (uint32_t)(d->grid.columns * d->grid.rows);
    uint32_t most = tiles * BLOCK; /* entries if every footprint of a block covers all tiles */
    d->bins = (struct sp_bins){ .capacity = most > ENTRIES_MIN ? most : ENTRIES_MIN };
    allocate_tiles(d, arena, tiles);
    d->records.splat = sp_arena_alloc(arena, "splats", RECORDS, sizeof *d->records.splat);
    if (d->blend.mode == SP_COMPOSITE_SLAB || (d->blend.insert && d->insert.has_splats))
        d->records.span = sp_arena_alloc(arena, "spans", RECORDS, sizeof *d->records.span);
    if (d->frame->ewa->clip.count)
        d->records.cut = sp_arena_alloc(arena, "cuts", RECORDS, sizeof *d->records.cut);
    d->blocks = sp_arena_alloc(arena, "blocks", BATCH_BLOCKS, sizeof *d->blocks);
    d->bins.counts =
        sp_arena_alloc(arena, "bin counts", (size_t)tiles * BATCH_BLOCKS, sizeof *d->bins.counts);
    d->bins.first = sp_arena_alloc(arena, "bins", tiles + (size_t)1, sizeof *d->bins.first);
    d->bins.entries =
        sp_arena_alloc(arena, "bin entries", d->bins.capacity, sizeof *d->bins.entries);
    return !arena->failed || sp_arena_fail(arena, "data", err);
}

static void set_rows(struct draw *d, int begin, int end) {
    for (int l = 0; l < SP_LEVELS; l++)
        for (int enlarged = 0; enlarged < 2; enlarged++) {
            d->frame->parts[l].ewa[enlarged].rows[0] = begin;
            d->frame->parts[l].ewa[enlarged].rows[1] = end;
        }
}

/* Returns how far a kernel reaches along the ray at most [cells]. */
static double kernel_reach(const struct draw *d) {
    const struct sp_view *view = d->frame->job->view;
    double radius[2];
    sp_kernel_radii(&d->frame->level->grid, sp_kernel_sigma(&view->filter), radius);
    return (double)d->frame->ewa->radius * radius[1] / d->frame->ewa->unit;
}

/* Sets up the compositor. Slabs get as many slots as a kernel may span; they are thicker if memory
 * does not suffice. *reach: of a kernel before its layer [cells]. */
static void choose_blend(struct draw *d, double *reach) {
    const struct sp_view *view = d->frame->job->view;
    const struct sp_grid *grid = &d->frame->level->grid;
    bool is_post = view->transfer_function.order == SP_TF_POST;
    d->blend = (struct sp_blend){
        .mode = view->compositing.mode,
        .linear = view->compositing.attenuation == SP_ATTENUATION_LINEAR,
        .planes = is_post ? SP_PLANES + 1 : SP_PLANES,
        .slots = 1,
        .cut = d->frame->ewa->cut,
        .cubic = view->filter.kernel == SP_KERNEL_CUBIC ? &d->frame->state->cubic : NULL,
        .post = is_post ? &d->post : NULL,
    };
    *reach = 0;
    if (d->blend.mode != SP_COMPOSITE_SLAB)
        return;
    /* The transfer function varies as fast over an averaged scalar: its slabs stay as thin. */
    const struct sp_grid *measure = is_post ? &sp_volume_info(d->frame->job->volume)->grid : grid;
    double spacing = fmin(measure->spacing[0], fmin(measure->spacing[1], measure->spacing[2]));
    *reach = kernel_reach(d);
    double thickness = sp_depth_thickness(
        d->frame->ewa, view->compositing.slab * spacing / d->frame->ewa->unit, *reach);
    double most = fmin(SP_SLOTS_MAX, (double)(ROW_BYTES / sums_bytes(&d->blend)) / d->grid.columns);
    thickness = fmax(thickness, 2 * *reach / (most - 3));
    d->blend.slots = (uint32_t)ceil(2 * *reach / thickness) + 2;
    d->blend.thickness = (float)thickness;
}

static bool choose_order(struct draw *d, double reach, struct sp_error *err) {
    struct sp_arena *arena = &d->frame->state->arena;
    double nearest = 0;
    struct sp_depth_job job = { .frame = d->frame->ewa,
                                .list = &d->frame->level->visible,
                                .level = d->frame->finest,
                                .is_enlarged = d->frame->is_enlarged,
                                .thickness = SPLAT_RANGE,
                                .reach = reach,
                                .pool = d->pool,
                                .arena = arena };
    if (d->blend.mode == SP_COMPOSITE_SHEET)
        return sp_order_sheets(&d->frame->camera, d->frame->levels, &d->frame->detail,
                               d->frame->axis, arena, &d->order) ||
               sp_arena_fail(arena, "data", err);
    if (d->blend.mode == SP_COMPOSITE_SLAB)
        job.thickness = (double)d->blend.thickness;
    if (!sp_order_distance(&job, &d->order, &nearest))
        return sp_arena_fail(arena, "data", err);
    d->blend.nearest = (float)nearest;
    d->nearest = nearest;
    return true;
}

static bool choose_shading(struct draw *d, struct sp_arena *arena, struct sp_error *err) {
    const struct sp_view *view = d->frame->job->view;
    if (!d->blend.post)
        return true;
    struct sp_gradient_grid gradient;
    double(*integral)[4] =
        sp_arena_alloc(arena, "transfer function's integral", SP_POST_NODES + 1, sizeof *integral);
    if (!integral)
        return sp_arena_fail(arena, "data", err);
    const struct sp_volume_info *info = sp_volume_info(d->frame->job->volume);
    sp_gradient_units_init(&gradient, info);
    d->post = (struct sp_post){ .shade = d->shading,
                                .half = (float)(0.5 * (double)d->blend.thickness *
                                                d->frame->ewa->unit * gradient.unit),
                                .perspective = view->camera.projection == SP_PERSPECTIVE,
                                .focal = (float)d->frame->camera.scale,
                                .centre = { d->frame->ewa->centre[0], d->frame->ewa->centre[1] } };
    for (int r = 0; r < 3; r++)
        for (int k = 0; k < 3; k++)
            d->post.to_camera[r][k] = (float)d->frame->camera.w.m[r][k];
    double limits[2];
    sp_missing_limits(info, limits);
    sp_post_curve_init(&d->post.curve, &view->transfer_function, limits,
                       sp_transfer_base(&d->frame->level->transfer), gradient.unit, integral);
    d->shading = NULL; /* pixels are shaded, not voxels */
    return true;
}

/* Relates the depths of fragments to the layers of the order. */
static bool choose_insert(struct draw *d, double reach, struct sp_error *err) {
    struct sp_arena *arena = &d->frame->state->arena;
    const double unit = d->frame->ewa->unit;
    double thickness = d->blend.mode == SP_COMPOSITE_SLAB
                           ? (double)d->blend.thickness
                           : sp_depth_thickness(d->frame->ewa, SPLAT_RANGE, reach);
    if (!d->frame->fragments)
        return true;
    d->blend.insert = &d->insert;
    d->insert = (struct sp_insert){ .fragments = d->frame->fragments,
                                    .camera = &d->frame->camera,
                                    .has_splats = d->blend.mode == SP_COMPOSITE_SPLAT,
                                    .nearest = d->nearest * unit,
                                    .thickness = thickness * unit,
                                    .reach = kernel_reach(d) * unit,
                                    .unit = unit };
    return d->blend.mode != SP_COMPOSITE_SHEET ||
           sp_insert_init_sheets(&d->insert, &d->frame->levels[0].grid, d->frame->axis, arena) ||
           sp_arena_fail(arena, "data", err);
}

static bool place_sheets(struct draw *d, struct sp_arena *arena) {
    const struct sp_grid *grid = &d->frame->levels[0].grid;
    const uint32_t count = grid->dims[d->frame->axis];
    uint32_t *sorted = sp_arena_alloc(arena, "order of sheets", count, sizeof *sorted);
    float *by_slice = sp_arena_alloc(arena, "places of sheets", count, sizeof *by_slice);
    float *by_layer = sp_arena_alloc(arena, "places of sheets", count, sizeof *by_layer);
    if (arena->failed)
        return false;
    sp_layer_places_init_sheets(&d->places, &d->frame->camera, grid, d->frame->axis, by_slice);
    sp_slices_sort(&d->frame->camera, grid, d->frame->axis, sorted);
    for (uint32_t k = 0; k < count; k++)
        by_layer[k] = by_slice[sorted[k]];
    d->places.at = by_layer;
    return true;
}

/* Says where the layers of the order lie, if the frame has depth. */
static bool choose_places(struct draw *d, double reach, struct sp_error *err) {
    const float unit = (float)d->frame->ewa->unit;
    struct sp_arena *arena = &d->frame->state->arena;
    if (!d->frame->job->frame->depth)
        return true;
    d->blend.places = &d->places;
    if (d->blend.mode == SP_COMPOSITE_SHEET)
        return place_sheets(d, arena) || sp_arena_fail(arena, "data", err);
    const float thickness = d->blend.mode == SP_COMPOSITE_SLAB
                                ? d->blend.thickness
                                : (float)sp_depth_thickness(d->frame->ewa, SPLAT_RANGE, reach);
    d->places = (struct sp_layer_places){ .camera = &d->frame->camera,
                                          .nearest = (float)d->nearest * unit,
                                          .thickness = thickness * unit };
    return true;
}

/* Does all work that precedes the first batch. */
static bool prepare(struct draw *d, struct sp_error *err) {
    struct sp_arena *arena = &d->frame->state->arena;
    d->grid.columns = (d->frame->ewa->size[0] + SP_TILE - 1) / SP_TILE;
    double reach;
    choose_blend(d, &reach);
    return choose_shading(d, arena, err) && choose_order(d, reach, err) &&
           choose_insert(d, reach, err) && choose_places(d, reach, err) && allocate(d, arena, err);
}

static bool all_saturated(const struct draw *d) {
    for (uint32_t t = 0; t < d->bins.tiles; t++)
        if (!d->grid.tiles[t].saturated)
            return false;
    return true;
}

/* Draws the band of tiles that begins at image row y. */
static bool draw_band(struct draw *d, int y, struct sp_error *err) {
    int left = (d->frame->ewa->size[1] - y + SP_TILE - 1) / SP_TILE;
    d->grid.rows = left < d->grid.rows ? left : d->grid.rows;
    d->grid.y = y;
    int end = y + d->grid.rows * SP_TILE;
    set_rows(d, y, end < d->frame->ewa->size[1] ? end : d->frame->ewa->size[1]);
    if (!sp_fragments_ensure(d->frame->fragments, y, end, err))
        return false;
    d->bins.tiles = (uint32_t)(d->grid.columns * d->grid.rows);
    for (int r = 0; r < d->grid.rows; r++)
        for (int c = 0; c < d->grid.columns; c++)
            sp_tile_init(&d->grid.tiles[r * d->grid.columns + c], c * SP_TILE, y + r * SP_TILE,
                         d->frame->ewa->size, &d->blend);
    uint64_t run = 0;
    uint32_t layer = 0, count;
    while (!is_cancelled(d) && !all_saturated(d) && (count = make_batch(d, &run, &layer)) > 0) {
        double clock = sp_job_clock_ms(d->frame->job);
        sp_parallel_for(d->pool, count, 1, splat_blocks, d);
        for (uint32_t b = 0; b < count; b++) {
            d->splats += d->blocks[b].count;
            d->fragments += d->blocks[b].fragments;
        }
        cpu_frame_add_time(d->frame, CPU_SPLAT, clock);
        add_batch(d, count);
    }
    double clock = sp_job_clock_ms(d->frame->job);
    sp_parallel_for(d->pool, d->bins.tiles, 4, resolve_tiles, d);
    cpu_frame_add_time(d->frame, CPU_RESOLVE, clock);
    return true;
}

static void write_stats(const struct draw *d, struct sp_frame_stats *stats) {
    static const char *const names[CPU_STAGES] = { "classify", "splat", "bin", "tile", "resolve" };
    cpu_frame_write_stats(d->frame);
    stats->splats = d->splats;
    stats->fragments = (uint64_t)d->fragments;
    stats->stage_count = CPU_STAGES;
    for (int i = 0; i < CPU_STAGES; i++)
        stats->stages[i] = (struct sp_stage_time){ names[i], d->frame->stage_ms[i] };
}

bool cpu_general_draw(struct cpu_frame *frame, struct sp_error *err) {
    struct draw d = { .frame = frame,
                      .kernels = &frame->state->kernels,
                      .pool = frame->state->pool,
                      .shading = frame->shading };
    double clock = sp_job_clock_ms(frame->job);
    if (!prepare(&d, err))
        return false;
    cpu_frame_add_time(frame, CPU_CLASSIFY, clock);
    int step = d.grid.rows * SP_TILE, height = frame->ewa->size[1];
    for (int y = 0; y < height && !is_cancelled(&d); y += step)
        if (!draw_band(&d, y, err))
            return false;
    if (is_cancelled(&d))
        return sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
    write_stats(&d, &frame->job->frame->stats);
    return true;
}
