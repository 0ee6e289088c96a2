/* SPDX-License-Identifier: Apache-2.0 */
#include <float.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "protocol/nearest.h"
#include "protocol/orbit.h"
#include "protocol/pointer.h"
#include "protocol/view.h"
#include "protocol/view_fields.h"

enum orbit_use { ORBIT_KEPT, ORBIT_GIVEN, ORBIT_RESET };

struct decoder {
    struct proto_pointer at; /* the current value */
    struct proto_orbit orbit;
    enum orbit_use uses[PROTO_ORBIT_MEMBERS];
    const proto_json *patch;
    struct sp_error *err;
};

__attribute__((format(printf, 2, 3))) static bool refuse(struct decoder *decoder,
                                                         const char *format, ...) {
    char text[SP_ERROR_TEXT];
    va_list args;
    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    return sp_fail(decoder->err, SP_ERR_INVALID, decoder->at.text, "%s", text);
}

static bool refuse_type(struct decoder *decoder, const char *expected, const proto_json *json) {
    return refuse(decoder, "must be %s, not %s", expected,
                  proto_json_type_name(proto_json_type(json)));
}

/* Returns the nearest float. The result is ±1 only if the number is, because opacities are below
 * 1. */
static float to_float(double number) {
    float nearest = (float)number;
    return fabsf(nearest) == 1 && fabs(number) < 1 ? nextafterf(nearest, 0) : nearest;
}

static const char *expected_number(enum proto_field_kind kind) {
    switch (kind) {
    case PROTO_FIELD_COUNT:
        return "a whole number";
    case PROTO_FIELD_AUTO:
        return "a number or null";
    case PROTO_FIELD_INFINITE:
        return "a number or \"inf\"";
    default:
        return "a number";
    }
}

static bool decode_number(struct decoder *decoder, enum proto_field_kind kind,
                          const proto_json *json, void *out) {
    const char *text = proto_json_string(json);
    double number;
    if (kind == PROTO_FIELD_INFINITE && text && strcmp(text, "inf") == 0) {
        *(double *)out = INFINITY;
        return true;
    }
    if (!proto_json_number(json, &number))
        return refuse_type(decoder, expected_number(kind), json);
    if (kind == PROTO_FIELD_COUNT) {
        int64_t whole;
        if (!proto_json_integer(json, &whole) || whole < 0 || whole > UINT32_MAX)
            return refuse(decoder, "%.17g is not a whole number in [0, 4294967295]", number);
        *(uint32_t *)out = (uint32_t)whole;
    } else if (kind == PROTO_FIELD_FLOAT) {
        if (fabs(number) > FLT_MAX)
            return refuse(decoder, "%g is outside [-%g, %g]", number, (double)FLT_MAX,
                          (double)FLT_MAX);
        *(float *)out = to_float(number);
    } else {
        *(double *)out = number + 0.0; /* -0 becomes 0: equal views have equal bytes */
    }
    return true;
}

/* Decodes `columns` numbers to `out`, or `rows` arrays of them if `rows` > 0. */
static bool decode_array(struct decoder *decoder, const struct proto_field *field, unsigned rows,
                         const proto_json *json, void *out) {
    size_t count = rows ? rows : field->columns;
    if (proto_json_type(json) != PROTO_JSON_ARRAY || proto_json_size(json) != count) {
        char expected[64];
        if (rows)
            snprintf(expected, sizeof expected, "an array of %u arrays of %u numbers", rows,
                     (unsigned)field->columns);
        else
            snprintf(expected, sizeof expected, "an array of %zu numbers", count);
        if (proto_json_type(json) != PROTO_JSON_ARRAY)
            return refuse_type(decoder, expected, json);
        return refuse(decoder, "must be %s, not of %zu", expected, proto_json_size(json));
    }
    size_t step = proto_field_bytes(field) / (field->rows ? field->rows : 1u);
    if (!rows)
        step /= field->columns;
    for (size_t i = 0; i < count; i++) {
        size_t length = decoder->at.length;
        proto_pointer_push_index(&decoder->at, i);
        const proto_json *item = proto_json_at(json, i);
        char *to = (char *)out + i * step;
        if (!(rows ? decode_array(decoder, field, 0, item, to)
                   : decode_number(decoder, field->kind, item, to)))
            return false;
        proto_pointer_pop(&decoder->at, length);
    }
    return true;
}

