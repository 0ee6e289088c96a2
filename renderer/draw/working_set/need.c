/* SPDX-License-Identifier: Apache-2.0
 *
 * Which bricks of a level a view may show: by the range of their values (without channels), by what
 * is clipped, and by what lies beside the image. And how much each of them matters:
 *
 *   importance = opacity · (radius / distance from the eye)²
 *
 * The opacity is the largest one that the transfer function gives to a value of the brick: the
 * range tells no more. The square is the brick's projected area, and its distance says what may
 * hide it: of bricks with the same opacity the nearest one is first. An orthographic camera sees
 * all bricks equally large; there the distance is that from the plane of the eye, so that the front
 * is also first. Bricks that the camera does not see now come last.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "classify/visible_ranges.h"
#include "data/bricks/places.h"
#include "data/volume/grid.h"
#include "draw/working_set/working_set.h"

/* The image is taken to be wider by this factor, so that a small turn needs no other bricks. */
static const double wider = 1.1;

struct search {
    const struct sp_brick_header *header;
    const struct sp_brick_entry *entries;
    const struct sp_view *view;
    unsigned level;
    bool is_whole; /* whatever the camera sees */
    /* The box is that of all channels: each of them shows other values, and the clip box of a frame
     * is in fractions of one subvolume. */
    bool has_channels;
    struct sp_visible_ranges visible;
    bool shows_all;     /* every value may matter */
    bool is_classified; /* all that is shown is what the transfer function shows */
    double surfaces[SP_LAYERS_MAX];
    uint32_t surface_count;
    struct sp_camera_transform camera;
    double margin; /* samples around a brick that what its samples draw may cover */
};

/* How far streaks reach from their samples [samples]; 0 = there are none. */
static double compute_reach(const struct sp_view *view) {
    const double cubic = 2; /* where the other kernels end */
    double reach = 0;
    for (uint32_t i = 0; i < view->layer_count; i++) {
        const struct sp_layer *layer = &view->layers[i];
        const double radius = view->filter.kernel == SP_KERNEL_GAUSSIAN
                                  ? view->filter.sigma * view->filter.cutoff
                                  : cubic;
        if (layer->visible && layer->type == SP_LAYER_VECTORS && !layer->id[0])
            reach = fmax(reach, radius * layer->stretch);
    }
    return reach;
}

/* Chooses by which values bricks may be left out. */
static void choose_values(struct search *s) {
    const struct sp_view *view = s->view;
    bool has_function = false;
    s->shows_all = sp_compositing_is_projection(view->compositing.mode) || view->edit_count > 0 ||
                   sp_view_draws_slices(view);
    for (uint32_t i = 0; i < view->layer_count; i++) {
        const struct sp_layer *layer = &view->layers[i];
        if (layer->visible && layer->type == SP_LAYER_SURFACE)
            s->surfaces[s->surface_count++] = layer->value;
        has_function |=
            layer->visible && (layer->type == SP_LAYER_VOLUME || layer->type == SP_LAYER_SHELL ||
                               layer->type == SP_LAYER_VECTORS);
    }
    if (has_function)
        sp_visible_ranges_init(&s->visible, &view->transfer_function);
    s->is_classified = has_function && !s->shows_all && !s->has_channels && !s->surface_count;
}

/* The values that interpolation in a brick may give: it may exceed the range of the samples by a
 * quarter (draw/resample/README.md). */
static double low_end(const struct sp_brick_entry *entry) {
    return entry->range[0] - 0.25 * (entry->range[1] - entry->range[0]);
}

static double high_end(const struct sp_brick_entry *entry) {
    return entry->range[1] + 0.25 * (entry->range[1] - entry->range[0]);
}

static bool may_show(const struct search *s, const struct sp_brick_entry *entry) {
    const double low = low_end(entry), high = high_end(entry);
    if (s->has_channels)
        return true;
    if (entry->range[0] > entry->range[1])
        return false; /* no sample is finite */
    if (s->shows_all || sp_visible_ranges_overlap(&s->visible, low, high))
        return true;
    for (uint32_t i = 0; i < s->surface_count; i++)
        if (s->surfaces[i] >= low && s->surfaces[i] <= high)
            return true;
    return false;
}

/* A brick in the world, with the samples next to it: its centre, and half of its edges. */
struct block {
    struct sp_vec3 centre, half[3];
};

