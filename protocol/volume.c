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
    bool ok = proto_json_set(object, "range", numbers(info->range, 2));
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
    ok = proto_json_append(axes, axis("value", info->range, values)) && ok;
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

static proto_json *field(const char *name, int components, enum sp_type type,
                         const double range[2]) {
    proto_json *object = proto_json_object();
    bool ok = proto_json_set_string(object, "name", name) &&
              proto_json_set_integer(object, "components", components) &&
              proto_json_set_string(object, "type", sp_type_name(type)) &&
              proto_json_set(object, "range", numbers(range, 2));
    if (!ok)
        proto_json_free(&object);
    return object;
}

/* The samples, then the vectors if there are any. */
static proto_json *fields(const struct sp_volume_info *info) {
    proto_json *array = proto_json_array();
    bool ok = proto_json_append(array, field(info->value_name, 1, info->type, info->range));
    if (info->vector_bytes)
        ok = ok && proto_json_append(array, field(info->vector_name, 3, SP_FLOAT32,
                                                  (const double[]){ 0, info->longest }));
    if (!ok)
        proto_json_free(&array);
    return array;
}

proto_json *proto_volume_encode(const struct sp_volume_info *info, const char *id,
                                bool with_histogram) {
    const struct sp_grid *grid = &info->grid;
    bool rectilinear = grid->coordinates[0] || grid->coordinates[1] || grid->coordinates[2];
    proto_json *volume = proto_json_object();
    bool ok = proto_json_set_string(volume, "id", id) &&
              proto_json_set_string(volume, "name", info->name) &&
              proto_json_set_string(volume, "source", info->source) &&
              proto_json_set(volume, "dims", dims(grid)) &&
              proto_json_set(volume, "spacing", numbers(grid->spacing, 3)) &&
              (!rectilinear || proto_json_set(volume, "coordinates", coordinates(grid))) &&
              proto_json_set(volume, "origin", numbers(grid->origin, 3)) &&
              proto_json_set(volume, "direction", direction(grid)) &&
              proto_json_set_string(volume, "unit", info->unit) && set_anatomy(volume, info) &&
              proto_json_set_string(volume, "type", sp_type_name(info->type)) &&
              proto_json_set_integer(volume, "components", info->components) &&
              proto_json_set(volume, "range", numbers(info->range, 2)) &&
              proto_json_set_integer(volume, "nonfinite", (int64_t)info->nonfinite) &&
              proto_json_set(volume, "fields", fields(info)) &&
              proto_json_set_integer(volume, "bytes",
                                     (int64_t)(info->voxel_bytes + info->vector_bytes)) &&
              (!with_histogram || proto_json_set(volume, "histogram", histogram(info)));
    if (!ok)
        proto_json_free(&volume);
    return volume;
}
