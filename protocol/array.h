/* SPDX-License-Identifier: Apache-2.0
 *
 * Arrays in shared memory (server/http/UNIX.md): the message that comes with the descriptor, and
 * the description that makes a volume of the array.
 *
 *   bytes  0 …  7   magic: 00 'S' 'P' 'L' 'M' 'E' 'M' 01
 *          8 … 15   size of the array, bytes [1, 2^53]; little endian
 *         16 … 19   size of the token, bytes [PROTO_ARRAY_TOKEN_MIN, PROTO_ARRAY_TOKEN_MAX]; little
 *                   endian
 *         20 …      the token
 */
#ifndef PROTO_ARRAY_H
#define PROTO_ARRAY_H

#include "protocol/json.h"
#include "sp/volume.h"

enum {
    PROTO_ARRAY_HEAD = 20,      /* bytes before the token */
    PROTO_ARRAY_TOKEN_MIN = 16, /* bytes, as in --token-file */
    PROTO_ARRAY_TOKEN_MAX = 128,
    PROTO_ARRAY_HELLO_MAX = PROTO_ARRAY_HEAD + PROTO_ARRAY_TOKEN_MAX
};

struct proto_array_hello {
    uint64_t bytes;
    char token[PROTO_ARRAY_TOKEN_MAX + 1];
};

/* True if the first byte of a connection begins such a message; no request of HTTP begins so. */
bool proto_array_is_hello(uint8_t first);
/* Decodes the bytes that have arrived, without the descriptor. *size is their number, and becomes
 * that of the whole message as far as it is known. Returns false with err->code SP_ERR_NOT_READY if
 * bytes are missing, and with SP_ERR_INVALID if the message is wrong; no text contains the token.
 * Thread-safe. */
bool proto_array_hello_decode(const uint8_t *bytes, size_t *size, struct proto_array_hello *hello,
                              struct sp_error *err);
/* Encodes a message; returns its size, at most PROTO_ARRAY_HELLO_MAX. */
size_t proto_array_hello_encode(const struct proto_array_hello *hello,
                                uint8_t bytes[PROTO_ARRAY_HELLO_MAX]);

/* The members of a volume request that describe an array; ends with NULL. */
extern const char *const proto_array_members[];
/* Reads "dims", "type", "spacing", "origin", "direction", "unit", "value_unit" and "meaning" of an
 * object. Writes grid, type, units and meaning, and zeroes everything else. SP_ERR_INVALID with a
 * JSON pointer as place; sp_volume_map_check() checks the rest. Thread-safe. */
bool proto_array_decode(const proto_json *json, struct sp_volume_info *info, struct sp_error *err);

#endif
