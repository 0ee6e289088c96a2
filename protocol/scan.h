/* SPDX-License-Identifier: Apache-2.0
 *
 * A walk over JSON text that knows where it is: it measures depth before a parser recurses, and
 * turns the byte at which a parser gave up into a JSON pointer. Private to protocol/.
 */
#ifndef PROTO_SCAN_H
#define PROTO_SCAN_H

#include <stdbool.h>
#include <stddef.h>

/* Walks the first `size` bytes and writes the JSON pointer (RFC 6901) of the value or key in which
 * it ends to `pointer` (`capacity` > 0 bytes, cut if longer). Text need not be valid JSON: brackets
 * that do not match are passed over. Returns false, with *size set to the byte of the bracket that
 * is one too deep, if nesting exceeds PROTO_DEPTH_MAX. */
bool proto_scan(const char *bytes, size_t *size, char *pointer, size_t capacity);

#endif
