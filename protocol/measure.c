/* SPDX-License-Identifier: Apache-2.0 */
#include "protocol/measure.h"

#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "protocol/text.h"

/* Decoding. */

static bool read_kind(const proto_json *object, enum sp_measure_kind *kind, struct sp_error *err) {
    const char *name = proto_json_string(proto_json_get(object, "kind"));
    for (unsigned k = 0; name && k < SP_MEASURE_KINDS; k++)
        if (strcmp(name, sp_measure_kind_name((enum sp_measure_kind)k)) == 0) {
            *kind = (enum sp_measure_kind)k;
            return true;
        }
    return sp_fail(err, SP_ERR_INVALID, "/kind",
                   "must be distance, angle, profile, rectangle, ellipse, marker, part or path");
}

static bool read_points(const proto_json *points, struct sp_measure *measure,
                        struct sp_error *err) {
    const unsigned count = sp_measure_point_count(measure->kind);
    if (proto_json_type(points) != PROTO_JSON_ARRAY || proto_json_size(points) != count)
        return sp_fail(err, SP_ERR_INVALID, "/points", "must be an array of %u point%s for %s",
                       count, count == 1 ? "" : "s", sp_measure_kind_name(measure->kind));
    for (unsigned i = 0; i < count; i++) {
        const proto_json *point = proto_json_at(points, i);
        char place[32];
        snprintf(place, sizeof place, "/points/%u", i);
        if (proto_json_type(point) != PROTO_JSON_ARRAY || proto_json_size(point) != 3)
            return sp_fail(err, SP_ERR_INVALID, place, "must be a world position: [x, y, z]");
        for (unsigned axis = 0; axis < 3; axis++) {
            snprintf(place, sizeof place, "/points/%u/%u", i, axis);
            if (!proto_json_number(proto_json_at(point, axis), &measure->points[i][axis]))
                return sp_fail(err, SP_ERR_INVALID, place, "must be a number");
        }
    }
    return true;
}

/* Reads "range", which a part and a path need and others do not have. */
static bool read_range(const proto_json *range, struct sp_measure *measure, struct sp_error *err) {
    if (!sp_measure_has_range(measure->kind))
        return !range || sp_fail(err, SP_ERR_INVALID, "/range", "only a part or a path has it");
    for (unsigned i = 0; i < 2; i++)
        if (proto_json_size(range) != 2 ||
            !proto_json_number(proto_json_at(range, i), &measure->range[i]))
            return sp_fail(err, SP_ERR_INVALID, "/range",
                           "must be the lowest and the highest value of the %s: [low, high]",
                           sp_measure_kind_name(measure->kind));
    return true;
}

bool proto_measure_decode(const proto_json *object, struct sp_measure *measure,
                          struct sp_error *err) {
    *measure = (struct sp_measure){ .kind = SP_MEASURE_DISTANCE };
    return read_kind(object, &measure->kind, err) &&
           read_points(proto_json_get(object, "points"), measure, err) &&
           read_range(proto_json_get(object, "range"), measure, err) &&
           sp_measure_check(measure, err);
}

bool proto_measure_is_id(const char *id) {
    static const char letters[] =
        "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_-";
    return id && *id && strlen(id) <= PROTO_MEASURE_ID_MAX && id[strspn(id, letters)] == 0;
}

static bool read_text(const proto_json *value, char text[PROTO_MEASURE_TEXT_MAX + 1],
                      struct sp_error *err) {
    const char *given = proto_json_string(value);
    if (!value)
        return true;
    if (!given || strlen(given) > PROTO_MEASURE_TEXT_MAX || !proto_text_is_plain(given))
        return sp_fail(err, SP_ERR_INVALID, "/text",
                       "must be a text of at most %d bytes without control characters, including "
                       "those for the direction of text",
                       PROTO_MEASURE_TEXT_MAX);
    strcpy(text, given);
    return true;
}

static bool read_color(const proto_json *value, char color[PROTO_MEASURE_COLOR_BYTES],
                       struct sp_error *err) {
    const char *given = proto_json_string(value);
    if (!value)
        return true;
    if (!given || strlen(given) != 7 || given[0] != '#' ||
        strspn(given + 1, "0123456789abcdefABCDEF") != 6)
        return sp_fail(err, SP_ERR_INVALID, "/color", "must be a colour like #ff8000");
    for (int i = 0; i < PROTO_MEASURE_COLOR_BYTES; i++)
        color[i] = (char)tolower((unsigned char)given[i]);
    return true;
}

