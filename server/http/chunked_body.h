/* SPDX-License-Identifier: Apache-2.0
 *
 * Bodies that come bit by bit: files, archives, events. Nobody waits for the next bit: a body that
 * has none puts its connection to sleep. Each bit, some tens of KiB, must be taken within
 * --request-time; asleep there is no deadline.
 */
#ifndef SRV_HTTP_CHUNKED_BODY_H
#define SRV_HTTP_CHUNKED_BODY_H

#include <sys/types.h>

#include "http/listener.h"

#define SRV_BODY_SIZE_UNKNOWN UINT64_MAX
enum { SRV_BODY_END = 0, SRV_BODY_FAILED = -1, SRV_BODY_PAUSED = -2 };

struct srv_chunked_body {
    void *user;
    /* The next bytes, at most `size`; or one of the above: the connection ends as it should, ends
     * early so that the client sees that something is missing, or was put to sleep. */
    ssize_t (*read)(void *user, char *bytes, size_t size);
    void (*finish)(void *user); /* once, whatever becomes of the body */
    bool has_one_deadline;      /* bit: the whole must be taken within --request-time */
};

/* The reply's body, of `size` bytes in all. Takes over `body`, also when memory is out: then the
 * reply is the problem. */
void srv_reply_chunked_body(struct srv_request *request, struct srv_reply *reply, uint64_t size,
                            const struct srv_chunked_body *body);

/* For read(), and for whoever knows that there is something to read again. */
void srv_chunked_body_pause(struct srv_request *request);
void srv_chunked_body_resume(struct srv_request *request);

#endif