static void compute_block(const struct search *s, const uint32_t first[3], const uint32_t size[3],
                          struct block *block) {
    const struct sp_grid *grid = &s->header->info.grid;
    block->centre = sp_vec3_from(grid->origin);
    for (int a = 0; a < 3; a++) {
        const double begin = first[a] - 0.5 - s->margin, end = begin + size[a] + 2 * s->margin;
        const double low = sp_brick_distance(s->header, s->level, a, begin);
        const double high = sp_brick_distance(s->header, s->level, a, end);
        for (int r = 0; r < 3; r++) {
            block->centre.v[r] += grid->direction[r][a] * (0.5 * (low + high));
            block->half[a].v[r] = grid->direction[r][a] * (0.5 * (high - low));
        }
    }
}

/* The largest opacity that values in [low, high] have. */
static double measure_opacity(const struct sp_transfer_function *tf, double low, double high) {
    const struct sp_tf_point *points = tf->points;
    const uint32_t last = tf->point_count - 1;
    double most = 0;
    if (low < points[0].value)
        most = (double)points[0].opacity;
    if (high > points[last].value)
        most = fmax(most, (double)points[last].opacity);
    for (uint32_t i = 0; i <= last; i++) {
        const double ends[2] = { fmax(low, points[i].value),
                                 i < last ? fmin(high, points[i + 1].value) : -INFINITY };
        if (points[i].value >= low && points[i].value <= high)
            most = fmax(most, (double)points[i].opacity);
        if (!(ends[0] <= ends[1] && points[i].value < points[i + 1].value))
            continue;
        for (int side = 0; side < 2; side++) { /* the function is linear between points */
            const double share =
                (ends[side] - points[i].value) / (points[i + 1].value - points[i].value);
            const double rise = (double)points[i + 1].opacity - (double)points[i].opacity;
            most = fmax(most, (double)points[i].opacity + share * rise);
        }
    }
    return most;
}

/* The importance as a number of struct sp_brick_need: 1024 of them per power of two. Seen bricks
 * have numbers of the upper half. */
static uint16_t to_number(double importance, bool is_seen) {
    enum { HALF = 1 << 15, PER_OCTAVE = 1 << 10 };
    const double number = HALF - 1 + PER_OCTAVE * log2(importance); /* of 1: the largest one */
    return (uint16_t)(fmin(fmax(number, BRICK_WANTED), HALF - 1) + (is_seen ? HALF : 0));
}

static uint16_t compute_importance(const struct search *s, const struct sp_brick_entry *entry,
                                   const struct block *block, bool is_seen) {
    const struct sp_camera_transform *c = &s->camera;
    const struct sp_vec3 way = sp_vec3_sub(block->centre, c->eye);
    const double distance = c->projection == SP_PERSPECTIVE
                                ? sp_vec3_length(way)
                                : sp_vec3_dot(sp_vec3_from(c->w.m[2]), way);
    double radius = 0, opacity = 1;
    for (int a = 0; a < 3; a++)
        radius += sp_vec3_dot(block->half[a], block->half[a]);
    radius = sqrt(radius);
    if (s->is_classified)
        opacity = measure_opacity(&s->view->transfer_function, low_end(entry), high_end(entry));
    const double share = radius / fmax(distance, radius); /* 1 if the eye is in the brick */
    return to_number(opacity * share * share, is_seen);
}

/* The largest normal·(world − point) of the block. */
static double compute_most(const struct block *block, struct sp_vec3 normal, struct sp_vec3 point) {
    double most = sp_vec3_dot(normal, sp_vec3_sub(block->centre, point));
    for (int a = 0; a < 3; a++)
        most += fabs(sp_vec3_dot(normal, block->half[a]));
    return most;
}

static bool is_in_image(const struct search *s, const struct block *block) {
    const struct sp_camera_transform *c = &s->camera;
    const struct sp_vec3 forward = sp_vec3_from(c->w.m[2]);
    if (compute_most(block, forward, c->eye) < c->near)
        return false;
    for (int i = 0; i < 4; i++) { /* the four sides */
        const int axis = i >> 1;
        struct sp_vec3 inwards = sp_vec3_scale(sp_vec3_from(c->w.m[axis]), i & 1 ? 1 : -1);
        double least = -wider * c->centre[axis] / c->scale;
        if (c->projection == SP_PERSPECTIVE) {
            const double tangent = wider * c->tan_half[axis];
            for (int r = 0; r < 3; r++)
                inwards.v[r] += tangent * forward.v[r];
            least = 0;
        }
        if (compute_most(block, inwards, c->eye) < least)
            return false;
    }
    return true;
}