bool proto_measure_apply(const proto_json *patch, bool is_new, struct proto_measure *measure,
                         struct sp_error *err) {
    struct proto_measure next = *measure;
    const proto_json *hidden = proto_json_get(patch, "hidden");
    if (is_new || proto_json_get(patch, "kind")) {
        if (!read_kind(patch, &next.geometry.kind, err))
            return false;
        if (!is_new && next.geometry.kind != measure->geometry.kind)
            return sp_fail(err, SP_ERR_INVALID, "/kind",
                           "the measurement exists and its kind is %s; remove it first",
                           sp_measure_kind_name(measure->geometry.kind));
    }
    if ((is_new || proto_json_get(patch, "points")) &&
        !read_points(proto_json_get(patch, "points"), &next.geometry, err))
        return false;
    if ((is_new || proto_json_get(patch, "range")) &&
        !read_range(proto_json_get(patch, "range"), &next.geometry, err))
        return false;
    if (!sp_measure_check(&next.geometry, err))
        return false;
    if (!read_text(proto_json_get(patch, "text"), next.text, err) ||
        !read_color(proto_json_get(patch, "color"), next.color, err))
        return false;
    if (hidden && !proto_json_bool(hidden, &next.is_hidden))
        return sp_fail(err, SP_ERR_INVALID, "/hidden", "must be true or false");
    *measure = next;
    return true;
}

/* Encoding. */

void proto_measure_set_units(struct proto_measure_value *value, const struct sp_volume_info *info) {
    memcpy(value->world_unit, info->unit, sizeof value->world_unit);
    memcpy(value->data_unit, info->value_unit, sizeof value->data_unit);
}

void proto_measure_unit(const struct proto_measure_value *value, char unit[SP_UNIT_BYTES + 2]) {
    const enum sp_measure_unit kind = value->result.unit;
    const char *power = kind == SP_MEASURE_AREA ? "^2" : kind == SP_MEASURE_VOLUME ? "^3" : "";
    snprintf(unit, SP_UNIT_BYTES + 2, "%s%s",
             kind == SP_MEASURE_DEGREES ? "deg"
             : kind == SP_MEASURE_DATA  ? value->data_unit
                                        : value->world_unit,
             value->world_unit[0] ? power : "");
}

/* A number that is not finite has no JSON; it becomes null. */
static proto_json *finite_or_null(double value) {
    return isfinite(value) ? proto_json_new_number(value) : proto_json_new_null();
}

static void set_number(proto_json **object, const char *key, bool has_value, double value) {
    proto_json_set(object, key, finite_or_null(has_value ? value : NAN));
}

static proto_json *encode_points(const struct sp_measure *measure) {
    proto_json *points = proto_json_array();
    for (unsigned i = 0; i < sp_measure_point_count(measure->kind); i++)
        proto_json_append(&points, proto_json_numbers(measure->points[i], 3));
    return points;
}

/* Sets "points", and "range" of a part or a path. */
static void set_geometry(proto_json **json, const struct sp_measure *measure) {
    proto_json_set(json, "points", encode_points(measure));
    if (sp_measure_has_range(measure->kind))
        proto_json_set(json, "range", proto_json_numbers(measure->range, 2));
}

static proto_json *encode_statistics(const struct sp_statistics *s) {
    const bool has_any = s->count > 0;
    proto_json *json = proto_json_object();
    proto_json_set_integer(&json, "count", (int64_t)s->count);
    proto_json_set_integer(&json, "nonfinite", (int64_t)s->nonfinite);
    set_number(&json, "mean", has_any, s->mean);
    set_number(&json, "deviation", has_any, s->deviation);
    set_number(&json, "min", has_any, s->min);
    set_number(&json, "max", has_any, s->max);
    return json;
}

/* Writes the share as whole per cent; what rounds to 0 or 100 without being it is named so. */
static void percent_of(double share, char text[32]) {
    const double percent = share * 100;
    if (percent < 1 || percent > 99)
        snprintf(text, 32, percent < 1 ? "less than 1 %%" : "more than 99 %%");
    else
        snprintf(text, 32, "%.0f %%", percent);
}

