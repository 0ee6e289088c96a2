/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/frame.h"

#include <math.h>
#include <string.h>

#include "base/clock.h"
#include "splat/adaptive.h"
#include "tile/blend.h"
#include "tile/depth.h"
#include "tile/order.h"

#define SPLAT_RANGE (1.0 / 16) /* cells: single splats are sorted by distance to this */
#define FARTHEST 1e7           /* cells; all beyond is as far, as in tile/depth.c */

_Static_assert((int)SP_CUTS_MAX == (int)GL_CUTS, "room for the planes that clip");
_Static_assert(2 * (int)SP_LEVELS <= (int)GL_PARTS, "a part for each level, enlarged or not");

/* A brick that is drawn. */
struct gl_item {
    uint32_t brick, count; /* of its level; entries */
    int64_t near, far;     /* layers that it may have entries in: [near, far] */
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
    /* Layers by distance are of one level, the finest that some brick needs. */
    for (uint32_t i = 0; i < f->detail.count; i++)
        f->is_enlarged = f->is_enlarged || (f->detail.bricks[i].level == f->finest &&
                                            f->detail.bricks[i].is_enlarged);
    f->drawn = f->compositing == SP_COMPOSITE_SHEET ? f->detail.levels : 1u << f->finest;
    return true;
}

static bool get_lists(struct gl_frame *f, const struct sp_backend_job *job,
                      const struct gl_sources *from, struct sp_error *err) {
    const struct sp_view *view = job->view;
    struct sp_classify_job classify = { .tf = &view->transfer_function,
                                        .levels = f->drawn,
                                        .axis = SP_NO_AXIS, /* any will do */
                                        .normals = view->shading.mode == SP_SHADING_PHONG ||
                                                   view->transfer_function.gradient_count > 0 ||
                                                   f->is_post,
                                        .reach = sp_kernel_reach(&view->filter),
                                        .bytes_max = from->cache->limit_bytes,
                                        .pool = from->pool,
                                        .cancel = job->cancel };
    struct gl_levels levels;
    if (!gl_levels_get(&levels, from->lists, from->cache, job->volume, &classify, err))
        return false;
    f->visible = levels.visible;
    memcpy(f->lists, levels.lists, sizeof f->lists);
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
    for (uint32_t i = 0; i < e->clip.count; i++) {
        memcpy(to->planes[i], e->clip.planes[i].normal, sizeof e->clip.planes[i].normal);
        to->planes[i][3] = e->clip.planes[i].offset;
    }
}

/* Filters by brick of a level. Of one that is small enough it is the one that its voxels would
 * have. */
