/* SPDX-License-Identifier: Apache-2.0 */
#include "protocol/volume.h"

#include <math.h>

#include "sp/view.h"

static proto_json *numbers(const double *values, size_t count) {
    proto_json *array = proto_json_array();
    for (size_t i = 0; i < count; i++)
        if (!proto_json_append_number(array, values[i])) {
            proto_json_free(&array);
            return NULL;
        }
    return array;
}

static proto_json *dims(const struct sp_grid *grid) {
    proto_json *array = proto_json_array();
    for (int i = 0; i < 3; i++)
        if (!proto_json_append_integer(array, grid->dims[i])) {
            proto_json_free(&array);
            return NULL;
        }
    return array;
}

/* Returns one array per axis, null for an evenly spaced axis. */
static proto_json *coordinates(const struct sp_grid *grid) {
    proto_json *axes = proto_json_array();
    for (int i = 0; i < 3; i++)
        if (!proto_json_append(axes, grid->coordinates[i]
                                         ? numbers(grid->coordinates[i], grid->dims[i])
                                         : proto_json_new_null())) {
            proto_json_free(&axes);
            return NULL;
        }
    return axes;
}

static proto_json *direction(const struct sp_grid *grid) {
    proto_json *rows = proto_json_array();
    for (int i = 0; i < 3; i++)
        if (!proto_json_append(rows, numbers(grid->direction[i], 3))) {
            proto_json_free(&rows);
            return NULL;
        }
    return rows;
}

/* Where world +x, +y and +z point to; absent when the file does not say. */
static bool set_anatomy(proto_json *volume, const struct sp_volume_info *info) {
    proto_json *letters = proto_json_array();
    bool ok = true;
    for (int i = 0; i < 3 && ok && info->anatomy[0]; i++)
        ok = proto_json_append_string(letters, (const char[2]){ info->anatomy[i], 0 });
    if (ok && info->anatomy[0])
        return proto_json_set(volume, "anatomy", letters);
    proto_json_free(&letters);
    return ok;
}

static proto_json *histogram(const struct sp_volume_info *info) {
    proto_json *object = proto_json_object(), *counts = proto_json_array();
    bool ok = proto_json_set(object, "range", numbers(info->data, 2));
    for (int i = 0; i < SP_HISTOGRAM_BINS && ok; i++)
        ok = proto_json_append_integer(counts, (int64_t)info->histogram[i]);
    if (!proto_json_set(object, "counts", counts) || !ok)
        proto_json_free(&object);
    return object;
}

static proto_json *axis(const char *name, const double range[2], int bins) {
    proto_json *object = proto_json_object();
    bool ok = proto_json_set_string(object, "axis", name) &&
              proto_json_set(object, "range", numbers(range, 2)) &&
              proto_json_set_integer(object, "bins", bins);
    if (!ok)
        proto_json_free(&object);
    return object;
}

static bool append_counts(proto_json *counts, const struct sp_volume_info *info,
                          const struct sp_joint_histogram *joint, uint64_t *samples) {
    const uint32_t *all = joint ? joint->counts[0] : NULL;
    int bins = joint ? SP_JOINT_GRADIENTS * SP_JOINT_VALUES : SP_HISTOGRAM_BINS;
    bool ok = true;
    *samples = 0;
    for (int i = 0; i < bins && ok; i++) {
        uint64_t count = all ? all[i] : info->histogram[i];
        *samples += count;
        ok = proto_json_append_integer(counts, (int64_t)count);
    }
    return ok;
}

/* {"maximum": {"center": c, "width": w}, …}: the automatic windows of projections. */
static proto_json *windows(const struct sp_volume_info *info) {
    static const char *const names[] = { "maximum", "minimum", "mean", "sum" };
    proto_json *object = proto_json_object();
    struct sp_view view = { 0 };
    struct sp_compositing_options *c = &view.compositing;
    bool ok = object != NULL;
    c->center = c->width = c->zero = c->absorption = NAN;
    for (int m = 0; m < 4; m++) {
        proto_json *window = proto_json_object();
        double values[2];
        c->mode = (enum sp_compositing)(SP_COMPOSITE_MAXIMUM + m);
        sp_projection_window(&view, info, values);
        ok = proto_json_set_number(window, "center", values[0]) && ok;
        ok = proto_json_set_number(window, "width", values[1]) && ok;
        ok = proto_json_set(object, names[m], window) && ok;
    }
    if (!ok)
        proto_json_free(&object);
    return object;
}