void proto_measure_note(const struct sp_measure *measure, const struct proto_measure_value *value,
                        char note[PROTO_MEASURE_NOTE_MAX + 1]) {
    const struct sp_measure_result *result = &value->result;
    const bool is_in_world = result->unit == SP_MEASURE_LENGTH || result->unit == SP_MEASURE_AREA ||
                             result->unit == SP_MEASURE_VOLUME;
    const char *name = sp_measure_kind_name(measure->kind);
    char unit[64] = "", outside[124] = "", coarse[60] = "", share[32] = "";
    if (sp_measure_has_range(measure->kind) && !result->has_value) {
        snprintf(note, PROTO_MEASURE_NOTE_MAX + 1, "%s",
                 measure->kind == SP_MEASURE_PART
                     ? "no sample near the point has a value in the range"
                     : "the ends of the path are not on one connected part");
        return;
    }
    if (is_in_world && !value->world_unit[0])
        snprintf(unit, sizeof unit, "the volume does not state the unit of its coordinates");
    if (result->outside > 0 && result->outside < 1)
        percent_of(result->outside, share);
    if (result->is_open)
        snprintf(outside, sizeof outside,
                 "the part is open where it reaches the border of the volume: no area is counted "
                 "there");
    if (result->outside > 0)
        snprintf(outside, sizeof outside, "%s%sthe %s lies outside of the volume%s", share,
                 share[0] ? " of " : "", name,
                 !result->has_statistics ? ""
                 : share[0]              ? "; the statistics count the rest"
                                         : ", so it has no statistics");
    if (value->level)
        snprintf(coarse, sizeof coarse, "measured in coarse samples: level %u", value->level);
    snprintf(note, PROTO_MEASURE_NOTE_MAX + 1, "%s%s%s%s%s", unit,
             unit[0] && outside[0] ? "; " : "", outside,
             coarse[0] && (unit[0] || outside[0]) ? "; " : "", coarse);
}

/* Sets the lengths, areas and counts that a part or a path has besides its value. */
static void set_part(proto_json **json, const struct sp_measure *measure,
                     const struct sp_measure_result *result) {
    if (result->has_value && measure->kind == SP_MEASURE_PATH)
        proto_json_set_number(json, "straight", result->straight);
    if (!result->has_value || measure->kind != SP_MEASURE_PART)
        return;
    proto_json_set_number(json, "area", result->area);
    proto_json_set_integer(json, "samples", (int64_t)result->samples);
    if (result->is_open)
        proto_json_set_bool(json, "open", true);
}

/* Sets "value", "unit", "data_unit", "outside", "note", "statistics", and the members of parts and
 * paths. */
static void set_value(proto_json **json, const struct sp_measure *measure,
                      const struct proto_measure_value *value) {
    char unit[SP_UNIT_BYTES + 2], note[PROTO_MEASURE_NOTE_MAX + 1];
    proto_measure_unit(value, unit);
    proto_measure_note(measure, value, note);
    set_number(json, "value", value->result.has_value, value->result.value);
    proto_json_set_string(json, "unit", unit);
    proto_json_set_string(json, "data_unit", value->data_unit);
    proto_json_set_number(json, "outside", value->result.outside);
    if (note[0])
        proto_json_set_string(json, "note", note);
    set_part(json, measure, &value->result);
    if (value->result.has_statistics)
        proto_json_set(json, "statistics", encode_statistics(&value->result.statistics));
}

proto_json *proto_measure_encode(const struct proto_measure *measure) {
    proto_json *json = proto_json_object();
    proto_json_set_string(&json, "id", measure->id);
    proto_json_set_string(&json, "kind", sp_measure_kind_name(measure->geometry.kind));
    proto_json_set_string(&json, "volume", measure->volume);
    set_geometry(&json, &measure->geometry);
    proto_json_set_string(&json, "text", measure->text);
    proto_json_set_string(&json, "color", measure->color);
    proto_json_set_string(&json, "author", measure->author);
    proto_json_set_bool(&json, "hidden", measure->is_hidden);
    set_value(&json, &measure->geometry, &measure->value);
    return json;
}

static proto_json *encode_histogram(const struct sp_measure_result *result) {
    const double range[2] = { result->statistics.min, result->statistics.max };
    proto_json *json = proto_json_object(), *counts = proto_json_array();
    for (int b = 0; b < SP_MEASURE_BINS; b++)
        proto_json_append_integer(&counts, (int64_t)result->histogram[b]);
    proto_json_set(&json, "range", proto_json_numbers(range, 2));
    proto_json_set(&json, "counts", counts);
    return json;
}

static proto_json *encode_profile(const struct sp_measure *line, double length,
                                  const double *values, uint32_t count) {
    proto_json *json = proto_json_object(), *positions = proto_json_array(),
               *array = proto_json_array();
    proto_json_set_number(&json, "step", length / (count - 1));
    for (uint32_t i = 0; i < count; i++) {
        double position[3];
        for (int axis = 0; axis < 3; axis++)
            position[axis] = line->points[0][axis] +
                             (line->points[1][axis] - line->points[0][axis]) * i / (count - 1);
        proto_json_append(&positions, proto_json_numbers(position, 3));
        proto_json_append(&array, finite_or_null(values[i]));
    }
    proto_json_set(&json, "positions", positions);
    proto_json_set(&json, "values", array);
    return json;
}

static proto_json *encode_path(const struct sp_part_path *path) {
    proto_json *array = proto_json_array();
    for (uint32_t i = 0; i < path->count; i++)
        proto_json_append(&array, proto_json_numbers(path->points[i], 3));
    return array;
}

