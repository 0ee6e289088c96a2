/* SPDX-License-Identifier: Apache-2.0
 *
 * The table of the view's fields: the name in JSON, the type, and the offset in `struct sp_view`.
 * decode.c and encode.c walk it; a new field is one line in view_fields.c. sp_view_validate()
 * checks the ranges. Private to protocol/.
 */
#ifndef PROTO_VIEW_FIELDS_H
#define PROTO_VIEW_FIELDS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum proto_field_kind {
    PROTO_FIELD_DOUBLE,
    PROTO_FIELD_AUTO,     /* double; null is a value, stored as NaN: the renderer chooses */
    PROTO_FIELD_INFINITE, /* double that may be "inf" */
    PROTO_FIELD_FLOAT,
    PROTO_FIELD_COUNT,     /* uint32_t */
    PROTO_FIELD_BOOL,      /* bool */
    PROTO_FIELD_ENUM,      /* an enum whose values index `names` */
    PROTO_FIELD_NAME,      /* char[SP_NAME_BYTES], at least 1 byte long unless it is optional */
    PROTO_FIELD_PRIMITIVE, /* of a patch alone: what views had before layers, an object with the
                              type "volume"; resets the layers */
    PROTO_FIELD_ORBIT,  /* double; of a patch alone: sets position and up; the offset is the member
                           of enum proto_orbit_member */
    PROTO_FIELD_OBJECT, /* members in `group`; their offsets are in the view, like this field's */
    PROTO_FIELD_LIST    /* of objects; the offsets of their members are within one item */
};

struct proto_group;

struct proto_field {
    const char *name;
    enum proto_field_kind kind;
    bool optional;            /* a member of a list item that may be missing */
    uint8_t only;             /* a member of a list item: bit n = items of type n have it, 0 = all
                                 have it; the type is an ENUM, the first member */
    uint8_t rows, columns;    /* numbers: {0,0} one, {0,n} an array of n, {m,n} m arrays of n */
    size_t offset;            /* bytes from the start of the view, or of the list's item */
    const char *const *names; /* ENUM: NULL-terminated */
    const struct proto_group *group; /* OBJECT, LIST */
    size_t count_offset;             /* LIST: offset of the uint32_t number of items */
    size_t item_bytes, item_max;     /* LIST */
};

struct proto_group {
    const struct proto_field *fields;
    size_t count;
    const void *item; /* LIST: default values of an item; NULL = zeros */
};

extern const struct proto_group proto_view_group;

/* Returns the size of the field's value in bytes. Not for OBJECT and LIST. */
size_t proto_field_bytes(const struct proto_field *field);

#endif
