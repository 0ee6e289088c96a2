/* SPDX-License-Identifier: Apache-2.0
 *
 * State that the TLS acceptor and the TLS relay share (tls.h). A connection belongs to the acceptor
 * until it is handed over, and to the relay from then on. Only its owner touches it. The acceptor
 * counts and frees all connections: the relay sets `is_over` when it is done with one.
 */
#ifndef SRV_HTTP_TLS_PRIVATE_H
#define SRV_HTTP_TLS_PRIVATE_H

#include <gnutls/gnutls.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdint.h>

#include "http/address.h"
#include "http/connection_limits.h"
#include "http/tls.h"

enum {
    SRV_TLS_BUFFER_BYTES = 16384, /* the largest record, so that no bytes stay buffered in GnuTLS */
    SRV_TLS_EVENTS = 64           /* per epoll_wait() */
};
#define SRV_TLS_TICK_MS 100.0

enum srv_tls_state { SRV_TLS_HANDSHAKE, SRV_TLS_OPEN, SRV_TLS_LINGERS, SRV_TLS_DEAD };
enum { SRV_TLS_CLIENT, SRV_TLS_SERVER, SRV_TLS_SIDES };

struct srv_tls_side { /* one socket in epoll */
    struct srv_tls_connection *connection;
    int fd;
    uint32_t events; /* 0 = not in epoll, which would report a hang-up again and again */
};

struct srv_tls_half { /* one direction of the bytes */
    size_t at, size;
    bool is_retry; /* GnuTLS must be called again with the same bytes */
    bool is_ended; /* the source has no more bytes */
    bool is_done;  /* and the end was passed on */
    uint8_t bytes[SRV_TLS_BUFFER_BYTES];
};

struct srv_tls_connection {
    /* Owned by the acceptor, also after the handover. */
    struct srv_tls_connection *next;
    bool is_handed_over;
    atomic_bool is_over;             /* the relay will not touch it again */
    struct sockaddr_storage address; /* this and the following members are constant */
    socklen_t address_size;
    char peer[SRV_ADDRESS_TEXT];
    struct srv_tls_keys *keys; /* the keys of its session */
    /* Owned by the thread that owns the connection. */
    struct srv_tls_connection *next_relayed; /* in `arrivals`, then in `relayed` */
    enum srv_tls_state state;
    int epoll; /* of the owning thread */
    struct srv_tls_side sides[SRV_TLS_SIDES];
    gnutls_session_t session;     /* NULL = not started, or the client sent plain HTTP */
    double deadline_ms;           /* 0 = none */
    struct srv_tls_half up, down; /* to the server, to the client */
};

struct srv_tls_thread {
    pthread_t id;
    int epoll, wake;
    bool is_there;    /* the thread was started */
    atomic_bool stop; /* the thread must end */
};

struct srv_tls {
    struct srv_tls_options options; /* `keys` is guarded by mutex */
    struct srv_tls_thread acceptor, relay;
    pthread_mutex_t mutex;
    struct srv_tls_connection *arrivals; /* to be taken by the relay; guarded by mutex */
    bool is_closed;                      /* give() is no longer called; guarded by mutex */
    /* Owned by the acceptor. */
    struct srv_tls_connection *list; /* all connections, newest first */
    struct srv_host_rate rate;
    int spare; /* reserved descriptor, to refuse connections when none are left; -1 = none */
    bool is_listening;
    /* Owned by the relay. */
    struct srv_tls_connection *relayed;
};

void *srv_tls_acceptor_main(void *tls);
void *srv_tls_relay_main(void *tls);

/* Wakes a thread from epoll_wait(). Any thread. */
void srv_tls_wake(struct srv_tls_thread *thread);
/* Resets the wake-up; for the thread itself. */
void srv_tls_woken(struct srv_tls_thread *thread);

/* For the thread that owns the connection. */

/* Sets the events to watch on one side; 0 = none. */
void srv_tls_watch(struct srv_tls_connection *c, int which, uint32_t events);
/* Ends sending to the client and waits up to LINGER_MS for it to close its side: a reset could
 * destroy bytes that it has not read yet. */
void srv_tls_linger(struct srv_tls_connection *c, double now_ms);
/* Reads and discards bytes of a lingering connection. */
void srv_tls_discard(struct srv_tls_connection *c);
/* Ends the TLS session and closes both sockets. */
void srv_tls_end(struct srv_tls_connection *c);

/* True if the errno means: wait and try again. */
bool srv_tls_is_again(int error);

#endif
