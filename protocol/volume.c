/* SPDX-License-Identifier: Apache-2.0 */
#include "protocol/volume.h"

#include <math.h>

#include "sp/view.h"

/* Returns one array per axis, null for an evenly spaced axis. */
static proto_json *coordinates(const struct sp_grid *grid) {
    proto_json *axes = proto_json_array();
    for (int i = 0; i < 3; i++)
        proto_json_append(&axes, grid->coordinates[i]
                                     ? proto_json_numbers(grid->coordinates[i], grid->dims[i])
                                     : proto_json_new_null());
    return axes;
}

/* [[…], …]: rows of three numbers. NULL when out of memory. */
static proto_json *rows(const double (*values)[3], size_t count) {
    proto_json *array = proto_json_array();
    for (size_t i = 0; i < count; i++)
        proto_json_append(&array, proto_json_numbers(values[i], 3));
    return array;
}

/* Where world +x, +y and +z point to; absent when the file does not say. */
static void set_anatomy(proto_json **volume, const struct sp_volume_info *info) {
    if (!info->anatomy[0])
        return;
    proto_json *letters = proto_json_array();
    for (int i = 0; i < 3; i++)
        proto_json_append_string(&letters, (const char[2]){ info->anatomy[i], 0 });
    proto_json_set(volume, "anatomy", letters);
}

static proto_json *histogram(const struct sp_volume_info *info) {
    proto_json *object = proto_json_object(), *counts = proto_json_array();
    proto_json_set(&object, "range", proto_json_numbers(info->data, 2));
    for (int i = 0; i < SP_HISTOGRAM_BINS; i++)
        proto_json_append_integer(&counts, (int64_t)info->histogram[i]);
    proto_json_set(&object, "counts", counts);
    return object;
}

static proto_json *axis(const char *name, const double range[2], int bins) {
    proto_json *object = proto_json_object();
    proto_json_set_string(&object, "axis", name);
    proto_json_set(&object, "range", proto_json_numbers(range, 2));
    proto_json_set_integer(&object, "bins", bins);
    return object;
}

static void append_counts(proto_json **counts, const struct sp_volume_info *info,
                          const struct sp_joint_histogram *joint, uint64_t *samples) {
    const uint32_t *all = joint ? joint->counts[0] : NULL;
    int bins = joint ? SP_JOINT_GRADIENTS * SP_JOINT_VALUES : SP_HISTOGRAM_BINS;
    *samples = 0;
    for (int i = 0; i < bins; i++) {
        uint64_t count = all ? all[i] : info->histogram[i];
        *samples += count;
        proto_json_append_integer(counts, (int64_t)count);
    }
}

/* {"maximum": {"center": c, "width": w}, …}: the automatic windows of projections. */
static proto_json *windows(const struct sp_volume_info *info) {
    static const char *const names[] = { "maximum", "minimum", "mean", "sum" };
    proto_json *object = proto_json_object();
    struct sp_view view = { 0 };
    struct sp_compositing_options *c = &view.compositing;
    c->center = c->width = c->zero = c->absorption = NAN;
    for (int m = 0; m < 4; m++) {
        proto_json *window = proto_json_object();
        double values[2];
        c->mode = (enum sp_compositing)(SP_COMPOSITE_MAXIMUM + m);
        sp_projection_window(&view, info, values);
        proto_json_set_number(&window, "center", values[0]);
        proto_json_set_number(&window, "width", values[1]);
        proto_json_set(&object, names[m], window);
    }
    return object;
}

proto_json *proto_histogram_encode(const struct sp_volume_info *info, const char *id,
                                   const struct sp_joint_histogram *joint) {
    proto_json *object = proto_json_object(), *axes = proto_json_array();
    proto_json *counts = proto_json_array();
    int values = joint ? SP_JOINT_VALUES : SP_HISTOGRAM_BINS;
    uint64_t samples;
    proto_json_set_string(&object, "volume", id);
    proto_json_set_string(&object, "type", sp_type_name(info->type));
    proto_json_append(&axes, axis("value", info->data, values));
    if (joint)
        proto_json_append(&axes, axis("gradient", joint->gradients, SP_JOINT_GRADIENTS));
    proto_json_set(&object, "axes", axes);
    append_counts(&counts, info, joint, &samples);
    proto_json_set_integer(&object, "samples", (int64_t)samples);
    proto_json_set(&object, "counts", counts);
    proto_json_set(&object, "windows", windows(info));
    return object;
}

