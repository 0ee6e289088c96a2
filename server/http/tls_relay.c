/* SPDX-License-Identifier: Apache-2.0
 *
 * The TLS relay: moves the bytes of open connections between the client and the HTTP side of the
 * socket pair. The work per event is bounded, whatever a client does.
 */
#include <errno.h>
#include <poll.h>
#include <string.h>
#include <sys/epoll.h>
#include <unistd.h>

#include "common/clock.h"
#include "http/connection_limits.h"
#include "http/tls_private.h"
#include "sp/log.h"

enum {
    BUFFERS =
        8, /* buffers per event and direction, so that one client does not occupy the thread */
    PAIR_BYTES = 64 * 1024 /* buffered in the socket pair, where no newer frame can replace them */
};
#define STOP_MS 2000.0

/* Moves bytes in one direction. Each function returns false when it must wait. */

static bool fill_up(struct srv_tls_connection *c) {
    ssize_t got = gnutls_record_recv(c->session, c->up.bytes, SRV_TLS_BUFFER_BYTES);
    if (got > 0) {
        c->up.at = 0;
        c->up.size = (size_t)got;
        return true;
    }
    if (got == GNUTLS_E_AGAIN || got == GNUTLS_E_INTERRUPTED)
        return false;
    if (got == 0) {
        c->up.is_ended = true;
        return true;
    }
    /* A warning alert needs no reaction. Renegotiation is refused. */
    if (!gnutls_error_is_fatal((int)got) && got != GNUTLS_E_REHANDSHAKE)
        return true;
    bool is_cut = got == GNUTLS_E_PREMATURE_TERMINATION || got == GNUTLS_E_PULL_ERROR;
    sp_log(is_cut ? SP_LOG_DEBUG : SP_LOG_INFO, "TLS connection of %s ended: %s", c->peer,
           gnutls_strerror((int)got));
    c->state = SRV_TLS_DEAD;
    return false;
}

static bool drain_up(struct srv_tls_connection *c) {
    struct srv_tls_half *up = &c->up;
    ssize_t sent =
        send(c->sides[SRV_TLS_SERVER].fd, up->bytes + up->at, up->size - up->at, MSG_NOSIGNAL);
    if (sent < 0 && srv_tls_is_again(errno))
        return false;
    if (sent < 0) { /* the HTTP side is closed: discard the bytes */
        up->at = up->size = 0;
        return true;
    }
    up->at += (size_t)sent;
    return true;
}

static bool fill_down(struct srv_tls_connection *c) {
    ssize_t got = recv(c->sides[SRV_TLS_SERVER].fd, c->down.bytes, SRV_TLS_BUFFER_BYTES, 0);
    if (got < 0 && srv_tls_is_again(errno))
        return false;
    c->down.at = 0;
    c->down.size = got > 0 ? (size_t)got : 0;
    c->down.is_ended = got <= 0;
    return true;
}

static bool drain_down(struct srv_tls_connection *c) {
    struct srv_tls_half *down = &c->down;
    ssize_t sent = down->is_retry ? gnutls_record_send(c->session, NULL, 0)
                                  : gnutls_record_send(c->session, down->bytes + down->at,
                                                       down->size - down->at);
    down->is_retry = sent == GNUTLS_E_AGAIN || sent == GNUTLS_E_INTERRUPTED;
    if (down->is_retry)
        return false;
    if (sent < 0) {
        c->state = SRV_TLS_DEAD;
        return false;
    }
    down->at += (size_t)sent;
    return true;
}

/* Never returns with bytes that the HTTP side could take, because no event would continue the
 * transfer. */
static void pump_up(struct srv_tls_connection *c) {
    struct srv_tls_half *up = &c->up;
    for (int turns = BUFFERS;; turns--) {
        while (up->at < up->size)
            if (!drain_up(c))
                return;
        if (up->is_ended && !up->is_done) {
            shutdown(c->sides[SRV_TLS_SERVER].fd, SHUT_WR);
            up->is_done = true;
        }
        if (up->is_done || turns == 0 || !fill_up(c))
            return;
    }
}

static void pump_down(struct srv_tls *tls, struct srv_tls_connection *c, double now_ms) {
    struct srv_tls_half *down = &c->down;
    for (int turns = BUFFERS; !down->is_ended; turns--) {
        while (down->at < down->size)
            if (!drain_down(c))
                return;
        if (turns == 0 || !fill_down(c))
            return;
    }
    if (c->deadline_ms == 0)
        c->deadline_ms = now_ms + tls->options.linger_ms;
    int code = gnutls_bye(c->session, GNUTLS_SHUT_WR);
    down->is_retry = code == GNUTLS_E_AGAIN || code == GNUTLS_E_INTERRUPTED;
    if (!down->is_retry)
        srv_tls_linger(c, now_ms);
}

static void watch_open(struct srv_tls_connection *c) {
    bool up_waits = c->up.at < c->up.size, down_waits = c->down.at < c->down.size;
    bool is_reading = !up_waits && !c->up.is_ended;
    srv_tls_watch(c, SRV_TLS_CLIENT,
                  (is_reading ? EPOLLIN : 0) | (c->down.is_retry ? EPOLLOUT : 0));
    srv_tls_watch(c, SRV_TLS_SERVER,
                  (!down_waits && !c->down.is_ended ? EPOLLIN : 0) | (up_waits ? EPOLLOUT : 0));
}

