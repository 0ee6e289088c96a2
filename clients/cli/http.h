/* SPDX-License-Identifier: Apache-2.0
 *
 * Requests to one daemon. The only file of the client that knows libcurl is http.c.
 */
#ifndef CLI_HTTP_H
#define CLI_HTTP_H

#include <stdbool.h>
#include <stddef.h>

#include "protocol/json.h"
#include "sp/status.h"

struct http;

/* `url` is a daemon's address, as it prints it: http://HOST:PORT/PREFIX?token=TOKEN, where path and
 * token may be missing; NULL = $SPLATD_URL, else http://127.0.0.1:8080. `token` NULL = that of the
 * URL, else $SPLATD_TOKEN, else none. NULL with *err set. */
struct http *http_create(const char *url, const char *token, unsigned timeout_s,
                         struct sp_error *err);
void http_destroy(struct http **http);
/* From now on a request ends with SP_ERR_CANCELLED soon after stop(user) is true. */
void http_set_stop(struct http *http, bool (*stop)(void *user), void *user);
/* The daemon's address without a token and a slash at its end; lives as long. */
const char *http_base(const struct http *http);

struct http_response {
    long status;
    char *body; /* NUL-terminated */
    size_t size, capacity;
    char type[96];                     /* Content-Type, without parameters */
    char backend[64], render_time[32]; /* X-Backend, X-Render-Time; "" = not sent */
    char splats[32];
};

/* One request below /api/v1; `path` begins with "/". `body` (may be NULL) is JSON. True for any
 * status below 400; otherwise *err tells what the daemon said: the pointer of its problem, else
 * "METHOD path", as place; SP_ERR_IO: there was no
 * answer, or not all of it. The caller frees the response either way, with http_response_finish().
 */
bool http_request(struct http *http, const char *method, const char *path, const char *accept,
                  const char *body, struct http_response *response, struct sp_error *err);
void http_response_finish(struct http_response *response);

/* The same, a GET whose bytes, if its status is below 400, go to add() as they come, and not into
 * the response. When add() returns false the request ends, with an error. */
bool http_fetch(struct http *http, const char *path, const char *accept,
                bool (*add)(void *user, const void *bytes, size_t size), void *user,
                struct http_response *response, struct sp_error *err);

/* The same for an answer in JSON; NULL with *err set. */
proto_json *http_json(struct http *http, const char *method, const char *path, const char *body,
                      struct sp_error *err);

/* `text` escaped for one segment of a path or one value of a query; free(). NULL = no memory. */
char *http_escape(struct http *http, const char *text);

#endif
