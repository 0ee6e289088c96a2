/* SPDX-License-Identifier: Apache-2.0
 *
 * A reply becomes an answer: compressed where the client takes that, readable for pages of other
 * origins that are allowed.
 */
#ifndef SRV_HTTP_RESPONSE_H
#define SRV_HTTP_RESPONSE_H

#include "http/listener.h"

/* Takes what the request's reply owns. NULL when out of memory. */
struct MHD_Response *srv_response_create(struct srv_request *request);

/* The question of a browser whether a page of an allowed origin may send a request (CORS). */
bool srv_cors_is_preflight(const struct srv_request *request);
/* `allowed`: the methods of the path. */
void srv_cors_reply_preflight(struct srv_reply *reply, unsigned allowed);

#endif
