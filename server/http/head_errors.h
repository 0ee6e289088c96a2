/* SPDX-License-Identifier: Apache-2.0
 *
 * Heads that the HTTP library refuses before it asks the daemon.
 *
 * libmicrohttpd 0.9.75 answers a Content-Length that is no number itself, and sends the head of
 * that answer twice. It cannot be told not to, but it logs the error first, on the thread of the
 * connection. At that moment the head of just one request of the thread is complete and not yet
 * given to the daemon: this one. The daemon answers it on the socket, and closes the socket for
 * writing, so that the answer of the library is dropped.
 */
#ifndef SRV_HTTP_HEAD_ERRORS_H
#define SRV_HTTP_HEAD_ERRORS_H

#include "http/request.h"

/* srv_head_begin() is called at the request line; srv_head_end() when the daemon gets the request,
 * or when the connection ends. srv_head_end() may be called more than once. */
void srv_head_begin(struct srv_request *request);
void srv_head_end(struct srv_request *request);

#endif
