/* SPDX-License-Identifier: Apache-2.0
 *
 * Turns a reply into a response of the HTTP library: compressed if the client accepts that, and
 * readable for pages of allowed origins (CORS).
 */
#ifndef SRV_HTTP_RESPONSE_H
#define SRV_HTTP_RESPONSE_H

#include "http/listener.h"

/* Takes over what the request's reply owns. NULL when out of memory. */
struct MHD_Response *srv_response_create(struct srv_request *request);

/* True if a browser asks whether a page of an allowed origin may send a request. */
bool srv_cors_is_preflight(const struct srv_request *request);
/* `allowed`: the methods of the path. */
void srv_cors_reply_preflight(struct srv_reply *reply, unsigned allowed);

#endif