static bool decode_enum(struct decoder *decoder, const struct proto_field *field,
                        const proto_json *json, int *out) {
    const char *name = proto_json_string(json);
    char known[160];
    size_t n = 0;
    for (int i = 0; field->names[i]; i++) {
        if (name && strcmp(name, field->names[i]) == 0) {
            *out = i;
            return true;
        }
        n += (size_t)snprintf(known + n, sizeof known - n, "%s\"%s\"",
                              i == 0                ? ""
                              : field->names[i + 1] ? ", "
                                                    : " or ",
                              field->names[i]);
    }
    if (!name)
        return refuse_type(decoder, known, json);
    return refuse(decoder, "must be %s, not \"%.64s\"", known, name);
}

static bool decode_name(struct decoder *decoder, const struct proto_field *field,
                        const proto_json *json, char *out) {
    const char *name = proto_json_string(json);
    if (!name)
        return refuse_type(decoder, "a string", json);
    size_t size = strlen(name), least = field->optional ? 0 : 1;
    if (size < least || size >= SP_NAME_BYTES)
        return refuse(decoder, "must have %zu to %d bytes, not %zu", least, SP_NAME_BYTES - 1,
                      size);
    memset(out, 0, SP_NAME_BYTES); /* equal views have equal bytes */
    memcpy(out, name, size);
    return true;
}

static bool decode_field(struct decoder *decoder, const struct proto_field *field,
                         const proto_json *json, const void *defaults, void *out);

static bool refuse_unknown(struct decoder *decoder, const struct proto_group *group) {
    char known[192] = "";
    for (size_t i = 0; i < group->count; i++)
        snprintf(known + strlen(known), sizeof known - strlen(known), "%s%s", i ? ", " : "",
                 group->fields[i].name);
    return refuse(decoder, "unknown field; known: %s", known);
}

/* Decodes the members of an object into the view or the list item at `out`. */
static bool decode_members(struct decoder *decoder, const struct proto_group *group,
                           const proto_json *json, const void *defaults, void *out) {
    if (proto_json_type(json) != PROTO_JSON_OBJECT)
        return refuse_type(decoder, "an object", json);
    void *at = NULL;
    const char *key;
    const proto_json *value;
    while (proto_json_next(json, &at, &key, &value)) {
        const struct proto_field *field = NULL;
        for (size_t i = 0; i < group->count && !field; i++)
            if (strcmp(group->fields[i].name, key) == 0)
                field = &group->fields[i];
        size_t length = decoder->at.length;
        proto_pointer_push(&decoder->at, key, strlen(key));
        if (!field) {
            const char *meant = proto_nearest_name(key, group);
            return meant ? refuse(decoder, "unknown field; did you mean \"%s\"?", meant)
                         : refuse_unknown(decoder, group);
        }
        if (!decode_field(decoder, field, value, defaults, out))
            return false;
        proto_pointer_pop(&decoder->at, length);
    }
    return true;
}

/* Does an item of a list have the member? */
static bool has_member(const struct proto_group *group, const struct proto_field *member,
                       const void *item) {
    return !member->only ||
           member->only >> *(const int *)((const char *)item + group->fields[0].offset) & 1;
}

/* Checks that the item has every member that its type needs, and no other. */
static bool check_members(struct decoder *decoder, const struct proto_group *group,
                          const proto_json *json, const void *item) {
    for (size_t m = 0; m < group->count; m++) {
        const struct proto_field *member = &group->fields[m];
        bool is_given = proto_json_get(json, member->name) != NULL;
        bool is_known = has_member(group, member, item);
        if (is_known && !is_given && !member->optional)
            return refuse(decoder, "\"%s\" is missing", member->name);
        if (is_known || !is_given)
            continue;
        const struct proto_field *type = &group->fields[0];
        const char *name = type->names[*(const int *)((const char *)item + type->offset)];
        proto_pointer_push(&decoder->at, member->name, strlen(member->name));
        return refuse(decoder, "a %s has no \"%s\"", name, member->name);
    }
    return true;
}

static bool decode_list(struct decoder *decoder, const struct proto_field *field,
                        const proto_json *json, void *out) {
    if (proto_json_type(json) != PROTO_JSON_ARRAY)
        return refuse_type(decoder, "an array", json);
    size_t count = proto_json_size(json);
    if (count > field->item_max)
        return refuse(decoder, "has %zu items; the limit is %zu", count, field->item_max);
    char *items = (char *)out + field->offset;
    memset(items, 0, field->item_max * field->item_bytes);
    for (size_t i = 0; i < count; i++) {
        size_t length = decoder->at.length;
        proto_pointer_push_index(&decoder->at, i);
        const proto_json *item = proto_json_at(json, i);
        char *to = items + i * field->item_bytes;
        if (field->group->item)
            memcpy(to, field->group->item, field->item_bytes);
        /* An item has no defaults, so null is a wrong type. */
        if (!decode_members(decoder, field->group, item, NULL, to))
            return false;
        if (!check_members(decoder, field->group, item, to))
            return false;
        proto_pointer_pop(&decoder->at, length);
    }
    *(uint32_t *)((char *)out + field->count_offset) = (uint32_t)count;
    return true;
}

