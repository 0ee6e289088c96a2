/* SPDX-License-Identifier: Apache-2.0
 *
 * The position of a JSON parser in its text. The parser's library limits the depth only at compile
 * time and reports errors as byte offsets, so json.c follows the bytes that the library reads: one
 * walk gives the depth before the library recurses and the JSON pointer of an error. Private to
 * protocol/.
 */
#ifndef PROTO_POSITION_H
#define PROTO_POSITION_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "protocol/limits.h"
#include "protocol/pointer.h"

struct proto_nesting {
    char kind;       /* '[' or '{' */
    bool in_value;   /* of an object: behind the colon of the current key */
    uint32_t index;  /* of an array: the current element, from 0 */
    const char *key; /* of an object: the text between the quotes of the current key; NULL = none */
    size_t key_bytes;
};

/* Set `bytes`, borrowed, and zero the rest. Belongs to one thread at a time. */
struct proto_position {
    const char *bytes;
    size_t at; /* bytes walked so far */
    struct proto_nesting stack[PROTO_DEPTH_MAX];
    unsigned depth; /* open arrays and objects */
    bool in_string, is_key, is_escaped, is_too_deep;
};

/* Walks on to `bytes[end]`, exclusive; does nothing if the position is already there. The text need
 * not be valid JSON: brackets that do not match are ignored. False if nesting exceeds
 * PROTO_DEPTH_MAX: the walk stops before that bracket, for good. */
bool proto_position_advance(struct proto_position *position, size_t end);

/* Writes the JSON pointer (RFC 6901) of the value or key that contains the position. */
void proto_position_pointer(const struct proto_position *position, struct proto_pointer *pointer);

/* Computes the line and column of the position, both from 1; columns count characters. */
void proto_position_line(const struct proto_position *position, unsigned *line, unsigned *column);

#endif