static bool is_clipped(const struct search *s, const uint32_t first[3], const uint32_t size[3],
                       const struct block *block) {
    const struct sp_clip *clip = &s->view->clip;
    const struct sp_vec3 zero = { { 0, 0, 0 } };
    for (int a = 0; a < 3; a++) {
        const double low = sp_brick_distance(s->header, s->level, a, first[a] - 1.5);
        const double high = sp_brick_distance(s->header, s->level, a, first[a] + size[a] + 0.5);
        double extent[2];
        sp_grid_extent(&s->header->info.grid, (unsigned)a, extent);
        const double length = extent[1] - extent[0];
        if (high < extent[0] + clip->box[0][a] * length ||
            low > extent[0] + clip->box[1][a] * length)
            return true;
    }
    for (uint32_t i = 0; i < clip->plane_count; i++)
        if (compute_most(block, sp_vec3_from(clip->planes[i].normal), zero) <
            clip->planes[i].offset)
            return true;
    return false;
}

/* How much a brick matters; 0 = it is not needed. */
static uint16_t compute_mark(const struct search *s, uint64_t number) {
    uint32_t first[3], size[3];
    struct block block;
    if (!may_show(s, &s->entries[number]))
        return 0;
    sp_brick_box(&s->header->level[s->level], number, first, size);
    compute_block(s, first, size, &block);
    const bool is_seen = is_in_image(s, &block) && !is_clipped(s, first, size, &block);
    return is_seen || s->is_whole ? compute_importance(s, &s->entries[number], &block, is_seen) : 0;
}

/* The box of the bricks that are marked; false = there are none. */
static bool bound_marks(const struct sp_brick_level *level, const uint16_t *marks,
                        uint32_t first[3], uint32_t count[3]) {
    uint32_t last[3] = { 0, 0, 0 };
    bool any = false;
    for (int a = 0; a < 3; a++)
        first[a] = level->bricks[a];
    for (uint64_t i = 0; i < sp_brick_count(level); i++) {
        const uint32_t at[3] = { (uint32_t)(i % level->bricks[0]),
                                 (uint32_t)(i / level->bricks[0] % level->bricks[1]),
                                 (uint32_t)(i / level->bricks[0] / level->bricks[1]) };
        for (int a = 0; marks[i] && a < 3; a++) {
            first[a] = at[a] < first[a] ? at[a] : first[a];
            last[a] = at[a] > last[a] ? at[a] : last[a];
        }
        any |= marks[i] != 0;
    }
    for (int a = 0; a < 3; a++)
        count[a] = any ? last[a] - first[a] + 1 : 0;
    return any;
}

bool sp_working_set_needs_vectors(const struct sp_brick_file *file, const struct sp_view *view) {
    return compute_reach(view) > 0 && sp_brick_file_header(file)->info.vector_bytes > 0;
}

bool sp_working_set_need(const struct sp_brick_file *file, const struct sp_view *view,
                         unsigned level, bool is_whole, struct sp_brick_need *need) {
    struct search s = { .header = sp_brick_file_header(file),
                        .entries = sp_brick_file_entries(file, level),
                        .view = view,
                        .level = level,
                        .is_whole = is_whole,
                        .has_channels = sp_view_has_channels(view) };
    const struct sp_brick_level *own = &s.header->level[level];
    const uint64_t count = sp_brick_count(own);
    uint16_t *marks = malloc(count * sizeof *marks);
    *need = (struct sp_brick_need){ .level = level,
                                    .has_vectors = sp_working_set_needs_vectors(file, view) };
    s.margin = fmax(compute_reach(view), 1);
    if (!marks)
        return false;
    choose_values(&s);
    sp_camera_transform_init(&s.camera, &view->camera, view->size);
    sp_brick_file_begin(file);
    for (uint64_t i = 0; i < count; i++)
        marks[i] = compute_mark(&s, i);
    sp_brick_file_end(file);
    if (bound_marks(own, marks, need->first, need->count)) {
        sp_brick_need_allocate(need, 0);
        for (uint64_t i = 0; need->wanted && i < sp_brick_need_count(need); i++)
            need->wanted[i] = marks[sp_brick_need_at(need, own, i)];
    }
    free(marks);
    return need->wanted || !need->count[0];
}
