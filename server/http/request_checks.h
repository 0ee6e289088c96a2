/* SPDX-License-Identifier: Apache-2.0
 *
 * Checks of a request before its body is read.
 */
#ifndef SRV_HTTP_REQUEST_CHECKS_H
#define SRV_HTTP_REQUEST_CHECKS_H

#include "http/request.h"

/* Runs the smuggling checks. True if the request is answered at once, without reading its body, and
 * the connection closes: the reply is a problem document. `version` is "HTTP/1.1" or "HTTP/1.0". */
bool srv_request_is_refused_at_once(struct srv_request *request, const char *version);

/* For a request that the library refuses before on_headers(): true if the smuggling checks also
 * refuse it; the reply is a problem document. */
bool srv_request_has_bad_head(struct srv_request *request);

/* Checks the limits of connections, finds the route, and checks token, query parameters, content
 * type and length. False: the reply is set. */
bool srv_request_check(struct srv_request *request);

/* Replies with status 401. The text tells a missing token from an unknown one, and then `how` to
 * give one. */
void srv_request_refuse_token(struct srv_request *request, const char *how);

/* True if the token has the right that the route needs; else the reply is a problem document. */
bool srv_request_check_right(struct srv_request *request, enum srv_right needs);

#endif
