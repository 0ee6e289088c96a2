/* SPDX-License-Identifier: Apache-2.0 */
#include "protocol/array.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "protocol/text.h"

static const uint8_t magic[8] = { 0, 'S', 'P', 'L', 'M', 'E', 'M', 1 };
#define BYTES_MAX (UINT64_C(1) << 53)

/* The message. */

static uint64_t read_number(const uint8_t *bytes, int size) {
    uint64_t value = 0;
    for (int i = size - 1; i >= 0; i--)
        value = value << 8 | bytes[i];
    return value;
}

static void write_number(uint64_t value, uint8_t *bytes, int size) {
    for (int i = 0; i < size; i++)
        bytes[i] = (uint8_t)(value >> 8 * i);
}

bool proto_array_is_hello(uint8_t first) {
    return first == magic[0];
}

bool proto_array_hello_decode(const uint8_t *bytes, size_t *size, struct proto_array_hello *hello,
                              struct sp_error *err) {
    const size_t came = *size;
    *size = PROTO_ARRAY_HEAD;
    if (memcmp(bytes, magic, came < sizeof magic ? came : sizeof magic) != 0)
        return sp_fail(err, SP_ERR_INVALID, NULL,
                       "the message does not begin with 00 53 50 4C 4D 45 4D 01");
    if (came < PROTO_ARRAY_HEAD)
        return sp_fail(err, SP_ERR_NOT_READY, NULL, "%zu of %d bytes have arrived", came,
                       PROTO_ARRAY_HEAD);
    const size_t token = (size_t)read_number(bytes + 16, 4);
    hello->bytes = read_number(bytes + 8, 8);
    if (hello->bytes == 0 || hello->bytes > BYTES_MAX)
        return sp_fail(err, SP_ERR_INVALID, NULL, "the size of the array is outside [1, 2^53]");
    if (token < PROTO_ARRAY_TOKEN_MIN || token > PROTO_ARRAY_TOKEN_MAX)
        return sp_fail(err, SP_ERR_INVALID, NULL, "the size of the token, %zu, is outside [%d, %d]",
                       token, PROTO_ARRAY_TOKEN_MIN, PROTO_ARRAY_TOKEN_MAX);
    *size += token;
    if (came < *size)
        return sp_fail(err, SP_ERR_NOT_READY, NULL, "%zu of %zu bytes have arrived", came, *size);
    if (came > *size || memchr(bytes + PROTO_ARRAY_HEAD, 0, token))
        return sp_fail(err, SP_ERR_INVALID, NULL,
                       came > *size ? "bytes follow the token" : "the token has a byte 0");
    memcpy(hello->token, bytes + PROTO_ARRAY_HEAD, token);
    hello->token[token] = 0;
    return true;
}

size_t proto_array_hello_encode(const struct proto_array_hello *hello,
                                uint8_t bytes[PROTO_ARRAY_HELLO_MAX]) {
    const size_t token = strlen(hello->token);
    memcpy(bytes, magic, sizeof magic);
    write_number(hello->bytes, bytes + 8, 8);
    write_number(token, bytes + 16, 4);
    memcpy(bytes + PROTO_ARRAY_HEAD, hello->token, token);
    return PROTO_ARRAY_HEAD + token;
}

/* The description. */

const char *const proto_array_members[] = { "dims", "type",       "spacing", "origin", "direction",
                                            "unit", "value_unit", "meaning", NULL };

static bool read_dims(const proto_json *json, uint32_t dims[3], struct sp_error *err) {
    const proto_json *array = proto_json_get(json, "dims");
    bool is_good = proto_json_type(array) == PROTO_JSON_ARRAY && proto_json_size(array) == 3;
    for (size_t i = 0; is_good && i < 3; i++) {
        int64_t value;
        is_good = proto_json_integer(proto_json_at(array, i), &value) && value >= 1 &&
                  value <= SP_DIM_MAX;
        dims[i] = is_good ? (uint32_t)value : 0;
    }
    return is_good || sp_fail(err, SP_ERR_INVALID, "/dims",
                              "must be three whole numbers in [1, %u], the fastest axis (x) first",
                              SP_DIM_MAX);
}

