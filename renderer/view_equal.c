/* SPDX-License-Identifier: Apache-2.0
 *
 * Compares views field by field. Structures have padding, and lists have unused entries, so that
 * equal views may differ in their bytes. tests/unit/view_equal_test.c changes each byte of a view:
 * a field that is forgotten here fails it.
 */
#include <math.h>
#include <string.h>

#include "sp/view.h"

static bool is_same(double a, double b) {
    if (isnan(a) || isnan(b))
        return isnan(a) && isnan(b);
    return a == b && signbit(a) == signbit(b);
}

static bool are_same(const double *a, const double *b, size_t count) {
    size_t i = 0;
    while (i < count && is_same(a[i], b[i]))
        i++;
    return i == count;
}

static bool are_same_floats(const float *a, const float *b, size_t count) {
    size_t i = 0;
    while (i < count && is_same((double)a[i], (double)b[i]))
        i++;
    return i == count;
}

static bool is_same_name(const char a[SP_NAME_BYTES], const char b[SP_NAME_BYTES]) {
    return strncmp(a, b, SP_NAME_BYTES) == 0;
}

static bool is_same_camera(const struct sp_camera *a, const struct sp_camera *b) {
    return a->projection == b->projection && are_same(a->position, b->position, 3) &&
           are_same(a->target, b->target, 3) && are_same(a->up, b->up, 3) &&
           is_same(a->fov_y, b->fov_y) && is_same(a->height, b->height) &&
           is_same(a->near, b->near);
}

static bool are_same_points(const struct sp_tf_point *a, const struct sp_tf_point *b,
                            uint32_t count) {
    uint32_t i = 0;
    while (i < count && is_same(a[i].value, b[i].value) &&
           are_same_floats(a[i].color, b[i].color, 3) &&
           are_same_floats(&a[i].opacity, &b[i].opacity, 1))
        i++;
    return i == count;
}

bool sp_transfer_function_equal(const struct sp_transfer_function *a,
                                const struct sp_transfer_function *b) {
    uint32_t i = 0;
    if (!is_same(a->reference_length, b->reference_length) || a->order != b->order ||
        a->point_count != b->point_count || a->gradient_count != b->gradient_count ||
        !are_same_points(a->points, b->points, a->point_count))
        return false;
    while (i < a->gradient_count && is_same(a->gradient[i].magnitude, b->gradient[i].magnitude) &&
           are_same_floats(&a->gradient[i].scale, &b->gradient[i].scale, 1))
        i++;
    return i == a->gradient_count;
}

static bool is_same_filter(const struct sp_filter *a, const struct sp_filter *b) {
    return a->mode == b->mode && a->kernel == b->kernel && is_same(a->sigma, b->sigma) &&
           is_same(a->cutoff, b->cutoff) && is_same(a->lowpass, b->lowpass) &&
           is_same(a->c_min, b->c_min) && is_same(a->c_max, b->c_max);
}

static bool is_same_compositing(const struct sp_compositing_options *a,
                                const struct sp_compositing_options *b) {
    return a->mode == b->mode && a->attenuation == b->attenuation && is_same(a->slab, b->slab) &&
           a->colors == b->colors && is_same(a->center, b->center) && is_same(a->width, b->width) &&
           is_same(a->zero, b->zero) && is_same(a->absorption, b->absorption);
}

static bool is_same_shading(const struct sp_shading *a, const struct sp_shading *b) {
    uint32_t i = 0;
    if (a->mode != b->mode || !is_same(a->ambient, b->ambient) ||
        !is_same(a->diffuse, b->diffuse) || !is_same(a->specular, b->specular) ||
        !is_same(a->exponent, b->exponent) || !is_same(a->smoothing, b->smoothing) ||
        !is_same(a->occlusion, b->occlusion) || !is_same(a->shadow, b->shadow) ||
        !is_same(a->reach, b->reach) || a->light_count != b->light_count)
        return false;
    while (i < a->light_count && a->lights[i].space == b->lights[i].space &&
           are_same(a->lights[i].direction, b->lights[i].direction, 3) &&
           are_same_floats(a->lights[i].color, b->lights[i].color, 3))
        i++;
    return i == a->light_count;
}

