/* SPDX-License-Identifier: Apache-2.0 */
#include "protocol/view_fields.h"

#include <assert.h>
#include <math.h>

#include "protocol/orbit.h"
#include "sp/view.h"

static_assert(sizeof(enum sp_projection) == sizeof(int),
              "enumerations are read and written as int");

#define COUNT_OF(array) (sizeof(array) / sizeof *(array))
#define GROUP(array)                                                                               \
    { array, COUNT_OF(array), NULL }
#define AT(member) .offset = offsetof(struct sp_view, member)
#define NAMES(...)                                                                                 \
    .names = (const char *const[]) {                                                               \
        __VA_ARGS__, NULL                                                                          \
    }

static const struct proto_field camera_fields[] = {
    { "projection", PROTO_FIELD_ENUM, AT(camera.projection), NAMES("perspective", "orthographic") },
    { "position", PROTO_FIELD_DOUBLE, .columns = 3, AT(camera.position) },
    { "target", PROTO_FIELD_DOUBLE, .columns = 3, AT(camera.target) },
    { "up", PROTO_FIELD_DOUBLE, .columns = 3, AT(camera.up) },
    { "fov_y", PROTO_FIELD_DOUBLE, AT(camera.fov_y) },
    { "height", PROTO_FIELD_DOUBLE, AT(camera.height) },
    { "near", PROTO_FIELD_DOUBLE, AT(camera.near) },
    { "azimuth", PROTO_FIELD_ORBIT, .offset = PROTO_ORBIT_AZIMUTH },
    { "elevation", PROTO_FIELD_ORBIT, .offset = PROTO_ORBIT_ELEVATION },
    { "distance", PROTO_FIELD_ORBIT, .offset = PROTO_ORBIT_DISTANCE },
    { "roll", PROTO_FIELD_ORBIT, .offset = PROTO_ORBIT_ROLL },
};
static const struct proto_group camera = GROUP(camera_fields);

static const struct proto_field point_fields[] = {
    { "value", PROTO_FIELD_DOUBLE, .offset = offsetof(struct sp_tf_point, value) },
    { "color", PROTO_FIELD_FLOAT, .columns = 3, .offset = offsetof(struct sp_tf_point, color) },
    { "opacity", PROTO_FIELD_FLOAT, .offset = offsetof(struct sp_tf_point, opacity) },
};
static const struct proto_group point = GROUP(point_fields);

static const struct proto_field gradient_fields[] = {
    { "magnitude", PROTO_FIELD_DOUBLE, .offset = offsetof(struct sp_gradient_point, magnitude) },
    { "scale", PROTO_FIELD_FLOAT, .offset = offsetof(struct sp_gradient_point, scale) },
};
static const struct proto_group gradient = GROUP(gradient_fields);

static const struct proto_field transfer_fields[] = {
    { "reference_length", PROTO_FIELD_DOUBLE, AT(transfer_function.reference_length) },
    { "order", PROTO_FIELD_ENUM, AT(transfer_function.order), NAMES("pre", "post", "auto") },
    { "points", PROTO_FIELD_LIST, AT(transfer_function.points), .group = &point,
      .count_offset = offsetof(struct sp_view, transfer_function.point_count),
      .item_bytes = sizeof(struct sp_tf_point), .item_max = SP_TF_POINTS_MAX },
    { "gradient", PROTO_FIELD_LIST, AT(transfer_function.gradient), .group = &gradient,
      .count_offset = offsetof(struct sp_view, transfer_function.gradient_count),
      .item_bytes = sizeof(struct sp_gradient_point), .item_max = SP_GRADIENT_POINTS_MAX },
};
static const struct proto_group transfer_function = GROUP(transfer_fields);

