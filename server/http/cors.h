/* SPDX-License-Identifier: Apache-2.0
 *
 * Pages of other origins that may use this daemon (--allow-origin). Each origin is listed with its
 * full name, "https://example.org:8443". A page still needs a token.
 */
#ifndef SRV_HTTP_CORS_H
#define SRV_HTTP_CORS_H

#include <stdbool.h>

#include "sp/status.h"

enum { SRV_ORIGINS_MAX = 700 }; /* characters of the list, which a header of the page repeats */

/* Checks a comma-separated list of origins; NULL = empty. False: SP_ERR_INVALID. */
bool srv_cors_check_origins(const char *list, struct sp_error *err);

/* True if the list contains `origin`, the value of an Origin header. False if either is NULL. */
bool srv_cors_allows(const char *list, const char *origin);

/* True if a page of `origin` may open a stream on `host`, the Host header. Without an Origin header
 * the client is not a browser, and may. Otherwise the scheme must be http or https, and host and
 * port must be equal; a missing port is the default of the scheme. */
bool srv_cors_is_same_origin(const char *origin, const char *host);

#endif
