/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <string.h>

#include "draw/layers/splat_list/draw.h"

#include "data/volume/grid.h"

enum {
    BLOCK = 1024,       /* voxels that one worker sets up at a time */
    BATCH_BLOCKS = 128, /* blocks that are set up before tiles are drawn */
    BAND_TILES = 2304,  /* larger images are drawn in bands */
    ENTRIES_MIN = 1 << 19
};

/* The optical depth of an opaque voxel: no light from behind its cell counts. */
static const double opaque_depth = 8;

static bool fail_cancelled(struct sp_error *err) {
    return sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
}

/* The tiles of some rows of the image, and the splats that lie on them. */
struct band {
    const struct sp_voxel_input *input;
    struct sp_voxel_source *source;
    int columns, rows, y;             /* of tiles; first row of the image */
    uint32_t tiles, blocks;           /* blocks of the batch */
    uint32_t begin;                   /* first voxel of the batch, in the order */
    struct sp_voxel_record *records;  /* [blocks · BLOCK] */
    uint32_t *written;                /* by block */
    double *areas;                    /* the same, px */
    uint32_t *counts;                 /* [blocks][tiles] */
    uint32_t *first, *entries;        /* as in struct sp_voxel_layer */
    uint32_t capacity;                /* of entries */
    struct sp_voxel_tile *tiles_open; /* [tiles], or one per worker: is_single */
    bool *closed;                     /* [tiles] */
    bool is_single;         /* one part has all splats of the band: tiles need not be kept */
    bool is_first, is_last; /* batch of the band */
    uint64_t drawn;
    double area;
};

/* Cancelled, or out of memory. */
static bool is_ended(const struct band *b) {
    return b->input->arena->failed || sp_interrupt_is_cancelled(&b->input->interrupt);
}

static bool is_cancelled(const struct band *b) {
    return sp_interrupt_is_cancelled(&b->input->interrupt);
}

/* Tiles that a record touches: columns [c0, c1], rows [r0, r1]. */
struct span {
    unsigned c0, r0, c1, r1;
};

static inline struct span compute_span(const struct band *b, const struct sp_voxel_record *r) {
    return (struct span){ (unsigned)r->x0 / SP_VOXEL_TILE, (unsigned)(r->y0 - b->y) / SP_VOXEL_TILE,
                          (unsigned)(r->x1 - 1) / SP_VOXEL_TILE,
                          (unsigned)(r->y1 - 1 - b->y) / SP_VOXEL_TILE };
}

/* Counts the tiles of a span. Most have at most two columns and rows: these are counted without
 * branches, which would be hard to predict. */
static inline void count_span(uint32_t *counts, unsigned columns, const struct span *s) {
    const unsigned wide = s->c1 - s->c0, high = s->r1 - s->r0;
    if (wide < 2 && high < 2) {
        uint32_t *above = counts + s->r0 * columns + s->c0, *below = above + high * columns;
        above[0]++;
        above[wide] += wide;
        below[0] += high;
        below[wide] += wide & high;
        return;
    }
    for (unsigned r = s->r0; r <= s->r1; r++)
        for (unsigned c = s->c0; c <= s->c1; c++)
            counts[r * columns + c]++;
}

/* Pixels inside the footprint; of a kernel around the eye, `area` is another number, and its box is
 * used. */
static inline double compute_area(const struct sp_voxel_frame *frame,
                                  const struct sp_voxel_record *r) {
    if (!frame->has_streaks && sp_close_is_around(&r->close))
        return (double)(r->x1 - r->x0) * (r->y1 - r->y0);
    return (double)r->area;
}