proto_json *proto_visible_part_encode(const struct sp_visible_part *part, const char *id) {
    proto_json *object = proto_json_object();
    proto_json_set_string(&object, "volume", id);
    proto_json_set_bool(&object, "visible", part->is_visible);
    proto_json_set(&object, "box", rows(part->box, 2));
    proto_json_set(&object, "center", proto_json_numbers(part->center, 3));
    proto_json_set(&object, "half", rows(part->half, 3));
    proto_json_set_number(&object, "radius", part->radius);
    return object;
}

static proto_json *field_to_json(const struct sp_volume_info *info, const char *name,
                                 int components, enum sp_type type, const double range[2]) {
    proto_json *object = proto_json_object();
    proto_json_set_string(&object, "name", name);
    proto_json_set_integer(&object, "components", components);
    proto_json_set_string(&object, "type", sp_type_name(type));
    proto_json_set(&object, "range", proto_json_numbers(range, 2));
    proto_json_set_string(&object, "unit", info->value_unit);
    return object;
}

/* The samples, then the vectors if there are any. */
static proto_json *fields(const struct sp_volume_info *info) {
    proto_json *array = proto_json_array();
    proto_json_append(&array, field_to_json(info, info->value_name, 1, info->type, info->range));
    if (info->vector_bytes)
        proto_json_append(&array, field_to_json(info, info->vector_name, 3, SP_FLOAT32,
                                                (const double[]){ 0, info->longest }));
    return array;
}

/* Sets a list of `capacity` texts of `size` bytes each, which "" ends; nothing if it is empty. */
static void set_texts(proto_json **volume, const char *key, const char *texts, int capacity,
                      size_t size) {
    if (!texts[0])
        return;
    proto_json *array = proto_json_array();
    for (int i = 0; i < capacity && texts[(size_t)i * size]; i++)
        proto_json_append_string(&array, texts + (size_t)i * size);
    proto_json_set(volume, key, array);
}

/* Of an axis z that was scaled: the numbers of the file. */
static void set_vertical(proto_json **volume, const struct sp_volume_info *info) {
    if (info->vertical.per_unit == 0)
        return;
    proto_json *vertical = proto_json_object();
    proto_json_set_number(&vertical, "per_unit", info->vertical.per_unit);
    proto_json_set_string(&vertical, "unit", info->vertical.unit);
    proto_json_set(volume, "vertical", vertical);
}

/* What the samples mean, and how a page begins to show them. */
static void set_meaning(proto_json **volume, const struct sp_volume_info *info) {
    if (info->meaning != SP_MEANING_UNKNOWN)
        proto_json_set_string(volume, "meaning", sp_meaning_name(info->meaning));
    if (sp_volume_is_thick_stack(info))
        proto_json_set_string(volume, "first_layout", "slices");
}

/* What is not loaded of the file, and what the reader left out or changed. */
static void set_lists(proto_json **volume, const struct sp_volume_info *info) {
    set_texts(volume, "other_fields", info->others[0], SP_OTHER_FIELDS_MAX, SP_FIELD_BYTES);
    set_texts(volume, "other_vectors", info->other_vectors[0], SP_OTHER_VECTORS_MAX,
              SP_FIELD_BYTES);
    set_texts(volume, "warnings", info->warnings[0], SP_WARNINGS_MAX, SP_WARNING_BYTES);
}

/* Of a time series: how many steps there are, and when. */
static void set_steps(proto_json **volume, const struct sp_volume_info *info) {
    const struct sp_steps *s = &info->steps;
    if (s->count <= 1)
        return;
    proto_json *steps = proto_json_object();
    proto_json_set_integer(&steps, "count", s->count);
    proto_json_set_string(&steps, "unit", s->unit);
    if (s->times)
        proto_json_set(&steps, "times", proto_json_numbers(s->times, s->count));
    proto_json_set(volume, "steps", steps);
}

