/* SPDX-License-Identifier: Apache-2.0
 *
 * Refuses requests that two programs could read differently. Behind a reverse proxy such a
 * difference lets a client smuggle a request past the proxy (RFC 9112, sections 6.3 and 11.2).
 */
#ifndef SRV_HTTP_SMUGGLING_H
#define SRV_HTTP_SMUGGLING_H

#include <stdbool.h>
#include <stddef.h>

enum {
    SRV_QUERY_AMPERSANDS_MAX = 16, /* '&' characters in a query */
    SRV_HEADERS_MAX = 128          /* of a request */
};

struct srv_rejection {
    unsigned status;    /* 0 = none */
    const char *detail; /* constant */
};

/* Checks the target of a request line before it is decoded; it may have `limit` bytes. Erases a
 * query with too many parameters: the HTTP library would fill its memory with them and have none
 * left for the answer. */
struct srv_rejection srv_smuggling_check_target(char *target, size_t limit);

/* What the headers say about where the request ends. */
struct srv_smuggling {
    unsigned all, hosts, lengths, encodings;
    bool is_not_number, is_not_chunked, is_not_name, is_not_text;
    const char
        *next;    /* where the next header begins in the memory of the library; NULL = unknown */
    bool is_torn; /* there were bytes between headers that belong to none */
};
/* The library cuts a head into texts where it lies: it puts NUL over each CR and LF, and joins
 * lines that continue others elsewhere. So what it dropped shows in the gaps: a NUL, and what
 * follows it up to the end of the line; a continued line; a line that ends with CR or LF alone.
 * Begins with the request line: its method, its target, which had `target_size` bytes up to the
 * first NUL, and its version. */
void srv_smuggling_begin(struct srv_smuggling *smuggling, const char *method, size_t target_size,
                         const char *version);
/* Ends with the end of the head, behind the empty line. */
void srv_smuggling_end(struct srv_smuggling *smuggling, const char *end);
/* Adds a header; `value` NULL = empty. */
void srv_smuggling_add_header(struct srv_smuggling *smuggling, const char *name, const char *value);
/* Checks all headers. `version` is "HTTP/1.1" or "HTTP/1.0". */
struct srv_rejection srv_smuggling_check_headers(const struct srv_smuggling *smuggling,
                                                 const char *version);

#endif
