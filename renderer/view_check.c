/* SPDX-License-Identifier: Apache-2.0 */
#include "sp/view.h"

#include <float.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "base/vec.h"
#include "splat/adaptive.h"

__attribute__((format(printf, 5, 6))) static bool
check_range(double x, double low, double high, struct sp_error *err, const char *format, ...) {
    if (x >= low && x <= high)
        return true;
    char pointer[SP_ERROR_PLACE];
    va_list args;
    va_start(args, format);
    vsnprintf(pointer, sizeof pointer, format, args);
    va_end(args);
    if (!isfinite(x))
        return sp_fail(err, SP_ERR_INVALID, pointer, "not a finite number");
    if (high >= DBL_MAX)
        return sp_fail(err, SP_ERR_INVALID, pointer, "%g is less than %g", x, low);
    return sp_fail(err, SP_ERR_INVALID, pointer, "%g is outside [%g, %g]", x, low, high);
}

static bool check_finite3(const double v[3], const char *pointer, struct sp_error *err) {
    for (int i = 0; i < 3; i++)
        if (!check_range(v[i], -DBL_MAX, DBL_MAX, err, "%s/%d", pointer, i))
            return false;
    return true;
}

static bool check_position(const double v[3], const char *pointer, struct sp_error *err) {
    for (int i = 0; i < 3; i++)
        if (!check_range(v[i], -SP_POSITION_MAX, SP_POSITION_MAX, err, "%s/%d", pointer, i))
            return false;
    return true;
}

static bool check_positive(double x, const char *pointer, struct sp_error *err) {
    if (isfinite(x) && x > 0)
        return true;
    return sp_fail(err, SP_ERR_INVALID, pointer, "%g is not a finite number above 0", x);
}

static bool check_choice(unsigned value, unsigned last, const char *pointer, struct sp_error *err) {
    return value <= last ||
           sp_fail(err, SP_ERR_INVALID, pointer, "%u is outside [0, %u]", value, last);
}

/* A vector without direction; any finite length is fine, whatever its square does. */
static bool is_zero(const double v[3]) {
    return v[0] == 0 && v[1] == 0 && v[2] == 0;
}

static bool check_camera(const struct sp_camera *c, struct sp_error *err) {
    if (!check_choice(c->projection, SP_ORTHOGRAPHIC, "/camera/projection", err) ||
        !check_position(c->position, "/camera/position", err) ||
        !check_position(c->target, "/camera/target", err) ||
        !check_finite3(c->up, "/camera/up", err) ||
        !check_range(c->fov_y, 1, 170, err, "/camera/fov_y") ||
        !check_positive(c->height, "/camera/height", err) ||
        !check_positive(c->near, "/camera/near", err))
        return false;
    double to[3], reach = 0;
    for (int i = 0; i < 3; i++) {
        to[i] = c->target[i] / 4 - c->position[i] / 4;
        reach = fmax(reach, fmax(fabs(c->position[i] / 4), fabs(c->target[i] / 4)));
    }
    struct sp_vec3 forward = sp_vec3_unit(to);
    /* Closer than this the direction is rounding noise. */
    double apart = fmax(fabs(to[0]), fmax(fabs(to[1]), fabs(to[2])));
    if (!(apart > 1e-12 * reach))
        return sp_fail(err, SP_ERR_INVALID, "/camera/position",
                       "position and target are the same point; move one of them");
    if (is_zero(c->up))
        return sp_fail(err, SP_ERR_INVALID, "/camera/up", "up is zero; give it a direction");
    if (!(sp_vec3_length(sp_vec3_cross(forward, sp_vec3_unit(c->up))) > 1e-6))
        return sp_fail(err, SP_ERR_INVALID, "/camera/up",
                       "up is parallel to the view direction; turn one of them");
    return true;
}

/* Checks the points of a transfer function. `owner` is the JSON pointer of the transfer function,
 * or of the channel; errors have it at the start of their place. */
