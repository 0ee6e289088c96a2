/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>

#include "classify/coloring.h"
#include "draw/layers/cloud/cloud.h"
#include "draw/layers/cloud/colors.h"
#include "draw/layers/cloud/cut.h"
#include "draw/layers/cloud/order.h"
#include "draw/layers/splat_list/phase.h"

enum { PARTS_MAX = 1 << 25 }; /* of a frame; the more points, the fewer parts each has */

/* The mean of part k of n parts of equal weight of a normal distribution, whose borders are found
 * by bisection. */
static double compute_part(uint32_t k, uint32_t n) {
    double density[2] = { 0, 0 };
    for (uint32_t side = 0; side < 2; side++) {
        double low = -9, high = 9;
        if (k + side == 0 || k + side == n)
            continue;
        for (int step = 0; step < 50; step++) {
            const double middle = 0.5 * (low + high);
            const bool is_above = 0.5 * erfc(-middle * M_SQRT1_2) * n > k + side;
            high = is_above ? middle : high;
            low = is_above ? low : middle;
        }
        density[side] = exp(-0.5 * low * low) / sqrt(2 * M_PI);
    }
    return n * (density[0] - density[1]);
}

/* The grid whose cell is as large as a typical element, so that lengths are near 1. */
static struct sp_grid unit_grid(const struct sp_volume_info *info) {
    struct sp_grid grid = { .dims = { 1, 1, 1 } };
    for (int a = 0; a < 3; a++) {
        grid.spacing[a] = info->element_spacing;
        grid.direction[a][a] = 1;
    }
    return grid;
}

static void init_frame(const struct sp_cloud_input *in, struct sp_grid *grid,
                       struct sp_voxel_frame *frame) {
    struct sp_filter filter = in->view->filter;
    filter.kernel = SP_KERNEL_GAUSSIAN;
    *grid = unit_grid(sp_volume_info(in->volume));
    *frame = (struct sp_voxel_frame){
        .mode = SP_FILTER_EWA,
        .is_trained = in->layer->type == SP_LAYER_GAUSSIANS,
        .linear = in->view->compositing.attenuation == SP_ATTENUATION_LINEAR,
        .apart = 1,
    };
    sp_ewa_frame_init(&frame->ewa, in->camera, grid, in->view, &filter);
    frame->ewa.post = false;
    frame->ewa.near = (float)fmax(in->camera->near / frame->ewa.unit, 1e-6);
    for (int i = 0; i < 2 && frame->is_trained; i++)
        frame->ewa.ratio_max[i] = 1.3f * (float)in->camera->tan_half[i]; /* Kerbl et al. 2023 */
    if (in->layer->type == SP_LAYER_VECTORS)
        sp_voxel_init_streaks(in->layer, in->camera, frame);
    sp_clip_frame_init(&frame->ewa.clip, in->camera, in->clipped, &in->view->clip, frame->ewa.unit);
}

/* Transform of the layer: the upper three rows. */
static struct sp_mat3 turn_of(const struct sp_layer *layer) {
    struct sp_mat3 turn;
    for (int r = 0; r < 3; r++)
        for (int a = 0; a < 3; a++)
            turn.m[r][a] = layer->transform[4 * r + a];
    return turn;
}

static void place(const struct sp_cloud_input *in, double unit, struct sp_cloud *cloud) {
    const struct sp_camera_transform *camera = in->camera;
    const struct sp_mat3 turn = turn_of(in->layer);
    const struct sp_mat3 all = sp_mat3_multiply(&camera->w, &turn);
    double det;
    const struct sp_mat3 back = sp_mat3_inverse(&turn, &det);
    struct sp_vec3 moved = { { in->layer->transform[3], in->layer->transform[7],
                               in->layer->transform[11] } };
    struct sp_vec3 away = sp_vec3_sub(moved, camera->eye);
    struct sp_vec3 offset = sp_mat3_apply(&camera->w, away), seen;
    cloud->is_orthographic = camera->projection == SP_ORTHOGRAPHIC;
    if (cloud->is_orthographic)
        seen = sp_vec3_normalize(sp_mat3_apply(&back, sp_vec3_from(camera->w.m[2])));
    else
        seen = sp_mat3_apply(&back, sp_vec3_scale(away, -1));
    for (int r = 0; r < 3; r++) {
        cloud->offset[r] = (float)(offset.v[r] / unit);
        cloud->eye[r] = (float)seen.v[r];
        for (int a = 0; a < 3; a++)
            cloud->place[r][a] = (float)(all.m[r][a] / unit);
    }
    cloud->per_volume = (float)(fabs(det) / (unit * unit * unit));
}

