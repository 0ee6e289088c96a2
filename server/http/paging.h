/* SPDX-License-Identifier: Apache-2.0
 *
 * Long lists are sent in pages: at most ?limit= items that follow the id ?after=. Every page but
 * the last has "next", the ?after= of the next page.
 */
#ifndef SRV_HTTP_PAGING_H
#define SRV_HTTP_PAGING_H

#include "common/pagination.h"
#include "http/request.h"

/* Prepares a page from the query parameters. False: the reply is a problem document. */
bool srv_paging_begin(struct srv_request *request, size_t item_bytes, struct srv_page *page,
                      struct srv_reply *reply);
/* Returns {"`name`": [encode(user, item), …], "next"?} and frees the page; the caller owns the
 * JSON. encode() returns NULL when out of memory, and so does this function. */
proto_json *srv_paging_json(struct srv_page *page, const char *name,
                            proto_json *(*encode)(void *user, const void *item), void *user);
/* Replies with that JSON. */
void srv_paging_reply(struct srv_page *page, const char *name,
                      proto_json *(*encode)(void *user, const void *item), void *user,
                      struct srv_reply *reply);

#endif
