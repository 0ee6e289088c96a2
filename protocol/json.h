/* SPDX-License-Identifier: Apache-2.0
 *
 * JSON for the rest of the program: strict parsing, reading, building, writing. The library behind
 * it is included in json.c alone.
 *
 * A `proto_json` is one node of a document, reference-counted. Whoever got it from a function
 * without const owns one reference and frees it with proto_json_free(); nodes got through const
 * functions live as long as the document. A document belongs to one thread at a time. Functions
 * that read accept NULL as "not there".
 */
#ifndef PROTO_JSON_H
#define PROTO_JSON_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sp/status.h"

typedef struct json_t proto_json;

enum proto_json_type {
    PROTO_JSON_NONE, /* of NULL: not there */
    PROTO_JSON_NULL,
    PROTO_JSON_BOOL,
    PROTO_JSON_NUMBER,
    PROTO_JSON_STRING,
    PROTO_JSON_ARRAY,
    PROTO_JSON_OBJECT
};

/* Parses one UTF-8 document that fills `size` bytes. Refused with SP_ERR_FORMAT, line and column in
 * err->text and the JSON pointer reached in err->place: anything that RFC 8259 does not allow (NaN,
 * comments, trailing bytes, bad UTF-8 …) and, beyond it, duplicate keys, the character U+0000,
 * numbers too large for a double, nesting deeper than PROTO_DEPTH_MAX and more than PROTO_BODY_MAX
 * bytes. SP_ERR_MEMORY when out of memory. NULL on failure. */
proto_json *proto_json_parse(const char *bytes, size_t size, struct sp_error *err);

proto_json *proto_json_ref(proto_json *json); /* one more reference; returns its argument */
void proto_json_free(proto_json **json);      /* drops one reference; accepts NULL; nulls */

enum proto_json_type proto_json_type(const proto_json *json);
const char *proto_json_type_name(enum proto_json_type type); /* "a number", …; never NULL */

/* The member of an object; NULL if `object` is no object or has none. */
const proto_json *proto_json_get(const proto_json *object, const char *key);
/* Elements of an array, members of an object, else 0. */
size_t proto_json_size(const proto_json *json);
/* Element i of an array; NULL past the end or if it is no array. */
const proto_json *proto_json_at(const proto_json *array, size_t i);
/* Walks the members of an object in the order of the text: start with *at = NULL, stop at false. */
bool proto_json_next(const proto_json *object, void **at, const char **key,
                     const proto_json **value);
/* Are all members of an object among the known (NULL at the end)? Else SP_ERR_INVALID, with the
 * pointer of the first that is not, and the known in the text. */
bool proto_json_only(const proto_json *object, const char *const *known, struct sp_error *err);

/* The value; NULL or false, with *out untouched, if the node is of another type. A number is an
 * integer if its value is whole and within ±2^53, however it is written. */
const char *proto_json_string(const proto_json *json);
bool proto_json_number(const proto_json *json, double *out);
bool proto_json_integer(const proto_json *json, int64_t *out);
bool proto_json_bool(const proto_json *json, bool *out);

/* Building. NULL or false = out of memory; a failed call leaves a valid document, and a value to be
 * stolen is freed. `object`, `array` and `value` may be NULL (= an earlier call failed): false. */
proto_json *proto_json_object(void);
proto_json *proto_json_array(void);
proto_json *proto_json_new_string(const char *text); /* bytes that are not UTF-8 become '?' */
proto_json *proto_json_new_number(double value);     /* finite */
proto_json *proto_json_new_float(float value); /* finite; the shortest decimal that gives it back */
proto_json *proto_json_new_integer(int64_t value);
proto_json *proto_json_new_null(void);
bool proto_json_set(proto_json *object, const char *key, proto_json *value); /* steals value */
bool proto_json_set_string(proto_json *object, const char *key, const char *text);
bool proto_json_set_number(proto_json *object, const char *key, double value);
bool proto_json_set_integer(proto_json *object, const char *key, int64_t value);
bool proto_json_set_bool(proto_json *object, const char *key, bool value);
bool proto_json_set_null(proto_json *object, const char *key);
bool proto_json_append(proto_json *array, proto_json *value); /* steals value */
bool proto_json_append_string(proto_json *array, const char *text);
bool proto_json_append_number(proto_json *array, double value);
bool proto_json_append_integer(proto_json *array, int64_t value);

/* Text without spaces, malloc'ed and NUL-terminated; *size (may be NULL) without the NUL. Numbers
 * take the shortest form that gives the same double. NULL when `json` is NULL or memory is out. The
 * canonical text has its keys sorted by bytes, so that equal values give equal bytes (for ETags).
 */
char *proto_json_to_text(const proto_json *json, size_t *size);
char *proto_json_to_canonical(const proto_json *json, size_t *size);

#endif
