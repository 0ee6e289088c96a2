/* SPDX-License-Identifier: Apache-2.0
 *
 * Answers that promise something wait for the disk.
 */
#include "http/listener.h"

static void on_kept(void *user, bool durable) {
    struct srv_request *request = user;
    srv_reply_header(&request->reply, "X-Durable", "%s", durable ? "yes" : "no");
    srv_request_complete(request);
}

void srv_request_reply_when_durable(struct srv_request *request) {
    struct srv_store *store = request->app->store;
    srv_request_suspend(request);
    /* From here on the request may be answered, and gone, at any moment. */
    srv_store_flush(store, on_kept, request);
}
