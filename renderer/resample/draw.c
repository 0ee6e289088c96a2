/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <string.h>

#include "resample/axes.h"
#include "resample/resample.h"
#include "volume/grid.h"

bool sp_resample_draws(const struct sp_view *view) {
    if (view->transfer_function.order != SP_TF_POST)
        return false;
    return view->compositing.mode == SP_COMPOSITE_SHEET ||
           (view->compositing.mode == SP_COMPOSITE_SLAB && sp_view_has_default_filter(view));
}

static bool fail_memory(const struct sp_arena *arena, struct sp_error *err) {
    return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the frame's %s",
                   arena->failed ? arena->failed : "data");
}

/* A level is drawn while its samples are at least this wide in the middle of the volume [px]. */
static const double narrowest = 0.7;

/* A block sees at most about this many samples of a sheet, per axis, at the far end of the volume.
 */
static const double most_seen = 200;

unsigned sp_resample_level(const struct sp_grid *grid, const struct sp_camera_transform *camera) {
    double width = 1, distance = 1, far = 1, finest = INFINITY, radius = 0;
    unsigned level = 0;
    for (int a = 0; a < 3; a++) {
        width *= cbrt(grid->spacing[a]);
        finest = fmin(finest, grid->spacing[a]);
        radius += grid->spacing[a] * grid->dims[a] / 2;
    }
    if (camera->projection == SP_PERSPECTIVE) {
        struct sp_vec3 to = sp_vec3_scale(camera->eye, -1);
        for (int r = 0; r < 3; r++)
            for (int a = 0; a < 3; a++)
                to.v[r] += (a ? 0 : grid->origin[r]) +
                           grid->direction[r][a] * grid->spacing[a] * (grid->dims[a] - 1) / 2;
        distance = fmax(sp_vec3_length(to), camera->near);
        far = distance + radius;
    }
    width *= camera->scale / distance;
    double seen = RESAMPLE_BLOCK * far / camera->scale / finest;
    while (level + 1 < SAMPLES_LEVELS &&
           (ldexp(width, (int)level) < narrowest || ldexp(seen, -(int)level) > most_seen))
        level++;
    return level;
}

static unsigned choose_level(const struct sp_resample_input *input) {
    const struct sp_grid *grid = &sp_volume_info(input->volume)->grid;
    unsigned level = input->mip_level, longest = 1;
    for (int a = 0; a < 3; a++)
        longest = grid->dims[a] > longest ? grid->dims[a] : longest;
    if (input->view->level_of_detail == SP_LOD_AUTO) {
        unsigned finest = sp_resample_level(grid, input->camera);
        level = level > finest ? level : finest;
    }
    while (level > 0 && longest >> level == 0)
        level--;
    return level < SAMPLES_LEVELS ? level : SAMPLES_LEVELS - 1;
}

/* Sample coordinates of a level: x = to·(world − origin) + shift. */
struct coordinates {
    struct sp_mat3 to, from; /* from: its inverse, sample → world */
    struct sp_vec3 origin;
    double shift;
};

static struct sp_vec3 place(const struct coordinates *c, struct sp_vec3 world) {
    struct sp_vec3 x = sp_mat3_apply(&c->to, sp_vec3_sub(world, c->origin));
    for (int a = 0; a < 3; a++)
        x.v[a] += c->shift;
    return x;
}

static void init_coordinates(struct coordinates *c, const struct sp_grid *grid, unsigned level) {
    double size = ldexp(1, (int)level);
    for (int r = 0; r < 3; r++) {
        c->origin.v[r] = grid->origin[r];
        for (int a = 0; a < 3; a++)
            c->from.m[r][a] = grid->direction[r][a] * grid->spacing[a] * size;
    }
    double volume;
    c->to = sp_mat3_inverse(&c->from, &volume);
    c->shift = 0.5 / size - 0.5;
}

