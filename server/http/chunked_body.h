/* SPDX-License-Identifier: Apache-2.0
 *
 * Bodies that are sent in blocks: files, archives, events. No thread waits for the next block: a
 * body that has none pauses its connection. The client must take each block, at most 64 KiB, within
 * --request-time. A paused connection has no deadline.
 */
#ifndef SRV_HTTP_CHUNKED_BODY_H
#define SRV_HTTP_CHUNKED_BODY_H

#include <sys/types.h>

#include "http/request.h"

#define SRV_BODY_SIZE_UNKNOWN UINT64_MAX
enum { SRV_BODY_END = 0, SRV_BODY_FAILED = -1, SRV_BODY_PAUSED = -2 };

struct srv_chunked_body {
    void *user;
    /* Writes at most `size` bytes and returns their number. Or returns SRV_BODY_END;
     * SRV_BODY_FAILED, which cuts the connection so that the client notices that bytes are missing;
     * or SRV_BODY_PAUSED after srv_chunked_body_pause(). */
    ssize_t (*read)(void *user, char *bytes, size_t size);
    void (*finish)(void *user); /* called exactly once */
    bool has_one_deadline;      /* the client must take the whole body within --request-time */
};

/* Sets the reply's body, of `size` bytes in total. Takes ownership of `body`, also when out of
 * memory; the reply is a problem document then. */
void srv_reply_chunked_body(struct srv_request *request, struct srv_reply *reply, uint64_t size,
                            const struct srv_chunked_body *body);

/* Pause is for read(). Resume is for the thread that has produced more bytes. */
void srv_chunked_body_pause(struct srv_request *request);
void srv_chunked_body_resume(struct srv_request *request);

#endif
