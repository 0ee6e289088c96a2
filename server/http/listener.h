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

#include <stddef.h>

#include "render/fingerprint.h"
#include "sp/status.h"

struct srv_config;
struct srv_hub;
struct srv_catalog;
struct srv_render_pool;
struct srv_frame_memory;
struct srv_tokens;
struct srv_streams;
struct srv_store;
struct srv_paths;
struct srv_work_queue;
struct srv_uploads;
struct srv_metrics;

struct srv_http_options {
    const struct srv_config *config;
    struct srv_hub *hub;
    struct srv_catalog *catalog;
    struct srv_brick_cache *cache; /* NULL = there is none */
    struct srv_render_pool *render_pool;
    const struct srv_frame_memory *frame_memory;
    struct srv_tokens *tokens;
    struct srv_streams *streams;
    struct srv_store *store;
    struct srv_paths *paths;
    struct srv_work_queue *disk;      /* for work that waits for a disk */
    struct srv_work_queue *measuring; /* for measurements of parts and paths */
    struct srv_work_queue *sampling;  /* for other measurements that read samples */
    struct srv_work_queue *listing;   /* for lists of the series of a folder */
    struct srv_work_queue *searching; /* for searches of the data folder */
    struct srv_uploads *uploads;      /* NULL = there are none */
    struct srv_metrics *metrics;
    /* Why other backends were refused at startup; owned by the caller. */
    const char *const *refusals;
    unsigned refusal_count;
    /* Identifies the program: two runs with the same value render equal images. */
    struct srv_fingerprint program;
};

struct srv_http;

/* Binds, listens and starts to answer. NULL with *err set: SP_ERR_IO with the address as its place
 * if that fails (port in use). */
struct srv_http *srv_http_create(const struct srv_http_options *options, struct sp_error *err);
/* Returns the address that it listens on, with the real port: "127.0.0.1:8080"; "" = none. */
const char *srv_http_address(const struct srv_http *http);
/* Returns the path of the Unix socket; "" = none. */
const char *srv_http_unix_path(const struct srv_http *http);
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

#endif