static bool check_points(const struct sp_tf_point *points, uint32_t count, const char *owner,
                         struct sp_error *err) {
    char place[96], pointer[112];
    for (uint32_t i = 0; i < count; i++) {
        const struct sp_tf_point *p = &points[i];
        snprintf(place, sizeof place, "%s/points/%u", owner, i);
        if (!check_range(p->value, -DBL_MAX, DBL_MAX, err, "%s/value", place))
            return false;
        if (i && !(p->value > p[-1].value)) {
            snprintf(pointer, sizeof pointer, "%s/value", place);
            return sp_fail(err, SP_ERR_INVALID, pointer,
                           "%g does not rise above the point before it (%g)", p->value,
                           p[-1].value);
        }
        for (int c = 0; c < 3; c++)
            if (!check_range(p->color[c], 0, 1, err, "%s/color/%d", place, c))
                return false;
        if (!(p->opacity >= 0 && p->opacity < 1)) {
            snprintf(pointer, sizeof pointer, "%s/opacity", place);
            return sp_fail(err, SP_ERR_INVALID, pointer, "%g is outside [0, 1)", p->opacity);
        }
    }
    return true;
}

static bool check_transfer_function(const struct sp_transfer_function *tf, struct sp_error *err) {
    if (!check_positive(tf->reference_length, "/transfer_function/reference_length", err) ||
        !check_choice(tf->order, SP_TF_AUTO, "/transfer_function/order", err) ||
        !check_range(tf->point_count, 1, SP_TF_POINTS_MAX, err, "/transfer_function/points") ||
        !check_range(tf->gradient_count, 0, SP_GRADIENT_POINTS_MAX, err,
                     "/transfer_function/gradient") ||
        !check_points(tf->points, tf->point_count, "/transfer_function", err))
        return false;
    char place[96];
    for (uint32_t i = 0; i < tf->gradient_count; i++) {
        const struct sp_gradient_point *p = &tf->gradient[i];
        snprintf(place, sizeof place, "/transfer_function/gradient/%u", i);
        if (!check_range(p->magnitude, 0, DBL_MAX, err, "%s/magnitude", place) ||
            !check_range(p->scale, 0, 1, err, "%s/scale", place))
            return false;
        if (i && !(p->magnitude > p[-1].magnitude)) {
            snprintf(place, sizeof place, "/transfer_function/gradient/%u/magnitude", i);
            return sp_fail(err, SP_ERR_INVALID, place,
                           "%g does not rise above the point before it (%g)", p->magnitude,
                           p[-1].magnitude);
        }
    }
    return true;
}

static bool check_filter(const struct sp_filter *f, const struct sp_camera *camera,
                         struct sp_error *err) {
    if (!check_choice(f->mode, SP_FILTER_NONE, "/filter/mode", err) ||
        !check_choice(f->kernel, SP_KERNEL_CUBIC, "/filter/kernel", err) ||
        !check_range(f->sigma, 0.3, 2, err, "/filter/sigma") ||
        !check_range(f->cutoff, 1, 6, err, "/filter/cutoff") ||
        !check_range(f->lowpass, 0, 8, err, "/filter/lowpass") ||
        !check_positive(f->c_min, "/filter/c_min", err))
        return false;
    if (!isnan(f->c_max) && !check_positive(f->c_max, "/filter/c_max", err))
        return false;
    double c_max = sp_adaptive_c_max(f, camera);
    return f->c_min <= c_max ||
           sp_fail(err, SP_ERR_INVALID, "/filter/c_min", "c_min %g is above c_max %g%s", f->c_min,
                   c_max, isnan(f->c_max) ? ", its default for this camera" : "");
}

static bool check_compositing(const struct sp_view *view, struct sp_error *err) {
    const struct sp_compositing_options *c = &view->compositing;
    if (!check_choice(c->mode, SP_COMPOSITE_SUM, "/compositing/mode", err) ||
        !check_choice(c->attenuation, SP_ATTENUATION_LINEAR, "/compositing/attenuation", err) ||
        !check_range(c->slab, 0.05, 64, err, "/compositing/slab") ||
        !check_choice(c->colors, SP_COLORS_TRANSFER_FUNCTION, "/compositing/colors", err) ||
        (!isnan(c->center) &&
         !check_range(c->center, -DBL_MAX, DBL_MAX, err, "/compositing/window/center")) ||
        (!isnan(c->width) && !check_positive(c->width, "/compositing/window/width", err)) ||
        (!isnan(c->zero) && !check_range(c->zero, -DBL_MAX, DBL_MAX, err, "/compositing/zero")) ||
        (!isnan(c->absorption) && !check_positive(c->absorption, "/compositing/absorption", err)))
        return false;
    if (c->mode == SP_COMPOSITE_SUM && c->colors == SP_COLORS_TRANSFER_FUNCTION)
        return sp_fail(err, SP_ERR_INVALID, "/compositing/colors",
                       "a sum is not in the unit of the transfer function: use \"grey\"");
    if (view->transfer_function.order == SP_TF_POST && c->mode == SP_COMPOSITE_SPLAT)
        return sp_fail(
            err, SP_ERR_INVALID, "/transfer_function/order",
            "\"post\" needs compositing.mode \"sheet\" or \"slab\": change both at once, or "
            "go back to \"auto\"");
    return true;
}