/* Adds the half space normal·world >= offset. */
static void add_half(struct sp_resample *r, const struct coordinates *c, struct sp_vec3 normal,
                     double offset) {
    struct sp_resample_half *half = &r->halves[r->half_count++];
    struct sp_mat3 turned = sp_mat3_transpose(&c->from);
    struct sp_vec3 n = sp_mat3_apply(&turned, normal);
    double length = sp_vec3_length(n), at = offset - sp_vec3_dot(normal, c->origin);
    for (int a = 0; a < 3; a++) {
        at += n.v[a] * c->shift;
        half->normal[a] = n.v[a] / length;
    }
    half->offset = at / length;
}

static void add_halves(struct sp_resample *r, const struct coordinates *c,
                       const struct sp_grid *grid) {
    const struct sp_clip *clip = &r->view->clip;
    const struct sp_camera_transform *camera = r->camera;
    for (int a = 0; a < 3; a++)
        for (int side = 0; side < 2; side++) {
            double extent[2], part = clip->box[side][a];
            sp_grid_extent(grid, (unsigned)a, extent);
            double distance = extent[0] + part * (extent[1] - extent[0]);
            double at = distance / grid->spacing[a] * (2 * c->shift + 1) + c->shift;
            struct sp_resample_half *half = &r->halves[r->half_count++];
            *half = (struct sp_resample_half){ .offset = side ? -at : at };
            half->normal[a] = side ? -1 : 1;
        }
    struct sp_vec3 forward = sp_vec3_from(camera->w.m[2]);
    add_half(r, c, forward, sp_vec3_dot(forward, camera->eye) + camera->near);
    for (uint32_t i = 0; i < clip->plane_count; i++) {
        struct sp_vec3 normal = sp_vec3_from(clip->planes[i].normal);
        double largest = fmax(fabs(normal.v[0]), fmax(fabs(normal.v[1]), fabs(normal.v[2])));
        for (int a = 0; a < 3; a++) /* squares of components, or 1 / largest, may overflow */
            normal.v[a] /= largest;
        double length = sp_vec3_length(normal);
        add_half(r, c, sp_vec3_scale(normal, 1 / length),
                 clip->planes[i].offset / largest / length);
    }
}

static void init_camera(struct sp_resample *r, const struct coordinates *c) {
    const struct sp_camera_transform *camera = r->camera;
    struct sp_vec3 axis[3];
    for (int i = 0; i < 3; i++)
        axis[i] = sp_mat3_apply(&c->to, sp_vec3_from(camera->w.m[i]));
    struct sp_vec3 eye = place(c, camera->eye);
    for (int a = 0; a < 3; a++) {
        r->eye[a] = r->start[a] = eye.v[a];
        r->ray[a] = axis[2].v[a];
        r->right[a] = axis[0].v[a] / camera->scale;
        r->down[a] = axis[1].v[a] / camera->scale;
    }
}

static int choose_axis(const struct sp_resample *r, const struct coordinates *c, double share[3]) {
    double along[3];
    for (int a = 0; a < 3; a++) {
        const struct sp_vec3 column = { { c->from.m[0][a], c->from.m[1][a], c->from.m[2][a] } };
        along[a] = fabs(r->ray[a]) * sp_vec3_length(column);
    }
    return sp_axes_choose(along, share);
}

/* Tables of a rectilinear axis. A sample of a coarser level lies half way between those that it
 * replaces. */
