/* SPDX-License-Identifier: Apache-2.0
 *
 * JSON for the rest of the program: strict parsing, reading, building, writing. Only json.c
 * includes the library behind it.
 *
 * A `proto_json` is one node of a document, reference-counted. A function that returns it without
 * const gives the caller one reference, to be dropped with proto_json_free(). A const node is
 * borrowed and lives as long as its document. A document belongs to one thread at a time. Functions
 * that read accept NULL as "missing".
 */
#ifndef PROTO_JSON_H
#define PROTO_JSON_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sp/status.h"

typedef struct json_t proto_json;

enum proto_json_type {
    PROTO_JSON_NONE, /* NULL: missing */
    PROTO_JSON_NULL,
    PROTO_JSON_BOOL,
    PROTO_JSON_NUMBER,
    PROTO_JSON_STRING,
    PROTO_JSON_ARRAY,
    PROTO_JSON_OBJECT
};

/* Parses one UTF-8 document of `size` bytes. Returns NULL on failure. SP_ERR_FORMAT: the text
 * breaks RFC 8259 (NaN, comments, trailing bytes, bad UTF-8 …), or it has duplicate keys, the
 * character U+0000, a number too large for a double, nesting deeper than PROTO_DEPTH_MAX, or more
 * than PROTO_BODY_MAX bytes. Then err->text has line and column, and err->place the JSON pointer of
 * the error. SP_ERR_MEMORY: out of memory. Thread-safe. */
proto_json *proto_json_parse(const char *bytes, size_t size, struct sp_error *err);

proto_json *proto_json_ref(proto_json *json); /* adds a reference; returns its argument */
void proto_json_free(proto_json **json); /* drops a reference; accepts NULL; sets *json to NULL */

enum proto_json_type proto_json_type(const proto_json *json);
const char *proto_json_type_name(enum proto_json_type type); /* "a number", …; never NULL */

/* Returns a member of an object; NULL if `object` is not an object or has no such member. */
const proto_json *proto_json_get(const proto_json *object, const char *key);
/* Returns the number of elements of an array or members of an object; 0 for other types. */
size_t proto_json_size(const proto_json *json);
/* Returns element i of an array; NULL past the end, or if `array` is not an array. */
const proto_json *proto_json_at(const proto_json *array, size_t i);
/* Iterates over the members of an object in the order of the text. Set *at = NULL before the first
 * call; false means that there are no more. */
bool proto_json_next(const proto_json *object, void **at, const char **key,
                     const proto_json **value);
/* True if every member of the object is in `known`, which ends with NULL. Otherwise SP_ERR_INVALID:
 * err->place points to the first unknown member, and err->text lists the known ones. */
bool proto_json_only(const proto_json *object, const char *const *known, struct sp_error *err);

/* Read a value. NULL or false, with *out unchanged, if the node has another type. A number is an
 * integer if its value is whole and within ±2^53, in any notation. The string is borrowed. */
const char *proto_json_string(const proto_json *json);
bool proto_json_number(const proto_json *json, double *out);
bool proto_json_integer(const proto_json *json, int64_t *out);
bool proto_json_bool(const proto_json *json, bool *out);

/* Build a document. NULL means out of memory. If memory runs out or `value` is NULL, a function
 * that adds to a document frees the document, sets it to NULL, and frees a value that it should
 * own. NULL stays NULL, so a builder checks the document only once, at the end. */
proto_json *proto_json_object(void);
proto_json *proto_json_array(void);
proto_json *proto_json_new_string(const char *text); /* replaces invalid UTF-8 by '?' */
proto_json *proto_json_new_number(double value);     /* finite */
proto_json *proto_json_new_float(float value);       /* finite; the shortest decimal that
                                                        reads back as the same float */
proto_json *proto_json_new_integer(int64_t value);
proto_json *proto_json_new_bool(bool value);
proto_json *proto_json_new_null(void);
void proto_json_set(proto_json **object, const char *key, proto_json *value); /* takes ownership */
void proto_json_set_string(proto_json **object, const char *key, const char *text);
void proto_json_set_number(proto_json **object, const char *key, double value);
void proto_json_set_integer(proto_json **object, const char *key, int64_t value);
void proto_json_set_bool(proto_json **object, const char *key, bool value);
void proto_json_set_null(proto_json **object, const char *key);
void proto_json_append(proto_json **array, proto_json *value); /* takes ownership */
void proto_json_append_string(proto_json **array, const char *text);
void proto_json_append_number(proto_json **array, double value);
void proto_json_append_integer(proto_json **array, int64_t value);
proto_json *proto_json_numbers(const double *values, size_t count); /* an array; finite */
proto_json *proto_json_integers(const uint32_t *values, size_t count);

/* Return the text without spaces, NUL-terminated, to be freed by the caller; *size (may be NULL)
 * excludes the NUL. Numbers have the shortest form that reads back as the same double. NULL if
 * `json` is NULL or memory runs out. In the canonical text, keys are sorted by bytes, so equal
 * values give equal bytes (for ETags). */
char *proto_json_to_text(const proto_json *json, size_t *size);
char *proto_json_to_canonical(const proto_json *json, size_t *size);

#endif