static bool check_shading(const struct sp_shading *s, struct sp_error *err) {
    if (!check_choice(s->mode, SP_SHADING_PHONG, "/shading/mode", err) ||
        !check_range(s->ambient, 0, 4, err, "/shading/ambient") ||
        !check_range(s->diffuse, 0, 4, err, "/shading/diffuse") ||
        !check_range(s->specular, 0, 4, err, "/shading/specular") ||
        !check_range(s->exponent, 1, 1024, err, "/shading/exponent") ||
        (!isnan(s->smoothing) && !check_range(s->smoothing, 0, 1, err, "/shading/smoothing")) ||
        !check_range(s->occlusion, 0, 1, err, "/shading/occlusion") ||
        !check_range(s->shadow, 0, 1, err, "/shading/shadow") ||
        !check_range(s->reach, 0.01, 10, err, "/shading/reach") ||
        !check_range(s->light_count, 0, SP_LIGHTS_MAX, err, "/shading/lights"))
        return false;
    for (uint32_t i = 0; i < s->light_count; i++) {
        const struct sp_light *l = &s->lights[i];
        char place[64];
        snprintf(place, sizeof place, "/shading/lights/%u/space", i);
        if (!check_choice(l->space, SP_LIGHT_WORLD, place, err))
            return false;
        snprintf(place, sizeof place, "/shading/lights/%u/direction", i);
        if (!check_finite3(l->direction, place, err))
            return false;
        if (is_zero(l->direction))
            return sp_fail(err, SP_ERR_INVALID, place, "the direction is zero");
        for (int c = 0; c < 3; c++)
            if (!check_range(l->color[c], 0, 4, err, "/shading/lights/%u/color/%d", i, c))
                return false;
    }
    return true;
}

static bool check_color(const struct sp_layer *layer, const char *place, struct sp_error *err) {
    for (int c = 0; c < 3; c++)
        if (!check_range(layer->color[c], 0, 1, err, "%s/color/%d", place, c))
            return false;
    return true;
}

static bool check_surface(const struct sp_layer *layer, const char *place, struct sp_error *err) {
    char pointer[48];
    if (!check_range(layer->value, -DBL_MAX, DBL_MAX, err, "%s/value", place) ||
        !check_color(layer, place, err))
        return false;
    if (!check_range(layer->opacity, 0, 1, err, "%s/opacity", place))
        return false;
    snprintf(pointer, sizeof pointer, "%s/flatness", place);
    return layer->flatness >= 1 ||
           sp_fail(err, SP_ERR_INVALID, pointer, "%g is less than 1", layer->flatness);
}

static bool check_shell(const struct sp_layer *layer, const char *place, struct sp_error *err) {
    char pointer[48];
    if (!check_range(layer->low, 0, 1, err, "%s/low", place) ||
        !check_range(layer->high, 0, 1, err, "%s/high", place))
        return false;
    snprintf(pointer, sizeof pointer, "%s/low", place);
    if (layer->low > layer->high)
        return sp_fail(err, SP_ERR_INVALID, pointer, "%g is above high (%g)", layer->low,
                       layer->high);
    snprintf(pointer, sizeof pointer, "%s/detail", place);
    return check_choice(layer->detail, SP_SHELL_FAST, pointer, err);
}