static bool read_type(const proto_json *json, enum sp_type *type, struct sp_error *err) {
    const char *name = proto_json_string(proto_json_get(json, "type"));
    for (int i = 0; name && i < SP_TYPE_COUNT; i++) {
        *type = (enum sp_type)i;
        if (strcmp(name, sp_type_name(*type)) == 0)
            return true;
    }
    return sp_fail(err, SP_ERR_INVALID, "/type",
                   "must be one of uint8, int8, uint16, int16, int32, float32, float64; convert "
                   "samples of other types");
}

/* Reads three numbers; a missing array leaves them as they are. */
static bool read_numbers(const proto_json *array, const char *pointer, double out[3],
                         struct sp_error *err) {
    bool is_good =
        !array || (proto_json_type(array) == PROTO_JSON_ARRAY && proto_json_size(array) == 3);
    for (size_t i = 0; array && is_good && i < 3; i++)
        is_good = proto_json_number(proto_json_at(array, i), &out[i]) && isfinite(out[i]);
    return is_good || sp_fail(err, SP_ERR_INVALID, pointer, "must be three numbers");
}

static bool read_direction(const proto_json *json, double direction[3][3], struct sp_error *err) {
    static const char *const pointers[3] = { "/direction/0", "/direction/1", "/direction/2" };
    const proto_json *axes = proto_json_get(json, "direction");
    if (axes && (proto_json_type(axes) != PROTO_JSON_ARRAY || proto_json_size(axes) != 3))
        return sp_fail(err, SP_ERR_INVALID, "/direction", "must be three vectors, one per axis");
    for (size_t axis = 0; axes && axis < 3; axis++) {
        double v[3];
        if (!read_numbers(proto_json_at(axes, axis), pointers[axis], v, err))
            return false;
        const double length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
        if (!(fabs(length - 1) < 1e-2))
            return sp_fail(err, SP_ERR_INVALID, pointers[axis],
                           "has length %g instead of 1; put the length into spacing", length);
        for (int row = 0; row < 3; row++) /* removes the rounding of the written digits */
            direction[row][axis] = v[row] / length;
    }
    return true;
}

static bool read_unit(const proto_json *json, const char *key, const char *pointer,
                      char unit[SP_UNIT_BYTES], struct sp_error *err) {
    const proto_json *member = proto_json_get(json, key);
    const char *text = proto_json_string(member);
    if (member && (!text || strlen(text) >= SP_UNIT_BYTES || !proto_text_is_plain(text)))
        return sp_fail(err, SP_ERR_INVALID, pointer,
                       "must be a string of at most %d bytes without control characters",
                       SP_UNIT_BYTES - 1);
    snprintf(unit, SP_UNIT_BYTES, "%s", text ? text : "");
    return true;
}

static bool read_meaning(const proto_json *json, enum sp_meaning *meaning, struct sp_error *err) {
    const proto_json *member = proto_json_get(json, "meaning");
    const char *name = proto_json_string(member);
    for (int i = SP_MEANING_UNKNOWN + 1; name && i < SP_MEANING_COUNT; i++) {
        *meaning = (enum sp_meaning)i;
        if (strcmp(name, sp_meaning_name(*meaning)) == 0)
            return true;
    }
    *meaning = SP_MEANING_UNKNOWN;
    return !member || sp_fail(err, SP_ERR_INVALID, "/meaning",
                              "must be one of labels, statistic, distance; leave it out for plain "
                              "quantities");
}

bool proto_array_decode(const proto_json *json, struct sp_volume_info *info, struct sp_error *err) {
    struct sp_grid *grid = &info->grid;
    memset(info, 0, sizeof *info);
    for (int a = 0; a < 3; a++)
        grid->spacing[a] = grid->direction[a][a] = 1;
    return read_dims(json, grid->dims, err) && read_type(json, &info->type, err) &&
           read_numbers(proto_json_get(json, "spacing"), "/spacing", grid->spacing, err) &&
           read_numbers(proto_json_get(json, "origin"), "/origin", grid->origin, err) &&
           read_direction(json, grid->direction, err) &&
           read_unit(json, "unit", "/unit", info->unit, err) &&
           read_unit(json, "value_unit", "/value_unit", info->value_unit, err) &&
           read_meaning(json, &info->meaning, err);
}
