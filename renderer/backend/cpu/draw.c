/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/cpu/draw.h"

#include <math.h>
#include <string.h>

#include "tile/bin.h"
#include "tile/depth.h"
#include "tile/order.h"
#include "tile/post.h"

enum {
    BLOCK = SP_BRICK_VOXELS, /* voxels set up at a time: at least those of a run */
    BATCH_BLOCKS = 32,       /* blocks a batch: 131,072 records of 64 bytes */
    BAND_TILES = 2304,       /* tiles a band, 32 KiB each: one band up to 1920 × 1080 */
    ENTRIES_MIN = 1 << 20,
    POLL_EVERY = 64, /* splats of a tile between two looks at the cancel flag */
    PIECE = 256,     /* records between two, while they are sorted into tiles */
    AHEAD = 6,       /* splats of a tile that are asked for before their turn */
};
/* Sums of the open slabs: of a band, and of a row of tiles at least. */
#define BAND_BYTES ((size_t)128 << 20)
#define ROW_BYTES ((size_t)512 << 20)

#define SPLAT_RANGE (1.0 / 16) /* cells: single splats are sorted by distance to this */

_Static_assert((int)SP_MIP_LEVEL_MAX < (int)SP_LEVELS, "one level per mip_level");

enum stage { CLASSIFY, SPLAT, BIN, TILE, RESOLVE, STAGES };

/* Consecutive runs of the order, and what became of them. */
struct block {
    uint64_t run; /* its first */
    uint32_t runs, layer;
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
    struct sp_detail detail;
    struct sp_level_frame parts[SP_LEVELS];
    const struct sp_ewa_frame *ewa; /* of the finest level that is drawn */
    struct sp_shade shade;
    const struct sp_shade *shading; /* &shade, or NULL */
    unsigned mip_level;             /* no finer level is asked for */
    unsigned finest;                /* level that is drawn */
    const struct sp_level *level;   /* the same */
    const struct sp_level *levels;  /* all */
    bool has_filters;               /* sheets without footprints: see sheets.h */
    uint64_t visible;               /* voxels of the volume */

    struct sp_order order;
    struct sp_blend blend;
    struct sp_post post;

    struct sp_tile_grid grid;
    struct sp_splats records; /* block b writes from b·BLOCK */
    struct block *blocks;
    struct sp_bins bins;
};

static bool is_cancelled(const struct draw *d) {
    return sp_job_is_cancelled(d->job);
}

static double add_time(struct draw *d, enum stage stage, double since) {
    double now = sp_job_clock_ms(d->job);
    d->stage_ms[stage] += now - since;
    return now;
}

/* Cuts the runs from *run on into blocks; returns how many. Where they are cut depends on the order
 * alone. */
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

/* Asks for the entries of a run while the one before it is set up: from brick to brick they lie far
 * apart. */
static void prefetch_run(const struct draw *d, const struct sp_run *run) {
    enum { LINE = 16 }; /* entries that come together */
    const struct sp_visible *list = &d->parts[run->level].level->visible;
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

/* Keeps those of `n` new records from `from` on that some tile still wants. */
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
        const struct sp_level_frame *part = &d->parts[from->level];
        const uint8_t *modes = part->modes[from->is_enlarged];
        run.list = &part->level->visible;
        run.transfer = &part->level->transfer;
        run.mode = modes ? (enum sp_filter_mode)modes[from->brick] : d->job->view->filter.mode;
        sp_visible_corner(run.list, from->brick, run.brick);
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

/* Next piece of a block's records, before which the cancel flag is looked at: each of them may
 * touch every tile. */
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

/* Asks for the record of entry e: those of a tile lie far apart. */
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

/* Bins and adds the batch's blocks [0, count), as many at a time as the entries have room for: a
 * footprint may cover every tile. */
static void add_batch(struct draw *d, uint32_t count) {
    double clock = sp_job_clock_ms(d->job);
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
        if (is_cancelled(d))
            return; /* there are entries that were not written */
        sp_parallel_for(d->pool, d->bins.tiles, 1, add_tiles, d);
        clock = add_time(d, TILE, clock);
    }
}

static void resolve_tiles(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    struct draw *d = user;
    struct sp_frame *frame = d->job->frame;
    const float *background = d->job->view->background;
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
        }
    }
}

static bool fail_memory(const struct sp_arena *arena, struct sp_error *err) {
    return sp_fail(err, SP_ERR_MEMORY, "", "no memory for the frame's %s",
                   arena->failed ? arena->failed : "data");
}