proto_json *proto_histogram_encode(const struct sp_volume_info *info, const char *id,
                                   const struct sp_joint_histogram *joint) {
    proto_json *object = proto_json_object(), *axes = proto_json_array();
    proto_json *counts = proto_json_array();
    int values = joint ? SP_JOINT_VALUES : SP_HISTOGRAM_BINS;
    uint64_t samples;
    bool ok = proto_json_set_string(object, "volume", id) &&
              proto_json_set_string(object, "type", sp_type_name(info->type));
    ok = proto_json_append(axes, axis("value", info->data, values)) && ok;
    if (joint)
        ok = proto_json_append(axes, axis("gradient", joint->gradients, SP_JOINT_GRADIENTS)) && ok;
    ok = proto_json_set(object, "axes", axes) && ok;
    ok = append_counts(counts, info, joint, &samples) && ok;
    ok = proto_json_set_integer(object, "samples", (int64_t)samples) && ok;
    ok = proto_json_set(object, "counts", counts) && ok;
    ok = proto_json_set(object, "windows", windows(info)) && ok;
    if (!ok)
        proto_json_free(&object);
    return object;
}

/* [[…], …]: rows of three numbers. NULL when out of memory. */
static proto_json *rows(const double (*values)[3], size_t count) {
    proto_json *array = proto_json_array();
    bool ok = array != NULL;
    for (size_t i = 0; i < count; i++)
        ok = proto_json_append(array, numbers(values[i], 3)) && ok;
    if (!ok)
        proto_json_free(&array);
    return array;
}

proto_json *proto_visible_part_encode(const struct sp_visible_part *part, const char *id) {
    proto_json *object = proto_json_object();
    bool ok = proto_json_set_string(object, "volume", id) &&
              proto_json_set_bool(object, "visible", part->is_visible) &&
              proto_json_set(object, "box", rows(part->box, 2)) &&
              proto_json_set(object, "center", numbers(part->center, 3)) &&
              proto_json_set(object, "half", rows(part->half, 3)) &&
              proto_json_set_number(object, "radius", part->radius);
    if (!ok)
        proto_json_free(&object);
    return object;
}

static proto_json *field_to_json(const struct sp_volume_info *info, const char *name,
                                 int components, enum sp_type type, const double range[2]) {
    proto_json *object = proto_json_object();
    bool ok = proto_json_set_string(object, "name", name) &&
              proto_json_set_integer(object, "components", components) &&
              proto_json_set_string(object, "type", sp_type_name(type)) &&
              proto_json_set(object, "range", numbers(range, 2)) &&
              proto_json_set_string(object, "unit", info->value_unit);
    if (!ok)
        proto_json_free(&object);
    return object;
}

/* The samples, then the vectors if there are any. */
static proto_json *fields(const struct sp_volume_info *info) {
    proto_json *array = proto_json_array();
    bool ok =
        proto_json_append(array, field_to_json(info, info->value_name, 1, info->type, info->range));
    if (info->vector_bytes)
        ok = ok && proto_json_append(array, field_to_json(info, info->vector_name, 3, SP_FLOAT32,
                                                          (const double[]){ 0, info->longest }));
    if (!ok)
        proto_json_free(&array);
    return array;
}

/* Sets a list of `capacity` texts of `size` bytes each, which "" ends; nothing if it is empty. */
static bool set_texts(proto_json *volume, const char *key, const char *texts, int capacity,
                      size_t size) {
    proto_json *array = proto_json_array();
    bool ok = array != NULL;
    for (int i = 0; ok && i < capacity && texts[(size_t)i * size]; i++)
        ok = proto_json_append(array, proto_json_new_string(texts + (size_t)i * size));
    if (ok && texts[0])
        return proto_json_set(volume, key, array);
    proto_json_free(&array);
    return ok;
}

/* Of an axis z that was scaled: the numbers of the file. */
static bool set_vertical(proto_json *volume, const struct sp_volume_info *info) {
    if (info->vertical.per_unit == 0)
        return true;
    proto_json *vertical = proto_json_object();
    bool ok = proto_json_set_number(vertical, "per_unit", info->vertical.per_unit) &&
              proto_json_set_string(vertical, "unit", info->vertical.unit);
    if (!ok)
        proto_json_free(&vertical);
    return proto_json_set(volume, "vertical", vertical);
}

/* What the samples mean, and how a page begins to show them. */
static bool set_meaning(proto_json *volume, const struct sp_volume_info *info) {
    return (info->meaning == SP_MEANING_UNKNOWN ||
            proto_json_set_string(volume, "meaning", sp_meaning_name(info->meaning))) &&
           (!sp_volume_is_thick_stack(info) ||
            proto_json_set_string(volume, "first_layout", "slices"));
}

/* What is not loaded of the file, and what the reader left out or changed. */
static bool set_lists(proto_json *volume, const struct sp_volume_info *info) {
    return set_texts(volume, "other_fields", info->others[0], SP_OTHER_FIELDS_MAX,
                     SP_FIELD_BYTES) &&
           set_texts(volume, "other_vectors", info->other_vectors[0], SP_OTHER_VECTORS_MAX,
                     SP_FIELD_BYTES) &&
           set_texts(volume, "warnings", info->warnings[0], SP_WARNINGS_MAX, SP_WARNING_BYTES);
}