static bool choose_modes(struct gl_frame *f, const struct sp_view *view, unsigned level,
                         bool enlarged, struct sp_arena *arena) {
    struct sp_adaptive adaptive;
    struct sp_view own = *view;
    const struct sp_grid *grid = &f->lists[level]->grid;
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
    for (unsigned l = 0; f->drawn >> l; l++)
        for (int enlarged = 0; f->drawn >> l & 1 && enlarged < 2; enlarged++) {
            struct sp_view own = *view;
            own.filter = sp_detail_filter(&view->filter, l, enlarged);
            struct sp_ewa_frame *ewa = &f->ewa[l][enlarged];
            sp_ewa_frame_init(ewa, &f->camera, &f->lists[l]->grid, &own);
            sp_clip_frame_init(&ewa->clip, &f->camera, f->grid, &view->clip, ewa->unit);
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
    c->choice[3] = f->sheet_count;
    c->picture[0] = view->size[0];
    c->picture[1] = view->size[1];
    c->picture[2] = f->axis;
    c->picture[3] = gl_frame_ewa(f)->clip.count;
    c->compose[0] = f->compositing;
    c->compose[1] = f->is_post;
    c->slabs[0] = (float)((double)f->nearest * f->thickness);
    c->slabs[1] = (float)f->thickness;
    c->lens[0] = (float)f->camera.scale;
    c->lens[1] = gl_frame_ewa(f)->centre[0];
    c->lens[2] = gl_frame_ewa(f)->centre[1];
}

/* The sheets that a brick has slices in. */
static void find_sheets(const struct gl_frame *f, struct gl_item *item) {
    const struct gl_list *list = f->lists[item->level];
    uint32_t corner[3], first, dim = list->grid.dims[f->axis];
    gl_list_corner(list, item->brick, corner);
    first = corner[f->axis];
    item->near = INT64_MAX;
    item->far = 0;
    for (uint32_t s = first; s < first + SP_BRICK && s < dim; s++) {
        int64_t layer = sp_order_layer(f->sheets, f->sheet_count, item->level, s);
        item->near = layer < item->near ? layer : item->near;
        item->far = layer > item->far ? layer : item->far;
    }
}

/* Layers by distance that kernels of a brick may lie in, counted from the eye: those of the sphere
 * around it, and one more on either side for rounding. */
static void find_distances(const struct gl_frame *f, double reach, struct gl_item *item) {
    const struct gl_list *list = f->lists[item->level];
    const struct sp_ewa_frame *ewa = gl_frame_ewa(f);
    struct sp_ewa_brick brick;
    uint32_t corner[3], last[3];
    float u[8][3], centre[3], radius = 0;
    gl_list_corner(list, item->brick, corner);
    sp_ewa_brick_init(&brick, ewa, corner);
    for (int a = 0; a < 3; a++) {
        uint32_t end = list->grid.dims[a] - corner[a];
        last[a] = end < SP_BRICK ? end - 1 : SP_BRICK - 1;
    }
    for (int i = 0; i < 8; i++)
        sp_ewa_brick_place(&brick, ewa,
                           (uint16_t)((i & 1 ? last[0] : 0) | (i & 2 ? last[1] << 4 : 0) |
                                      (i & 4 ? last[2] << 8 : 0)),
                           u[i]);
    for (int r = 0; r < 3; r++)
        centre[r] = 0.5f * (u[0][r] + u[7][r]);
    for (int i = 0; i < 8; i++) {
        float d[3] = { u[i][0] - centre[0], u[i][1] - centre[1], u[i][2] - centre[2] };
        radius = fmaxf(radius, sqrtf(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]));
    }
    double distance = (double)sp_ewa_distance(ewa, centre), beyond = (double)radius + reach;
    double near = fmax(fmin(distance - (double)radius, FARTHEST) - reach, -FARTHEST);
    double far = fmin(distance + beyond, FARTHEST + reach);
    item->near = (int64_t)floor(near / f->thickness) - 1;
    item->far = (int64_t)floor(fmax(near, far) / f->thickness) + 1;
}

static void add_item(struct gl_frame *f, uint32_t brick, unsigned level, bool is_enlarged) {
    const uint64_t *first = f->lists[level]->first;
    uint64_t count = first[brick + 1] - first[brick];
    if (count)
        f->items[f->item_count++] = (struct gl_item){ .brick = brick,
                                                      .count = (uint32_t)count,
                                                      .level = (uint8_t)level,
                                                      .is_enlarged = is_enlarged };
}

/* Sheets: bricks of the cut that are not empty, those of a level together. */
static bool list_sheets(struct gl_frame *f, struct sp_arena *arena) {
    f->items = sp_arena_alloc(arena, "bricks", f->detail.count, sizeof *f->items);
    for (unsigned l = 0; f->items && f->drawn >> l; l++)
        for (uint32_t i = 0; f->drawn >> l & 1 && i < f->detail.count; i++)
            if (f->detail.bricks[i].level == l)
                add_item(f, f->detail.bricks[i].brick, l, f->detail.bricks[i].is_enlarged);
    for (uint32_t i = 0; i < f->item_count; i++)
        find_sheets(f, &f->items[i]);
    f->layer_count = f->sheet_count;
    return f->items != NULL;
}

/* Slabs and single splats: all bricks of the one level. */
static bool list_distances(struct gl_frame *f, double reach, struct sp_arena *arena) {
    uint32_t bricks = gl_list_bricks(f->lists[f->finest]);
    int64_t near = INT64_MAX, far = INT64_MIN;
    f->items = sp_arena_alloc(arena, "bricks", bricks, sizeof *f->items);
    for (uint32_t b = 0; f->items && b < bricks; b++)
        add_item(f, b, f->finest, f->is_enlarged);
    for (uint32_t i = 0; i < f->item_count; i++) {
        find_distances(f, reach, &f->items[i]);
        near = f->items[i].near < near ? f->items[i].near : near;
        far = f->items[i].far > far ? f->items[i].far : far;
    }
    for (uint32_t i = 0; i < f->item_count; i++) {
        f->items[i].near -= near;
        f->items[i].far -= near;
    }
    f->nearest = f->item_count ? near : 0;
    f->layer_count = f->item_count ? (uint32_t)(far - near + 1) : 0;
    return f->items != NULL;
}