/* The transfer function for the values of points. */
static bool classify(const struct sp_cloud_input *in, struct sp_cloud *cloud,
                     struct sp_error *err) {
    struct sp_transfer transfer;
    const struct sp_volume_info *info = sp_volume_info(in->volume);
    if (!sp_transfer_init(&transfer, &in->view->transfer_function, info, NULL, err))
        return false;
    struct sp_pieces *pieces = sp_arena_alloc(in->arena, "transfer function", 1, sizeof *pieces);
    if (pieces)
        *pieces = *transfer.pieces;
    cloud->pieces = pieces;
    cloud->base = (float)sp_transfer_base(&transfer);
    sp_transfer_finish(&transfer);
    return pieces || sp_arena_fail(in->arena, "elements", err);
}

/* Sets the transfer function and the numbers that colour the points. */
static void set_coloring(const struct sp_cloud_input *in, struct sp_cloud *cloud) {
    struct sp_coloring coloring;
    sp_coloring_init(&coloring, in->layer, &in->view->transfer_function, in->volume, in->colors);
    if (!coloring.volume)
        return;
    if (coloring.by_length)
        cloud->color_vectors = sp_volume_vectors(coloring.volume);
    else
        cloud->color_values = sp_volume_elements(coloring.volume)->values;
    cloud->color_low = (float)coloring.low;
    cloud->color_scale = (float)coloring.scale;
    cloud->color_first = (float)(coloring.first - (double)cloud->base);
}

/* Where the view composites slabs, kernels are divided in depth: one is four times as thick as the
 * size of its point. */
static void choose_parts(const struct sp_compositing_options *compositing, uint32_t points,
                         struct sp_cloud *cloud) {
    const double wanted = ceil(4 / compositing->slab);
    double rest = 1;
    if (compositing->mode != SP_COMPOSITE_SLAB)
        return;
    cloud->parts = wanted < SP_CLOUD_PARTS_MAX ? (uint32_t)wanted : SP_CLOUD_PARTS_MAX;
    /* Points, and at most as many merged ones, have numbers. Sorting takes 24 bytes per part. */
    const uint32_t numbers = UINT32_MAX / 2 / (cloud->elements->shape.count + 1);
    const uint32_t sorted = PARTS_MAX / (points + 1) + 1;
    const uint32_t most = numbers < sorted ? numbers : sorted;
    cloud->parts = cloud->parts < most ? cloud->parts : most;
    for (uint32_t k = 0; k < cloud->parts; k++) {
        const double at = compute_part(k, cloud->parts);
        cloud->part_at[k] = (float)at;
        rest -= at * at / cloud->parts;
    }
    cloud->part_deviation = (float)sqrt(fmax(rest, 0));
    cloud->per_volume /= (float)cloud->parts;
}

/* How wide a cell of points may be that is drawn as one. */
static float pixels_of(const struct sp_cloud_input *in) {
    const bool is_exact = in->view->level_of_detail == SP_LOD_OFF;
    return in->mip_level ? (float)(2u << in->mip_level) : is_exact ? 0 : 0.5f;
}

/* Chooses the share of the points that a layer of vectors draws. False: out of memory. */
static bool choose_streaks(const struct sp_cloud_input *in, struct sp_cloud_choice *choice) {
    const uint32_t count = choice->count;
    choice->elements =
        sp_arena_alloc(in->arena, "vectors", count + (size_t)1, sizeof *choice->elements);
    choice->count = 0;
    for (uint32_t i = 0; choice->elements && i < count; i++) {
        choice->elements[choice->count] = i;
        choice->count += sp_streak_is_drawn(sp_streak_hash(i), in->layer->density);
    }
    return choice->elements;
}