/* Sets up blocks of voxels and counts on how many tiles their splats lie. */
static void set_up_blocks(void *user, size_t begin, size_t end, unsigned worker) {
    struct band *b = user;
    const unsigned columns = (unsigned)b->columns;
    (void)worker;
    for (size_t n = begin; n < end && !is_cancelled(b); n++) {
        uint32_t at = b->begin + (uint32_t)n * BLOCK, left = b->source->order.count - at;
        const struct sp_voxel_record *records = b->records + n * BLOCK;
        uint32_t *counts = b->counts + n * b->tiles;
        double area = 0;
        b->written[n] =
            b->source->set_up(&b->source->frame, b->source->from, b->source->order.voxels + at,
                              left < BLOCK ? left : BLOCK, b->records + n * BLOCK);
        memset(counts, 0, b->tiles * sizeof *counts);
        for (uint32_t i = 0; i < b->written[n]; i++) {
            struct span s = compute_span(b, &records[i]);
            area += compute_area(&b->source->frame, &records[i]);
            count_span(counts, columns, &s);
        }
        b->areas[n] = area;
    }
}

static void fill_blocks(void *user, size_t begin, size_t end, unsigned worker) {
    struct band *b = user;
    const unsigned columns = (unsigned)b->columns;
    (void)worker;
    for (size_t n = begin; n < end && !is_cancelled(b); n++) {
        uint32_t *next = b->counts + n * b->tiles;
        for (uint32_t i = 0; i < b->written[n]; i++) {
            struct span s = compute_span(b, &b->records[n * BLOCK + i]);
            for (unsigned r = s.r0; r <= s.r1; r++)
                for (unsigned c = s.c0; c <= s.c1; c++)
                    b->entries[next[r * columns + c]++] = (uint32_t)(n * BLOCK) + i;
        }
    }
}

/* Turns the counts of blocks [begin, end) into starts. Both loops over them read memory in order.
 */
static void sum_counts(struct band *b, uint32_t begin, uint32_t end) {
    uint32_t *next = b->first + 1; /* by tile: where its next block starts, then where it ends */
    memset(b->first, 0, (b->tiles + (size_t)1) * sizeof *b->first);
    for (uint32_t n = begin; n < end; n++)
        for (uint32_t t = 0; t + 1 < b->tiles; t++)
            next[t + 1] += b->counts[(size_t)n * b->tiles + t];
    for (uint32_t t = 1; t < b->tiles; t++)
        next[t] += next[t - 1];
    for (uint32_t n = begin; n < end; n++)
        for (uint32_t t = 0; t < b->tiles; t++) {
            uint32_t *count = &b->counts[(size_t)n * b->tiles + t], had = *count;
            *count = next[t];
            next[t] += had;
        }
}

static uint64_t block_total(const struct band *b, uint32_t block) {
    uint64_t total = 0;
    for (uint32_t t = 0; t < b->tiles; t++)
        total += b->counts[(size_t)block * b->tiles + t];
    return total;
}

/* Fills a tile without splats: the background, line by line. */
static void fill_empty(const struct band *b, int x, int y) {
    struct sp_frame *image = b->input->frame;
    static const float one[SP_VOXEL_TILE] = { [0 ... SP_VOXEL_TILE - 1] = 1 };
    static const float none[SP_VOXEL_TILE] = { 0 };
    const float *const planes[4] = { one, none, none, none };
    const float *background = b->input->view->background;
    float line[4 * SP_VOXEL_TILE];
    size_t pixel = image->format == SP_RGBAF32 ? 16 : 4;
    int left = (int)image->width - x, below = (int)image->height - y;
    uint32_t n = (uint32_t)(left < SP_VOXEL_TILE ? left : SP_VOXEL_TILE);
    if (image->format == SP_RGBAF32)
        sp_resolve_rgbaf32(planes, n, background, line);
    else
        sp_resolve_rgba8(planes, n, background, (unsigned char *)line);
    for (int row = 0; row < SP_VOXEL_TILE && row < below; row++)
        memcpy((char *)image->pixels + (size_t)(y + row) * image->stride_bytes + pixel * (size_t)x,
               line, n * pixel);
    for (int row = 0; image->depth && row < SP_VOXEL_TILE && row < below; row++) {
        float *depth = sp_depth_row(image, image->depth, (size_t)(y + row)) + x;
        for (uint32_t i = 0; i < n; i++)
            depth[i] = INFINITY;
        memset(sp_depth_row(image, image->spread, (size_t)(y + row)) + x, 0, n * sizeof *depth);
    }
}