static void pump(struct srv_tls *tls, struct srv_tls_connection *c, double now_ms) {
    pump_up(c);
    if (c->state == SRV_TLS_OPEN)
        pump_down(tls, c, now_ms);
    if (c->state == SRV_TLS_OPEN)
        watch_open(c);
}

/* Start and end of connections. */

static void open_pair(struct srv_tls *tls, struct srv_tls_connection *c) {
    int pair[2], bytes = PAIR_BYTES;
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0, pair) != 0) {
        srv_connection_refused(tls->options.metrics, SRV_REFUSED_FULL,
                               "TLS connection of %s refused: no socket pair: %s", c->peer,
                               strerror(errno));
        c->state = SRV_TLS_DEAD;
        return;
    }
    setsockopt(pair[1], SOL_SOCKET, SO_SNDBUF, &bytes, sizeof bytes);
    c->sides[SRV_TLS_SERVER].fd = pair[0];
    c->state = SRV_TLS_OPEN;
    if (!tls->options.give(tls->options.user, pair[1], (const struct sockaddr *)&c->address,
                           c->address_size)) {
        srv_connection_refused(
            tls->options.metrics, SRV_REFUSED_FULL,
            "TLS connection of %s refused: the HTTP threads take no more connections", c->peer);
        c->state = SRV_TLS_DEAD;
    }
}

/* Takes over connections from the acceptor. Pumps each at once, because bytes may already wait in
 * GnuTLS. */
static void adopt_arrivals(struct srv_tls *tls, double now_ms) {
    srv_tls_woken(&tls->relay);
    pthread_mutex_lock(&tls->mutex); /* held during give(), so that srv_tls_close() waits for it */
    struct srv_tls_connection *list = tls->arrivals;
    tls->arrivals = NULL;
    for (struct srv_tls_connection *c = list; c; c = c->next_relayed) {
        if (tls->is_closed)
            c->state = SRV_TLS_DEAD;
        else
            open_pair(tls, c);
    }
    pthread_mutex_unlock(&tls->mutex);
    while (list) {
        struct srv_tls_connection *c = list;
        list = c->next_relayed;
        c->next_relayed = tls->relayed;
        tls->relayed = c;
        if (c->state == SRV_TLS_OPEN)
            pump(tls, c, now_ms);
    }
}

/* Ends dead connections. The acceptor counts and frees them. */
static void reap(struct srv_tls *tls) {
    for (struct srv_tls_connection **link = &tls->relayed; *link;) {
        struct srv_tls_connection *c = *link;
        if (c->state != SRV_TLS_DEAD) {
            link = &c->next_relayed;
            continue;
        }
        *link = c->next_relayed;
        srv_tls_end(c);
        atomic_store(&c->is_over, true);
    }
}

/* Starts the deadline when the HTTP side has closed. Epoll does not watch that side while bytes
 * wait for the client. */
static void check_http_side(struct srv_tls *tls, struct srv_tls_connection *c, double now_ms) {
    struct pollfd look = { .fd = c->sides[SRV_TLS_SERVER].fd, .events = POLLRDHUP };
    if (c->state == SRV_TLS_OPEN && c->deadline_ms == 0 && c->down.at < c->down.size &&
        poll(&look, 1, 0) > 0)
        c->deadline_ms = now_ms + tls->options.linger_ms;
}

static void tick(struct srv_tls *tls, double now_ms) {
    for (struct srv_tls_connection *c = tls->relayed; c; c = c->next_relayed) {
        check_http_side(tls, c, now_ms);
        if (c->deadline_ms == 0 || now_ms < c->deadline_ms)
            continue;
        if (c->state == SRV_TLS_OPEN)
            sp_log(SP_LOG_INFO,
                   "TLS connection of %s closed: the client did not read the rest within "
                   "--request-time",
                   c->peer);
        c->state = SRV_TLS_DEAD;
    }
}

/* The thread. */

/* True if the connection is dead; reap() frees it after the events. */
static bool on_event(struct srv_tls *tls, struct srv_tls_connection *c, double now_ms) {
    if (c->state == SRV_TLS_OPEN)
        pump(tls, c, now_ms);
    else if (c->state == SRV_TLS_LINGERS)
        srv_tls_discard(c);
    return c->state == SRV_TLS_DEAD;
}

void *srv_tls_relay_main(void *user) {
    struct srv_tls *tls = user;
    struct epoll_event events[SRV_TLS_EVENTS];
    double last_tick_ms = 0, stop_ms = 0;
    for (;;) {
        bool is_last = atomic_load(&tls->relay.stop), has_dead = false;
        int count = epoll_wait(tls->relay.epoll, events, SRV_TLS_EVENTS, (int)SRV_TLS_TICK_MS);
        double now_ms = srv_clock_ms();
        for (int i = 0; i < count; i++) {
            if (events[i].data.ptr)
                has_dead |=
                    on_event(tls, ((struct srv_tls_side *)events[i].data.ptr)->connection, now_ms);
            else
                adopt_arrivals(tls, now_ms);
        }
        if (now_ms - last_tick_ms >= SRV_TLS_TICK_MS) {
            tick(tls, now_ms);
            last_tick_ms = now_ms;
            has_dead = true;
        }
        if (has_dead)
            reap(tls);
        stop_ms = is_last && stop_ms == 0 ? now_ms + STOP_MS : stop_ms;
        if (is_last && (!tls->relayed || now_ms >= stop_ms))
            break;
    }
    for (struct srv_tls_connection *c = tls->relayed; c; c = c->next_relayed)
        c->state = SRV_TLS_DEAD;
    reap(tls);
    return NULL;
}