/* Chooses the numbers that give the colours of merged points, if others than values do. */
static bool choose_colors(const struct sp_cloud_input *in, struct sp_cloud *cloud,
                          const struct sp_cloud_tree *tree, struct sp_error *err) {
    if (!sp_cloud_has_colors(cloud))
        return true;
    struct sp_volume *volume = cloud->color_vectors ? in->volume : in->colors;
    const struct sp_cloud_colors *colors = sp_cloud_cache_get_colors(
        in->trees, cloud, tree, in->volume, volume, in->pool, &in->interrupt, err);
    if (!colors)
        return false;
    cloud->merged_colors = colors->numbers;
    cloud->merged_colors_id = colors->id;
    return true;
}

/* Chooses what is drawn: all elements, some of them, or of many points levels of detail. */
static bool choose(const struct sp_cloud_input *in, struct sp_cloud *cloud,
                   struct sp_voxel_source *source, struct sp_cloud_choice *choice,
                   struct sp_error *err) {
    const struct sp_cloud_tree *tree = NULL;
    *choice = (struct sp_cloud_choice){ .count = cloud->elements->shape.count };
    if (source->frame.has_streaks)
        return choose_streaks(in, choice) || sp_arena_fail(in->arena, "elements", err);
    if (!sp_cloud_cache_get(in->trees, in->volume, in->bytes_max, in->pool, &in->interrupt, &tree,
                            err))
        return false;
    if (!tree)
        return true;
    if (!choose_colors(in, cloud, tree, err))
        return false;
    source->mip_level = in->mip_level;
    cloud->tree = tree;
    struct sp_visible_ranges visible;
    sp_visible_ranges_init(&visible, &in->view->transfer_function);
    const struct sp_cloud_cut cut = { .tree = tree,
                                      .cloud = cloud,
                                      .frame = &source->frame,
                                      .visible = &visible,
                                      .pixels = pixels_of(in) };
    return sp_cloud_cut(&cut, in->pool, in->arena, choice) ||
           sp_arena_fail(in->arena, "elements", err);
}

bool sp_cloud_prepare(const struct sp_cloud_input *in, struct sp_cloud *cloud,
                      struct sp_voxel_source *source, struct sp_error *err) {
    *cloud =
        (struct sp_cloud){ .elements = sp_volume_elements(in->volume),
                           .size = 1,
                           .parts = 1,
                           .part_deviation = 1,
                           .opacity = in->layer->opacity,
                           .is_normalised = in->layer->convention == SP_CONVENTION_NORMALISED };
    *source = (struct sp_voxel_source){ .set_up = in->set_up,
                                        .from = cloud,
                                        .count = cloud->elements->shape.count };
    struct sp_grid *grid = sp_arena_alloc(in->arena, "elements", 1, sizeof *grid);
    if (!grid)
        return sp_arena_fail(in->arena, "elements", err);
    init_frame(in, grid, &source->frame);
    place(in, source->frame.ewa.unit, cloud);
    if (!source->frame.is_trained) {
        cloud->size = (float)in->layer->size;
        if (!classify(in, cloud, err))
            return false;
        set_coloring(in, cloud);
    }
    struct sp_cloud_choice choice;
    if (!choose(in, cloud, source, &choice, err))
        return false;
    if (!source->frame.is_trained && !source->frame.has_streaks)
        choose_parts(&in->view->compositing, choice.count, cloud);
    sp_voxel_set_up_fn *first = source->frame.is_trained ? in->set_up : NULL;
    if (!in->set_up) /* the caller sorts */
        source->order = (struct sp_voxel_order){ choice.elements, choice.count };
    else if (!sp_cloud_sort(cloud, choice.elements ? &choice : NULL, &source->frame, first,
                            in->pool, in->arena, &in->interrupt, &source->order))
        return sp_arena_fail(in->arena, "elements", err);
    return !sp_interrupt_is_cancelled(&in->interrupt) ||
           sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
}
