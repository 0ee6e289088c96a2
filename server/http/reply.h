/* SPDX-License-Identifier: Apache-2.0
 *
 * A reply: status, headers and body, before response.c turns it into a response of the HTTP
 * library.
 */
#ifndef SRV_HTTP_REPLY_H
#define SRV_HTTP_REPLY_H

#include <stdbool.h>
#include <stddef.h>

#include "protocol/json.h"
#include "sp/status.h"

struct MHD_Response;

enum { SRV_REPLY_HEADERS = 16, SRV_REPLY_VALUE = 1024, SRV_REPLY_DETAIL = 256 };

struct srv_reply {
    unsigned status;
    const char *mime; /* NULL = no body */
    const void *body;
    size_t size;
    void *owned;      /* freed with the reply; NULL = the body is constant */
    const void *gzip; /* a constant body, already compressed; NULL = compress on demand */
    size_t gzip_size;
    struct MHD_Response *chunked_body; /* replaces `body` (chunked_body.h); owned */
    struct {
        const char *name;
        char value[SRV_REPLY_VALUE];
    } headers[SRV_REPLY_HEADERS];
    unsigned header_count;
    char detail[SRV_REPLY_DETAIL]; /* text of a problem, truncated; "" = no problem, or logged
                                      already */
};

void srv_reply_finish(struct srv_reply *reply);

__attribute__((format(printf, 3, 4))) void
srv_reply_header(struct srv_reply *reply, const char *name, const char *format, ...);
/* Takes the malloc'ed text. */
void srv_reply_text(struct srv_reply *reply, unsigned status, const char *mime, char *text,
                    size_t size);
/* Frees the JSON; NULL becomes a 503 (out of memory). */
void srv_reply_json(struct srv_reply *reply, unsigned status, proto_json *json);
/* Replies with the JSON, which it frees, or with the error if it is NULL. */
void srv_reply_result(struct srv_reply *reply, proto_json *json, const struct sp_error *err);
void srv_reply_static(struct srv_reply *reply, const char *mime, const void *body, size_t size);

/* Replies with a problem document (RFC 9457). `pointer` may be NULL. The second function takes
 * pointer and text from the error, and the status from its code. */
__attribute__((format(printf, 4, 5))) void srv_reply_problem(struct srv_reply *reply,
                                                             unsigned status, const char *pointer,
                                                             const char *format, ...);
void srv_reply_error(struct srv_reply *reply, const struct sp_error *err);
/* The same for a refused view at the JSON pointer `at` of the body ("" = the whole body): the
 * pointer of the error is relative to it. An unknown volume gives 422, not 404, because the view
 * names it. */
void srv_reply_view_error(struct srv_reply *reply, const char *at, const struct sp_error *err);
unsigned srv_status_from(enum sp_code code);

#endif
