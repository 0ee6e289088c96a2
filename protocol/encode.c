/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>

#include "protocol/view.h"
#include "protocol/view_fields.h"

static proto_json *encode_number(enum proto_field_kind kind, const void *from) {
    switch (kind) {
    case PROTO_FIELD_COUNT:
        return proto_json_new_integer(*(const uint32_t *)from);
    case PROTO_FIELD_FLOAT:
        return proto_json_new_float(*(const float *)from);
    case PROTO_FIELD_INFINITE:
        if (isinf(*(const double *)from))
            return proto_json_new_string("inf");
        break;
    case PROTO_FIELD_AUTO:
        if (isnan(*(const double *)from))
            return proto_json_new_null();
        break;
    default:
        break;
    }
    return proto_json_new_number(*(const double *)from);
}

static proto_json *encode_array(const struct proto_field *field, unsigned rows, const char *from) {
    proto_json *array = proto_json_array();
    size_t count = rows ? rows : field->columns;
    size_t step = proto_field_bytes(field) / (field->rows ? field->rows : 1u);
    if (!rows)
        step /= field->columns;
    for (size_t i = 0; i < count; i++)
        proto_json_append(&array, rows ? encode_array(field, 0, from + i * step)
                                       : encode_number(field->kind, from + i * step));
    return array;
}

static proto_json *encode_members(const struct proto_group *group, const char *from);

static proto_json *encode_list(const struct proto_field *field, const char *from) {
    proto_json *list = proto_json_array();
    uint32_t count = *(const uint32_t *)(from + field->count_offset);
    for (uint32_t i = 0; i < count; i++) {
        const char *item = from + field->offset + i * field->item_bytes;
        proto_json_append(&list, encode_members(field->group, item));
    }
    return list;
}

static proto_json *encode_field(const struct proto_field *field, const char *from) {
    switch (field->kind) {
    case PROTO_FIELD_OBJECT:
        return encode_members(field->group, from);
    case PROTO_FIELD_LIST:
        return encode_list(field, from);
    case PROTO_FIELD_ENUM:
        return proto_json_new_string(field->names[*(const int *)(from + field->offset)]);
    case PROTO_FIELD_NAME:
        return proto_json_new_string(from + field->offset);
    case PROTO_FIELD_BOOL:
        return proto_json_new_bool(*(const bool *)(from + field->offset));
    case PROTO_FIELD_PRIMITIVE: /* encoded as layers */
    case PROTO_FIELD_ORBIT:     /* encoded as position and up */
    case PROTO_FIELD_DOUBLE:
    case PROTO_FIELD_AUTO:
    case PROTO_FIELD_INFINITE:
    case PROTO_FIELD_FLOAT:
    case PROTO_FIELD_COUNT:
        break;
    }
    return field->columns ? encode_array(field, field->rows, from + field->offset)
                          : encode_number(field->kind, from + field->offset);
}

static proto_json *encode_members(const struct proto_group *group, const char *from) {
    proto_json *object = proto_json_object();
    for (size_t i = 0; i < group->count; i++) {
        const struct proto_field *field = &group->fields[i];
        bool is_written =
            field->kind != PROTO_FIELD_ORBIT && field->kind != PROTO_FIELD_PRIMITIVE &&
            (!field->only || field->only >> *(const int *)(from + group->fields[0].offset) & 1);
        if (is_written)
            proto_json_set(&object, field->name, encode_field(field, from));
    }
    return object;
}

proto_json *proto_view_encode(const struct sp_view *view) {
    return encode_members(&proto_view_group, (const char *)view);
}