static void draw_tiles(void *user, size_t begin, size_t end, unsigned worker) {
    struct band *b = user;
    const struct sp_voxel_kernels *kernels = b->input->kernels;
    for (size_t t = begin; t < end && !is_cancelled(b); t++) {
        struct sp_voxel_tile *tile = &b->tiles_open[b->is_single ? worker : t];
        int x = (int)(t % (size_t)b->columns) * SP_VOXEL_TILE;
        int y = b->y + (int)(t / (size_t)b->columns) * SP_VOXEL_TILE;
        uint32_t first = b->first[t], count = b->first[t + 1] - first;
        if (b->is_first && b->is_last && !count) {
            fill_empty(b, x, y);
            continue;
        }
        if (b->is_first)
            kernels->start(tile, x, y, b->source->frame.ewa.size, b->input->frame->depth);
        kernels->add(tile, &b->source->frame, b->records, b->entries + first, count);
        if (b->is_last)
            kernels->resolve(tile, b->input->view->background, b->input->frame);
    }
}

/* Sets up the next batch of the band. */
static void begin_batch(struct band *b, uint32_t begin) {
    uint32_t left = (b->source->order.count - begin + BLOCK - 1) / BLOCK;
    b->begin = begin;
    b->blocks = left < BATCH_BLOCKS ? left : BATCH_BLOCKS;
    sp_parallel_for(b->input->pool, b->blocks, 1, set_up_blocks, b);
    for (uint32_t n = 0; n < b->blocks && !is_cancelled(b); n++) {
        b->drawn += b->written[n];
        b->area += b->areas[n];
    }
}

/* Notes which tiles are closed; returns true if all are. */
static bool note_closed(struct band *b) {
    uint32_t count = 0;
    for (uint32_t t = 0; t < b->tiles; t++)
        count += b->closed[t] = b->tiles_open[t].open_count == 0;
    b->source->frame.closed = count ? b->closed : NULL;
    return count == b->tiles;
}

/* The parts of a batch add to the same tiles, so that one tile per worker is not enough. */
static bool open_all_tiles(struct band *b) {
    b->tiles_open = sp_arena_alloc(b->input->arena, "tiles", b->tiles, sizeof *b->tiles_open);
    b->is_single = false;
    return b->tiles_open;
}

/* Draws the batch, in as many parts as the entries need: one splat may cover all tiles. */
static void draw_batch(struct band *b, bool is_last) {
    for (uint32_t begin = 0, end; begin < b->blocks || !b->blocks; begin = end) {
        uint64_t total = 0;
        for (end = begin; end < b->blocks; end++) {
            total += block_total(b, end);
            if (end > begin && total > b->capacity)
                break;
        }
        if (b->is_single && end < b->blocks && !open_all_tiles(b))
            return;
        sum_counts(b, begin, end);
        struct band part = *b; /* the workers count blocks from its first one on */
        part.counts += (size_t)begin * b->tiles;
        part.written += begin;
        part.records += (size_t)begin * BLOCK;
        sp_parallel_for(b->input->pool, end - begin, 1, fill_blocks, &part);
        if (is_cancelled(b))
            return; /* some entries were not written */
        part.is_last = is_last && end == b->blocks;
        sp_parallel_for(b->input->pool, b->tiles, 1, draw_tiles, &part);
        b->is_first = false;
        if (!b->blocks)
            return;
    }
}

static void resolve_tiles(void *user, size_t begin, size_t end, unsigned worker) {
    struct band *b = user;
    (void)worker;
    for (size_t t = begin; t < end; t++)
        b->input->kernels->resolve(&b->tiles_open[t], b->input->view->background, b->input->frame);
}