static const struct proto_field filter_fields[] = {
    { "mode", PROTO_FIELD_ENUM, AT(filter.mode),
      NAMES("adaptive", "ewa", "reconstruction", "lowpass", "swan", "none") },
    { "kernel", PROTO_FIELD_ENUM, AT(filter.kernel), NAMES("gaussian", "cubic") },
    { "sigma", PROTO_FIELD_DOUBLE, AT(filter.sigma) },
    { "cutoff", PROTO_FIELD_DOUBLE, AT(filter.cutoff) },
    { "lowpass", PROTO_FIELD_DOUBLE, AT(filter.lowpass) },
    { "c_min", PROTO_FIELD_DOUBLE, AT(filter.c_min) },
    { "c_max", PROTO_FIELD_AUTO, AT(filter.c_max) },
};
static const struct proto_group filter = GROUP(filter_fields);

static const struct proto_field projection_window_fields[] = {
    { "center", PROTO_FIELD_AUTO, AT(compositing.center) },
    { "width", PROTO_FIELD_AUTO, AT(compositing.width) },
};
static const struct proto_group projection_window = GROUP(projection_window_fields);

static const struct proto_field compositing_fields[] = {
    { "mode", PROTO_FIELD_ENUM, AT(compositing.mode),
      NAMES("splat", "sheet", "slab", "maximum", "minimum", "mean", "sum") },
    { "attenuation", PROTO_FIELD_ENUM, AT(compositing.attenuation),
      NAMES("exponential", "linear") },
    { "slab", PROTO_FIELD_DOUBLE, AT(compositing.slab) },
    { "colors", PROTO_FIELD_ENUM, AT(compositing.colors), NAMES("grey", "transfer_function") },
    { "window", PROTO_FIELD_OBJECT, .group = &projection_window },
    { "zero", PROTO_FIELD_AUTO, AT(compositing.zero) },
    { "absorption", PROTO_FIELD_AUTO, AT(compositing.absorption) },
};
static const struct proto_group compositing = GROUP(compositing_fields);

static const struct proto_field light_fields[] = {
    { "direction", PROTO_FIELD_DOUBLE, .columns = 3,
      .offset = offsetof(struct sp_light, direction) },
    { "space", PROTO_FIELD_ENUM, .optional = true, .offset = offsetof(struct sp_light, space),
      NAMES("camera", "world") },
    { "color", PROTO_FIELD_FLOAT, .optional = true, .columns = 3,
      .offset = offsetof(struct sp_light, color) },
};
static const struct sp_light light_default = { .space = SP_LIGHT_CAMERA, .color = { 1, 1, 1 } };
static const struct proto_group light = { light_fields, COUNT_OF(light_fields), &light_default };

static const struct proto_field shading_fields[] = {
    { "mode", PROTO_FIELD_ENUM, AT(shading.mode), NAMES("none", "phong") },
    { "ambient", PROTO_FIELD_DOUBLE, AT(shading.ambient) },
    { "diffuse", PROTO_FIELD_DOUBLE, AT(shading.diffuse) },
    { "specular", PROTO_FIELD_DOUBLE, AT(shading.specular) },
    { "exponent", PROTO_FIELD_DOUBLE, AT(shading.exponent) },
    { "smoothing", PROTO_FIELD_AUTO, AT(shading.smoothing) },
    { "occlusion", PROTO_FIELD_DOUBLE, AT(shading.occlusion) },
    { "shadow", PROTO_FIELD_DOUBLE, AT(shading.shadow) },
    { "reach", PROTO_FIELD_DOUBLE, AT(shading.reach) },
    { "lights", PROTO_FIELD_LIST, AT(shading.lights), .group = &light,
      .count_offset = offsetof(struct sp_view, shading.light_count),
      .item_bytes = sizeof(struct sp_light), .item_max = SP_LIGHTS_MAX },
};
static const struct proto_group shading = GROUP(shading_fields);