/* As thick as the view wants slabs, as long as a kernel lies in no more than SP_SLOTS_MAX. */
static double slab_thickness(const struct gl_frame *f, const struct sp_view *view, double *reach) {
    const struct sp_ewa_frame *ewa = gl_frame_ewa(f);
    const struct sp_grid *grid = &f->lists[f->finest]->grid;
    /* A coarse scalar is no smoother to the transfer function: its slabs stay as thin. */
    const double *spacing = f->is_post ? f->grid->spacing : grid->spacing;
    double radius[2], smallest = fmin(spacing[0], fmin(spacing[1], spacing[2]));
    sp_kernel_radii(grid, sp_kernel_sigma(&view->filter), radius);
    *reach = (double)ewa->radius * radius[1] / ewa->unit;
    double thickness =
        sp_depth_thickness(ewa, view->compositing.slab * smallest / ewa->unit, *reach);
    return fmax(thickness, 2 * *reach / (SP_SLOTS_MAX - 3));
}

static bool list_items(struct gl_frame *f, const struct sp_view *view, struct sp_arena *arena) {
    double reach = 0;
    f->spanned = 1;
    if (f->compositing == SP_COMPOSITE_SHEET)
        return list_sheets(f, arena);
    f->thickness = f->compositing == SP_COMPOSITE_SLAB
                       ? slab_thickness(f, view, &reach)
                       : sp_depth_thickness(gl_frame_ewa(f), SPLAT_RANGE, 0);
    f->spanned += (uint32_t)ceil(2 * reach / f->thickness);
    return list_distances(f, reach, arena);
}

static bool order_sheets(struct gl_frame *f, const struct sp_grid *grid, struct sp_arena *arena) {
    f->sheet_count = grid->dims[f->axis];
    uint32_t *order = sp_arena_alloc(arena, "order of sheets", f->sheet_count, sizeof *order);
    f->sheets = sp_arena_alloc(arena, "layers of sheets", f->sheet_count, sizeof *f->sheets);
    if (arena->failed)
        return false;
    sp_order_slices(&f->camera, grid, f->axis, order);
    for (uint32_t k = 0; k < f->sheet_count; k++)
        f->sheets[order[k]] = k;
    return true;
}

bool gl_frame_begin(struct gl_frame *f, const struct sp_backend_job *job,
                    const struct gl_sources *from, struct sp_error *err) {
    const struct sp_grid *grid = &sp_volume_info(job->volume)->grid;
    struct sp_arena *arena = from->arena;
    double start_ms = sp_clock_ms();
    bool is_post = job->view->transfer_function.order == SP_TF_POST;
    *f = (struct gl_frame){ .grid = grid,
                            .mode = job->view->filter.mode,
                            .compositing = job->view->compositing.mode,
                            .is_post = is_post,
                            /* A scalar averaged over 4³ voxels is another object to the transfer
                             * function. */
                            .coarse = is_post && job->coarse > 1 ? 1 : job->coarse };
    sp_camera_frame_init(&f->camera, &job->view->camera, job->view->size);
    f->axis = sp_order_axis(&f->camera, grid);
    if (!choose_levels(f, job, arena))
        return fail_memory(arena, err);
    if (!get_lists(f, job, from, err))
        return false;
    if (!order_sheets(f, grid, arena) || !make_parts(f, job->view, arena) ||
        !list_items(f, job->view, arena))
        return fail_memory(arena, err);
    write_constants(f, job->view);
    f->stride = 2 + (f->compositing == SP_COMPOSITE_SLAB ? 2 : 0) + gl_frame_ewa(f)->clip.count;
    f->classify_ms = sp_clock_ms() - start_ms;
    return true;
}

static void write_brick(const struct gl_frame *f, const struct gl_item *item, uint32_t record,
                        struct gl_brick *to) {
    const struct gl_list *list = f->lists[item->level];
    const uint8_t *modes = f->modes[item->level][item->is_enlarged];
    struct sp_ewa_brick brick;
    uint32_t corner[3];
    gl_list_corner(list, item->brick, corner);
    sp_ewa_brick_init(&brick, &f->ewa[item->level][item->is_enlarged], corner);
    memcpy(to->base, brick.base, sizeof brick.base);
    to->list[0] = (uint32_t)list->first[item->brick];
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