/* Of a time series: how many steps there are, and when. */
static bool set_steps(proto_json *volume, const struct sp_volume_info *info) {
    const struct sp_steps *s = &info->steps;
    if (s->count <= 1)
        return true;
    proto_json *steps = proto_json_object(), *times = s->times ? proto_json_array() : NULL;
    bool ok = proto_json_set_integer(steps, "count", s->count) &&
              proto_json_set_string(steps, "unit", s->unit);
    for (uint32_t i = 0; ok && times && i < s->count; i++)
        ok = proto_json_append(times, proto_json_new_number(s->times[i]));
    if (times)
        ok = proto_json_set(steps, "times", times) && ok;
    if (!ok)
        proto_json_free(&steps);
    return proto_json_set(volume, "steps", steps);
}

/* Of a volume without a grid: what it consists of. */
static bool set_elements(proto_json *volume, const struct sp_volume_info *info) {
    const struct sp_elements_shape *shape = &info->elements;
    if (shape->kind == SP_KIND_GRID)
        return true;
    proto_json *elements = proto_json_object();
    bool ok = proto_json_set_integer(elements, "count", shape->count) &&
              proto_json_set_number(elements, "spacing", info->element_spacing);
    if (info->folded)
        ok = ok && proto_json_set_integer(elements, "folded", (int64_t)info->folded);
    if (shape->kind == SP_KIND_MESH)
        ok = ok && proto_json_set_integer(elements, "vertices", shape->vertex_count);
    if (shape->kind == SP_KIND_GAUSSIANS)
        ok = ok && proto_json_set_integer(elements, "degree", shape->degree);
    if (!ok)
        proto_json_free(&elements);
    return proto_json_set(volume, "elements", elements);
}

/* Of a volume that is larger than memory. */
static bool set_whole(proto_json *volume, const struct sp_volume_info *info) {
    const struct sp_grid *grid = &info->grid;
    if (info->whole.dims[0] == 0)
        return true;
    struct sp_grid all = *grid;
    double bytes = (double)sp_type_size(info->type);
    for (int a = 0; a < 3; a++) {
        all.spacing[a] = info->whole.spacing[a];
        all.dims[a] = info->whole.dims[a];
        bytes *= all.dims[a];
    }
    proto_json *whole = proto_json_object();
    bool ok = proto_json_set(whole, "dims", dims(&all));
    ok = proto_json_set(whole, "spacing", numbers(all.spacing, 3)) && ok;
    ok = proto_json_set(whole, "origin", numbers(info->whole.origin, 3)) && ok;
    ok = proto_json_set_integer(whole, "levels", info->whole.levels) && ok;
    ok = proto_json_set_number(whole, "bytes", bytes) && ok;
    return proto_json_set(volume, "whole", whole) && ok;
}

proto_json *proto_volume_encode(const struct sp_volume_info *info, const char *id,
                                bool with_histogram) {
    const struct sp_grid *grid = &info->grid;
    bool rectilinear = grid->coordinates[0] || grid->coordinates[1] || grid->coordinates[2];
    proto_json *volume = proto_json_object();
    bool ok = proto_json_set_string(volume, "id", id) &&
              proto_json_set_string(volume, "name", info->name) &&
              proto_json_set_string(volume, "source", info->source) &&
              proto_json_set_string(volume, "kind", sp_kind_name(info->elements.kind)) &&
              set_elements(volume, info) && proto_json_set(volume, "dims", dims(grid)) &&
              set_whole(volume, info) &&
              proto_json_set(volume, "spacing", numbers(grid->spacing, 3)) &&
              (!rectilinear || proto_json_set(volume, "coordinates", coordinates(grid))) &&
              proto_json_set(volume, "origin", numbers(grid->origin, 3)) &&
              proto_json_set(volume, "direction", direction(grid)) &&
              proto_json_set_string(volume, "unit", info->unit) && set_vertical(volume, info) &&
              set_anatomy(volume, info) && set_meaning(volume, info) &&
              proto_json_set_string(volume, "type", sp_type_name(info->type)) &&
              proto_json_set_integer(volume, "components", info->components) &&
              proto_json_set(volume, "range", numbers(info->range, 2)) &&
              proto_json_set_integer(volume, "nonfinite", (int64_t)info->nonfinite) &&
              proto_json_set(volume, "fields", fields(info)) && set_lists(volume, info) &&
              set_steps(volume, info) &&
              proto_json_set_integer(volume, "bytes", (int64_t)sp_volume_bytes(info)) &&
              (!with_histogram || proto_json_set(volume, "histogram", histogram(info)));
    if (!ok)
        proto_json_free(&volume);
    return volume;
}