#define LAYER(member) .offset = offsetof(struct sp_layer, member)
enum {
    ONLY_SURFACE = 1 << SP_LAYER_SURFACE,
    ONLY_SHELL = 1 << SP_LAYER_SHELL,
    ONLY_VECTORS = 1 << SP_LAYER_VECTORS,
    ONLY_POINTS = 1 << SP_LAYER_POINTS,
    ONLY_GAUSSIANS = 1 << SP_LAYER_GAUSSIANS,
    ONLY_GEOMETRY = 1 << SP_LAYER_GEOMETRY,
    ONLY_CHANNEL = 1 << SP_LAYER_CHANNEL,
    ONLY_ELEMENTS = ONLY_POINTS | ONLY_GAUSSIANS | ONLY_GEOMETRY
};
static const struct proto_field layer_fields[] = {
    { "type", PROTO_FIELD_ENUM, LAYER(type),
      NAMES("volume", "surface", "shell", "vectors", "points", "gaussians", "geometry",
            "channel") },
    { "visible", PROTO_FIELD_BOOL, .optional = true, LAYER(visible) },
    { "value", PROTO_FIELD_DOUBLE, .only = ONLY_SURFACE, LAYER(value) },
    { "color", PROTO_FIELD_FLOAT, .optional = true,
      .only = ONLY_SURFACE | ONLY_VECTORS | ONLY_GEOMETRY | ONLY_CHANNEL, .columns = 3,
      LAYER(color) },
    { "opacity", PROTO_FIELD_FLOAT, .optional = true,
      .only = ONLY_SURFACE | ONLY_GAUSSIANS | ONLY_GEOMETRY, LAYER(opacity) },
    { "flatness", PROTO_FIELD_INFINITE, .optional = true, .only = ONLY_SURFACE, LAYER(flatness) },
    { "low", PROTO_FIELD_DOUBLE, .optional = true, .only = ONLY_SHELL, LAYER(low) },
    { "high", PROTO_FIELD_DOUBLE, .optional = true, .only = ONLY_SHELL, LAYER(high) },
    { "detail", PROTO_FIELD_ENUM, .optional = true, .only = ONLY_SHELL, LAYER(detail),
      NAMES("high", "fast") },
    { "style", PROTO_FIELD_ENUM, .optional = true, .only = ONLY_VECTORS, LAYER(style),
      NAMES("modulate", "blend") },
    { "phase", PROTO_FIELD_DOUBLE, .optional = true, .only = ONLY_VECTORS, LAYER(phase) },
    { "stretch", PROTO_FIELD_DOUBLE, .optional = true, .only = ONLY_VECTORS, LAYER(stretch) },
    { "density", PROTO_FIELD_DOUBLE, .optional = true, .only = ONLY_VECTORS, LAYER(density) },
    { "color_by", PROTO_FIELD_NAME, .optional = true, .only = ONLY_VECTORS | ONLY_POINTS,
      LAYER(color_by) },
    { "color_low", PROTO_FIELD_AUTO, .optional = true, .only = ONLY_VECTORS | ONLY_POINTS,
      LAYER(color_low) },
    { "color_high", PROTO_FIELD_AUTO, .optional = true, .only = ONLY_VECTORS | ONLY_POINTS,
      LAYER(color_high) },
    { "id", PROTO_FIELD_NAME, .optional = true, .only = ONLY_ELEMENTS | ONLY_CHANNEL, LAYER(id) },
    { "transform", PROTO_FIELD_DOUBLE, .optional = true, .only = ONLY_ELEMENTS, .columns = 16,
      LAYER(transform) },
    { "size", PROTO_FIELD_DOUBLE, .optional = true, .only = ONLY_POINTS, LAYER(size) },
    { "convention", PROTO_FIELD_ENUM, .optional = true, .only = ONLY_GAUSSIANS, LAYER(convention),
      NAMES("inria", "normalised") },
    { "colors", PROTO_FIELD_ENUM, .optional = true, .only = ONLY_GEOMETRY, LAYER(colors),
      NAMES("own", "layer") },
    { "points", PROTO_FIELD_LIST, .optional = true, .only = ONLY_CHANNEL, .group = &point,
      LAYER(points), .count_offset = offsetof(struct sp_layer, point_count),
      .item_bytes = sizeof(struct sp_tf_point), .item_max = SP_CHANNEL_POINTS_MAX },
};
/* sp_layer_default() */
static const struct sp_layer layer_default = {
    .visible = true,
    .value = NAN,
    .color = { 0.9f, 0.85f, 0.75f },
    .opacity = 1,
    .flatness = INFINITY,
    .low = 0.05,
    .high = 0.95,
    .stretch = 4,
    .density = 0.2,
    .transform = { [0] = 1, [5] = 1, [10] = 1, [15] = 1 },
    .size = 1,
    .color_low = NAN,
    .color_high = NAN
};
static const struct proto_group layer = { layer_fields, COUNT_OF(layer_fields), &layer_default };