static bool is_same_layer(const struct sp_layer *a, const struct sp_layer *b) {
    return a->type == b->type && a->visible == b->visible && is_same(a->value, b->value) &&
           are_same_floats(a->color, b->color, 3) && are_same_floats(&a->opacity, &b->opacity, 1) &&
           is_same(a->flatness, b->flatness) && is_same(a->low, b->low) &&
           is_same(a->high, b->high) && a->detail == b->detail && a->style == b->style &&
           is_same(a->phase, b->phase) && is_same(a->stretch, b->stretch) &&
           is_same(a->density, b->density) && is_same_name(a->color_by, b->color_by) &&
           is_same(a->color_low, b->color_low) && is_same(a->color_high, b->color_high) &&
           is_same_name(a->id, b->id) && are_same(a->transform, b->transform, 16) &&
           is_same(a->size, b->size) && a->convention == b->convention && a->colors == b->colors &&
           a->point_count == b->point_count &&
           are_same_points(a->points, b->points, a->point_count);
}

static bool is_same_clip(const struct sp_clip *a, const struct sp_clip *b) {
    uint32_t i = 0;
    if (!are_same(a->box[0], b->box[0], 3) || !are_same(a->box[1], b->box[1], 3) ||
        a->plane_count != b->plane_count)
        return false;
    while (i < a->plane_count && are_same(a->planes[i].normal, b->planes[i].normal, 3) &&
           is_same(a->planes[i].offset, b->planes[i].offset))
        i++;
    return i == a->plane_count;
}

static bool is_same_edit(const struct sp_edit *a, const struct sp_edit *b) {
    return a->type == b->type && a->keep == b->keep && are_same(a->normal, b->normal, 3) &&
           is_same(a->offset, b->offset) && are_same(a->box[0], b->box[0], 3) &&
           are_same(a->box[1], b->box[1], 3) && are_same(a->center, b->center, 3) &&
           is_same(a->radius, b->radius) && are_same(a->point, b->point, 3) &&
           are_same(a->range, b->range, 2);
}

static bool are_same_slices(const struct sp_slices *a, const struct sp_slices *b) {
    for (int i = 0; i < 3; i++)
        if (a->planes[i] != b->planes[i])
            return false;
    return a->mode == b->mode && a->in_3d == b->in_3d && are_same(a->position, b->position, 3) &&
           are_same(a->normal, b->normal, 3) && is_same(a->center, b->center) &&
           is_same(a->width, b->width) && a->colors == b->colors;
}

/* Compares everything but the slices. */
static bool is_same_scene(const struct sp_view *a, const struct sp_view *b) {
    if (a->layer_count != b->layer_count || a->edit_count != b->edit_count)
        return false;
    for (uint32_t i = 0; i < a->layer_count; i++)
        if (!is_same_layer(&a->layers[i], &b->layers[i]))
            return false;
    for (uint32_t i = 0; i < a->edit_count; i++)
        if (!is_same_edit(&a->edits[i], &b->edits[i]))
            return false;
    return is_same_name(a->volume, b->volume) && a->size[0] == b->size[0] &&
           a->size[1] == b->size[1] && are_same_floats(a->background, b->background, 4) &&
           is_same_camera(&a->camera, &b->camera) &&
           sp_transfer_function_equal(&a->transfer_function, &b->transfer_function) &&
           is_same_filter(&a->filter, &b->filter) &&
           is_same_compositing(&a->compositing, &b->compositing) &&
           is_same_shading(&a->shading, &b->shading) && is_same_clip(&a->clip, &b->clip) &&
           a->level_of_detail == b->level_of_detail && a->time.step == b->time.step;
}

bool sp_view_equal(const struct sp_view *a, const struct sp_view *b) {
    return is_same_scene(a, b) && are_same_slices(&a->slices, &b->slices);
}

bool sp_view_is_same_image(const struct sp_view *a, const struct sp_view *b) {
    bool has_slices = sp_view_draws_slices(a) || sp_view_draws_slices(b);
    return has_slices ? sp_view_equal(a, b) : is_same_scene(a, b);
}