static bool check_coloring(const struct sp_layer *layer, const char *place, struct sp_error *err) {
    const double low = layer->color_low, high = layer->color_high;
    char pointer[48];
    snprintf(pointer, sizeof pointer, "%s/color_by", place);
    if (!memchr(layer->color_by, 0, sizeof layer->color_by))
        return sp_fail(err, SP_ERR_INVALID, pointer, "the id is longer than %d bytes",
                       SP_NAME_BYTES - 1);
    if ((!isnan(low) && !check_range(low, -DBL_MAX, DBL_MAX, err, "%s/color_low", place)) ||
        (!isnan(high) && !check_range(high, -DBL_MAX, DBL_MAX, err, "%s/color_high", place)))
        return false;
    snprintf(pointer, sizeof pointer, "%s/color_high", place);
    return !(low >= high) ||
           sp_fail(err, SP_ERR_INVALID, pointer, "%g is not above color_low, %g", high, low);
}

static bool check_vectors(const struct sp_layer *layer, const char *place, struct sp_error *err) {
    char pointer[48];
    snprintf(pointer, sizeof pointer, "%s/style", place);
    return check_choice(layer->style, SP_VECTORS_BLEND, pointer, err) &&
           check_color(layer, place, err) && check_coloring(layer, place, err) &&
           check_range(layer->phase, -1e6, 1e6, err, "%s/phase", place) &&
           check_range(layer->stretch, 1, 8, err, "%s/stretch", place) &&
           check_range(layer->density, 0, 1, err, "%s/density", place);
}

static bool check_id(const struct sp_layer *layer, const char *place, struct sp_error *err) {
    char pointer[48];
    snprintf(pointer, sizeof pointer, "%s/id", place);
    return memchr(layer->id, 0, sizeof layer->id) ||
           sp_fail(err, SP_ERR_INVALID, pointer, "the id is longer than %d bytes",
                   SP_NAME_BYTES - 1);
}

/* Of a layer of elements: where they come from and where they are. */
static bool check_elements(const struct sp_layer *layer, const char *place, struct sp_error *err) {
    const double *m = layer->transform;
    char pointer[48];
    if (!check_id(layer, place, err))
        return false;
    for (int i = 0; i < 16; i++)
        if (!check_range(m[i], -SP_POSITION_MAX, SP_POSITION_MAX, err, "%s/transform/%d", place, i))
            return false;
    snprintf(pointer, sizeof pointer, "%s/transform", place);
    if (m[12] != 0 || m[13] != 0 || m[14] != 0 || m[15] != 1)
        return sp_fail(err, SP_ERR_INVALID, pointer,
                       "the last four numbers, its last row, are not 0, 0, 0, 1");
    const struct sp_mat3 turn = {
        { { m[0], m[1], m[2] }, { m[4], m[5], m[6] }, { m[8], m[9], m[10] } }
    };
    double det = sp_mat3_determinant(&turn), size = 1;
    for (int row = 0; row < 3; row++)
        size *= sp_vec3_length(sp_vec3_from(turn.m[row]));
    return fabs(det) > 1e-9 * size ||
           sp_fail(err, SP_ERR_INVALID, pointer, "it is singular: it flattens the data");
}

static bool check_channel(const struct sp_layer *layer, const char *place, struct sp_error *err) {
    char pointer[48];
    snprintf(pointer, sizeof pointer, "%s/id", place);
    if (!check_id(layer, place, err) || !check_color(layer, place, err))
        return false;
    if (!layer->id[0])
        return sp_fail(err, SP_ERR_INVALID, pointer,
                       "empty: give the id of the volume that the channel shows");
    return check_range(layer->point_count, 0, SP_CHANNEL_POINTS_MAX, err, "%s/points", place) &&
           check_points(layer->points, layer->point_count, place, err);
}

/* Channels must show different volumes. With channels no part may be cut away, because the volumes
 * have different parts. */
static bool check_channels(const struct sp_view *view, struct sp_error *err) {
    char place[32];
    for (uint32_t i = 0; i < view->layer_count; i++)
        for (uint32_t k = 0; k < i && view->layers[i].type == SP_LAYER_CHANNEL; k++) {
            snprintf(place, sizeof place, "/layers/%u/id", i);
            if (view->layers[k].type == SP_LAYER_CHANNEL &&
                strcmp(view->layers[k].id, view->layers[i].id) == 0)
                return sp_fail(err, SP_ERR_INVALID, place,
                               "layer %u is a channel of the same volume: remove one of them", k);
        }
    for (uint32_t i = 0; i < view->edit_count && sp_view_has_channels(view); i++) {
        snprintf(place, sizeof place, "/edits/%u/type", i);
        if (view->edits[i].type == SP_EDIT_PART)
            return sp_fail(err, SP_ERR_INVALID, place,
                           "a part is cut away by the values of one volume, and this view has "
                           "channels: hide them, or use a box, a sphere or a plane");
    }
    return true;
}

