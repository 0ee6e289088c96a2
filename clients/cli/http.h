/* SPDX-License-Identifier: Apache-2.0
 *
 * Requests to one daemon. The only file of the client that knows libcurl is http.c.
 */
#ifndef CLI_HTTP_H
#define CLI_HTTP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "protocol/json.h"
#include "sp/status.h"

struct http;

/* `url` is the address that the daemon prints: http://HOST:PORT/PREFIX?token=TOKEN; prefix and
 * token are optional. NULL = $SPLATD_URL, else http://127.0.0.1:8080. `token` NULL = the token of
 * the URL, else $SPLATD_TOKEN, else none. Returns NULL with *err set on failure. */
struct http *http_create(const char *url, const char *token, unsigned timeout_s,
                         struct sp_error *err);
void http_destroy(struct http **http);
/* Sets a callback: requests end with SP_ERR_CANCELLED soon after stop(user) returns true. */
void http_set_stop(struct http *http, bool (*stop)(void *user), void *user);
/* Returns the daemon's address without token and trailing slash; valid as long as `http`. */
const char *http_base(const struct http *http);

struct http_response {
    long status;
    char *body; /* NUL-terminated */
    size_t size, capacity;
    char type[96];                     /* Content-Type, without parameters */
    char complete[8];                  /* X-Complete; "" = not sent */
    char level[8], asked[8];           /* X-Level, X-Level-Asked */
    char lost[24];                     /* X-Bricks-Lost */
    char retry_after[8];               /* Retry-After, in seconds; "" = not sent */
    char backend[64], render_time[32]; /* X-Backend, X-Render-Time; "" = not sent */
    char splats[32];
    char pointer[SP_ERROR_PLACE]; /* JSON pointer of the problem document; "" = none */
};

/* Sends one request below /api/v1. `path` begins with "/"; `body` is JSON or NULL. True for a
 * status below 400. Otherwise *err holds the daemon's error, with the JSON pointer of its problem
 * document or "METHOD path" as the place; SP_ERR_IO means no answer or an incomplete one. In both
 * cases the caller calls http_response_finish(). */
bool http_request(struct http *http, const char *method, const char *path, const char *accept,
                  const char *body, struct http_response *response, struct sp_error *err);
void http_response_finish(struct http_response *response);

/* Like http_request() with GET, but passes the bytes of an answer below status 400 to add() as they
 * arrive. The request fails if add() returns false. */
bool http_fetch(struct http *http, const char *path, const char *accept,
                bool (*add)(void *user, const void *bytes, size_t size), void *user,
                struct http_response *response, struct sp_error *err);

/* Sends `size` bytes of an upload (tus), from `offset` on, with PATCH. read() fills a buffer and
 * returns how many bytes it wrote; 0 ends the request with SP_ERR_INVALID. */
bool http_send(struct http *http, const char *path, int64_t offset, int64_t size,
               size_t (*read)(void *user, void *bytes, size_t size), void *user,
               struct http_response *response, struct sp_error *err);

/* Like http_request() for an answer in JSON; NULL with *err set on failure. */
proto_json *http_json(struct http *http, const char *method, const char *path, const char *body,
                      struct sp_error *err);

/* Posts a document and frees it; body NULL = memory ran out. In an error about the member at the
 * JSON pointer `member`, the place becomes `name`, the word that the user knows. member NULL = no
 * place is renamed. Returns the answer; NULL with *err set on failure. */
proto_json *http_post(struct http *http, const char *path, proto_json *body, const char *member,
                      const char *name, struct sp_error *err);

/* Returns `text` escaped for a path segment or a query value, allocated; NULL when out of memory.
 */
char *http_escape(struct http *http, const char *text);

#endif
