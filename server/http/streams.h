/* SPDX-License-Identifier: Apache-2.0
 *
 * The stream thread: all upgraded connections, one epoll. It alone reads and writes their sockets.
 */
#ifndef SRV_HTTP_STREAMS_H
#define SRV_HTTP_STREAMS_H

#include <stdbool.h>
#include <stddef.h>
#include <sys/socket.h>

#include "session/hub.h"

struct srv_streams;

struct srv_streams_options {
    struct srv_hub *hub;
    struct srv_metrics *metrics; /* NULL = nothing is counted */
    size_t message_bytes;
    double ping_ms, stall_ms;
    void *user;
    void (*tick)(void *user, double now_ms); /* about ten times a second; NULL = none */
};
struct srv_streams *srv_streams_create(const struct srv_streams_options *options,
                                       struct sp_error *err);
/* Closes what is left at once. */
void srv_streams_destroy(struct srv_streams **streams);

struct srv_stream_start {
    char session[SRV_SESSION_ID_BYTES];
    enum srv_role role;
    char token[SRV_TOKEN_NAME_BYTES]; /* of srv_hub_join() */
    int socket;                       /* non-blocking */
    const void *extra;                /* bytes that the client sent already; copied */
    size_t extra_size;
    struct sockaddr_storage peer;
    void *owner; /* released by close() when the stream thread is done with the socket */
    void (*close)(void *owner);
};
/* Hands a connection over. Any thread. False when out of memory: nothing was taken. */
bool srv_streams_add(struct srv_streams *streams, const struct srv_stream_start *start);

/* Some participant has something to send. Any thread; `user` is the streams object. */
void srv_streams_ready(void *streams);

/* Says good-bye to everybody with 1001; returns when all are gone, after 3 s at the latest. */
void srv_streams_drain(struct srv_streams *streams);

#endif