/* Bytes of a tile's sums. */
static size_t sums_bytes(const struct sp_blend *blend) {
    return (size_t)blend->slots * blend->planes * SP_TILE_AREA * sizeof(float);
}

static int band_rows(const struct draw *d) {
    size_t tiles = BAND_BYTES / sums_bytes(&d->blend);
    int rows = (int)(tiles < BAND_TILES ? tiles : BAND_TILES) / d->grid.columns;
    int needed = (d->ewa->size[1] + SP_TILE - 1) / SP_TILE;
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
    }
}

static bool allocate(struct draw *d, struct sp_arena *arena, struct sp_error *err) {
    enum { RECORDS = BLOCK * BATCH_BLOCKS };
    d->grid.rows = band_rows(d);
    uint32_t tiles = (uint32_t)(d->grid.columns * d->grid.rows);
    uint32_t most = tiles * BLOCK; /* entries of one block whose footprints cover everything */
    d->bins = (struct sp_bins){ .capacity = most > ENTRIES_MIN ? most : ENTRIES_MIN };
    allocate_tiles(d, arena, tiles);
    d->records.splat = sp_arena_alloc(arena, "splats", RECORDS, sizeof *d->records.splat);
    if (d->blend.mode == SP_COMPOSITE_SLAB)
        d->records.span = sp_arena_alloc(arena, "spans", RECORDS, sizeof *d->records.span);
    if (d->ewa->clip.count)
        d->records.cut = sp_arena_alloc(arena, "cuts", RECORDS, sizeof *d->records.cut);
    d->blocks = sp_arena_alloc(arena, "blocks", BATCH_BLOCKS, sizeof *d->blocks);
    d->bins.counts =
        sp_arena_alloc(arena, "bin counts", (size_t)tiles * BATCH_BLOCKS, sizeof *d->bins.counts);
    d->bins.first = sp_arena_alloc(arena, "bins", tiles + (size_t)1, sizeof *d->bins.first);
    d->bins.entries =
        sp_arena_alloc(arena, "bin entries", d->bins.capacity, sizeof *d->bins.entries);
    return !arena->failed || fail_memory(arena, err);
}

/* Adaptive: the filter of each brick of a level. Of one that is small enough it is the one that its
 * voxels would have. */
static const uint8_t *choose_modes(struct draw *d, unsigned level, bool enlarged,
                                   struct sp_arena *arena) {
    struct sp_adaptive adaptive;
    struct sp_view view = *d->job->view;
    const struct sp_grid *grid = &d->parts[level].level->grid;
    uint8_t *modes = sp_arena_alloc(arena, "filter modes", sp_adaptive_count(grid), 1);
    if (!enlarged)
        view.filter.sigma = ldexp(view.filter.sigma, -(int)level);
    if (modes) {
        sp_adaptive_init(&adaptive, &d->camera, grid, &view);
        sp_adaptive_fill(&adaptive, modes);
    }
    return modes;
}

/* Bricks of several levels are drawn in sheets of footprints; otherwise all are of one, the finest
 * that some brick needs. */
static uint32_t levels_drawn(const struct draw *d) {
    bool is_mixed = d->job->view->compositing.mode == SP_COMPOSITE_SHEET;
    return is_mixed ? d->detail.levels : 1u << d->finest;
}

/* Whether the one level is too coarse for some of its bricks. */
static bool is_enlarged(const struct draw *d) {
    for (uint32_t i = 0; i < d->detail.count; i++)
        if (d->detail.bricks[i].level == d->finest && d->detail.bricks[i].is_enlarged)
            return true;
    return false;
}

/* Levels that a frame needs. */
static bool choose_levels(struct draw *d, struct sp_arena *arena, struct sp_error *err) {
    const struct sp_grid *grid = &sp_volume_info(d->job->volume)->grid;
    unsigned levels = sp_detail_levels(grid->dims, SP_LEVELS);
    struct sp_detail_job job = { .camera = &d->camera,
                                 .grid = grid,
                                 .view = d->job->view,
                                 .floor = d->mip_level,
                                 .levels = levels > d->mip_level ? levels : d->mip_level + 1 };
    if (!sp_detail_choose(&job, arena, &d->detail))
        return fail_memory(arena, err);
    d->finest = (unsigned)__builtin_ctz(d->detail.levels);
    return true;
}

