/* SPDX-License-Identifier: Apache-2.0
 *
 * Parsers of request headers and query values. Pure functions. A parser of a header accepts
 * NULL for a missing header, except srv_header_websocket_accept().
 */
#ifndef SRV_HTTP_HEADERS_H
#define SRV_HTTP_HEADERS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Cuts trailing spaces and tabs, which are no part of a value (RFC 9110, 5.5). */
void srv_header_trim(char *value);
/* True if a comma-separated list ("Connection: keep-alive, Upgrade") contains the token. Ignores
 * case. */
bool srv_header_has_token(const char *list, const char *token);

/* Returns the quality of a media type in an Accept header (RFC 9110, 12.5.1): the q of its most
 * specific range, in [0, 1]. 1 without a header. */
double srv_header_accept_quality(const char *accept, const char *mime);

/* True if If-None-Match is "*" or lists `etag`, by weak comparison (RFC 9110, 13.1.2). */
bool srv_header_has_etag(const char *if_none_match, const char *etag);

/* Returns the token of "Authorization: Bearer TOKEN", or NULL. Points into the argument. */
const char *srv_header_bearer_token(const char *authorization);

/* Media types of JSON bodies, as in an Accept-Patch header (RFC 5789, 3.1). */
#define SRV_JSON_TYPES "application/json, application/merge-patch+json"

/* True for SRV_JSON_TYPES, with or without parameters, and for NULL. */
bool srv_header_is_json(const char *content_type);

enum { SRV_WEBSOCKET_ACCEPT_BYTES = 29 };

/* Computes Sec-WebSocket-Accept from a Sec-WebSocket-Key of at most 64 bytes. False if GnuTLS does
 * not provide SHA-1 or when out of memory. Thread-safe. */
bool srv_header_websocket_accept(const char *key, char accept[SRV_WEBSOCKET_ACCEPT_BYTES]);

/* Parses a whole number in [1, max]: digits only. */
bool srv_query_number(const char *text, unsigned max, unsigned *number);

/* Parses "WIDTH,HEIGHT": whole numbers of at most 5 digits. */
bool srv_query_size(const char *text, uint32_t size[2]);

/* Parses `count` decimal numbers, separated by commas, each finite. */
bool srv_query_numbers(const char *text, unsigned count, double *numbers);

enum srv_range { SRV_RANGE_WHOLE, SRV_RANGE_PARTIAL, SRV_RANGE_NONE };

/* Decodes a Range header (RFC 9110, 14) for a file of `size` bytes: the answer has the bytes
 * [*from, *from + *count). SRV_RANGE_PARTIAL: a single range. SRV_RANGE_WHOLE: no or several
 * ranges, another unit, or an If-Range other than `etag`. SRV_RANGE_NONE: the file does not have
 * these bytes. Both headers may be NULL. */
enum srv_range srv_header_range(const char *range, const char *if_range, const char *etag,
                                uint64_t size, uint64_t *from, uint64_t *count);

#endif
