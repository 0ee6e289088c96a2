/* SPDX-License-Identifier: Apache-2.0
 *
 * The TLS acceptor: accepts connections, does the handshakes, and hands the connections over to the
 * relay. It is a background thread, so that new connections take no processor time from open ones.
 * It holds a shared lock only to hand a connection over.
 */
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <unistd.h>

#include "common/background.h"
#include "common/clock.h"
#include "http/connection_limits.h"
#include "http/tls_private.h"
#include "sp/log.h"

enum {
    UNSENT_BYTES = 128 * 1024, /* as in streams.c */
    ACCEPTS = 64               /* per event of the listening socket */
};

static void listen_again(struct srv_tls *tls, bool on) {
    struct epoll_event event = { .events = EPOLLIN, .data.ptr = tls };
    int operation = on ? EPOLL_CTL_ADD : EPOLL_CTL_DEL;
    if (on != tls->is_listening &&
        epoll_ctl(tls->acceptor.epoll, operation, tls->options.socket, &event) == 0)
        tls->is_listening = on;
}

static bool is_in_handshake(const struct srv_tls_connection *c) {
    return !c->is_handed_over && c->state == SRV_TLS_HANDSHAKE;
}

/* Handshakes. */

/* Hands the connection over to the relay, which owns it from here on. */
static void hand_over(struct srv_tls *tls, struct srv_tls_connection *c) {
    srv_tls_watch(c, SRV_TLS_CLIENT, 0);
    c->deadline_ms = 0;
    c->epoll = tls->relay.epoll;
    c->is_handed_over = true;
    sp_log(SP_LOG_DEBUG, "TLS connection of %s: %s", c->peer,
           gnutls_protocol_get_name(gnutls_protocol_get_version(c->session)));
    pthread_mutex_lock(&tls->mutex);
    c->next_relayed = tls->arrivals;
    tls->arrivals = c;
    pthread_mutex_unlock(&tls->mutex);
    srv_tls_wake(&tls->relay);
}

static void shake(struct srv_tls *tls, struct srv_tls_connection *c, double now_ms) {
    int code = gnutls_handshake(c->session);
    if (code == 0) {
        hand_over(tls, c);
    } else if (!gnutls_error_is_fatal(code)) {
        bool writes = gnutls_record_get_direction(c->session) == 1;
        srv_tls_watch(c, SRV_TLS_CLIENT, writes ? EPOLLOUT : EPOLLIN);
    } else {
        srv_connection_refused(tls->options.metrics, SRV_REFUSED_TLS,
                               "TLS handshake with %s failed: %s", c->peer, gnutls_strerror(code));
        gnutls_alert_send_appropriate(c->session, code);
        srv_tls_linger(c, now_ms);
    }
}

/* True if an HTTP request line begins with the first byte. Checked once, before the handshake. */
static bool is_plain_http(const struct srv_tls_connection *c) {
    uint8_t first = 0;
    return recv(c->sides[SRV_TLS_CLIENT].fd, &first, 1, MSG_PEEK) == 1 && first >= 'A' &&
           first <= 'Z';
}

static void refuse_plain_http(struct srv_tls *tls, struct srv_tls_connection *c, double now_ms) {
    static const char body[] = "{\"type\":\"about:blank\",\"title\":\"Bad Request\",\"status\":400,"
                               "\"detail\":\"this port speaks TLS; use https\"}";
    char answer[512];
    int size = snprintf(answer, sizeof answer,
                        "HTTP/1.1 400 Bad Request\r\nContent-Type: application/problem+json\r\n"
                        "Connection: close\r\nContent-Length: %zu\r\n\r\n%s",
                        sizeof body - 1, body);
    ssize_t sent = send(c->sides[SRV_TLS_CLIENT].fd, answer, (size_t)size, MSG_NOSIGNAL);
    srv_connection_refused(tls->options.metrics, SRV_REFUSED_TLS,
                           "TLS handshake with %s failed: the client sent plain HTTP", c->peer);
    if (sent == size)
        srv_tls_linger(c, now_ms);
    else
        c->state = SRV_TLS_DEAD;
}

static void on_event(struct srv_tls *tls, struct srv_tls_connection *c, double now_ms) {
    if (c->state == SRV_TLS_HANDSHAKE && !c->session) {
        if (is_plain_http(c))
            refuse_plain_http(tls, c, now_ms);
        else if (!srv_tls_keys_begin(c->keys, c->sides[SRV_TLS_CLIENT].fd, &c->session))
            c->state = SRV_TLS_DEAD;
    }
    if (c->state == SRV_TLS_HANDSHAKE)
        shake(tls, c, now_ms);
    else if (c->state == SRV_TLS_LINGERS)
        srv_tls_discard(c);
}