static bool make_parts(struct draw *d, struct sp_arena *arena, struct sp_error *err) {
    const struct sp_view *view = d->job->view;
    uint32_t levels = levels_drawn(d);
    for (unsigned l = 0; levels >> l; l++)
        for (int enlarged = 0; levels >> l & 1 && enlarged < 2; enlarged++) {
            struct sp_level_frame *part = &d->parts[l];
            struct sp_ewa_frame *ewa = &part->ewa[enlarged];
            struct sp_view own = *view;
            part->level = &d->levels[l];
            own.filter = sp_detail_filter(&view->filter, l, enlarged);
            sp_ewa_frame_init(ewa, &d->camera, &part->level->grid, &own);
            sp_clip_frame_init(&ewa->clip, &d->camera, &d->levels[0].grid, &view->clip, ewa->unit);
            if (view->filter.mode == SP_FILTER_ADAPTIVE &&
                !(part->modes[enlarged] = choose_modes(d, l, enlarged, arena)))
                return fail_memory(arena, err);
        }
    d->level = d->parts[d->finest].level;
    d->ewa = &d->parts[d->finest].ewa[is_enlarged(d)];
    return true;
}

static void set_rows(struct draw *d, int begin, int end) {
    for (int l = 0; l < SP_LEVELS; l++)
        for (int enlarged = 0; enlarged < 2; enlarged++) {
            d->parts[l].ewa[enlarged].rows[0] = begin;
            d->parts[l].ewa[enlarged].rows[1] = end;
        }
}

/* What the compositor needs to know; slabs get as many slots as a kernel may span, and as thick as
 * memory for them asks. *reach: of a kernel along the ray [cells]. */
static void choose_blend(struct draw *d, const struct cpu_state *state, double *reach) {
    const struct sp_view *view = d->job->view;
    const struct sp_grid *grid = &d->level->grid;
    bool is_post = view->transfer_function.order == SP_TF_POST;
    d->blend = (struct sp_blend){
        .mode = view->compositing.mode,
        .linear = view->compositing.attenuation == SP_ATTENUATION_LINEAR,
        .planes = is_post ? SP_PLANES + 1 : SP_PLANES,
        .slots = 1,
        .cut = d->ewa->cut,
        .cubic = view->filter.kernel == SP_KERNEL_CUBIC ? &state->cubic : NULL,
        .post = is_post ? &d->post : NULL,
    };
    *reach = 0;
    if (d->blend.mode != SP_COMPOSITE_SLAB)
        return;
    /* A coarse scalar is no smoother to the transfer function: its slabs stay as thin. */
    const struct sp_grid *measure = is_post ? &sp_volume_info(d->job->volume)->grid : grid;
    double radius[2],
        spacing = fmin(measure->spacing[0], fmin(measure->spacing[1], measure->spacing[2]));
    sp_kernel_radii(grid, sp_kernel_sigma(&view->filter), radius);
    *reach = (double)d->ewa->radius * radius[1] / d->ewa->unit;
    double thickness =
        sp_depth_thickness(d->ewa, view->compositing.slab * spacing / d->ewa->unit, *reach);
    double most = fmin(SP_SLOTS_MAX, (double)(ROW_BYTES / sums_bytes(&d->blend)) / d->grid.columns);
    thickness = fmax(thickness, 2 * *reach / (most - 3));
    d->blend.slots = (uint32_t)ceil(2 * *reach / thickness) + 2;
    d->blend.thickness = (float)thickness;
}

static bool choose_order(struct draw *d, struct cpu_state *state, unsigned axis, double reach,
                         struct sp_error *err) {
    double nearest = 0;
    struct sp_depth_job job = { .frame = d->ewa,
                                .list = &d->level->visible,
                                .level = d->finest,
                                .is_enlarged = is_enlarged(d),
                                .thickness = SPLAT_RANGE,
                                .reach = reach,
                                .pool = d->pool,
                                .arena = &state->arena };
    if (d->blend.mode == SP_COMPOSITE_SHEET)
        return sp_order_sheets(&d->camera, d->levels, &d->detail, axis, &state->arena, &d->order) ||
               fail_memory(&state->arena, err);
    if (d->blend.mode == SP_COMPOSITE_SLAB)
        job.thickness = (double)d->blend.thickness;
    if (!sp_order_distance(&job, &d->order, &nearest))
        return fail_memory(&state->arena, err);
    d->blend.nearest = (float)nearest;
    return true;
}