static void draw_band(struct band *b, int y, int rows) {
    uint32_t count = b->source->order.count, begin = 0;
    b->y = y;
    b->rows = rows;
    b->tiles = (uint32_t)(rows * b->columns);
    b->source->frame.ewa.rows[0] = y;
    b->source->frame.ewa.rows[1] = y + rows * SP_VOXEL_TILE < b->source->frame.ewa.size[1]
                                       ? y + rows * SP_VOXEL_TILE
                                       : b->source->frame.ewa.size[1];
    b->is_first = true;
    b->source->frame.closed = NULL;
    do {
        begin_batch(b, begin);
        begin += b->blocks * BLOCK;
        if (is_cancelled(b))
            return;
        draw_batch(b, begin >= count);
        if (is_ended(b))
            return;
        if (begin < count && note_closed(b)) {
            sp_parallel_for(b->input->pool, b->tiles, 4, resolve_tiles, b);
            return;
        }
    } while (begin < count);
}

/* Distances and local spacings along the axes of a rectilinear grid [mean spacings]. */
static bool init_places(struct sp_voxel_frame *frame, const struct sp_grid *grid,
                        struct sp_arena *arena) {
    frame->is_rectilinear = sp_grid_is_rectilinear(grid);
    for (unsigned a = 0; frame->is_rectilinear && a < 3; a++) {
        uint32_t n = grid->dims[a];
        float *place = sp_arena_alloc(arena, "coordinates", n, sizeof *place);
        float *size = sp_arena_alloc(arena, "coordinates", n, sizeof *size);
        if (!place || !size)
            return false;
        for (uint32_t i = 0; i < n; i++) {
            place[i] = (float)(sp_grid_distance(grid, a, i) / grid->spacing[a]);
            size[i] = (float)(sp_grid_local_spacing(grid, a, i) / grid->spacing[a]);
        }
        frame->place[a] = place;
        frame->size[a] = size;
    }
    return true;
}

/* Makes streaks as long as the cells of a rectilinear grid are along them. */
static void fit_streaks(const struct sp_grid *grid, struct sp_voxel_frame *frame) {
    struct sp_mat3 direction;
    double determinant;
    memcpy(direction.m, grid->direction, sizeof direction.m);
    const struct sp_mat3 inverse = sp_mat3_inverse(&direction, &determinant);
    for (int a = 0; a < 3; a++)
        for (int c = 0; c < 3; c++)
            frame->streaks.to_grid[a][c] =
                (float)(inverse.m[a][c] * frame->ewa.unit / grid->spacing[a]);
}

void sp_voxel_init_streaks(const struct sp_layer *layer, const struct sp_camera_transform *camera,
                           struct sp_voxel_frame *frame) {
    const float stretch = (float)layer->stretch;
    struct sp_streaks *s = &frame->streaks;
    frame->has_streaks = true;
    for (int r = 0; r < 3; r++) {
        for (int a = 0; a < 3; a++)
            s->to_camera[r][a] = (float)camera->w.m[r][a];
        s->color[r] = layer->color[r];
    }
    s->widen = stretch * stretch - 1;
    s->length = SP_STREAK_PERIOD * stretch;
    s->phase = (float)(layer->phase - floor(layer->phase));
    s->blends = layer->style == SP_VECTORS_BLEND;
}

static bool init_frame(const struct sp_voxel_input *input, struct sp_voxel_frame *frame) {
    const struct sp_grid *grid = input->grid;
    struct sp_filter filter = input->view->filter;
    const bool has_streaks = input->layer->type == SP_LAYER_VECTORS;
    bool is_flat = !has_streaks && input->layer->detail == SP_SHELL_FAST;
    *frame = (struct sp_voxel_frame){
        .mode = is_flat ? SP_FILTER_NONE : SP_FILTER_EWA,
        .shade = has_streaks ? NULL : input->shade, /* vectors have no normals */
        .linear = input->view->compositing.attenuation == SP_ATTENUATION_LINEAR,
        .opaque = is_flat ? 64 : (float)opaque_depth,
        .apart = 1,
    };
    filter.kernel = SP_KERNEL_GAUSSIAN;
    sp_ewa_frame_init(&frame->ewa, input->camera, grid, input->view, &filter);
    frame->ewa.post = false;
    if (has_streaks)
        sp_voxel_init_streaks(input->layer, input->camera, frame);
    if (has_streaks)
        fit_streaks(grid, frame);
    return init_places(frame, grid, input->arena);
}