static bool init_axis(struct sp_resample_axis *axis, const struct sp_resample_input *input,
                      const struct sp_samples *samples, unsigned a, unsigned level) {
    const struct sp_grid *grid = &sp_volume_info(input->volume)->grid;
    double size = ldexp(1, (int)level);
    uint32_t dims = samples->dims[a], last = grid->dims[a] - 1, i = 0;
    *axis = (struct sp_resample_axis){ 0 };
    if (!grid->coordinates[a] || dims < 2)
        return true;
    enum { PER_SAMPLE = 16, MOST = 1 << 16 };
    axis->steps = dims < MOST / PER_SAMPLE ? (int)dims * PER_SAMPLE : MOST;
    float *place = sp_arena_alloc(input->arena, "coordinates", dims, sizeof *place);
    float *index =
        sp_arena_alloc(input->arena, "coordinates", (size_t)axis->steps + 1, sizeof *index);
    if (!place || !index)
        return false;
    for (uint32_t k = 0; k < dims; k++) {
        double middle = (k + 0.5) * size - 0.5;
        uint32_t low = (uint32_t)middle < last ? (uint32_t)middle : last;
        double distance = sp_grid_distance(grid, a, low);
        if (low < last)
            distance += (middle - low) * (sp_grid_distance(grid, a, low + 1) - distance);
        place[k] = (float)((distance / grid->spacing[a] + 0.5) / size - 0.5);
    }
    axis->first = place[0];
    axis->steps_per_place = (float)axis->steps / (place[dims - 1] - place[0]);
    for (int k = 0; k <= axis->steps; k++) {
        float at = axis->first + (float)k / axis->steps_per_place;
        while (i + 2 < dims && place[i + 1] < at)
            i++;
        index[k] = (float)i + (at - place[i]) / (place[i + 1] - place[i]);
    }
    axis->narrowest = INFINITY;
    for (uint32_t k = 1; k < dims; k++) {
        axis->narrowest = fminf(axis->narrowest, place[k] - place[k - 1]);
        axis->widest = fmaxf(axis->widest, place[k] - place[k - 1]);
    }
    axis->place = place;
    axis->index = index;
    return true;
}

static void init_metric(struct sp_resample *r, const struct coordinates *c) {
    const double most = 1e15; /* reference lengths per sample: what is visible is opaque */
    double unit = r->view->transfer_function.reference_length;
    struct sp_mat3 turned = sp_mat3_transpose(&c->from);
    struct sp_mat3 m = sp_mat3_multiply(&turned, &c->from);
    for (int a = 0; a < 3; a++) /* so that squares fit a float */
        unit = fmax(unit, sqrt(m.m[a][a]) / most);
    static const int pair[6][2] = { { 0, 0 }, { 1, 1 }, { 2, 2 }, { 1, 2 }, { 0, 2 }, { 0, 1 } };
    for (int i = 0; i < 6; i++)
        r->metric[i] = m.m[pair[i][0]][pair[i][1]] / (unit * unit);
    struct sp_mat3 slope = sp_mat3_transpose(&c->to); /* gradients turn by the inverse transpose */
    double largest = 0;
    for (int i = 0; i < 9; i++)
        largest = fmax(largest, fabs(slope.m[i / 3][i % 3]));
    for (int i = 0; i < 9; i++)
        r->to_world[i / 3][i % 3] = (float)(slope.m[i / 3][i % 3] / largest);
    r->gradient_unit = (float)(largest / r->curve.levels_per_unit);
}

/* Surfaces change the value by at least this share of the transfer function's span per sample. */
static const double surface = 0.08;

static void init_light(struct sp_resample *r, unsigned level) {
    const struct sp_transfer_function *tf = &r->view->transfer_function;
    double span = tf->points[tf->point_count - 1].value - tf->points[0].value;
    float size = ldexpf(1, (int)level); /* coordinate on level 0 = (coordinate + ½)·size − ½ */
    r->light_scale = size * r->light->per_sample;
    r->light_first = (size - 1) / 2 * r->light->per_sample + r->light->first;
    r->light_firmness = (float)fmin(1 / (surface * span * r->curve.levels_per_unit), 1e6);
}

