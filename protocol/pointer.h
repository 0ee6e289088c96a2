/* SPDX-License-Identifier: Apache-2.0
 *
 * A JSON pointer (RFC 6901) that follows a walk through a document.
 */
#ifndef PROTO_POINTER_H
#define PROTO_POINTER_H

#include <stddef.h>

#include "sp/status.h"

struct proto_pointer { /* all zero = the whole document, "" */
    char text[SP_ERROR_PLACE];
    size_t length; /* bytes of text */
};

/* Append one token and escape '~' and '/'. A pointer that does not fit is cut at its end. Save the
 * length before a push; proto_pointer_pop() with that length undoes it. */
void proto_pointer_push(struct proto_pointer *pointer, const char *key, size_t key_bytes);
void proto_pointer_push_index(struct proto_pointer *pointer, size_t index);
void proto_pointer_pop(struct proto_pointer *pointer, size_t old_length);

#endif