/* Of a volume without a grid: what it consists of. */
static void set_elements(proto_json **volume, const struct sp_volume_info *info) {
    const struct sp_elements_shape *shape = &info->elements;
    if (shape->kind == SP_KIND_GRID)
        return;
    proto_json *elements = proto_json_object();
    proto_json_set_integer(&elements, "count", shape->count);
    proto_json_set_number(&elements, "spacing", info->element_spacing);
    if (info->folded)
        proto_json_set_integer(&elements, "folded", (int64_t)info->folded);
    if (shape->kind == SP_KIND_MESH)
        proto_json_set_integer(&elements, "vertices", shape->vertex_count);
    if (shape->kind == SP_KIND_GAUSSIANS)
        proto_json_set_integer(&elements, "degree", shape->degree);
    proto_json_set(volume, "elements", elements);
}

/* Of a grid: the noise of its samples; null if it is unknown. */
static void set_noise(proto_json **volume, const struct sp_volume_info *info) {
    if (info->elements.kind != SP_KIND_GRID)
        return;
    if (isfinite(info->noise))
        proto_json_set_number(volume, "noise", info->noise);
    else
        proto_json_set_null(volume, "noise");
}

/* Of a volume that is larger than memory. */
static void set_whole(proto_json **volume, const struct sp_volume_info *info) {
    if (info->whole.dims[0] == 0)
        return;
    double bytes = (double)sp_type_size(info->type);
    for (int a = 0; a < 3; a++)
        bytes *= info->whole.dims[a];
    proto_json *whole = proto_json_object();
    proto_json_set(&whole, "dims", proto_json_integers(info->whole.dims, 3));
    proto_json_set(&whole, "spacing", proto_json_numbers(info->whole.spacing, 3));
    proto_json_set(&whole, "origin", proto_json_numbers(info->whole.origin, 3));
    proto_json_set_integer(&whole, "levels", info->whole.levels);
    proto_json_set_number(&whole, "bytes", bytes);
    proto_json_set(volume, "whole", whole);
}

proto_json *proto_volume_encode(const struct sp_volume_info *info, const char *id,
                                bool with_histogram) {
    const struct sp_grid *grid = &info->grid;
    bool rectilinear = grid->coordinates[0] || grid->coordinates[1] || grid->coordinates[2];
    proto_json *volume = proto_json_object();
    proto_json_set_string(&volume, "id", id);
    proto_json_set_string(&volume, "name", info->name);
    proto_json_set_string(&volume, "source", info->source);
    proto_json_set_string(&volume, "kind", sp_kind_name(info->elements.kind));
    set_elements(&volume, info);
    proto_json_set(&volume, "dims", proto_json_integers(grid->dims, 3));
    set_whole(&volume, info);
    proto_json_set(&volume, "spacing", proto_json_numbers(grid->spacing, 3));
    if (rectilinear)
        proto_json_set(&volume, "coordinates", coordinates(grid));
    proto_json_set(&volume, "origin", proto_json_numbers(grid->origin, 3));
    proto_json_set(&volume, "direction", rows(grid->direction, 3));
    proto_json_set_string(&volume, "unit", info->unit);
    set_vertical(&volume, info);
    set_anatomy(&volume, info);
    set_meaning(&volume, info);
    proto_json_set_string(&volume, "type", sp_type_name(info->type));
    proto_json_set_integer(&volume, "components", info->components);
    proto_json_set(&volume, "range", proto_json_numbers(info->range, 2));
    proto_json_set_integer(&volume, "nonfinite", (int64_t)info->nonfinite);
    set_noise(&volume, info);
    proto_json_set(&volume, "fields", fields(info));
    set_lists(&volume, info);
    set_steps(&volume, info);
    proto_json_set_integer(&volume, "bytes", (int64_t)sp_volume_bytes(info));
    if (with_histogram)
        proto_json_set(&volume, "histogram", histogram(info));
    return volume;
}
