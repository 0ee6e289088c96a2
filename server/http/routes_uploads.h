/* SPDX-License-Identifier: Apache-2.0
 *
 * What the routes of uploads (routes_uploads.c) and their bodies (upload_body.c) share.
 */
#ifndef SRV_HTTP_ROUTES_UPLOADS_H
#define SRV_HTTP_ROUTES_UPLOADS_H

#include "http/request.h"
#include "uploads/uploads.h"

/* Checks the header Tus-Resumable, which a client may leave out. False: the reply is a problem
 * document. */
bool srv_upload_check_version(const struct srv_request *request, struct srv_reply *reply);
/* Adds the headers that every answer about an upload has; info NULL = only the version. */
void srv_upload_headers(struct srv_reply *reply, const struct srv_upload_info *info);
/* 403: there are no uploads. */
void srv_uploads_reply_none(struct srv_reply *reply);
/* A problem document for an error of uploads/uploads.h. */
void srv_uploads_reply_error(struct srv_reply *reply, const struct sp_error *err);

#endif
