/* SPDX-License-Identifier: Apache-2.0 */
#include "protocol/json.h"

#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "protocol/json_reason.h"
#include "protocol/limits.h"
#include "protocol/pointer.h"
#include "protocol/position.h"
#include "sp/utf8.h"

/* Memory.
 *
 * While it reads a token, jansson does not check that its buffer grew: without memory it would lose
 * a character, abort, or write past a block. So the first allocation that fails during a parse is
 * served from a spare block, which is larger than any such buffer can become. The parse then ends,
 * and its result is discarded. jansson passes no user pointer to its allocator, hence the
 * thread-local variable. */
struct parse {
    struct proto_position position; /* lags behind the bytes that were delivered by one */
    size_t size, delivered;
    void *spare;
    size_t spare_size;
    bool is_short; /* of memory */
};
static _Thread_local struct parse *parsing; /* NULL = this thread parses nothing */

static void *allocate(size_t size) {
    void *block = malloc(size);
    if (block || !parsing || parsing->is_short)
        return block;
    parsing->is_short = true;
    return size <= parsing->spare_size ? parsing->spare : NULL;
}

static void release(void *block) {
    if (!parsing || block != parsing->spare)
        free(block);
}

__attribute__((constructor)) static void install_allocator(void) {
    json_set_alloc_funcs(allocate, release);
}

/* Parsing. */

/* Delivers one byte per call, so that jansson sees nothing behind a failed allocation or a bracket
 * that is too deep. The position lags by one byte because jansson puts back the byte that ends a
 * number. */
static size_t read_byte(void *buffer, size_t size, void *user) {
    struct parse *parse = user;
    (void)size;
    if (parse->is_short || !proto_position_advance(&parse->position, parse->delivered) ||
        parse->delivered == parse->size)
        return 0;
    *(char *)buffer = parse->position.bytes[parse->delivered++];
    return 1;
}

/* NULL on failure: parse->is_short, parse->position.is_too_deep, or else *error. */
static json_t *load(struct parse *parse, size_t flags, json_error_t *error) {
    parse->position = (struct proto_position){ .bytes = parse->position.bytes };
    parse->delivered = 0;
    parsing = parse;
    json_t *json = json_load_callback(read_byte, parse, flags, error);
    if (parse->is_short) {
        json_decref(json);
        json = NULL;
    }
    parsing = NULL;
    return json;
}

static enum proto_json_fault fault_of(const json_error_t *error) {
    switch (json_error_code(error)) {
    case json_error_premature_end_of_input:
        return PROTO_JSON_ENDS;
    case json_error_end_of_input_expected:
        return PROTO_JSON_GOES_ON;
    case json_error_invalid_utf8:
        return PROTO_JSON_NOT_UTF8;
    case json_error_null_character:
    case json_error_null_byte_in_key:
        return PROTO_JSON_NUL;
    case json_error_duplicate_key:
        return PROTO_JSON_TWICE;
    case json_error_numeric_overflow:
        return PROTO_JSON_TOO_LARGE;
    default:
        return PROTO_JSON_SYNTAX;
    }
}

static void report(struct parse *parse, const json_error_t *error, struct sp_error *err) {
    struct proto_pointer pointer;
    char reason[PROTO_JSON_REASON_BYTES];
    unsigned line, column;
    if (parse->is_short) {
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory for %zu bytes of JSON", parse->size);
        return;
    }
    size_t end = error->position > 0 ? (size_t)error->position : 0;
    proto_position_advance(&parse->position, end < parse->delivered ? end : parse->delivered);
    proto_position_pointer(&parse->position, &pointer);
    proto_position_line(&parse->position, &line, &column);
    if (parse->position.is_too_deep)
        sp_fail(err, SP_ERR_FORMAT, pointer.text,
                "nested deeper than %d at line %u, column %u; flatten the document",
                PROTO_DEPTH_MAX, line, column);
    else {
        proto_json_reason(fault_of(error), &parse->position, parse->size, reason);
        sp_fail(err, SP_ERR_FORMAT, pointer.text, "not valid JSON at line %u, column %u: %s", line,
                column, reason);
    }
}