proto_json *proto_measure_answer(const char *volume, const struct sp_measure *measure,
                                 const struct proto_measure_value *value,
                                 const struct proto_measure_line *line) {
    proto_json *json = proto_json_object();
    proto_json_set_string(&json, "volume", volume);
    proto_json_set_string(&json, "kind", sp_measure_kind_name(measure->kind));
    set_geometry(&json, measure);
    set_value(&json, measure, value);
    if (value->result.has_histogram)
        proto_json_set(&json, "histogram", encode_histogram(&value->result));
    if (line->profile)
        proto_json_set(
            &json, "profile",
            encode_profile(measure, value->result.value, line->profile, line->profile_count));
    if (line->path && line->path->is_found)
        proto_json_set(&json, "path", encode_path(line->path));
    return json;
}

/* Reading a saved measurement. */

/* Sums of very large values are infinite, and null in JSON. */
static double number_or_nan(const proto_json *json, const char *key) {
    double value = NAN;
    proto_json_number(proto_json_get(json, key), &value);
    return value;
}

static bool read_statistics(const proto_json *json, struct sp_statistics *s) {
    int64_t count, nonfinite;
    if (!proto_json_integer(proto_json_get(json, "count"), &count) || count < 0 ||
        !proto_json_integer(proto_json_get(json, "nonfinite"), &nonfinite) || nonfinite < 0)
        return false;
    *s = (struct sp_statistics){ .count = (uint64_t)count, .nonfinite = (uint64_t)nonfinite };
    s->mean = number_or_nan(json, "mean");
    s->deviation = number_or_nan(json, "deviation");
    s->min = number_or_nan(json, "min");
    s->max = number_or_nan(json, "max");
    return true;
}

static bool copy_string(const proto_json *json, const char *key, char *out, size_t bytes) {
    const char *text = proto_json_string(proto_json_get(json, key));
    if (!text || strlen(text) >= bytes)
        return false;
    strcpy(out, text);
    return true;
}

/* Reads the lengths, areas and counts that a part or a path has besides its value. */
static bool read_part(const proto_json *json, const struct sp_measure *geometry,
                      struct sp_measure_result *result) {
    int64_t samples;
    if (!result->has_value || !sp_measure_has_range(geometry->kind))
        return true;
    if (geometry->kind == SP_MEASURE_PATH)
        return proto_json_number(proto_json_get(json, "straight"), &result->straight);
    if (!proto_json_number(proto_json_get(json, "area"), &result->area) ||
        !proto_json_integer(proto_json_get(json, "samples"), &samples) || samples < 0)
        return false;
    result->samples = (uint64_t)samples;
    proto_json_bool(proto_json_get(json, "open"), &result->is_open);
    return true;
}

/* The unit of a result follows from the kind; the saved text tells the unit of the world. */
static bool restore_value(const proto_json *json, const struct sp_measure *geometry,
                          struct proto_measure_value *value) {
    struct sp_measure_result *result = &value->result;
    const proto_json *statistics = proto_json_get(json, "statistics");
    char unit[SP_UNIT_BYTES + 2];
    result->unit = sp_measure_unit_of(geometry->kind);
    result->has_value = proto_json_number(proto_json_get(json, "value"), &result->value);
    /* An earlier daemon did not save the share outside. */
    if (!proto_json_number(proto_json_get(json, "outside"), &result->outside) ||
        !(result->outside >= 0 && result->outside <= 1))
        result->outside = 0;
    copy_string(json, "data_unit", value->data_unit, sizeof value->data_unit); /* nor this */
    result->has_statistics = statistics != NULL;
    if ((statistics && !read_statistics(statistics, &result->statistics)) ||
        !read_part(json, geometry, result) || !copy_string(json, "unit", unit, sizeof unit))
        return false;
    const bool has_power = result->unit == SP_MEASURE_AREA || result->unit == SP_MEASURE_VOLUME;
    if (has_power && strlen(unit) >= 2)
        unit[strlen(unit) - 2] = 0;
    if (has_power || result->unit == SP_MEASURE_LENGTH)
        snprintf(value->world_unit, sizeof value->world_unit, "%.*s", SP_UNIT_BYTES - 1, unit);
    return true;
}

bool proto_measure_restore(const proto_json *json, struct proto_measure *measure) {
    struct proto_measure next = { .is_hidden = false };
    struct sp_error unused;
    if (!copy_string(json, "id", next.id, sizeof next.id) || !proto_measure_is_id(next.id) ||
        !copy_string(json, "volume", next.volume, sizeof next.volume) ||
        !copy_string(json, "author", next.author, sizeof next.author) ||
        !proto_measure_apply(json, true, &next, &unused) || !next.color[0] ||
        !restore_value(json, &next.geometry, &next.value))
        return false;
    *measure = next;
    return true;
}