static void copy_default(const struct proto_field *field, const void *defaults, void *out) {
    const char *from = defaults;
    char *to = out;
    if (field->kind == PROTO_FIELD_OBJECT) {
        for (size_t i = 0; i < field->group->count; i++)
            copy_default(&field->group->fields[i], defaults, out);
    } else if (field->kind == PROTO_FIELD_LIST) {
        memmove(to + field->offset, from + field->offset, field->item_max * field->item_bytes);
        memmove(to + field->count_offset, from + field->count_offset, sizeof(uint32_t));
    } else if (field->kind != PROTO_FIELD_ORBIT && field->kind != PROTO_FIELD_PRIMITIVE) {
        memmove(to + field->offset, from + field->offset, proto_field_bytes(field));
    }
}

/* Reads a member of the orbit; place_camera() uses it once the whole patch is read. */
static bool decode_orbit(struct decoder *decoder, const struct proto_field *field,
                         const proto_json *json) {
    static const struct {
        double low, high;
    } ranges[PROTO_ORBIT_MEMBERS] = {
        [PROTO_ORBIT_AZIMUTH] = { -360, 360 },
        [PROTO_ORBIT_ELEVATION] = { -90, 90 },
        [PROTO_ORBIT_DISTANCE] = { 0, SP_POSITION_MAX },
        [PROTO_ORBIT_ROLL] = { -360, 360 },
    };
    size_t member = field->offset;
    double *value = &decoder->orbit.value[member];
    bool is_reset = proto_json_type(json) == PROTO_JSON_NULL;
    decoder->uses[member] = is_reset ? ORBIT_RESET : ORBIT_GIVEN;
    if (is_reset)
        return true;
    if (!decode_number(decoder, PROTO_FIELD_DOUBLE, json, value))
        return false;
    if (member == PROTO_ORBIT_DISTANCE && !(*value > 0))
        return refuse(decoder, "%g must be above 0", *value);
    if (!(*value >= ranges[member].low && *value <= ranges[member].high))
        return refuse(decoder, "%g is outside [%g, %g]", *value, ranges[member].low,
                      ranges[member].high);
    return true;
}

/* Resets the layers, unless the patch also has layers. */
static bool decode_primitive(struct decoder *decoder, const proto_json *json,
                             const struct sp_view *defaults, struct sp_view *view) {
    const proto_json *type = proto_json_get(json, "type");
    const char *name = proto_json_string(type);
    bool is_type_null = type && proto_json_type(type) == PROTO_JSON_NULL;
    if (proto_json_type(json) != PROTO_JSON_NULL && proto_json_type(json) != PROTO_JSON_OBJECT)
        return refuse_type(decoder, "an object", json);
    if (proto_json_size(json) > (type ? 1u : 0u))
        return refuse(decoder, "unknown field; known: type");
    size_t length = decoder->at.length;
    proto_pointer_push(&decoder->at, "type", 4);
    if (type && !is_type_null && !name)
        return refuse_type(decoder, "\"volume\"", type);
    if (name && strcmp(name, "volume") != 0)
        return refuse(decoder,
                      "must be \"volume\", not \"%.64s\": add surfaces and shells to \"layers\"",
                      name);
    proto_pointer_pop(&decoder->at, length);
    if (proto_json_get(decoder->patch, "layers"))
        return true;
    memcpy(view->layers, defaults->layers, sizeof view->layers);
    view->layer_count = defaults->layer_count;
    return true;
}

static bool decode_field(struct decoder *decoder, const struct proto_field *field,
                         const proto_json *json, const void *defaults, void *out) {
    if (field->kind == PROTO_FIELD_ORBIT)
        return decode_orbit(decoder, field, json);
    if (field->kind == PROTO_FIELD_PRIMITIVE)
        return decode_primitive(decoder, json, defaults, out);
    void *to = (char *)out + field->offset;
    if (proto_json_type(json) == PROTO_JSON_NULL && field->kind == PROTO_FIELD_AUTO) {
        *(double *)to = NAN;
        return true;
    }
    if (proto_json_type(json) == PROTO_JSON_NULL && defaults) {
        copy_default(field, defaults, out);
        return true;
    }
    switch (field->kind) {
    case PROTO_FIELD_OBJECT:
        return decode_members(decoder, field->group, json, defaults, out);
    case PROTO_FIELD_LIST:
        return decode_list(decoder, field, json, out);
    case PROTO_FIELD_ENUM:
        return decode_enum(decoder, field, json, to);
    case PROTO_FIELD_NAME:
        return decode_name(decoder, field, json, to);
    case PROTO_FIELD_BOOL:
        return proto_json_bool(json, to) || refuse_type(decoder, "true or false", json);
    case PROTO_FIELD_PRIMITIVE:
    case PROTO_FIELD_ORBIT:
    case PROTO_FIELD_DOUBLE:
    case PROTO_FIELD_AUTO:
    case PROTO_FIELD_INFINITE:
    case PROTO_FIELD_FLOAT:
    case PROTO_FIELD_COUNT:
        break;
    }
    return field->columns ? decode_array(decoder, field, field->rows, json, to)
                          : decode_number(decoder, field->kind, json, to);
}