static bool init_source(const struct sp_voxel_input *input, struct sp_voxel_source *source,
                        struct sp_error *err) {
    if (input->source) {
        *source = *input->source;
        return true;
    }
    *source = (struct sp_voxel_source){ .set_up = input->kernels ? input->kernels->set_up : NULL,
                                        .from = input->list,
                                        .count = input->list->count };
    struct sp_voxel_order_job sort = { .list = input->list,
                                       .camera = input->camera,
                                       .grid = input->grid,
                                       .keeps_hidden = input->keeps_hidden,
                                       .by_depth = input->by_depth,
                                       .pool = input->pool,
                                       .arena = input->arena,
                                       .interrupt = &input->interrupt };
    if (!init_frame(input, &source->frame) || !sp_voxel_sort(&sort, &source->order))
        return sp_arena_fail(input->arena, "data", err);
    return !sp_interrupt_is_cancelled(&input->interrupt) || fail_cancelled(err);
}

static bool allocate(struct band *b, uint32_t tiles) {
    struct sp_arena *arena = b->input->arena;
    uint32_t blocks = (b->source->order.count + BLOCK - 1) / BLOCK;
    b->is_single = blocks <= BATCH_BLOCKS;
    b->blocks = blocks < BATCH_BLOCKS ? blocks : BATCH_BLOCKS;
    b->capacity = tiles * BLOCK > ENTRIES_MIN ? tiles * BLOCK : ENTRIES_MIN;
    unsigned held = b->is_single ? sp_pool_threads(b->input->pool) : tiles;
    b->records = sp_arena_alloc(arena, "splats", (size_t)b->blocks * BLOCK, sizeof *b->records);
    b->written = sp_arena_alloc(arena, "blocks", b->blocks, sizeof *b->written);
    b->areas = sp_arena_alloc(arena, "blocks", b->blocks, sizeof *b->areas);
    b->counts = sp_arena_alloc(arena, "bin counts", (size_t)b->blocks * tiles, sizeof *b->counts);
    b->first = sp_arena_alloc(arena, "bins", tiles + (size_t)1, sizeof *b->first);
    b->entries = sp_arena_alloc(arena, "bin entries", b->capacity, sizeof *b->entries);
    b->tiles_open = sp_arena_alloc(arena, "tiles", held, sizeof *b->tiles_open);
    b->closed = sp_arena_alloc(arena, "tiles", tiles, sizeof *b->closed);
    b->source->frame.columns = b->columns;
    return !arena->failed;
}

static void write_stats(const struct band *b, const double ms[3]) {
    struct sp_frame_stats *stats = &b->input->frame->stats;
    stats->mip_level = b->source->mip_level;
    stats->visible_voxels = b->source->count;
    stats->splats = b->drawn;
    stats->fragments = (uint64_t)b->area;
    stats->stage_count = 2;
    stats->stages[0] = (struct sp_stage_time){ "classify", ms[1] - ms[0] };
    stats->stages[1] = (struct sp_stage_time){ "tile", ms[2] - ms[1] };
}

