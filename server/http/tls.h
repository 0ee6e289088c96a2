/* SPDX-License-Identifier: Apache-2.0
 *
 * TLS in front of the HTTP library, whose own breaks upgraded connections. Behind it everything is
 * as it is without TLS:
 *
 *   client ◄──TCP──► GnuTLS ◄── 16 KiB up, 16 KiB down ──► one end │ other end ──► give()
 *                                                            └──────┘ socket pair
 *
 *   the acceptor      accepted ──► handshake ──► failed, plain HTTP ──► lingers ──► closed
 *                                │
 *   the relay                  └──► open ──► lingers ──► closed
 *
 * Two threads, since a handshake costs a hundred times what it costs to carry a picture's buffer,
 * and whoever likes may begin one: the acceptor is nice, one for all handshakes, which take turns.
 * So who floods it takes a share of the processor that a nice thread gets, and from open
 * connections nothing else: none of their bytes waits for a handshake.
 *
 * Bounded: a connection costs two buffers and GnuTLS's session; a handshake has a deadline; of too
 * many handshakes the oldest ends, so that clients which dawdle keep nobody out; beyond
 * connections_max, for one host beyond accepted_from() or handshakes_per_s, and without descriptors
 * the newest is closed at once.
 * Back-pressure goes through: a side is read only while the other takes it. An end of either side
 * is passed on after the bytes before it; the time limits of an open connection are those of
 * whoever has the other end, and once that end is closed, linger_ms.
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
    struct srv_tls_keys *keys; /* taken over on success */
    int socket;                /* listens, does not block; closed by srv_tls_destroy() */
    double handshake_ms;       /* longest */
    double linger_ms;          /* longest for a client to read the rest, once give()'s end closed */
    unsigned handshakes_max;   /* at a time */
    double handshakes_per_s;   /* from one host (host_rate.h); 0 = any number */
    bool spares_loopback;      /* from this machine's own: any number, too */
    unsigned connections_max;  /* at a time, handshakes and those that linger too */
    struct srv_metrics *metrics; /* not owned; NULL = what is refused is not counted */
    void *user;
    /* Connections that one host may have at a time, as connections_max; NULL = any number. On the
     * acceptor. */
    unsigned (*accepted_from)(void *user, const struct sockaddr *host);
    /* Takes the other end over, also when false: then the connection ends. On the relay. */
    bool (*give)(void *user, int socket, const struct sockaddr *peer, socklen_t size);
};

/* Accepts from then on. NULL with *err set. */
struct srv_tls *srv_tls_create(const struct srv_tls_options *options, struct sp_error *err);
/* New connections get these; takes them over. Any thread. */
void srv_tls_set_keys(struct srv_tls *tls, struct srv_tls_keys *keys);
/* Ends accepting and handshakes; once it returns, give() is not called any more. */
void srv_tls_close(struct srv_tls *tls);
/* After all ends that were given are closed: clients get what is left, within two seconds. */
void srv_tls_destroy(struct srv_tls **tls);

#endif
