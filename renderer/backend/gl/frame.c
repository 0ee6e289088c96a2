/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/frame.h"

#include <math.h>
#include <string.h>

#include "base/clock.h"
#include "splat/adaptive.h"
#include "tile/order.h"

_Static_assert(2 * (int)SP_LEVELS <= (int)GL_PARTS, "a part for each level, enlarged or not");

/* A brick that is drawn. */
struct gl_item {
    uint32_t brick, count; /* of its level; entries */
    uint32_t near, far;    /* layers that it may have entries in: [near, far] */
    uint8_t level;
    bool is_enlarged;
};

static bool fail_memory(const struct sp_arena *arena, struct sp_error *err) {
    return sp_fail(err, SP_ERR_MEMORY, "", "no memory for the frame's %s",
                   arena->failed ? arena->failed : "data");
}

/* The cut of levels that the frame is drawn with. */
static bool choose_levels(struct gl_frame *f, const struct sp_backend_job *job,
                          struct sp_arena *arena) {
    const struct sp_grid *grid = &sp_volume_info(job->volume)->grid;
    unsigned levels = sp_detail_levels(grid->dims, SP_LEVELS);
    struct sp_detail_job detail = { .camera = &f->camera,
                                    .grid = grid,
                                    .view = job->view,
                                    .floor = f->coarse,
                                    .levels = levels > f->coarse ? levels : f->coarse + 1 };
    if (!sp_detail_choose(&detail, arena, &f->detail))
        return false;
    f->finest = (unsigned)__builtin_ctz(f->detail.levels);
    return true;
}

static bool get_lists(struct gl_frame *f, const struct sp_backend_job *job,
                      const struct gl_sources *from, struct sp_error *err) {
    const struct sp_view *view = job->view;
    struct sp_classify_job classify = { .tf = &view->transfer_function,
                                        .levels = f->detail.levels,
                                        .axis = SP_NO_AXIS, /* any will do */
                                        .normals = view->shading.mode == SP_SHADING_PHONG ||
                                                   view->transfer_function.gradient_count > 0,
                                        .reach = sp_kernel_reach(&view->filter),
                                        .bytes_max = from->cache->limit_bytes,
                                        .pool = from->pool,
                                        .cancel = job->cancel };
    const struct sp_classification *c =
        sp_classify_cache_get(from->cache, job->volume, &classify, err);
    if (!c)
        return false;
    f->visible = c->visible;
    f->levels = c->levels;
    gl_lists_begin(from->lists);
    for (unsigned l = 0; f->detail.levels >> l; l++)
        if (f->detail.levels >> l & 1) {
            f->lists[l] = gl_lists_get(from->lists, job->volume, &c->levels[l], from->pool, err);
            if (!f->lists[l])
                return false;
        }
    return true;
}

static void write_part(struct gl_part *to, const struct sp_ewa_frame *e, unsigned level) {
    for (int r = 0; r < 3; r++) {
        memcpy(to->step[r], e->step[r], sizeof e->step[r]);
        memcpy(to->kernel[r], e->kernel[r], sizeof e->kernel[r]);
    }
    memcpy(to->view, (float[]){ e->scale, e->centre[0], e->centre[1], e->near }, sizeof to->view);
    memcpy(to->footprint, (float[]){ e->lowpass2, e->radius, e->cut, e->peak },
           sizeof to->footprint);
    memcpy(to->bounds, (float[]){ e->gain, e->flat, e->ratio_max[0], e->ratio_max[1] },
           sizeof to->bounds);
    to->kind[0] = level;
    to->kind[1] = sp_grid_is_rectilinear(e->grid);
}

/* Filters by brick of a level. Of one that is small enough it is the one that its voxels would
 * have. */
static bool choose_modes(struct gl_frame *f, const struct sp_view *view, unsigned level,
                         bool enlarged, struct sp_arena *arena) {
    struct sp_adaptive adaptive;
    struct sp_view own = *view;
    const struct sp_grid *grid = &f->levels[level].grid;
    uint8_t *modes = sp_arena_alloc(arena, "filter modes", sp_adaptive_count(grid), 1);
    if (!modes)
        return false;
    if (!enlarged)
        own.filter.sigma = ldexp(own.filter.sigma, -(int)level);
    sp_adaptive_init(&adaptive, &f->camera, grid, &own);
    sp_adaptive_fill(&adaptive, modes);
    f->modes[level][enlarged] = modes;
    return true;
}