/* The list. */

/* Frees dead connections, and connections that the relay has finished. */
static void reap(struct srv_tls *tls) {
    for (struct srv_tls_connection **link = &tls->list; *link;) {
        struct srv_tls_connection *c = *link;
        if (c->is_handed_over ? !atomic_load(&c->is_over) : c->state != SRV_TLS_DEAD) {
            link = &c->next;
            continue;
        }
        *link = c->next;
        srv_tls_end(c);
        srv_tls_keys_unref(&c->keys);
        free(c);
    }
}

/* Ends the oldest handshake if there are too many; never the newest. */
static void end_oldest_handshake(struct srv_tls *tls) {
    struct srv_tls_connection *oldest = NULL;
    unsigned handshakes = 0;
    for (struct srv_tls_connection *c = tls->list; c; c = c->next) {
        handshakes += is_in_handshake(c);
        oldest = is_in_handshake(c) ? c : oldest;
    }
    if (handshakes <= tls->options.handshakes_max)
        return;
    srv_connection_refused(
        tls->options.metrics, SRV_REFUSED_HANDSHAKE,
        "TLS handshake with %s ended: more than %u handshakes at a time (--handshakes)",
        oldest->peer, tls->options.handshakes_max);
    oldest->state = SRV_TLS_DEAD;
}

static bool has_capacity(struct srv_tls *tls, const struct sockaddr *host, const char *peer) {
    unsigned all = 0, same_host = 0;
    for (struct srv_tls_connection *c = tls->list; c; c = c->next) {
        bool is_there = !atomic_load(&c->is_over);
        all += is_there;
        same_host += is_there && srv_address_same_host((const struct sockaddr *)&c->address, host);
    }
    if (all >= tls->options.connections_max) {
        srv_connection_refused(
            tls->options.metrics, SRV_REFUSED_FULL,
            "TLS connection of %s refused: %u connections are open (--connections)", peer, all);
        return false;
    }
    if (!tls->options.accepted_from ||
        same_host < tls->options.accepted_from(tls->options.user, host))
        return true;
    srv_connection_refused(
        tls->options.metrics, SRV_REFUSED_ADDRESS,
        "TLS connection of %s refused: its address has %u connections (--connections-per-address)",
        peer, same_host);
    return false;
}

/* Accepting. */

static bool is_within_rate(struct srv_tls *tls, const struct sockaddr_storage *host,
                           const char *peer, double now_ms) {
    if ((tls->options.spares_loopback && srv_address_is_loopback((const struct sockaddr *)host)) ||
        srv_host_rate_spend(&tls->rate, host, now_ms))
        return true;
    srv_connection_refused(
        tls->options.metrics, SRV_REFUSED_HANDSHAKE,
        "TLS connection of %s refused: its address started more than %.0f handshakes per "
        "second (--handshake-rate)",
        peer, tls->options.handshakes_per_s);
    return false;
}

static void accept_connection(struct srv_tls *tls, int fd, const struct sockaddr_storage *address,
                              socklen_t size, double now_ms) {
    int on = 1, unsent = UNSENT_BYTES;
    char peer[SRV_ADDRESS_TEXT];
    srv_address_to_text((const struct sockaddr *)address, peer);
    bool is_allowed = has_capacity(tls, (const struct sockaddr *)address, peer) &&
                      is_within_rate(tls, address, peer, now_ms);
    struct srv_tls_connection *c = is_allowed ? calloc(1, sizeof *c) : NULL;
    if (!c) {
        if (is_allowed)
            srv_connection_refused(tls->options.metrics, SRV_REFUSED_FULL,
                                   "TLS connection of %s refused: no memory", peer);
        close(fd);
        return;
    }
    setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    setsockopt(fd, IPPROTO_TCP, TCP_NOTSENT_LOWAT, &unsent, sizeof unsent);
    for (int i = 0; i < SRV_TLS_SIDES; i++)
        c->sides[i] = (struct srv_tls_side){ .connection = c, .fd = i == SRV_TLS_CLIENT ? fd : -1 };
    c->state = SRV_TLS_HANDSHAKE;
    c->epoll = tls->acceptor.epoll;
    c->deadline_ms = now_ms + tls->options.handshake_ms;
    c->address = *address;
    c->address_size = size;
    memcpy(c->peer, peer, sizeof peer);
    pthread_mutex_lock(&tls->mutex);
    c->keys = srv_tls_keys_ref(tls->options.keys);
    pthread_mutex_unlock(&tls->mutex);
    c->next = tls->list;
    tls->list = c;
    srv_tls_watch(c, SRV_TLS_CLIENT, EPOLLIN);
    end_oldest_handshake(tls);
}

