/* SPDX-License-Identifier: Apache-2.0
 *
 * TLS in front of the HTTP library, whose own TLS breaks upgraded connections. The HTTP side of a
 * connection looks as without TLS:
 *
 *   client ◄──TCP──► GnuTLS ◄── 16 KiB up, 16 KiB down ──► one end │ other end ──► give()
 *                                                            └── socket pair ──┘
 *
 *   acceptor   accepted ──► handshake ──► failed, or plain HTTP ──► lingers ──► closed
 *                              │
 *   relay                      └──► open ──► lingers ──► closed
 *
 * There are two threads, because a handshake costs about a hundred times as much processor time as
 * relaying a buffer, and any client can start one. The acceptor does all handshakes as a background
 * thread. A flood of handshakes takes only the processor time of a background thread; no byte of an
 * open connection waits for it.
 *
 * Limits: a connection costs two buffers and the GnuTLS session; a handshake has a deadline; if
 * there are too many handshakes, the oldest one ends, so that slow clients do not lock others out.
 * The newest connection is closed at once beyond connections_max, beyond accepted_from() or
 * handshakes_per_s of its host, and without file descriptors.
 *
 * Back-pressure passes through: a side is read only while the other side takes data. The end of one
 * side is passed on after the bytes before it. An open connection has the time limits of its HTTP
 * side; once that side is closed, the limit is linger_ms.
 */
#ifndef SRV_HTTP_TLS_H
#define SRV_HTTP_TLS_H

#include <stdbool.h>
#include <sys/socket.h>

#include "http/tls_keys.h"
#include "ops/metrics.h"
#include "sp/status.h"

struct srv_tls;

struct srv_tls_options {
    struct srv_tls_keys *keys;   /* owned by the acceptor on success */
    int socket;                  /* non-blocking listening socket; closed by srv_tls_destroy() */
    double handshake_ms;         /* time limit of a handshake */
    double linger_ms;            /* time for a client to read the rest after the HTTP side closed */
    unsigned handshakes_max;     /* at a time */
    double handshakes_per_s;     /* from one host (connection_limits.h); 0 = no limit */
    bool spares_loopback;        /* no limit for loopback addresses */
    unsigned connections_max;    /* at a time, including handshakes and lingering connections */
    struct srv_metrics *metrics; /* not owned; NULL = refusals are not counted */
    void *user;
    /* Returns how many connections one host may have at a time, counted as for connections_max;
     * NULL = no limit. Called on the acceptor. */
    unsigned (*accepted_from)(void *user, const struct sockaddr *host);
    /* Takes ownership of the HTTP side of the socket pair, also on failure. False: the connection
     * ends. Called on the relay. */
    bool (*give)(void *user, int socket, const struct sockaddr *peer, socklen_t size);
};

/* Starts to accept connections. NULL with *err set. */
struct srv_tls *srv_tls_create(const struct srv_tls_options *options, struct sp_error *err);
/* Takes ownership of the keys, for new connections. Any thread. */
void srv_tls_set_keys(struct srv_tls *tls, struct srv_tls_keys *keys);
/* Stops accepting and ends handshakes. give() is not called after it returns. */
void srv_tls_close(struct srv_tls *tls);
/* Call after all HTTP sides are closed. Waits up to two seconds for clients to read the rest. */
void srv_tls_destroy(struct srv_tls **tls);

#endif