static bool choose_shading(struct draw *d, struct sp_arena *arena, struct sp_error *err) {
    const struct sp_view *view = d->job->view;
    if (view->shading.mode == SP_SHADING_PHONG) {
        sp_shade_init(&d->shade, &d->camera, &view->shading);
        d->shading = &d->shade;
    }
    if (!d->blend.post)
        return true;
    struct sp_gradient_grid gradient;
    double(*integral)[4] =
        sp_arena_alloc(arena, "transfer function's integral", SP_POST_NODES + 1, sizeof *integral);
    if (!integral)
        return fail_memory(arena, err);
    const struct sp_volume_info *info = sp_volume_info(d->job->volume);
    sp_gradient_units_init(&gradient, info);
    d->post = (struct sp_post){ .shade = d->shading,
                                .half = (float)(0.5 * (double)d->blend.thickness * d->ewa->unit *
                                                gradient.unit),
                                .perspective = view->camera.projection == SP_PERSPECTIVE,
                                .focal = (float)d->camera.scale,
                                .centre = { d->ewa->centre[0], d->ewa->centre[1] } };
    for (int r = 0; r < 3; r++)
        for (int k = 0; k < 3; k++)
            d->post.to_camera[r][k] = (float)d->camera.w.m[r][k];
    sp_post_curve_init(&d->post.curve, &view->transfer_function, info->range,
                       sp_transfer_base(&d->level->transfer), gradient.unit, integral);
    d->shading = NULL; /* pixels are shaded, not voxels */
    return true;
}

/* What every path draws: the level, and constants of the frame. *axis: of the sheets. */
static bool choose_level(struct draw *d, struct cpu_state *state, unsigned *sheets_axis,
                         struct sp_error *err) {
    const struct sp_view *view = d->job->view;
    const struct sp_grid *grid = &sp_volume_info(d->job->volume)->grid;
    bool is_post = view->transfer_function.order == SP_TF_POST;
    /* A scalar averaged over 4³ voxels is another object to the transfer function. */
    d->mip_level = is_post && d->job->mip_level > 1 ? 1 : d->job->mip_level;
    sp_camera_frame_init(&d->camera, &view->camera, view->size);
    unsigned axis = view->compositing.mode == SP_COMPOSITE_SHEET
                        ? sp_slices_major_axis(&d->camera, grid)
                        : SP_NO_AXIS;
    struct sp_classify_job classify = { .tf = &view->transfer_function,
                                        .levels = 1,
                                        .axis = axis,
                                        .normals = view->shading.mode == SP_SHADING_PHONG ||
                                                   view->transfer_function.gradient_count > 0 ||
                                                   is_post,
                                        .reach = sp_kernel_reach(&view->filter),
                                        .bytes_max = state->cache.limit_bytes,
                                        .pool = d->pool,
                                        .cancel = d->job->cancel,
                                        .pause = d->job->pause };
    d->has_filters = state->kernels.has_fast_path && sp_postconv_can_draw(view, grid);
    if (!choose_levels(d, &state->arena, err))
        return false;
    classify.levels = levels_drawn(d);
    const struct sp_classification *classification =
        sp_classify_cache_get(&state->cache, d->job->volume, &classify, err);
    if (!classification)
        return false;
    d->visible = classification->visible;
    d->levels = classification->levels;
    *sheets_axis = axis;
    return make_parts(d, &state->arena, err);
}

/* The rest of what is between the view and the first batch. */
static bool prepare(struct draw *d, struct cpu_state *state, unsigned axis, struct sp_error *err) {
    d->grid.columns = (d->ewa->size[0] + SP_TILE - 1) / SP_TILE;
    double reach;
    choose_blend(d, state, &reach);
    return choose_shading(d, &state->arena, err) && choose_order(d, state, axis, reach, err) &&
           allocate(d, &state->arena, err);
}

static bool all_saturated(const struct draw *d) {
    for (uint32_t t = 0; t < d->bins.tiles; t++)
        if (!d->grid.tiles[t].saturated)
            return false;
    return true;
}

