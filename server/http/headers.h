/* SPDX-License-Identifier: Apache-2.0
 *
 * Parsers of request headers. Pure functions; all accept NULL for a missing header.
 */
#ifndef SRV_HTTP_HEADERS_H
#define SRV_HTTP_HEADERS_H

#include <stdbool.h>
#include <stddef.h>

/* True if a comma-separated list ("Connection: keep-alive, Upgrade") contains the token. Ignores
 * case. */
bool srv_header_has_token(const char *list, const char *token);

/* Returns the quality of a media type in an Accept header (RFC 9110, 12.5.1): the q of its most
 * specific range, in [0, 1]. 1 without a header. */
double srv_header_accept_quality(const char *accept, const char *mime);

/* True if a page of `origin` may open a stream on `host`, the Host header. Without an Origin header
 * the client is not a browser, and may. Otherwise the scheme must be http or https, and host and
 * port must be equal; the default port is that of the scheme. */
bool srv_cors_is_same_origin(const char *origin, const char *host);

/* True if If-None-Match is "*" or lists `etag`, by weak comparison (RFC 9110, 13.1.2). */
bool srv_header_has_etag(const char *if_none_match, const char *etag);

/* Returns the token of "Authorization: Bearer TOKEN", or NULL. Points into the argument. */
const char *srv_header_bearer_token(const char *authorization);

/* Media types of JSON bodies, as in an Accept-Patch header (RFC 5789, 3.1). */
#define SRV_JSON_TYPES "application/json, application/merge-patch+json"

/* True for SRV_JSON_TYPES, with or without parameters, and for NULL. */
bool srv_header_is_json(const char *content_type);

#endif
