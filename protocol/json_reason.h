/* SPDX-License-Identifier: Apache-2.0
 *
 * Explains why a text is not JSON, in this program's words. The library behind json.c gives a code
 * and an offset; its own texts name its flags and tokens. Private to protocol/.
 */
#ifndef PROTO_JSON_REASON_H
#define PROTO_JSON_REASON_H

#include <stddef.h>

#include "protocol/position.h"

enum proto_json_fault {
    PROTO_JSON_SYNTAX, /* the token that ends at the position does not belong there */
    PROTO_JSON_ENDS,   /* the text ends too early */
    PROTO_JSON_GOES_ON,
    PROTO_JSON_NOT_UTF8,
    PROTO_JSON_NUL,
    PROTO_JSON_TWICE, /* the key that ends at the position */
    PROTO_JSON_TOO_LARGE
};

enum { PROTO_JSON_REASON_BYTES = 160 };

/* Writes the reason as a clause: "a string needs double quotes". `position` is where the parser
 * stopped, and `size` counts the bytes of the whole text. */
void proto_json_reason(enum proto_json_fault fault, const struct proto_position *position,
                       size_t size, char text[PROTO_JSON_REASON_BYTES]);

#endif