static const struct proto_field plane_fields[] = {
    { "normal", PROTO_FIELD_DOUBLE, .columns = 3,
      .offset = offsetof(struct sp_clip_plane, normal) },
    { "offset", PROTO_FIELD_DOUBLE, .offset = offsetof(struct sp_clip_plane, offset) },
};
static const struct proto_group plane = GROUP(plane_fields);

static const struct proto_field clip_fields[] = {
    { "box", PROTO_FIELD_DOUBLE, .rows = 2, .columns = 3, AT(clip.box) },
    { "planes", PROTO_FIELD_LIST, AT(clip.planes), .group = &plane,
      .count_offset = offsetof(struct sp_view, clip.plane_count),
      .item_bytes = sizeof(struct sp_clip_plane), .item_max = SP_CLIP_PLANES_MAX },
};
static const struct proto_group clip = GROUP(clip_fields);

#define EDIT(member) .offset = offsetof(struct sp_edit, member)
#define ONLY_EDIT(type) .only = 1 << SP_EDIT_##type
static const struct proto_field edit_fields[] = {
    { "type", PROTO_FIELD_ENUM, EDIT(type), NAMES("plane", "box", "sphere", "part") },
    { "keep", PROTO_FIELD_ENUM, .optional = true,
      .only = 1 << SP_EDIT_BOX | 1 << SP_EDIT_SPHERE | 1 << SP_EDIT_PART, EDIT(keep),
      NAMES("outside", "inside") },
    { "normal", PROTO_FIELD_DOUBLE, ONLY_EDIT(PLANE), .columns = 3, EDIT(normal) },
    { "offset", PROTO_FIELD_DOUBLE, ONLY_EDIT(PLANE), EDIT(offset) },
    { "box", PROTO_FIELD_DOUBLE, ONLY_EDIT(BOX), .rows = 2, .columns = 3, EDIT(box) },
    { "center", PROTO_FIELD_DOUBLE, ONLY_EDIT(SPHERE), .columns = 3, EDIT(center) },
    { "radius", PROTO_FIELD_DOUBLE, ONLY_EDIT(SPHERE), EDIT(radius) },
    { "point", PROTO_FIELD_DOUBLE, ONLY_EDIT(PART), .columns = 3, EDIT(point) },
    { "range", PROTO_FIELD_DOUBLE, ONLY_EDIT(PART), .columns = 2, EDIT(range) },
};
static const struct proto_group edit = GROUP(edit_fields);

static const struct proto_field quality_fields[] = {
    { "level_of_detail", PROTO_FIELD_ENUM, AT(level_of_detail), NAMES("auto", "off") },
};
static const struct proto_group quality = GROUP(quality_fields);

static const struct proto_field window_fields[] = {
    { "center", PROTO_FIELD_DOUBLE, AT(slices.center) },
    { "width", PROTO_FIELD_DOUBLE, AT(slices.width) },
};
static const struct proto_group window = GROUP(window_fields);

static const struct proto_field slice_planes_fields[] = {
    { "i", PROTO_FIELD_BOOL, AT(slices.planes[0]) },
    { "j", PROTO_FIELD_BOOL, AT(slices.planes[1]) },
    { "k", PROTO_FIELD_BOOL, AT(slices.planes[2]) },
};
static const struct proto_group slice_planes = GROUP(slice_planes_fields);