bool sp_voxel_draw(const struct sp_voxel_input *input, struct sp_error *err) {
    struct sp_voxel_source source;
    struct band b = { .input = input, .source = &source };
    double ms[3] = { sp_interrupt_clock_ms(&input->interrupt) };
    if (!init_source(input, &source, err))
        return false;
    ms[1] = sp_interrupt_clock_ms(&input->interrupt);
    int rows = (source.frame.ewa.size[1] + SP_VOXEL_TILE - 1) / SP_VOXEL_TILE, step;
    b.columns = (source.frame.ewa.size[0] + SP_VOXEL_TILE - 1) / SP_VOXEL_TILE;
    step = BAND_TILES / b.columns < rows ? BAND_TILES / b.columns : rows;
    if (!allocate(&b, (uint32_t)(step * b.columns)))
        return sp_arena_fail(input->arena, "data", err);
    for (int row = 0; row < rows && !is_ended(&b); row += step)
        draw_band(&b, row * SP_VOXEL_TILE, row + step < rows ? step : rows - row);
    if (is_cancelled(&b))
        return fail_cancelled(err);
    if (input->arena->failed)
        return sp_arena_fail(input->arena, "data", err);
    ms[2] = sp_interrupt_clock_ms(&input->interrupt);
    write_stats(&b, ms);
    return true;
}

static bool bin_all(struct sp_voxel_layer *layer, struct band *b, struct sp_error *err) {
    struct sp_arena *arena = b->input->arena;
    b->blocks = (b->source->order.count + BLOCK - 1) / BLOCK;
    b->tiles = (uint32_t)(b->columns * b->rows);
    b->records = sp_arena_alloc(arena, "splats", (size_t)b->blocks * BLOCK, sizeof *b->records);
    b->written = sp_arena_alloc(arena, "blocks", b->blocks, sizeof *b->written);
    b->areas = sp_arena_alloc(arena, "blocks", b->blocks, sizeof *b->areas);
    b->counts =
        sp_arena_alloc(arena, "bin counts", (size_t)b->blocks * b->tiles, sizeof *b->counts);
    b->first = sp_arena_alloc(arena, "bins", b->tiles + (size_t)1, sizeof *b->first);
    if (arena->failed)
        return sp_arena_fail(arena, "data", err);
    sp_parallel_for(b->input->pool, b->blocks, 1, set_up_blocks, b);
    if (is_cancelled(b))
        return fail_cancelled(err);
    uint64_t total = 0;
    for (uint32_t n = 0; n < b->blocks; n++) {
        total += block_total(b, n);
        layer->drawn += b->written[n];
        layer->area += b->areas[n];
    }
    b->entries = total > UINT32_MAX
                     ? NULL
                     : sp_arena_alloc(arena, "bin entries", total + 1, sizeof *b->entries);
    if (!b->entries)
        return sp_arena_fail(arena, "data", err);
    sum_counts(b, 0, b->blocks);
    sp_parallel_for(b->input->pool, b->blocks, 1, fill_blocks, b);
    return !is_cancelled(b) || fail_cancelled(err);
}

bool sp_voxel_source_acquire(const struct sp_voxel_input *input, struct sp_voxel_layer *layer,
                             struct sp_error *err) {
    *layer = (struct sp_voxel_layer){ .input = input };
    return init_source(input, &layer->source, err);
}

bool sp_voxel_prepare(const struct sp_voxel_input *input, struct sp_voxel_layer *layer,
                      struct sp_error *err) {
    if (!sp_voxel_source_acquire(input, layer, err))
        return false;
    struct band b = { .input = input,
                      .source = &layer->source,
                      .columns =
                          (layer->source.frame.ewa.size[0] + SP_VOXEL_TILE - 1) / SP_VOXEL_TILE,
                      .rows =
                          (layer->source.frame.ewa.size[1] + SP_VOXEL_TILE - 1) / SP_VOXEL_TILE };
    if (!bin_all(layer, &b, err))
        return false;
    layer->columns = b.columns;
    layer->rows = b.rows;
    layer->records = b.records;
    layer->first = b.first;
    layer->entries = b.entries;
    return true;
}

void sp_voxel_tile(const struct sp_voxel_layer *layer, int column, int row,
                   struct sp_fragment_tile *tile) {
    uint32_t t = (uint32_t)(row * layer->columns + column), first = layer->first[t];
    layer->input->kernels->merge(tile, &layer->source.frame, layer->records, layer->entries + first,
                                 layer->first[t + 1] - first);
}
