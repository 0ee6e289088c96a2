/* SPDX-License-Identifier: Apache-2.0
 *
 * The body of PATCH /uploads/{id}: it goes to the disk in blocks, and only the size of the upload
 * limits it.
 *
 *   HTTP thread: bytes ─► block ──full: suspend──► disk thread: checksum, write ──resume──► …
 *
 * Each block, 256 KiB, must arrive within --request-time. When a connection is lost, the bytes that
 * have arrived count, unless the request has a checksum.
 */
#ifndef SRV_HTTP_UPLOAD_BODY_H
#define SRV_HTTP_UPLOAD_BODY_H

#include "http/request.h"

struct srv_upload_body;

/* True if the route takes such a body. */
bool srv_upload_body_is_for(const struct srv_route *route);
/* Checks the headers and begins to write. False: the reply is a problem document. */
bool srv_upload_body_open(struct srv_request *request);
/* Takes bytes; *size becomes the number of bytes that are left for the next call. May suspend the
 * request. */
void srv_upload_body_append(struct srv_request *request, const char *bytes, size_t *size);
/* The request ends, before or after its answer. Accepts a request without such a body. */
void srv_upload_body_close(struct srv_request *request);

#endif