static bool check_layer(const struct sp_layer *layer, const char *place, struct sp_error *err) {
    char pointer[48];
    switch (layer->type) {
    case SP_LAYER_SURFACE:
        return check_surface(layer, place, err);
    case SP_LAYER_SHELL:
        return check_shell(layer, place, err);
    case SP_LAYER_VECTORS:
        return check_vectors(layer, place, err);
    case SP_LAYER_POINTS:
        return check_elements(layer, place, err) && check_coloring(layer, place, err) &&
               check_range(layer->size, 0.1, 10, err, "%s/size", place);
    case SP_LAYER_GAUSSIANS:
        snprintf(pointer, sizeof pointer, "%s/convention", place);
        return check_elements(layer, place, err) &&
               check_range(layer->opacity, 0, 1, err, "%s/opacity", place) &&
               check_choice(layer->convention, SP_CONVENTION_NORMALISED, pointer, err);
    case SP_LAYER_GEOMETRY:
        snprintf(pointer, sizeof pointer, "%s/colors", place);
        return check_elements(layer, place, err) && check_color(layer, place, err) &&
               check_range(layer->opacity, 0, 1, err, "%s/opacity", place) &&
               check_choice(layer->colors, SP_COLORS_OF_LAYER, pointer, err);
    case SP_LAYER_CHANNEL:
        return check_channel(layer, place, err);
    case SP_LAYER_VOLUME:
        break;
    }
    return true;
}

static bool check_layers(const struct sp_view *view, struct sp_error *err) {
    /* Layers of which there is one at most. */
    static const char *const single[SP_LAYER_TYPES] = { [SP_LAYER_VOLUME] = "volume",
                                                        [SP_LAYER_SHELL] = "shell",
                                                        [SP_LAYER_VECTORS] = "layer of vectors" };
    unsigned counts[SP_LAYER_TYPES] = { 0 };
    if (!check_range(view->layer_count, 1, SP_LAYERS_MAX, err, "/layers"))
        return false;
    for (uint32_t i = 0; i < view->layer_count; i++) {
        const struct sp_layer *layer = &view->layers[i];
        char place[32];
        snprintf(place, sizeof place, "/layers/%u/type", i);
        if (!check_choice(layer->type, SP_LAYER_TYPES - 1, place, err))
            return false;
        if (++counts[layer->type] > 1 && single[layer->type])
            return sp_fail(err, SP_ERR_INVALID, place,
                           "a second %s: there may be one volume, one shell and one layer of "
                           "vectors",
                           single[layer->type]);
        snprintf(place, sizeof place, "/layers/%u", i);
        if (!check_layer(layer, place, err))
            return false;
    }
    return true;
}

static bool check_clip(const struct sp_clip *clip, struct sp_error *err) {
    for (int corner = 0; corner < 2; corner++)
        for (int i = 0; i < 3; i++)
            if (!check_range(clip->box[corner][i], 0, 1, err, "/clip/box/%d/%d", corner, i))
                return false;
    for (int i = 0; i < 3; i++)
        if (clip->box[0][i] > clip->box[1][i]) {
            char place[32];
            snprintf(place, sizeof place, "/clip/box/0/%d", i);
            return sp_fail(err, SP_ERR_INVALID, place, "%g is above the upper corner's %g",
                           clip->box[0][i], clip->box[1][i]);
        }
    if (!check_range(clip->plane_count, 0, SP_CLIP_PLANES_MAX, err, "/clip/planes"))
        return false;
    for (uint32_t i = 0; i < clip->plane_count; i++) {
        char place[48];
        snprintf(place, sizeof place, "/clip/planes/%u/normal", i);
        if (!check_finite3(clip->planes[i].normal, place, err))
            return false;
        if (is_zero(clip->planes[i].normal))
            return sp_fail(err, SP_ERR_INVALID, place, "the normal is zero");
        if (!check_range(clip->planes[i].offset, -DBL_MAX, DBL_MAX, err, "/clip/planes/%u/offset",
                         i))
            return false;
    }
    return true;
}

