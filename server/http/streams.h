/* SPDX-License-Identifier: Apache-2.0
 *
 * The stream thread: all upgraded connections, one epoll. It alone reads and writes their sockets.
 * It has no clock of its own: the timer thread calls srv_streams_tick().
 */
#ifndef SRV_HTTP_STREAMS_H
#define SRV_HTTP_STREAMS_H

#include <stdbool.h>
#include <stddef.h>
#include <sys/socket.h>

#include "session/participant.h"

#define SRV_STREAMS_TICK_MS 100.0

struct srv_streams;

struct srv_streams_options {
    struct srv_hub *hub;
    struct srv_metrics *metrics; /* NULL = nothing is counted */
    size_t message_bytes;
    double ping_ms, stall_ms;
};
struct srv_streams *srv_streams_create(const struct srv_streams_options *options,
                                       struct sp_error *err);
/* Closes the remaining streams at once. */
void srv_streams_destroy(struct srv_streams **streams);

struct srv_stream_start {
    char session[SRV_SESSION_ID_BYTES];
    enum srv_role role;
    char token[SRV_TOKEN_NAME_BYTES]; /* of srv_hub_join() */
    int socket;                       /* non-blocking */
    const void *extra;                /* bytes that arrived with the handshake; copied */
    size_t extra_size;
    struct sockaddr_storage peer;
    void *owner; /* released by close() when the stream thread is done with the socket */
    void (*close)(void *owner);
};
/* Hands a connection over to the stream thread. Any thread. False when out of memory: the caller
 * still owns it. */
bool srv_streams_add(struct srv_streams *streams, const struct srv_stream_start *start);

/* Wakes the stream thread: a participant has something to send. Any thread. */
void srv_streams_ready(void *streams);

/* Makes the stream thread check pings, time limits and ingress quotas of its streams. Call it about
 * every SRV_STREAMS_TICK_MS; calls that arrive before the thread has handled the last one count
 * once. Any thread. */
void srv_streams_tick(struct srv_streams *streams);
/* Returns when the stream thread last finished such a check, in ms of srv_clock_ms(). Any thread.
 */
double srv_streams_alive_ms(const struct srv_streams *streams);

/* Closes all streams with 1001. Returns when all are gone, after 3 s at the latest. */
void srv_streams_drain(struct srv_streams *streams);

#endif
