/* SPDX-License-Identifier: Apache-2.0 */
#include "http/paging.h"

#include <stdlib.h>

#include "http/headers.h"

enum { LIMIT_DEFAULT = 100, LIMIT_MAX = 1000 };

bool srv_paging_begin(struct srv_request *request, size_t item_bytes, struct srv_page *page,
                      struct srv_reply *reply) {
    const char *after = srv_request_query(request, "after");
    const char *text = srv_request_query(request, "limit");
    unsigned limit = LIMIT_DEFAULT;
    if (text && !srv_query_number(text, LIMIT_MAX, &limit)) {
        srv_reply_problem(reply, 400, NULL, "?limit= must be a whole number in [1, %d]", LIMIT_MAX);
        return false;
    }
    /* One item more than the page holds shows whether there is a next page. */
    *page = (struct srv_page){ .item_bytes = item_bytes,
                               .max = limit + 1,
                               .after = after ? after : "" };
    page->items = malloc(page->max * item_bytes);
    if (!page->items)
        srv_reply_problem(reply, 503, NULL, "out of memory for a list");
    return page->items != NULL;
}

proto_json *srv_paging_json(struct srv_page *page, const char *name,
                            proto_json *(*encode)(void *user, const void *item), void *user) {
    const char *items = page->items;
    bool has_next = page->count == page->max;
    unsigned count = has_next ? page->max - 1 : page->count;
    proto_json *json = proto_json_object(), *list = proto_json_array();
    for (unsigned i = 0; i < count; i++)
        proto_json_append(&list, encode(user, items + i * page->item_bytes));
    proto_json_set(&json, name, list);
    if (has_next)
        proto_json_set_string(&json, "next", items + (count - 1) * page->item_bytes);
    free(page->items);
    return json;
}

void srv_paging_reply(struct srv_page *page, const char *name,
                      proto_json *(*encode)(void *user, const void *item), void *user,
                      struct srv_reply *reply) {
    srv_reply_json(reply, 200, srv_paging_json(page, name, encode, user));
}