proto_json *proto_json_parse(const char *bytes, size_t size, struct sp_error *err) {
    enum { TOKEN_BUFFER_MIN = 64 }; /* bytes */
    if (size > PROTO_BODY_MAX) {
        sp_fail(err, SP_ERR_FORMAT, "", "%zu bytes of JSON; the limit is %d; send less at once",
                size, PROTO_BODY_MAX);
        return NULL;
    }
    struct parse parse = { .position.bytes = bytes,
                           .size = size,
                           .spare_size = 2 * size + TOKEN_BUFFER_MIN };
    json_error_t error = { .position = 0 };
    json_t *json = NULL;
    parse.spare = malloc(parse.spare_size);
    parse.is_short = !parse.spare;
    const size_t flags = JSON_REJECT_DUPLICATES | JSON_DECODE_ANY;
    if (parse.spare)
        json = load(&parse, flags, &error);
    /* jansson refuses integers beyond 64 bits unless it reads all integers as doubles. */
    if (!json && !parse.is_short && !parse.position.is_too_deep &&
        json_error_code(&error) == json_error_numeric_overflow)
        json = load(&parse, flags | JSON_DECODE_INT_AS_REAL, &error);
    if (!json)
        report(&parse, &error, err);
    free(parse.spare);
    return json;
}

proto_json *proto_json_ref(proto_json *json) {
    return json_incref(json);
}

void proto_json_free(proto_json **json) {
    json_decref(*json);
    *json = NULL;
}

/* Reading. */

enum proto_json_type proto_json_type(const proto_json *json) {
    if (!json)
        return PROTO_JSON_NONE;
    switch (json_typeof(json)) {
    case JSON_OBJECT:
        return PROTO_JSON_OBJECT;
    case JSON_ARRAY:
        return PROTO_JSON_ARRAY;
    case JSON_STRING:
        return PROTO_JSON_STRING;
    case JSON_INTEGER:
    case JSON_REAL:
        return PROTO_JSON_NUMBER;
    case JSON_TRUE:
    case JSON_FALSE:
        return PROTO_JSON_BOOL;
    case JSON_NULL:
        return PROTO_JSON_NULL;
    }
    return PROTO_JSON_NONE;
}

const char *proto_json_type_name(enum proto_json_type type) {
    static const char *const names[] = { "nothing",  "null",     "true or false", "a number",
                                         "a string", "an array", "an object" };
    return names[type];
}

const proto_json *proto_json_get(const proto_json *object, const char *key) {
    return json_object_get(object, key);
}

size_t proto_json_size(const proto_json *json) {
    return json_is_array(json) ? json_array_size(json) : json_object_size(json);
}

const proto_json *proto_json_at(const proto_json *array, size_t i) {
    return json_array_get(array, i);
}

bool proto_json_next(const proto_json *object, void **at, const char **key,
                     const proto_json **value) {
    json_t *o = (json_t *)object; /* the iterators take no const, but change nothing */
    *at = *at ? json_object_iter_next(o, *at) : json_object_iter(o);
    if (!*at)
        return false;
    *key = json_object_iter_key(*at);
    *value = json_object_iter_value(*at);
    return true;
}

static bool is_among(const char *key, const char *const *known) {
    while (*known && strcmp(*known, key) != 0)
        known++;
    return *known;
}

bool proto_json_only(const proto_json *object, const char *const *known, struct sp_error *err) {
    void *at = NULL;
    const char *key;
    const proto_json *value;
    while (proto_json_next(object, &at, &key, &value)) {
        if (is_among(key, known))
            continue;
        struct proto_pointer pointer = { .length = 0 };
        char list[256] = "";
        proto_pointer_push(&pointer, key, strlen(key));
        for (const char *const *k = known; *k; k++)
            snprintf(list + strlen(list), sizeof list - strlen(list), "%s%s", list[0] ? ", " : "",
                     *k);
        return sp_fail(err, SP_ERR_INVALID, pointer.text, "unknown member%s%s",
                       list[0] ? "; known: " : "", list);
    }
    return true;
}

