/* SPDX-License-Identifier: Apache-2.0
 *
 * Lists that may be long are told in pages: ?limit= items at most, of those behind ?after=. An
 * answer that is not the last has "next", which is the next one's ?after=.
 */
#ifndef SRV_HTTP_PAGING_H
#define SRV_HTTP_PAGING_H

#include "common/pagination.h"
#include "http/listener.h"

/* A page for items of so many bytes, as the query says. False: the reply is the problem. */
bool srv_paging_begin(struct srv_request *request, size_t item_bytes, struct srv_page *page,
                      struct srv_reply *reply);
/* The answer {"`name`": [encode(user, item), …], "next"?}; ends the page. encode() gives NULL when
 * out of memory. */
void srv_paging_reply(struct srv_page *page, const char *name,
                      proto_json *(*encode)(void *user, const void *item), void *user,
                      struct srv_reply *reply);

#endif