static bool allocate(struct sp_resample *r, struct sp_resample_scratch **scratch, unsigned workers,
                     struct sp_arena *arena) {
    const uint32_t *dims = r->samples->dims, *regions = r->samples->regions;
    /* Cells at both ends; refined samples of one sheet at most; what vectors read beyond. */
    enum { MARGIN = 64, MOST = 1 << 19, BEYOND = 4096, CELL_MIN = 4 * 8 * 8 };
    size_t largest = 0, intervals = 0;
    for (int a = 0; a < 3; a++) {
        size_t across = dims[a == 0 ? 1 : 0], down = dims[a == 2 ? 1 : 2];
        size_t samples = (2 * across + 2 * MARGIN) * (2 * down + 2 * MARGIN);
        largest = samples > largest ? samples : largest;
        size_t length = (size_t)regions[a] * SAMPLES_REGION;
        intervals = length > intervals ? length : intervals;
    }
    r->refined_max = largest < MOST ? largest : MOST;
    *scratch = sp_arena_alloc(arena, "tiles", workers, sizeof **scratch);
    for (unsigned w = 0; *scratch && w < workers; w++) {
        struct sp_resample_scratch *s = &(*scratch)[w];
        memset(s, 0, sizeof *s);
        s->is_refined = sp_arena_alloc(arena, "cells", r->refined_max / CELL_MIN + 1, 1);
        s->active = sp_arena_alloc(arena, "intervals", intervals, sizeof *s->active);
        for (int i = 0; i < RESAMPLE_SHEETS; i++)
            s->sheets[i].refined =
                sp_arena_alloc(arena, "refined slices", r->refined_max + BEYOND, sizeof(int16_t));
    }
    return !arena->failed;
}

struct tiles {
    const struct sp_resample *r;
    struct sp_resample_scratch *scratch;
    sp_resample_tile_fn *draw;
};

static void draw_tiles(void *user, size_t begin, size_t end, unsigned worker) {
    struct tiles *tiles = user;
    for (size_t i = begin; i < end; i++) {
        if (sp_interrupt_is_cancelled(&tiles->r->interrupt))
            return;
        tiles->draw(tiles->r, &tiles->scratch[worker], (uint32_t)i);
    }
}

/* Draws all tiles with slices of axis r->axis. */
static bool draw(const struct sp_resample_input *input, struct sp_resample *r,
                 struct sp_resample_scratch *scratch, struct sp_error *err) {
    unsigned workers = sp_pool_threads(input->pool);
    struct sp_frame_stats *stats = &input->frame->stats;
    struct tiles tiles = { r, scratch, input->draw_tile };
    sp_parallel_for(input->pool, (size_t)(r->columns * r->rows), 1, draw_tiles, &tiles);
    if (sp_interrupt_is_cancelled(&input->interrupt))
        return sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
    for (unsigned w = 0; w < workers; w++) {
        if (scratch[w].is_too_wide)
            return sp_fail(err, SP_ERR_BUDGET, "/quality/level_of_detail",
                           "the volume is too small in the image for its samples: set "
                           "quality.level_of_detail to \"auto\", or come nearer");
        stats->splats += scratch[w].refined;
        stats->fragments += scratch[w].sampled;
        scratch[w].refined = scratch[w].sampled = 0;
    }
    return true;
}

/* Gets the samples and their class for axis r->axis. */
static bool get_samples(const struct sp_resample_input *input, unsigned level,
                        struct sp_resample *r, struct sp_error *err) {
    struct sp_samples_job job = { .volume = input->volume,
                                  .level = level,
                                  .axis = (unsigned)r->axis,
                                  .tf = &input->view->transfer_function,
                                  .bytes_max = input->bytes_max,
                                  .pool = input->pool,
                                  .interrupt = input->interrupt };
    r->samples = sp_samples_get(input->cache, &job, &r->class, err);
    if (r->samples)
        r->curve = r->class->curve;
    return r->samples;
}

/* Draws the image of another axis and mixes it into the frame. Without memory for it the frame
 * stays as it is. */