const char *proto_json_string(const proto_json *json) {
    return json_string_value(json);
}

bool proto_json_number(const proto_json *json, double *out) {
    if (!json_is_number(json))
        return false;
    *out = json_number_value(json);
    return true;
}

bool proto_json_integer(const proto_json *json, int64_t *out) {
    const int64_t most = INT64_C(1) << 53;
    if (json_is_integer(json)) {
        json_int_t i = json_integer_value(json);
        if (i < -most || i > most)
            return false;
        *out = i;
        return true;
    }
    double d = json_real_value(json);
    if (!json_is_real(json) || !(fabs(d) <= (double)most) || d != floor(d))
        return false;
    *out = (int64_t)d;
    return true;
}

bool proto_json_bool(const proto_json *json, bool *out) {
    if (!json_is_boolean(json))
        return false;
    *out = json_is_true(json);
    return true;
}

/* Building. */

proto_json *proto_json_object(void) {
    return json_object();
}

proto_json *proto_json_array(void) {
    return json_array();
}

proto_json *proto_json_new_string(const char *text) {
    json_t *string = json_string(text);
    if (string)
        return string;
    char *copy = strdup(text);
    if (!copy)
        return NULL;
    sp_utf8_mend(copy);
    string = json_string(copy);
    free(copy);
    return string;
}

proto_json *proto_json_new_number(double value) {
    return json_real(value);
}

proto_json *proto_json_new_float(float value) {
    char text[32];
    double shortest = (double)value;
    for (int digits = 6; digits <= 9; digits++) {
        snprintf(text, sizeof text, "%.*g", digits, (double)value);
        shortest = strtod(text, NULL);
        if ((float)shortest == value)
            break;
    }
    return json_real(shortest);
}

proto_json *proto_json_new_integer(int64_t value) {
    return json_integer(value);
}

proto_json *proto_json_new_bool(bool value) {
    return json_boolean(value);
}

proto_json *proto_json_new_null(void) {
    return json_null();
}

void proto_json_set(proto_json **object, const char *key, proto_json *value) {
    if (json_object_set_new(*object, key, value) != 0)
        proto_json_free(object);
}

void proto_json_set_string(proto_json **object, const char *key, const char *text) {
    proto_json_set(object, key, proto_json_new_string(text));
}

void proto_json_set_number(proto_json **object, const char *key, double value) {
    proto_json_set(object, key, json_real(value));
}

void proto_json_set_integer(proto_json **object, const char *key, int64_t value) {
    proto_json_set(object, key, json_integer(value));
}

void proto_json_set_bool(proto_json **object, const char *key, bool value) {
    proto_json_set(object, key, json_boolean(value));
}

void proto_json_set_null(proto_json **object, const char *key) {
    proto_json_set(object, key, json_null());
}

void proto_json_append(proto_json **array, proto_json *value) {
    if (json_array_append_new(*array, value) != 0)
        proto_json_free(array);
}

void proto_json_append_string(proto_json **array, const char *text) {
    proto_json_append(array, proto_json_new_string(text));
}

void proto_json_append_number(proto_json **array, double value) {
    proto_json_append(array, json_real(value));
}

void proto_json_append_integer(proto_json **array, int64_t value) {
    proto_json_append(array, json_integer(value));
}

proto_json *proto_json_numbers(const double *values, size_t count) {
    proto_json *array = proto_json_array();
    for (size_t i = 0; i < count; i++)
        proto_json_append_number(&array, values[i]);
    return array;
}

proto_json *proto_json_integers(const uint32_t *values, size_t count) {
    proto_json *array = proto_json_array();
    for (size_t i = 0; i < count; i++)
        proto_json_append_integer(&array, values[i]);
    return array;
}

/* Writing. */

struct text {
    char *bytes;
    size_t size, capacity;
    bool failed, sorted;
};

static void put(struct text *out, const char *bytes, size_t size) {
    if (out->failed)
        return;
    if (out->capacity - out->size <= size) {
        size_t capacity = (out->size + size + 1) * 2;
        char *grown = realloc(out->bytes, capacity);
        if (!grown) {
            out->failed = true;
            return;
        }
        out->bytes = grown;
        out->capacity = capacity;
    }
    memcpy(out->bytes + out->size, bytes, size);
    out->size += size;
    out->bytes[out->size] = 0;
}