static const struct proto_field slices_fields[] = {
    { "mode", PROTO_FIELD_ENUM, AT(slices.mode), NAMES("none", "orthogonal", "oblique") },
    { "in_3d", PROTO_FIELD_BOOL, AT(slices.in_3d) },
    { "planes", PROTO_FIELD_OBJECT, .group = &slice_planes },
    { "position", PROTO_FIELD_DOUBLE, .columns = 3, AT(slices.position) },
    { "normal", PROTO_FIELD_DOUBLE, .columns = 3, AT(slices.normal) },
    { "window", PROTO_FIELD_OBJECT, .group = &window },
    { "colors", PROTO_FIELD_ENUM, AT(slices.colors),
      NAMES("grey", "transfer_function", "viridis", "inferno", "cividis", "turbo", "blue-red") },
};
static const struct proto_group slices = GROUP(slices_fields);

static const struct proto_field time_fields[] = {
    { "step", PROTO_FIELD_COUNT, AT(time.step) },
};
static const struct proto_group time_group = GROUP(time_fields);

static const struct proto_field view_fields[] = {
    { "volume", PROTO_FIELD_NAME, AT(volume) },
    { "size", PROTO_FIELD_COUNT, .columns = 2, AT(size) },
    { "background", PROTO_FIELD_FLOAT, .columns = 4, AT(background) },
    { "camera", PROTO_FIELD_OBJECT, .group = &camera },
    { "transfer_function", PROTO_FIELD_OBJECT, .group = &transfer_function },
    { "filter", PROTO_FIELD_OBJECT, .group = &filter },
    { "compositing", PROTO_FIELD_OBJECT, .group = &compositing },
    { "shading", PROTO_FIELD_OBJECT, .group = &shading },
    { "primitive", PROTO_FIELD_PRIMITIVE, .offset = 0 },
    { "layers", PROTO_FIELD_LIST, AT(layers), .group = &layer,
      .count_offset = offsetof(struct sp_view, layer_count), .item_bytes = sizeof(struct sp_layer),
      .item_max = SP_LAYERS_MAX },
    { "clip", PROTO_FIELD_OBJECT, .group = &clip },
    { "edits", PROTO_FIELD_LIST, AT(edits), .group = &edit,
      .count_offset = offsetof(struct sp_view, edit_count), .item_bytes = sizeof(struct sp_edit),
      .item_max = SP_EDITS_MAX },
    { "quality", PROTO_FIELD_OBJECT, .group = &quality },
    { "slices", PROTO_FIELD_OBJECT, .group = &slices },
    { "time", PROTO_FIELD_OBJECT, .group = &time_group },
};
const struct proto_group proto_view_group = GROUP(view_fields);

size_t proto_field_bytes(const struct proto_field *field) {
    size_t count = (field->rows ? field->rows : 1u) * (field->columns ? field->columns : 1u);
    switch (field->kind) {
    case PROTO_FIELD_DOUBLE:
    case PROTO_FIELD_AUTO:
    case PROTO_FIELD_INFINITE:
        return count * sizeof(double);
    case PROTO_FIELD_FLOAT:
        return count * sizeof(float);
    case PROTO_FIELD_COUNT:
        return count * sizeof(uint32_t);
    case PROTO_FIELD_BOOL:
        return sizeof(bool);
    case PROTO_FIELD_ENUM:
        return sizeof(int);
    case PROTO_FIELD_NAME:
        return SP_NAME_BYTES;
    case PROTO_FIELD_PRIMITIVE:
    case PROTO_FIELD_ORBIT:
    case PROTO_FIELD_OBJECT:
    case PROTO_FIELD_LIST:
        break;
    }
    assert(!"primitives, orbits, objects and lists have no size in the view");
    return 0;
}
