/* SPDX-License-Identifier: Apache-2.0
 *
 * HTTP: accepts, checks, routes, answers.
 *
 *   accept ─► deadlines ─► token ─► route ─► body (counted) ─► handler ─► reply
 *                                                            └─ pending: suspended until
 *                                                               srv_request_complete()
 *
 * Handlers run on the library's threads and never render, encode or wait.
 */
#ifndef SRV_HTTP_LISTENER_H
#define SRV_HTTP_LISTENER_H

#include <microhttpd.h>
#include <stdint.h>

#include "config/config.h"
#include "config/tokens.h"
#include "http/deadlines.h"
#include "http/reply.h"
#include "http/router.h"
#include "http/smuggling.h"
#include "http/snapshot_memory.h"
#include "http/streams.h"
#include "paths/paths.h"
#include "render/render_pool.h"
#include "store/store.h"

struct srv_http_options {
    const struct srv_config *config;
    struct srv_hub *hub;
    struct srv_catalog *catalog;
    struct srv_render_pool *render_pool;
    struct srv_snapshot_memory *snapshot_memory;
    struct srv_tokens *tokens;
    struct srv_streams *streams;
    struct srv_store *store;
    struct srv_paths *paths;
    struct srv_metrics *metrics;
    const char *const
        *refusals; /* why other backends were refused at startup; owned by the caller */
    unsigned refusal_count;
    struct srv_fingerprint
        program; /* of the program: two runs with the same value render equal images */
};

struct srv_http;

/* Binds, listens and starts to answer. NULL with *err set: SP_ERR_IO with the address as its place
 * if that fails (port in use). */
struct srv_http *srv_http_create(const struct srv_http_options *options, struct sp_error *err);
/* Returns the address that it listens on, with the real port: "127.0.0.1:8080". */
const char *srv_http_address(const struct srv_http *http);
/* Reads tokens, certificate and key again, for new requests and connections. If a file cannot be
 * read, the old content stays, and the result is false. */
bool srv_http_reload(struct srv_http *http, struct sp_error *err);
/* From now on every new request is answered with 503 and its connection closes. */
void srv_http_close(struct srv_http *http);
/* After srv_http_close(): waits until all current requests are answered, at most `limit_ms`. */
void srv_http_drain(struct srv_http *http, double limit_ms);
/* Call after the render pool has stopped and all streams have ended. */
void srv_http_destroy(struct srv_http **http);
/* Closes connections past their deadline; for the timer thread. */
void srv_http_tick(void *http, double now_ms);

/* Returns the number of open connections, including streams. */
size_t srv_http_connections(struct srv_http *http);

/* For handlers. */

struct srv_request {
    struct srv_http *http;
    const struct srv_http_options *app;
    struct MHD_Connection *mhd;
    struct srv_connection *connection;
    const struct srv_route *route;
    const char *method, *path;
    char param[SRV_PARAM_BYTES]; /* the part of the path that matched {} */
    char *body;                  /* NUL-terminated; NULL = empty */
    size_t body_size;
    struct srv_grant grant;  /* rights of the token; 0 without a valid token of the daemon */
    bool has_snapshot;       /* a snapshot is being rendered for it */
    uint64_t snapshot_bytes; /* taken from app->snapshot_memory */
    struct srv_reply reply;
    void *upgrade; /* state of a stream's handshake; freed with the request */

    size_t body_max;  /* bytes of the body that are stored; the handler refuses a longer body. 0 =
                         --body-size */
    size_t body_seen; /* including bytes that were discarded */
    size_t body_capacity;
    struct srv_joined_header *joined; /* headers that came in several lines */
    struct srv_rejection target;      /* why the request target is refused */
    bool is_last;                     /* the connection closes after the answer */
    bool is_begun, is_refused, is_answered, is_dispatched, is_suspended, is_counted;
};

/* Returns a header, or NULL if the client did not send it. Several lines are joined to one list
 * (RFC 9110, 5.3). The text lives as long as the request. */
const char *srv_request_header(const struct srv_request *request, const char *name);
const char *srv_request_query(const struct srv_request *request, const char *key);
/* Returns the bearer token, or else that of ?token=; NULL = none. */
const char *srv_request_token(const struct srv_request *request);

/* Writes the name and the quota of the token; without a token the name is empty. */
void srv_request_owner(const struct srv_request *request, struct srv_owner *owner);

/* Parses the body, which must be a JSON object; an empty body is {}. NULL: the reply is a problem
 * document. */
proto_json *srv_request_json(const struct srv_request *request, struct srv_reply *reply);

/* A handler whose answer takes time calls suspend first, then starts the work. The thread that
 * finishes the work fills request->reply, touches nothing else, and calls complete once. */
void srv_request_suspend(struct srv_request *request);
void srv_request_complete(struct srv_request *request);
/* Replaces both, as the last call of a handler that has filled its reply: sends the answer once the
 * changes of the store are on disk. The header X-Durable is "no" if they are only in memory (no
 * --state, or a full disk). */
void srv_request_reply_when_durable(struct srv_request *request);
/* Reserves memory (snapshot_memory.h) and quota (tokens.h) for a snapshot, until
 * srv_request_end_snapshot() or the end of the request. False: *err names the limit or quota that
 * is exceeded. */
bool srv_request_begin_snapshot(struct srv_request *request, uint64_t bytes, struct sp_error *err);
void srv_request_end_snapshot(struct srv_request *request);
/* Returns both for a snapshot that was refused, which does not count towards the fps quota. */
void srv_request_cancel_snapshot(struct srv_request *request);
/* Call after an upgrade: the connection is a stream from now on, and no longer a request. */
void srv_request_upgraded(struct srv_request *request);

/* Handlers, by file. */
typedef void srv_handler(struct srv_request *request, struct srv_reply *reply);
srv_handler srv_get_volumes, srv_get_volume, srv_post_volume, srv_delete_volume,
    srv_get_volume_view;                                                 /* routes_volumes.c */
srv_handler srv_post_render, srv_get_render;                             /* routes_render.c */
srv_handler srv_get_views, srv_post_view, srv_get_view, srv_delete_view; /* routes_views.c */
srv_handler srv_get_sessions, srv_post_session, srv_get_session, srv_patch_session,
    srv_delete_session, srv_get_stream; /* routes_sessions.c */
/* Checks the token for a route that needs SRV_RIGHT_SESSION, before the body is read. False: the
 * reply is a problem document. */
bool srv_session_admits(struct srv_request *request, struct srv_reply *reply);
srv_handler srv_get_presets, srv_get_preset, srv_put_preset,
    srv_delete_preset; /* routes_presets.c */
srv_handler srv_get_paths, srv_post_path, srv_get_path, srv_delete_path, srv_get_path_events,
    srv_get_path_frame, srv_get_path_archive, srv_get_path_movie; /* routes_paths.c */
srv_handler srv_get_metrics;                                      /* routes_metrics.c */
srv_handler srv_get_healthz, srv_get_readyz, srv_get_contract;    /* routes_static.c */
/* Serves a file of the web page; false if there is none at this path. */
bool srv_get_asset(struct srv_request *request, struct srv_reply *reply);

#endif