static void put_string(struct text *out, const char *s) {
    put(out, "\"", 1);
    for (; *s; s++) {
        size_t plain = strcspn(s, "\"\\\x01\x02\x03\x04\x05\x06\x07\b\t\n\x0b\f\r\x0e\x0f\x10\x11"
                                  "\x12\x13\x14\x15\x16\x17\x18\x19\x1a\x1b\x1c\x1d\x1e\x1f");
        put(out, s, plain);
        s += plain;
        if (!*s)
            break;
        char escape[8];
        int n = *s == '"' || *s == '\\' ? snprintf(escape, sizeof escape, "\\%c", *s)
                                        : snprintf(escape, sizeof escape, "\\u%04x", *s);
        put(out, escape, (size_t)n);
    }
    put(out, "\"", 1);
}

static void put_number(struct text *out, const json_t *json) {
    char text[32];
    int n = 0;
    if (json_is_integer(json)) {
        n = snprintf(text, sizeof text, "%lld", (long long)json_integer_value(json));
    } else {
        double d = json_real_value(json);
        d = d == 0 ? 0 : d; /* -0 becomes 0 */
        if (fabs(d) < 1e15 && d == floor(d))
            n = snprintf(text, sizeof text, "%.0f", d);
        else
            for (int digits = 15; digits <= 17; digits++) {
                n = snprintf(text, sizeof text, "%.*g", digits, d);
                if (strtod(text, NULL) == d)
                    break;
            }
    }
    put(out, text, (size_t)n);
}

static void put_value(struct text *out, json_t *json);

static int compare_keys(const void *a, const void *b) {
    return strcmp(*(const char *const *)a, *(const char *const *)b);
}

static void put_object(struct text *out, json_t *json) {
    size_t count = json_object_size(json), i = 0;
    const char **keys = malloc((count ? count : 1) * sizeof *keys);
    if (!keys) {
        out->failed = true;
        return;
    }
    for (void *at = json_object_iter(json); at; at = json_object_iter_next(json, at))
        keys[i++] = json_object_iter_key(at);
    if (out->sorted)
        qsort(keys, count, sizeof *keys, compare_keys);
    put(out, "{", 1);
    for (i = 0; i < count; i++) {
        if (i)
            put(out, ",", 1);
        put_string(out, keys[i]);
        put(out, ":", 1);
        put_value(out, json_object_get(json, keys[i]));
    }
    put(out, "}", 1);
    free(keys);
}

/* The recursion is bounded: parsing limits the depth, and builders cannot create a cycle. */
static void put_value(struct text *out, json_t *json) {
    switch (json_typeof(json)) {
    case JSON_OBJECT:
        put_object(out, json);
        break;
    case JSON_ARRAY:
        put(out, "[", 1);
        for (size_t i = 0; i < json_array_size(json); i++) {
            if (i)
                put(out, ",", 1);
            put_value(out, json_array_get(json, i));
        }
        put(out, "]", 1);
        break;
    case JSON_STRING:
        put_string(out, json_string_value(json));
        break;
    case JSON_INTEGER:
    case JSON_REAL:
        put_number(out, json);
        break;
    case JSON_TRUE:
        put(out, "true", 4);
        break;
    case JSON_FALSE:
        put(out, "false", 5);
        break;
    case JSON_NULL:
        put(out, "null", 4);
        break;
    }
}

static char *to_text(const proto_json *json, bool sorted, size_t *size) {
    if (!json)
        return NULL;
    struct text out = { .sorted = sorted };
    put_value(&out, (json_t *)json); /* does not modify it */
    if (out.failed) {
        free(out.bytes);
        return NULL;
    }
    if (size)
        *size = out.size;
    return out.bytes;
}

char *proto_json_to_text(const proto_json *json, size_t *size) {
    return to_text(json, false, size);
}

char *proto_json_to_canonical(const proto_json *json, size_t *size) {
    return to_text(json, true, size);
}