static bool is_orbit_used(const struct decoder *decoder) {
    for (int i = 0; i < PROTO_ORBIT_MEMBERS; i++)
        if (decoder->uses[i] != ORBIT_KEPT)
            return true;
    return false;
}

/* Places the camera by the members of the orbit in the patch, if there are any. The other members
 * come from the camera before the patch: a new target moves the eye along. */
static bool place_camera(struct decoder *decoder, const struct sp_camera *defaults,
                         const struct sp_camera *before, struct sp_camera *camera) {
    const proto_json *members = proto_json_get(decoder->patch, "camera");
    const proto_json *position = proto_json_get(members, "position");
    const proto_json *up = proto_json_get(members, "up");
    if (!is_orbit_used(decoder))
        return true;
    bool has_position = proto_json_type(position) == PROTO_JSON_ARRAY;
    if (has_position || proto_json_type(up) == PROTO_JSON_ARRAY)
        return sp_fail(decoder->err, SP_ERR_INVALID,
                       has_position ? "/camera/position" : "/camera/up",
                       "excludes azimuth, elevation, distance and roll");
    struct sp_camera from = *before;
    if (position) { /* null */
        memcpy(from.position, defaults->position, sizeof from.position);
        memcpy(from.target, defaults->target, sizeof from.target);
    }
    if (up)
        memcpy(from.up, defaults->up, sizeof from.up);
    struct proto_orbit orbit = proto_orbit_of(&from, defaults);
    struct proto_orbit reset = proto_orbit_of(defaults, defaults);
    for (int i = 0; i < PROTO_ORBIT_MEMBERS; i++)
        if (decoder->uses[i] != ORBIT_KEPT)
            orbit.value[i] =
                decoder->uses[i] == ORBIT_GIVEN ? decoder->orbit.value[i] : reset.value[i];
    proto_orbit_place(&orbit, defaults, camera);
    return true;
}

static bool merge(struct decoder *decoder, const struct sp_view *defaults, struct sp_view *view) {
    const struct sp_camera before = view->camera;
    return decode_members(decoder, &proto_view_group, decoder->patch, defaults, view) &&
           place_camera(decoder, &defaults->camera, &before, &view->camera);
}

bool proto_view_merge(const proto_json *patch, const struct sp_view *defaults, struct sp_view *view,
                      struct sp_error *err) {
    return merge(&(struct decoder){ .patch = patch, .err = err }, defaults, view);
}

/* True if the view would be valid with the default camera. */
static bool is_camera_at_fault(const struct sp_view *refused, const struct sp_camera *defaults) {
    struct sp_view view = *refused;
    memcpy(view.camera.position, defaults->position, sizeof view.camera.position);
    memcpy(view.camera.target, defaults->target, sizeof view.camera.target);
    memcpy(view.camera.up, defaults->up, sizeof view.camera.up);
    return sp_view_validate(&view, NULL);
}

bool proto_view_apply(const proto_json *patch, const struct sp_view *defaults, struct sp_view *view,
                      struct sp_error *err) {
    struct decoder decoder = { .patch = patch, .err = err };
    struct sp_view merged = *view;
    struct sp_error why;
    if (!merge(&decoder, defaults, &merged))
        return false;
    if (!sp_view_validate(&merged, &why)) {
        /* A patch with members of the orbit has no position that an error could point to. */
        bool has_distance = decoder.uses[PROTO_ORBIT_DISTANCE] == ORBIT_GIVEN;
        if (is_orbit_used(&decoder) && is_camera_at_fault(&merged, &defaults->camera))
            return sp_fail(err, why.code, has_distance ? "/camera/distance" : "/camera",
                           "the position that the angles and the distance give: %s", why.text);
        return sp_fail(err, why.code, why.place, "%s", why.text);
    }
    *view = merged;
    return true;
}

const char *proto_view_volume(const proto_json *patch) {
    return proto_json_string(proto_json_get(patch, "volume"));
}