static bool check_edit_box(const struct sp_edit *edit, const char *place, struct sp_error *err) {
    char pointer[48];
    for (int i = 0; i < 6; i++)
        if (!check_range(edit->box[i / 3][i % 3], 0, 1, err, "%s/box/%d/%d", place, i / 3, i % 3))
            return false;
    for (int i = 0; i < 3; i++) {
        snprintf(pointer, sizeof pointer, "%s/box/0/%d", place, i);
        if (edit->box[0][i] > edit->box[1][i])
            return sp_fail(err, SP_ERR_INVALID, pointer, "%g is above the upper corner's %g",
                           edit->box[0][i], edit->box[1][i]);
    }
    return true;
}

static bool check_edit_part(const struct sp_edit *edit, const char *place, struct sp_error *err) {
    char pointer[48];
    snprintf(pointer, sizeof pointer, "%s/point", place);
    if (!check_position(edit->point, pointer, err) ||
        !check_range(edit->range[0], -DBL_MAX, DBL_MAX, err, "%s/range/0", place) ||
        !check_range(edit->range[1], -DBL_MAX, DBL_MAX, err, "%s/range/1", place))
        return false;
    snprintf(pointer, sizeof pointer, "%s/range/0", place);
    return edit->range[0] <= edit->range[1] ||
           sp_fail(err, SP_ERR_INVALID, pointer, "%g is above the highest value, %g",
                   edit->range[0], edit->range[1]);
}

static bool check_edit(const struct sp_edit *edit, const char *place, struct sp_error *err) {
    char pointer[48];
    switch (edit->type) {
    case SP_EDIT_PLANE:
        snprintf(pointer, sizeof pointer, "%s/normal", place);
        return check_finite3(edit->normal, pointer, err) &&
               (!is_zero(edit->normal) ||
                sp_fail(err, SP_ERR_INVALID, pointer, "the normal is zero")) &&
               check_range(edit->offset, -DBL_MAX, DBL_MAX, err, "%s/offset", place);
    case SP_EDIT_BOX:
        return check_edit_box(edit, place, err);
    case SP_EDIT_SPHERE:
        snprintf(pointer, sizeof pointer, "%s/center", place);
        if (!check_position(edit->center, pointer, err))
            return false;
        snprintf(pointer, sizeof pointer, "%s/radius", place);
        return check_positive(edit->radius, pointer, err);
    case SP_EDIT_PART:
        return check_edit_part(edit, place, err);
    }
    return true;
}

static bool check_edits(const struct sp_view *view, struct sp_error *err) {
    if (!check_range(view->edit_count, 0, SP_EDITS_MAX, err, "/edits"))
        return false;
    for (uint32_t i = 0; i < view->edit_count; i++) {
        const struct sp_edit *edit = &view->edits[i];
        char place[32];
        snprintf(place, sizeof place, "/edits/%u/type", i);
        if (!check_choice(edit->type, SP_EDIT_PART, place, err))
            return false;
        snprintf(place, sizeof place, "/edits/%u/keep", i);
        if (!check_choice(edit->keep, SP_KEEP_INSIDE, place, err))
            return false;
        snprintf(place, sizeof place, "/edits/%u", i);
        if (!check_edit(edit, place, err))
            return false;
    }
    return true;
}

static bool check_slices(const struct sp_view *view, struct sp_error *err) {
    const struct sp_slices *s = &view->slices;
    if (!check_choice(s->mode, SP_SLICES_OBLIQUE, "/slices/mode", err) ||
        !check_choice(s->colors, SP_SLICE_BLUE_RED, "/slices/colors", err) ||
        !check_position(s->position, "/slices/position", err) ||
        !check_finite3(s->normal, "/slices/normal", err) ||
        !check_range(s->center, -DBL_MAX, DBL_MAX, err, "/slices/window/center") ||
        !check_positive(s->width, "/slices/window/width", err))
        return false;
    if (is_zero(s->normal))
        return sp_fail(err, SP_ERR_INVALID, "/slices/normal", "the normal is zero");
    return s->mode != SP_SLICES_OBLIQUE || !s->in_3d ||
           view->clip.plane_count < SP_CLIP_PLANES_MAX ||
           sp_fail(err, SP_ERR_INVALID, "/slices/in_3d",
                   "an oblique slice in the image needs one of the %d clip planes, and all are "
                   "in use; remove one of them",
                   SP_CLIP_PLANES_MAX);
}