/* Draws the rows of tiles from picture row y on. */
static void draw_band(struct draw *d, int y) {
    int left = (d->ewa->size[1] - y + SP_TILE - 1) / SP_TILE;
    d->grid.rows = left < d->grid.rows ? left : d->grid.rows;
    d->grid.y = y;
    int end = y + d->grid.rows * SP_TILE;
    set_rows(d, y, end < d->ewa->size[1] ? end : d->ewa->size[1]);
    d->bins.tiles = (uint32_t)(d->grid.columns * d->grid.rows);
    for (int r = 0; r < d->grid.rows; r++)
        for (int c = 0; c < d->grid.columns; c++)
            sp_tile_init(&d->grid.tiles[r * d->grid.columns + c], c * SP_TILE, y + r * SP_TILE,
                         d->ewa->size, &d->blend);
    uint64_t run = 0;
    uint32_t layer = 0, count;
    while (!is_cancelled(d) && !all_saturated(d) && (count = make_batch(d, &run, &layer)) > 0) {
        double clock = sp_job_clock_ms(d->job);
        sp_parallel_for(d->pool, count, 1, splat_blocks, d);
        for (uint32_t b = 0; b < count; b++) {
            d->splats += d->blocks[b].count;
            d->fragments += d->blocks[b].fragments;
        }
        add_time(d, SPLAT, clock);
        add_batch(d, count);
    }
    double clock = sp_job_clock_ms(d->job);
    sp_parallel_for(d->pool, d->bins.tiles, 4, resolve_tiles, d);
    add_time(d, RESOLVE, clock);
}

static void write_stats(const struct draw *d, struct sp_frame_stats *stats) {
    static const char *const names[STAGES] = { "classify", "splat", "bin", "tile", "resolve" };
    stats->mip_level = d->mip_level;
    stats->visible_voxels = d->mip_level ? d->level->visible.count : d->visible;
    stats->splats = d->splats;
    stats->fragments = (uint64_t)d->fragments;
    stats->stage_count = STAGES;
    for (int i = 0; i < STAGES; i++)
        stats->stages[i] = (struct sp_stage_time){ names[i], d->stage_ms[i] };
}

/* Post-convolved: see sheets.h; *drawn says whether that pays. */
static bool draw_sheets(struct draw *d, struct cpu_state *state, unsigned axis, bool *drawn,
                        struct sp_error *err) {
    const struct sp_view *view = d->job->view;
    struct sp_frame_stats *stats = &d->job->frame->stats;
    if (view->shading.mode == SP_SHADING_PHONG)
        sp_shade_init(&d->shade, &d->camera, &view->shading);
    struct sp_postconv_input frame = { .view = view,
                                       .frame = d->job->frame,
                                       .interrupt = sp_job_interrupt(d->job),
                                       .tables = &state->postconv,
                                       .camera = &d->camera,
                                       .shade = view->shading.mode == SP_SHADING_PHONG ? &d->shade
                                                                                       : NULL,
                                       .grid = &d->levels[0].grid,
                                       .parts = d->parts,
                                       .detail = &d->detail,
                                       .axis = axis,
                                       .classify_ms = d->stage_ms[CLASSIFY],
                                       .draw_tile = state->kernels.postconv_tile,
                                       .pool = d->pool,
                                       .arena = &state->arena };
    struct sp_postconv postconv;
    if (!sp_postconv_prepare(&frame, &postconv, err))
        return false;
    *drawn = sp_postconv_is_worthwhile(&postconv);
    d->stage_ms[SPLAT] += postconv.prepare_ms;
    if (!*drawn)
        return true;
    stats->mip_level = d->mip_level;
    stats->visible_voxels = d->mip_level ? d->level->visible.count : d->visible;
    return sp_postconv_draw(&frame, &postconv, err);
}

bool cpu_draw(struct cpu_state *state, const struct sp_backend_job *job, struct sp_error *err) {
    struct draw d = { .job = job, .kernels = &state->kernels, .pool = state->pool };
    double clock = sp_job_clock_ms(job);
    unsigned axis;
    sp_arena_reset(&state->arena);
    if (!choose_level(&d, state, &axis, err))
        return false;
    add_time(&d, CLASSIFY, clock);
    bool drawn = false;
    if (d.has_filters && !draw_sheets(&d, state, axis, &drawn, err))
        return false;
    if (drawn)
        return true;
    clock = sp_job_clock_ms(job);
    if (!prepare(&d, state, axis, err))
        return false;
    add_time(&d, CLASSIFY, clock);
    int step = d.grid.rows * SP_TILE;
    for (int y = 0; y < d.ewa->size[1] && !is_cancelled(&d); y += step)
        draw_band(&d, y);
    if (is_cancelled(&d))
        return sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
    write_stats(&d, &job->frame->stats);
    return true;
}