static bool make_parts(struct gl_frame *f, const struct sp_view *view, struct sp_arena *arena) {
    for (unsigned l = 0; f->detail.levels >> l; l++)
        for (int enlarged = 0; f->detail.levels >> l & 1 && enlarged < 2; enlarged++) {
            struct sp_view own = *view;
            own.filter = sp_detail_filter(&view->filter, l, enlarged);
            sp_ewa_frame_init(&f->ewa[l][enlarged], &f->camera, &f->levels[l].grid, &own);
            write_part(&f->constants.parts[2 * l + (unsigned)enlarged], &f->ewa[l][enlarged], l);
            if (view->filter.mode == SP_FILTER_ADAPTIVE &&
                !choose_modes(f, view, l, enlarged, arena))
                return false;
        }
    return true;
}

static void write_constants(struct gl_frame *f, const struct sp_view *view) {
    struct gl_constants *c = &f->constants;
    bool is_lit = view->shading.mode == SP_SHADING_PHONG;
    struct sp_shade shade;
    sp_shade_init(&shade, &f->camera, &view->shading);
    for (int r = 0; r < 3; r++)
        memcpy(c->to_camera[r], shade.to_camera[r], sizeof shade.to_camera[r]);
    memcpy(c->phong, (float[]){ shade.ambient, shade.diffuse, shade.specular, shade.exponent },
           sizeof c->phong);
    c->glint[0] = shade.glint_width;
    c->glint[1] = shade.glint_gain;
    for (int i = 0; i < shade.light_count; i++) {
        memcpy(c->lights[i].direction, shade.lights[i].direction, sizeof(float[3]));
        memcpy(c->lights[i].world, shade.lights[i].world, sizeof(float[3]));
        memcpy(c->lights[i].color, shade.lights[i].color, sizeof(float[3]));
    }
    c->choice[0] = view->camera.projection == SP_PERSPECTIVE;
    c->choice[1] = is_lit;
    c->choice[2] = (uint32_t)shade.light_count;
    c->choice[3] = f->layer_count;
    c->picture[0] = view->size[0];
    c->picture[1] = view->size[1];
    c->picture[2] = f->axis;
}

/* Where the layers of a brick lie in the order. */
static void find_layers(const struct gl_frame *f, struct gl_item *item) {
    const struct sp_level *level = &f->levels[item->level];
    uint32_t corner[3], first, dim = level->grid.dims[f->axis];
    sp_visible_corner(&level->visible, item->brick, corner);
    first = corner[f->axis];
    item->near = UINT32_MAX;
    item->far = 0;
    for (uint32_t s = first; s < first + SP_BRICK && s < dim; s++) {
        uint32_t layer = sp_order_layer(f->layers, f->layer_count, item->level, s);
        item->near = layer < item->near ? layer : item->near;
        item->far = layer > item->far ? layer : item->far;
    }
}

/* Bricks that are not empty, those of a level together. */
static bool list_items(struct gl_frame *f, struct sp_arena *arena) {
    f->items = sp_arena_alloc(arena, "bricks", f->detail.count, sizeof *f->items);
    for (unsigned l = 0; f->items && f->detail.levels >> l; l++)
        for (uint32_t i = 0; f->detail.levels >> l & 1 && i < f->detail.count; i++) {
            const struct sp_detail_brick *b = &f->detail.bricks[i];
            const uint64_t *first = f->levels[l].visible.first;
            if (b->level != l || first[b->brick] == first[b->brick + 1])
                continue;
            struct gl_item *item = &f->items[f->item_count++];
            *item = (struct gl_item){ .brick = b->brick,
                                      .count = (uint32_t)(first[b->brick + 1] - first[b->brick]),
                                      .level = b->level,
                                      .is_enlarged = b->is_enlarged };
            find_layers(f, item);
        }
    return f->items != NULL;
}

static bool order_sheets(struct gl_frame *f, const struct sp_grid *grid, struct sp_arena *arena) {
    f->layer_count = grid->dims[f->axis];
    uint32_t *sheets = sp_arena_alloc(arena, "order of sheets", f->layer_count, sizeof *sheets);
    f->layers = sp_arena_alloc(arena, "layers of sheets", f->layer_count, sizeof *f->layers);
    if (arena->failed)
        return false;
    sp_order_slices(&f->camera, grid, f->axis, sheets);
    for (uint32_t k = 0; k < f->layer_count; k++)
        f->layers[sheets[k]] = k;
    return true;
}

bool gl_frame_begin(struct gl_frame *f, const struct sp_backend_job *job,
                    const struct gl_sources *from, struct sp_error *err) {
    const struct sp_grid *grid = &sp_volume_info(job->volume)->grid;
    struct sp_arena *arena = from->arena;
    double start_ms = sp_clock_ms();
    *f = (struct gl_frame){ .coarse = job->coarse, .mode = job->view->filter.mode };
    sp_camera_frame_init(&f->camera, &job->view->camera, job->view->size);
    f->axis = sp_order_axis(&f->camera, grid);
    if (!choose_levels(f, job, arena))
        return fail_memory(arena, err);
    if (!get_lists(f, job, from, err))
        return false;
    if (!order_sheets(f, grid, arena) || !make_parts(f, job->view, arena) || !list_items(f, arena))
        return fail_memory(arena, err);
    write_constants(f, job->view);
    f->classify_ms = sp_clock_ms() - start_ms;
    return true;
}