static bool add_axis(const struct sp_resample_input *input, unsigned level, struct sp_resample *r,
                     struct sp_resample_scratch *scratch, double share, struct sp_error *err) {
    struct sp_frame second = *input->frame;
    struct sp_error why = { 0 };
    second.pixels =
        sp_arena_alloc(input->arena, "second image", second.height, second.stride_bytes);
    if (!second.pixels)
        return fail_memory(input->arena, err);
    r->frame = &second;
    bool is_drawn = get_samples(input, level, r, &why) && draw(input, r, scratch, &why);
    r->frame = input->frame;
    if (is_drawn)
        sp_axes_mix(input->frame, second.pixels, share, input->pool);
    else if (why.code != SP_ERR_BUDGET && err)
        *err = why;
    return is_drawn || why.code == SP_ERR_BUDGET;
}

/* Draws the frame with the slices of each axis that has a share of it. */
static bool draw_axes(const struct sp_resample_input *input, unsigned level, struct sp_resample *r,
                      const double share[3], struct sp_error *err) {
    struct sp_resample_scratch *scratch;
    int best = r->axis;
    if (!allocate(r, &scratch, sp_pool_threads(input->pool), input->arena))
        return fail_memory(input->arena, err);
    if (!draw(input, r, scratch, err))
        return false;
    double sum = share[best];
    for (int a = 0; a < 3; a++) {
        if (a == best || !(share[a] > 0))
            continue;
        sum += share[a];
        r->axis = a;
        if (!add_axis(input, level, r, scratch, share[a] / sum, err))
            return false;
    }
    return true;
}

bool sp_resample_draw(const struct sp_resample_input *input, struct sp_error *err) {
    const struct sp_volume_info *info = sp_volume_info(input->volume);
    const struct sp_view *view = input->view;
    struct sp_frame_stats *stats = &input->frame->stats;
    double clock = sp_interrupt_clock_ms(&input->interrupt);
    struct sp_resample r = {
        .view = view,
        .frame = input->frame,
        .interrupt = input->interrupt,
        .camera = input->camera,
        .shade = input->shade,
        .light = input->light,
        .is_linear = view->compositing.attenuation == SP_ATTENUATION_LINEAR,
        .is_fine = view->compositing.mode == SP_COMPOSITE_SLAB,
        .needs_gradient = input->shade || view->transfer_function.gradient_count > 0,
        .columns = ((int)input->frame->width + RESAMPLE_TILE - 1) / RESAMPLE_TILE,
        .rows = ((int)input->frame->height + RESAMPLE_TILE - 1) / RESAMPLE_TILE
    };
    unsigned level = choose_level(input);
    double share[3];
    struct coordinates coordinates;
    init_coordinates(&coordinates, &info->grid, level);
    add_halves(&r, &coordinates, &info->grid);
    init_camera(&r, &coordinates);
    r.axis = choose_axis(&r, &coordinates, share);
    if (!get_samples(input, level, &r, err))
        return false;
    r.lowest = info->nonfinite ? CURVE_LEVEL_NONE : CURVE_LEVEL_MIN;
    for (unsigned a = 0; a < 3; a++)
        if (!init_axis(&r.axes[a], input, r.samples, a, level))
            return fail_memory(input->arena, err);
    if (r.light)
        init_light(&r, level);
    init_metric(&r, &coordinates);
    double prepared = sp_interrupt_clock_ms(&input->interrupt);
    stats->mip_level = input->mip_level;
    stats->visible_voxels =
        r.class->visible_count * SAMPLES_REGION * SAMPLES_REGION * SAMPLES_REGION;
    if (!draw_axes(input, level, &r, share, err))
        return false;
    stats->stage_count = 2;
    stats->stages[0] = (struct sp_stage_time){ "classify", prepared - clock };
    stats->stages[1] =
        (struct sp_stage_time){ "tile", sp_interrupt_clock_ms(&input->interrupt) - prepared };
    return true;
}
