/* SPDX-License-Identifier: Apache-2.0
 *
 * The table of the view's fields: what each is called in JSON, what it may hold, and where it lies
 * in `struct sp_view`. decode.c and encode.c walk it; a new field is one line in view_fields.c.
 * Ranges are not here: sp_view_validate() has them. Private to protocol/.
 */
#ifndef PROTO_VIEW_FIELDS_H
#define PROTO_VIEW_FIELDS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum proto_field_kind {
    PROTO_FIELD_DOUBLE,
    PROTO_FIELD_AUTO, /* double; null is a value, kept as NaN: "choose for me" */
    PROTO_FIELD_FLOAT,
    PROTO_FIELD_COUNT,  /* uint32_t */
    PROTO_FIELD_ENUM,   /* an enum from 0, written as one of `names` */
    PROTO_FIELD_NAME,   /* char[SP_NAME_BYTES], 1 byte or more */
    PROTO_FIELD_OBJECT, /* members in `group`, their offsets counted like this field's own */
    PROTO_FIELD_LIST    /* of objects; their members' offsets are within one item */
};

struct proto_group;

struct proto_field {
    const char *name;
    enum proto_field_kind kind;
    bool optional;            /* members of list items: may be missing */
    uint8_t rows, columns;    /* numbers: {0,0} one, {0,n} an array of n, {m,n} m arrays of n */
    size_t offset;            /* bytes from the start of the view, or of the list's item */
    const char *const *names; /* ENUM: NULL-terminated */
    const struct proto_group *group; /* OBJECT, LIST */
    size_t count_offset;             /* LIST: of the uint32_t that counts the items */
    size_t item_bytes, item_max;     /* LIST */
};

struct proto_group {
    const struct proto_field *fields;
    size_t count;
    const void *item; /* LIST: what an item holds before its members are read; NULL = zeros */
};

extern const struct proto_group proto_view_group;

/* Bytes of a field's value, for the kinds that are plain values. */
size_t proto_field_bytes(const struct proto_field *field);

#endif
