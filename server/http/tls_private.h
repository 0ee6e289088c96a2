/* SPDX-License-Identifier: Apache-2.0
 *
 * What the two threads of the TLS acceptor share (tls.h). A connection belongs to the acceptor
 * until it is handed over, and from then on to the relay; who has it alone touches it. The acceptor
 * counts and frees all of them: the relay says by `is_over` that it is done with one.
 */
#ifndef SRV_HTTP_TLS_PRIVATE_H
#define SRV_HTTP_TLS_PRIVATE_H

#include <gnutls/gnutls.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdint.h>

#include "http/address.h"
#include "http/host_rate.h"
#include "http/tls.h"

enum {
    SRV_TLS_BUFFER_BYTES = 16384, /* the largest record: nothing stays behind in GnuTLS */
    SRV_TLS_EVENTS = 64           /* of one epoll_wait() */
};
#define SRV_TLS_TICK_MS 100.0

enum srv_tls_state { SRV_TLS_HANDSHAKE, SRV_TLS_OPEN, SRV_TLS_LINGERS, SRV_TLS_DEAD };
enum { SRV_TLS_CLIENT, SRV_TLS_SERVER, SRV_TLS_SIDES };

struct srv_tls_side { /* what epoll knows of one socket */
    struct srv_tls_connection *connection;
    int fd;
    uint32_t events; /* 0 = epoll has it not: it would tell of hang-ups for ever */
};

struct srv_tls_half { /* one direction */
    size_t at, size;
    bool is_retry; /* GnuTLS wants to go on with what it was handed */
    bool is_ended; /* the source has no more */
    bool is_done;  /* and the sink was told */
    uint8_t bytes[SRV_TLS_BUFFER_BYTES];
};

struct srv_tls_connection {
    /* The acceptor's, all the time. */
    struct srv_tls_connection *next;
    bool is_handed_over;
    atomic_bool is_over;             /* the relay will not touch it again */
    struct sockaddr_storage address; /* constant, as is what follows */
    socklen_t address_size;
    char peer[SRV_ADDRESS_TEXT];
    struct srv_tls_keys *keys; /* its session's */
    /* Of the one who has it. */
    struct srv_tls_connection *next_relayed; /* in `arrivals`, then in `relayed` */
    enum srv_tls_state state;
    int epoll; /* of the one who has it */
    struct srv_tls_side sides[SRV_TLS_SIDES];
    gnutls_session_t session;     /* NULL = told in plain text that TLS is spoken here */
    double deadline_ms;           /* 0 = none */
    struct srv_tls_half up, down; /* to the server, to the client */
};

struct srv_tls_thread {
    pthread_t id;
    int epoll, wake;
    bool is_there;    /* for whoever ends it */
    atomic_bool stop; /* it is to end */
};

struct srv_tls {
    struct srv_tls_options options; /* its keys are guarded by mutex */
    struct srv_tls_thread acceptor, relay;
    pthread_mutex_t mutex;
    struct srv_tls_connection *arrivals; /* on their way to the relay; guarded by mutex */
    bool is_closed;                      /* give() is not called any more; guarded by mutex */
    /* The acceptor's. */
    struct srv_tls_connection *list; /* all there are, newest first */
    struct srv_host_rate rate;
    int spare; /* a descriptor to refuse with when there are no others */
    bool is_listening;
    /* The relay's. */
    struct srv_tls_connection *relayed;
};

void *srv_tls_acceptor_main(void *tls);
void *srv_tls_relay_main(void *tls);

/* Tells a thread that there is something to look at. Any thread. */
void srv_tls_wake(struct srv_tls_thread *thread);
/* For the thread itself: takes what woke it. */
void srv_tls_woken(struct srv_tls_thread *thread);

/* For the one who has the connection. */

/* 0 = nothing is wanted of that side. */
void srv_tls_watch(struct srv_tls_connection *c, int which, uint32_t events);
/* No more bytes to the client; it has a while to close its side, too: a reset could take away what
 * it has not read yet. */
void srv_tls_linger(struct srv_tls_connection *c, double now_ms);
/* Reads what a client says that lingers. */
void srv_tls_discard(struct srv_tls_connection *c);
/* Ends its session and closes its sockets. */
void srv_tls_end(struct srv_tls_connection *c);

/* "Wait, and try again": as an errno. */
bool srv_tls_is_again(int error);

#endif