bool sp_view_validate(const struct sp_view *view, struct sp_error *err) {
    for (int i = 0; i < 2; i++)
        if (!check_range(view->size[i], 1, SP_SIZE_MAX, err, "/size/%d", i))
            return false;
    for (int i = 0; i < 4; i++)
        if (!check_range(view->background[i], 0, 1, err, "/background/%d", i))
            return false;
    if (!memchr(view->volume, 0, sizeof view->volume))
        return sp_fail(err, SP_ERR_INVALID, "/volume", "the id is longer than %d bytes",
                       SP_NAME_BYTES - 1);
    return check_camera(&view->camera, err) &&
           check_transfer_function(&view->transfer_function, err) &&
           check_filter(&view->filter, &view->camera, err) && check_compositing(view, err) &&
           check_shading(&view->shading, err) && check_layers(view, err) &&
           check_clip(&view->clip, err) && check_edits(view, err) && check_channels(view, err) &&
           check_slices(view, err) &&
           check_range(view->time.step, 0, SP_STEPS_MAX - 1, err, "/time/step") &&
           check_choice(view->level_of_detail, SP_LOD_OFF, "/quality/level_of_detail", err);
}

/* Finds what the volume lacks and the layer needs; NULL = nothing. */
static const char *find_missing(const struct sp_layer *layer, const struct sp_volume_info *info) {
    const bool is_grid = info->elements.kind == SP_KIND_GRID;
    switch (layer->type) {
    case SP_LAYER_VECTORS:
        return info->vector_bytes ? NULL : "vectors";
    case SP_LAYER_POINTS:
        return info->elements.kind == SP_KIND_POINTS ? NULL : "points";
    case SP_LAYER_GAUSSIANS:
        return info->elements.kind == SP_KIND_GAUSSIANS ? NULL : "Gaussians";
    case SP_LAYER_GEOMETRY:
        return info->elements.kind == SP_KIND_MESH ? NULL : "triangles";
    case SP_LAYER_VOLUME:
    case SP_LAYER_SURFACE:
    case SP_LAYER_SHELL:
    case SP_LAYER_CHANNEL:
        return is_grid ? NULL : "grid of samples";
    }
    return NULL;
}

bool sp_view_layer_fits(const struct sp_view *view, uint32_t layer,
                        const struct sp_volume_info *info, struct sp_error *err) {
    char place[32];
    const struct sp_layer *own = &view->layers[layer];
    const char *missing = find_missing(own, info);
    if ((own->type == SP_LAYER_VECTORS || own->type == SP_LAYER_POINTS) && !missing &&
        strcmp(own->color_by, SP_COLOR_BY_LENGTH) == 0 && !info->vector_bytes) {
        snprintf(place, sizeof place, "/layers/%u/color_by", layer);
        return sp_fail(err, SP_ERR_INVALID, place,
                       "this volume has no vectors whose length gives the colours");
    }
    snprintf(place, sizeof place, "/layers/%u/%s", layer, own->id[0] ? "id" : "type");
    return !missing ||
           sp_fail(err, SP_ERR_INVALID, place,
                   "this volume has no %s: remove or hide the layer, or load another volume",
                   missing);
}

bool sp_view_fits(const struct sp_view *view, const struct sp_volume_info *info,
                  struct sp_error *err) {
    const uint32_t steps = info->steps.count > 1 ? info->steps.count : 1;
    if (view->time.step >= steps)
        return sp_fail(err, SP_ERR_INVALID, "/time/step",
                       "%u is outside [0, %u], the time steps of the volume", view->time.step,
                       steps - 1);
    for (uint32_t i = 0; i < view->layer_count; i++)
        if (view->layers[i].visible && !view->layers[i].id[0] &&
            !sp_view_layer_fits(view, i, info, err))
            return false;
    if (info->elements.kind == SP_KIND_GRID)
        return true;
    if (view->edit_count)
        return sp_fail(err, SP_ERR_INVALID, "/edits",
                       "edits need a grid of samples, and this volume has %s; use \"clip\"",
                       sp_kind_name(info->elements.kind));
    return !view->slices.in_3d || sp_fail(err, SP_ERR_INVALID, "/slices/in_3d",
                                          "slices need a grid of samples, and this volume has %s",
                                          sp_kind_name(info->elements.kind));
}
