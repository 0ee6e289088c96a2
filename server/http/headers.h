/* SPDX-License-Identifier: Apache-2.0
 *
 * What request headers mean. Pure functions; all accept NULL for a header that is not there.
 */
#ifndef SRV_HTTP_HEADERS_H
#define SRV_HTTP_HEADERS_H

#include <stdbool.h>
#include <stddef.h>

/* Does a comma-separated list hold this token, in any case ("Connection: keep-alive, Upgrade")? */
bool srv_header_has_token(const char *list, const char *token);

/* How much a media type is wanted by an Accept header (RFC 9110, 12.5.1): the q of its most
 * specific range in [0,1]; 1 without a header. */
double srv_header_accept_quality(const char *accept, const char *mime);

/* May a page of `origin` open a stream on `host` (Host header)? Without an Origin yes: that is no
 * browser. Else scheme http or https and the same host and port; a port left out is the scheme's.
 */
bool srv_cors_is_same_origin(const char *origin, const char *host);

/* If-None-Match: "*", or a list that holds `etag`; weak comparison (RFC 9110, 13.1.2). */
bool srv_header_has_etag(const char *if_none_match, const char *etag);

/* The token of "Authorization: Bearer TOKEN", NULL if it is none. */
const char *srv_header_bearer_token(const char *authorization);

/* For an Accept-Patch header (RFC 5789, 3.1). */
#define SRV_JSON_TYPES "application/json, application/merge-patch+json"

/* JSON? One of SRV_JSON_TYPES, with parameters; NULL counts as JSON. */
bool srv_header_is_json(const char *content_type);

#endif
