/* SPDX-License-Identifier: Apache-2.0
 *
 * Turns a reply into a response of libmicrohttpd: compressed if the client accepts that, and
 * readable by pages of allowed origins (CORS).
 */
#ifndef SRV_HTTP_RESPONSE_H
#define SRV_HTTP_RESPONSE_H

#include "http/request.h"

/* Takes ownership of what the request's reply owns. NULL when out of memory. */
struct MHD_Response *srv_response_create(struct srv_request *request);

/* True if the request is the preflight of a page of an allowed origin. */
bool srv_cors_is_preflight(const struct srv_request *request);
/* `allowed`: the methods of the path. */
void srv_cors_reply_preflight(struct srv_reply *reply, unsigned allowed);

#endif