static void write_brick(const struct gl_frame *f, const struct gl_item *item, uint32_t record,
                        struct gl_brick *to) {
    const struct sp_level *level = &f->levels[item->level];
    const struct gl_list *list = f->lists[item->level];
    const uint8_t *modes = f->modes[item->level][item->is_enlarged];
    struct sp_ewa_brick brick;
    uint32_t corner[3];
    sp_visible_corner(&level->visible, item->brick, corner);
    sp_ewa_brick_init(&brick, &f->ewa[item->level][item->is_enlarged], corner);
    memcpy(to->base, brick.base, sizeof brick.base);
    to->list[0] = (uint32_t)level->visible.first[item->brick];
    to->list[1] = item->count;
    to->list[2] = record;
    to->list[3] = 2u * item->level + item->is_enlarged;
    to->list[3] |= (modes ? modes[item->brick] : (uint32_t)f->mode) << 8;
    to->place[0] = corner[f->axis];
    for (int a = 0; a < 3; a++)
        to->place[1 + a] = list->axis_row[a] + corner[a];
}

/* Adds the batches of layers [begin, end): one, unless its entries are more than a batch's records.
 * Only counts where there is no memory yet. */
static void add_batches(struct gl_frame *f, uint32_t begin, uint32_t end, uint32_t records) {
    struct gl_batch batch = { .first = begin, .layers = end - begin };
    for (uint32_t i = 0; i < f->item_count; i++) {
        const struct gl_item *item = &f->items[i];
        if (item->near >= end || item->far < begin)
            continue;
        if (batch.records + item->count > records) {
            batch.stays_open = true;
            if (f->batches)
                f->batches[f->batch_count] = batch;
            f->batch_count++;
            batch = (struct gl_batch){ .first = begin, .layers = end - begin, .resumes = true };
        }
        if (!batch.bricks[item->level]++)
            batch.brick[item->level] = f->brick_count;
        if (f->bricks)
            write_brick(f, item, batch.records, &f->bricks[f->brick_count]);
        f->brick_count++;
        batch.records += item->count;
    }
    if (!batch.records)
        return;
    if (f->batches)
        f->batches[f->batch_count] = batch;
    f->batch_count++;
}

/* Entries of bricks with layers before k, and of those that end before k. */
struct sums {
    uint64_t *begun, *ended; /* [layer_count + 1] */
};

static bool sum_entries(const struct gl_frame *f, struct sp_arena *arena, struct sums *s) {
    size_t n = (size_t)f->layer_count + 1;
    s->begun = sp_arena_alloc(arena, "entries by layer", n, sizeof *s->begun);
    s->ended = sp_arena_alloc(arena, "entries by layer", n, sizeof *s->ended);
    if (arena->failed)
        return false;
    memset(s->begun, 0, n * sizeof *s->begun);
    memset(s->ended, 0, n * sizeof *s->ended);
    for (uint32_t i = 0; i < f->item_count; i++) {
        s->begun[f->items[i].near + 1] += f->items[i].count;
        s->ended[f->items[i].far + 1] += f->items[i].count;
    }
    for (size_t k = 1; k < n; k++) {
        s->begun[k] += s->begun[k - 1];
        s->ended[k] += s->ended[k - 1];
    }
    return true;
}

static void cut(struct gl_frame *f, uint32_t layers, uint32_t records, const struct sums *s) {
    f->batch_count = f->brick_count = 0;
    for (uint32_t begin = 0, end; begin < f->layer_count; begin = end) {
        for (end = begin + 1; end < f->layer_count && end - begin < layers; end++)
            if (s->begun[end + 1] - s->ended[begin] > records)
                break;
        if (s->begun[end] > s->ended[begin])
            add_batches(f, begin, end, records);
    }
}

bool gl_frame_cut(struct gl_frame *f, uint32_t layers, uint32_t records, struct sp_arena *arena) {
    struct sums s;
    if (!sum_entries(f, arena, &s))
        return false;
    f->bricks = NULL;
    f->batches = NULL;
    cut(f, layers, records, &s);
    f->bricks = sp_arena_alloc(arena, "bricks of batches", f->brick_count, sizeof *f->bricks);
    f->batches = sp_arena_alloc(arena, "batches", f->batch_count, sizeof *f->batches);
    if (arena->failed)
        return false;
    cut(f, layers, records, &s);
    return true;
}