/* Refuses a connection when no file descriptors are left: frees the reserved descriptor, then
 * accepts and closes the connection, which would otherwise wait in the backlog. False with errno
 * set: there is no connection, or accept4() failed. */
static bool refuse_one(struct srv_tls *tls, int reason) {
    if (tls->spare >= 0)
        close(tls->spare);
    int fd = accept4(tls->options.socket, NULL, NULL, SOCK_NONBLOCK | SOCK_CLOEXEC), code = errno;
    if (fd >= 0) {
        srv_connection_refused(tls->options.metrics, SRV_REFUSED_FULL, "TLS connection refused: %s",
                               strerror(reason));
        close(fd);
    }
    tls->spare = open("/dev/null", O_RDONLY | O_CLOEXEC);
    errno = code;
    return fd >= 0;
}

/* True if the process has no file descriptors or memory left. accept4() fails with these errors
 * even if no client waits. */
static bool is_exhausted(int error) {
    return error == EMFILE || error == ENFILE || error == ENOBUFS || error == ENOMEM;
}

static void accept_all(struct srv_tls *tls, double now_ms) {
    for (int i = 0; i < ACCEPTS; i++) {
        struct sockaddr_storage address = { .ss_family = AF_UNSPEC };
        socklen_t size = sizeof address;
        int fd = accept4(tls->options.socket, (struct sockaddr *)&address, &size,
                         SOCK_NONBLOCK | SOCK_CLOEXEC);
        if (fd >= 0) {
            accept_connection(tls, fd, &address, size, now_ms);
            continue;
        }
        if (is_exhausted(errno) && refuse_one(tls, errno))
            continue;
        if (is_exhausted(errno)) {
            srv_connection_refused(tls->options.metrics, SRV_REFUSED_FULL,
                                   "no connection can be accepted for now: %s", strerror(errno));
            listen_again(tls, false); /* until the next tick */
            return;
        }
        if (srv_tls_is_again(errno))
            return;
    }
}

/* The thread. */

static void tick(struct srv_tls *tls, double now_ms) {
    for (struct srv_tls_connection *c = tls->list; c; c = c->next) {
        if (c->is_handed_over || c->deadline_ms == 0 || now_ms < c->deadline_ms)
            continue;
        if (c->state == SRV_TLS_HANDSHAKE)
            srv_connection_refused(tls->options.metrics, SRV_REFUSED_TLS,
                                   "TLS handshake with %s ended: not finished within --header-time",
                                   c->peer);
        c->state = SRV_TLS_DEAD;
    }
    listen_again(tls, true);
    reap(tls);
}

void *srv_tls_acceptor_main(void *user) {
    struct srv_tls *tls = user;
    struct epoll_event events[SRV_TLS_EVENTS];
    double last_tick_ms = 0;
    srv_background_thread_enter("the thread for TLS handshakes", SRV_NICE_BACKGROUND);
    listen_again(tls, true);
    while (!atomic_load(&tls->acceptor.stop)) {
        int count = epoll_wait(tls->acceptor.epoll, events, SRV_TLS_EVENTS, (int)SRV_TLS_TICK_MS);
        double now_ms = srv_clock_ms();
        for (int i = 0; i < count && !atomic_load(&tls->acceptor.stop); i++) {
            if (events[i].data.ptr == tls)
                accept_all(tls, now_ms);
            else if (events[i].data.ptr)
                on_event(tls, ((struct srv_tls_side *)events[i].data.ptr)->connection, now_ms);
            else
                srv_tls_woken(&tls->acceptor);
        }
        if (now_ms - last_tick_ms >= SRV_TLS_TICK_MS) {
            tick(tls, now_ms);
            last_tick_ms = now_ms;
        }
    }
    for (struct srv_tls_connection *c = tls->list; c; c = c->next)
        if (!c->is_handed_over)
            c->state = SRV_TLS_DEAD;
    reap(tls);
    return NULL;
}
