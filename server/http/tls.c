/* SPDX-License-Identifier: Apache-2.0 */
#include "http/tls.h"

#include <assert.h>
#include <errno.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "clock.h"
#include "http/address.h"
#include "http/refusals.h"
#include "sp/log.h"

enum {
    BUFFER_BYTES = 16384,      /* the largest record: nothing stays behind in GnuTLS */
    TURNS = 8,                 /* buffers a turn, so that one client does not keep the thread */
    PAIR_BYTES = 64 * 1024,    /* on their way to us, where no newer frame replaces them */
    UNSENT_BYTES = 128 * 1024, /* as in streams.c */
    ACCEPTS = 64,              /* a turn */
    EVENTS = 64
};
#define TICK_MS 100.0
#define LINGER_MS 2000.0 /* for a client to close after our end */
#define STOP_MS 2000.0

enum state { HANDSHAKE, OPEN, LINGERS, DEAD };
enum { CLIENT, SERVER, SIDES };

struct side { /* what epoll knows of one socket */
    struct connection *connection;
    int fd;
    uint32_t events; /* 0 = epoll has it not: it would tell of hang-ups for ever */
};

struct half { /* one direction */
    size_t at, size;
    bool is_retry; /* GnuTLS wants to go on with what it was handed */
    bool is_ended; /* the source has no more */
    bool is_done;  /* and the sink was told */
    uint8_t bytes[BUFFER_BYTES];
};

struct connection {
    struct connection *next;
    enum state state;
    struct side sides[SIDES];
    gnutls_session_t session;  /* NULL = told in plain text that TLS is spoken here */
    struct srv_tls_keys *keys; /* its session's */
    double deadline_ms;        /* 0 = none */
    struct half up, down;      /* to the server, to the client */
    struct sockaddr_storage address;
    socklen_t address_size;
    char peer[SRV_ADDRESS_TEXT];
};

struct srv_tls {
    struct srv_tls_options options; /* its keys are guarded by mutex */
    pthread_t thread;
    int epoll, wake;
    pthread_mutex_t mutex;
    pthread_cond_t changed;
    bool close, is_closed, stop; /* guarded by mutex */
    /* The thread's. */
    struct connection *list; /* newest first */
    unsigned count;
    bool accepts, is_listening;
};

/* Sockets. */

static void watch(struct srv_tls *tls, struct connection *c, int which, uint32_t events) {
    struct side *side = &c->sides[which];
    if (events == side->events || side->fd < 0)
        return;
    struct epoll_event event = { .events = events, .data.ptr = side };
    int operation = !side->events ? EPOLL_CTL_ADD : events ? EPOLL_CTL_MOD : EPOLL_CTL_DEL;
    if (epoll_ctl(tls->epoll, operation, side->fd, &event) != 0)
        c->state = DEAD;
    side->events = events;
}

static void listen_again(struct srv_tls *tls, bool on) {
    struct epoll_event event = { .events = EPOLLIN, .data.ptr = tls };
    if (on != tls->is_listening &&
        epoll_ctl(tls->epoll, on ? EPOLL_CTL_ADD : EPOLL_CTL_DEL, tls->options.socket, &event) == 0)
        tls->is_listening = on;
}

static bool is_again(int error) {
    return error == EAGAIN || error == EWOULDBLOCK || error == EINTR;
}

/* No more bytes to the client; it has a while to close its side, too: a reset could take away what
 * it has not read yet. */
static void linger(struct srv_tls *tls, struct connection *c, double now_ms) {
    c->state = shutdown(c->sides[CLIENT].fd, SHUT_WR) == 0 ? LINGERS : DEAD;
    c->deadline_ms = now_ms + LINGER_MS;
    watch(tls, c, SERVER, 0);
}

static void discard(struct connection *c) {
    uint8_t bytes[4096];
    ssize_t got;
    int turns = 16;
    do
        got = recv(c->sides[CLIENT].fd, bytes, sizeof bytes, 0);
    while (got > 0 && --turns > 0);
    if (got == 0 || (got < 0 && !is_again(errno)))
        c->state = DEAD;
}

/* Bytes, one direction after the other. Each returns false when it has to wait. */

static bool fill_up(struct connection *c) {
    ssize_t got = gnutls_record_recv(c->session, c->up.bytes, BUFFER_BYTES);
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
    /* An alert that is no error is over with that. Nobody may begin a handshake again. */
    if (!gnutls_error_is_fatal((int)got) && got != GNUTLS_E_REHANDSHAKE)
        return true;
    bool is_cut = got == GNUTLS_E_PREMATURE_TERMINATION || got == GNUTLS_E_PULL_ERROR;
    sp_log(is_cut ? SP_LOG_DEBUG : SP_LOG_INFO, "TLS connection of %s ended: %s", c->peer,
           gnutls_strerror((int)got));
    c->state = DEAD;
    return false;
}

static bool drain_up(struct connection *c) {
    struct half *up = &c->up;
    ssize_t sent = send(c->sides[SERVER].fd, up->bytes + up->at, up->size - up->at, MSG_NOSIGNAL);
    if (sent < 0 && is_again(errno))
        return false;
    if (sent < 0) { /* the server's end was closed: what comes now is for nobody */
        up->at = up->size = 0;
        return true;
    }
    up->at += (size_t)sent;
    return true;
}

static bool fill_down(struct connection *c) {
    ssize_t got = recv(c->sides[SERVER].fd, c->down.bytes, BUFFER_BYTES, 0);
    if (got < 0 && is_again(errno))
        return false;
    c->down.at = 0;
    c->down.size = got > 0 ? (size_t)got : 0;
    c->down.is_ended = got <= 0;
    return true;
}

static bool drain_down(struct connection *c) {
    struct half *down = &c->down;
    ssize_t sent = down->is_retry ? gnutls_record_send(c->session, NULL, 0)
                                  : gnutls_record_send(c->session, down->bytes + down->at,
                                                       down->size - down->at);
    down->is_retry = sent == GNUTLS_E_AGAIN || sent == GNUTLS_E_INTERRUPTED;
    if (down->is_retry)
        return false;
    if (sent < 0) {
        c->state = DEAD;
        return false;
    }
    down->at += (size_t)sent;
    return true;
}

/* Never stops while it holds bytes that could go on: nothing would wake it. */
static void pump_up(struct connection *c) {
    struct half *up = &c->up;
    for (int turns = TURNS;; turns--) {
        while (up->at < up->size)
            if (!drain_up(c))
                return;
        if (up->is_ended && !up->is_done) {
            shutdown(c->sides[SERVER].fd, SHUT_WR);
            up->is_done = true;
        }
        if (up->is_done || turns == 0 || !fill_up(c))
            return;
    }
}

static void pump_down(struct srv_tls *tls, struct connection *c, double now_ms) {
    struct half *down = &c->down;
    for (int turns = TURNS; !down->is_ended; turns--) {
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
        linger(tls, c, now_ms);
}

static void watch_open(struct srv_tls *tls, struct connection *c) {
    bool up_waits = c->up.at < c->up.size, down_waits = c->down.at < c->down.size;
    bool is_reading = !up_waits && !c->up.is_ended;
    watch(tls, c, CLIENT, (is_reading ? EPOLLIN : 0) | (c->down.is_retry ? EPOLLOUT : 0));
    watch(tls, c, SERVER,
          (!down_waits && !c->down.is_ended ? EPOLLIN : 0) | (up_waits ? EPOLLOUT : 0));
}

static void pump(struct srv_tls *tls, struct connection *c, double now_ms) {
    pump_up(c);
    if (c->state == OPEN)
        pump_down(tls, c, now_ms);
    if (c->state == OPEN)
        watch_open(tls, c);
}

/* Handshakes. */

static void open_pair(struct srv_tls *tls, struct connection *c, double now_ms) {
    int pair[2], bytes = PAIR_BYTES;
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0, pair) != 0) {
        srv_refused(tls->options.metrics, SRV_REFUSED_FULL,
                    "TLS connection of %s refused: no socket pair: %s", c->peer, strerror(errno));
        c->state = DEAD;
        return;
    }
    setsockopt(pair[1], SOL_SOCKET, SO_SNDBUF, &bytes, sizeof bytes);
    c->sides[SERVER].fd = pair[0];
    if (!tls->options.give(tls->options.user, pair[1], (const struct sockaddr *)&c->address,
                           c->address_size)) {
        srv_refused(tls->options.metrics, SRV_REFUSED_FULL,
                    "TLS connection of %s refused: there is no room", c->peer);
        c->state = DEAD;
        return;
    }
    sp_log(SP_LOG_DEBUG, "TLS connection of %s: %s", c->peer,
           gnutls_protocol_get_name(gnutls_protocol_get_version(c->session)));
    pump(tls, c, now_ms);
}

static void shake(struct srv_tls *tls, struct connection *c, double now_ms) {
    int code = gnutls_handshake(c->session);
    if (code == 0) {
        c->state = OPEN;
        c->deadline_ms = 0;
        open_pair(tls, c, now_ms);
    } else if (!gnutls_error_is_fatal(code)) {
        bool writes = gnutls_record_get_direction(c->session) == 1;
        watch(tls, c, CLIENT, writes ? EPOLLOUT : EPOLLIN);
    } else {
        srv_refused(tls->options.metrics, SRV_REFUSED_TLS, "no TLS with %s: %s", c->peer,
                    gnutls_strerror(code));
        gnutls_alert_send_appropriate(c->session, code);
        linger(tls, c, now_ms);
    }
}

/* A request line instead of a greeting; looked at once, before the handshake begins. */
static bool is_plain_http(const struct connection *c) {
    uint8_t first = 0;
    return recv(c->sides[CLIENT].fd, &first, 1, MSG_PEEK) == 1 && first >= 'A' && first <= 'Z';
}

static void tell_plain(struct srv_tls *tls, struct connection *c, double now_ms) {
    static const char body[] = "{\"type\":\"about:blank\",\"title\":\"Bad Request\",\"status\":400,"
                               "\"detail\":\"this port speaks TLS: use https\"}";
    char answer[512];
    int size = snprintf(answer, sizeof answer,
                        "HTTP/1.1 400 Bad Request\r\nContent-Type: application/problem+json\r\n"
                        "Connection: close\r\nContent-Length: %zu\r\n\r\n%s",
                        sizeof body - 1, body);
    ssize_t sent = send(c->sides[CLIENT].fd, answer, (size_t)size, MSG_NOSIGNAL);
    srv_refused(tls->options.metrics, SRV_REFUSED_TLS, "no TLS with %s: it speaks plain HTTP",
                c->peer);
    if (sent == size)
        linger(tls, c, now_ms);
    else
        c->state = DEAD;
}

static void on_event(struct srv_tls *tls, struct side *side, double now_ms) {
    struct connection *c = side->connection;
    if (c->state == HANDSHAKE && !c->session) {
        if (is_plain_http(c))
            tell_plain(tls, c, now_ms);
        else if (!srv_tls_keys_begin(c->keys, c->sides[CLIENT].fd, &c->session))
            c->state = DEAD;
    }
    if (c->state == HANDSHAKE)
        shake(tls, c, now_ms);
    else if (c->state == OPEN)
        pump(tls, c, now_ms);
    else if (c->state == LINGERS)
        discard(c);
    if (c->state == LINGERS)
        watch(tls, c, CLIENT, EPOLLIN);
}

/* The list. */

static void reap(struct srv_tls *tls) {
    for (struct connection **link = &tls->list; *link;) {
        struct connection *c = *link;
        if (c->state != DEAD) {
            link = &c->next;
            continue;
        }
        *link = c->next;
        for (int i = 0; i < SIDES; i++)
            if (c->sides[i].fd >= 0)
                close(c->sides[i].fd); /* which takes it out of epoll */
        if (c->session)
            gnutls_deinit(c->session);
        srv_tls_keys_unref(&c->keys);
        free(c);
        tls->count--;
    }
}

/* If there are too many; not the one that just arrived. */
static void end_oldest_handshake(struct srv_tls *tls) {
    struct connection *oldest = NULL;
    unsigned handshakes = 0;
    for (struct connection *c = tls->list; c; c = c->next) {
        handshakes += c->state == HANDSHAKE;
        oldest = c->state == HANDSHAKE ? c : oldest;
    }
    if (handshakes <= tls->options.handshakes_max)
        return;
    srv_refused(tls->options.metrics, SRV_REFUSED_HANDSHAKE,
                "no TLS with %s: more than %u handshakes at a time (--handshakes)", oldest->peer,
                tls->options.handshakes_max);
    oldest->state = DEAD;
}

static bool has_room(struct srv_tls *tls, const struct sockaddr *host, const char *peer) {
    if (tls->count >= tls->options.connections_max) {
        srv_refused(tls->options.metrics, SRV_REFUSED_FULL,
                    "TLS connection of %s refused: --connections (%u are open)", peer, tls->count);
        return false;
    }
    if (!tls->options.accepted_from)
        return true;
    unsigned same_host = 0;
    for (const struct connection *c = tls->list; c; c = c->next)
        same_host += srv_address_same_host((const struct sockaddr *)&c->address, host);
    if (same_host < tls->options.accepted_from(tls->options.user, host))
        return true;
    srv_refused(tls->options.metrics, SRV_REFUSED_ADDRESS,
                "TLS connection of %s refused: it has %u (--connections-per-address)", peer,
                same_host);
    return false;
}

static void take(struct srv_tls *tls, int fd, const struct sockaddr_storage *address,
                 socklen_t size, double now_ms) {
    int on = 1, unsent = UNSENT_BYTES;
    char peer[SRV_ADDRESS_TEXT];
    srv_address_to_text((const struct sockaddr *)address, peer);
    bool has = has_room(tls, (const struct sockaddr *)address, peer);
    struct connection *c = has ? calloc(1, sizeof *c) : NULL;
    if (!c) {
        if (has)
            srv_refused(tls->options.metrics, SRV_REFUSED_FULL,
                        "TLS connection of %s refused: no memory", peer);
        close(fd);
        return;
    }
    setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    setsockopt(fd, IPPROTO_TCP, TCP_NOTSENT_LOWAT, &unsent, sizeof unsent);
    for (int i = 0; i < SIDES; i++)
        c->sides[i] = (struct side){ .connection = c, .fd = i == CLIENT ? fd : -1 };
    c->state = HANDSHAKE;
    c->deadline_ms = now_ms + tls->options.handshake_ms;
    c->address = *address;
    c->address_size = size;
    memcpy(c->peer, peer, sizeof peer);
    pthread_mutex_lock(&tls->mutex);
    c->keys = srv_tls_keys_ref(tls->options.keys);
    pthread_mutex_unlock(&tls->mutex);
    c->next = tls->list;
    tls->list = c;
    tls->count++;
    watch(tls, c, CLIENT, EPOLLIN);
    end_oldest_handshake(tls);
}

static void accept_all(struct srv_tls *tls, double now_ms) {
    for (int i = 0; i < ACCEPTS; i++) {
        struct sockaddr_storage address = { .ss_family = AF_UNSPEC };
        socklen_t size = sizeof address;
        int fd = accept4(tls->options.socket, (struct sockaddr *)&address, &size,
                         SOCK_NONBLOCK | SOCK_CLOEXEC);
        if (fd >= 0) {
            take(tls, fd, &address, size, now_ms);
        } else if (errno == EMFILE || errno == ENFILE || errno == ENOBUFS || errno == ENOMEM) {
            srv_refused(tls->options.metrics, SRV_REFUSED_FULL,
                        "no connection can be accepted for now: %s", strerror(errno));
            listen_again(tls, false); /* until the next tick */
            return;
        } else if (is_again(errno)) {
            return;
        }
    }
}

/* While bytes wait for the client nobody reads the server's side, nor hears of its end. */
static void look_for_end(struct srv_tls *tls, struct connection *c, double now_ms) {
    struct pollfd look = { .fd = c->sides[SERVER].fd, .events = POLLRDHUP };
    if (c->state == OPEN && c->deadline_ms == 0 && c->down.at < c->down.size &&
        poll(&look, 1, 0) > 0)
        c->deadline_ms = now_ms + tls->options.linger_ms;
}

static void tick(struct srv_tls *tls, double now_ms) {
    for (struct connection *c = tls->list; c; c = c->next) {
        look_for_end(tls, c, now_ms);
        if (c->deadline_ms == 0 || now_ms < c->deadline_ms)
            continue;
        if (c->state == HANDSHAKE)
            srv_refused(tls->options.metrics, SRV_REFUSED_TLS,
                        "no TLS with %s: no handshake within --header-time", c->peer);
        else if (c->state == OPEN)
            sp_log(SP_LOG_INFO,
                   "TLS connection of %s closed: the rest was not read within "
                   "--request-time",
                   c->peer);
        c->state = DEAD;
    }
}

/* The thread. */

/* False: all is said and done. */
static bool take_orders(struct srv_tls *tls, double *stop_ms, double now_ms) {
    pthread_mutex_lock(&tls->mutex);
    bool closes = tls->close && !tls->is_closed, stop = tls->stop;
    pthread_mutex_unlock(&tls->mutex);
    if (closes) {
        tls->accepts = false;
        listen_again(tls, false);
        for (struct connection *c = tls->list; c; c = c->next)
            if (c->state == HANDSHAKE)
                c->state = DEAD;
        pthread_mutex_lock(&tls->mutex);
        tls->is_closed = true;
        pthread_cond_broadcast(&tls->changed);
        pthread_mutex_unlock(&tls->mutex);
    }
    if (stop && *stop_ms == 0)
        *stop_ms = now_ms + STOP_MS;
    reap(tls);
    return !stop || (tls->list && now_ms < *stop_ms);
}

static void *tls_main(void *user) {
    struct srv_tls *tls = user;
    struct epoll_event events[EVENTS];
    double last_tick_ms = 0, now_ms = srv_clock_ms(), stop_ms = 0;
    tls->accepts = true;
    listen_again(tls, true);
    while (take_orders(tls, &stop_ms, now_ms)) {
        int count = epoll_wait(tls->epoll, events, EVENTS, (int)TICK_MS);
        now_ms = srv_clock_ms();
        for (int i = 0; i < count; i++) {
            uint64_t counter;
            if (events[i].data.ptr == tls) {
                accept_all(tls, now_ms);
            } else if (events[i].data.ptr) {
                on_event(tls, events[i].data.ptr, now_ms);
            } else if (read(tls->wake, &counter, sizeof counter) < 0 && !is_again(errno)) {
                sp_log(SP_LOG_ERROR, "the TLS thread's wake-up failed: %s", strerror(errno));
            }
        }
        if (now_ms - last_tick_ms >= TICK_MS) {
            tick(tls, now_ms);
            listen_again(tls, tls->accepts);
            last_tick_ms = now_ms;
        }
    }
    for (struct connection *c = tls->list; c; c = c->next)
        c->state = DEAD;
    reap(tls);
    return NULL;
}

static void order(struct srv_tls *tls, bool *what) {
    uint64_t one = 1;
    pthread_mutex_lock(&tls->mutex);
    *what = true;
    pthread_mutex_unlock(&tls->mutex);
    ssize_t written = write(tls->wake, &one, sizeof one);
    (void)written; /* full means that it is awake already */
}

struct srv_tls *srv_tls_create(const struct srv_tls_options *options, struct sp_error *err) {
    struct srv_tls *tls = calloc(1, sizeof *tls);
    if (!tls) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "no memory for the TLS thread");
        return NULL;
    }
    assert(options->handshakes_max >= 1 && options->give);
    tls->options = *options;
    pthread_mutex_init(&tls->mutex, NULL);
    pthread_cond_init(&tls->changed, NULL);
    tls->epoll = epoll_create1(EPOLL_CLOEXEC);
    tls->wake = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    struct epoll_event event = { .events = EPOLLIN, .data.ptr = NULL };
    int failed = tls->epoll < 0 || tls->wake < 0 ||
                         epoll_ctl(tls->epoll, EPOLL_CTL_ADD, tls->wake, &event) != 0
                     ? errno
                     : pthread_create(&tls->thread, NULL, tls_main, tls);
    if (!failed)
        return tls;
    sp_fail(err, SP_ERR_IO, NULL, "cannot start the TLS thread: %s", strerror(failed));
    if (tls->epoll >= 0)
        close(tls->epoll);
    if (tls->wake >= 0)
        close(tls->wake);
    pthread_cond_destroy(&tls->changed);
    pthread_mutex_destroy(&tls->mutex);
    free(tls);
    return NULL;
}

void srv_tls_set_keys(struct srv_tls *tls, struct srv_tls_keys *keys) {
    pthread_mutex_lock(&tls->mutex);
    srv_tls_keys_unref(&tls->options.keys);
    tls->options.keys = keys;
    pthread_mutex_unlock(&tls->mutex);
}

void srv_tls_close(struct srv_tls *tls) {
    order(tls, &tls->close);
    pthread_mutex_lock(&tls->mutex);
    while (!tls->is_closed)
        pthread_cond_wait(&tls->changed, &tls->mutex);
    pthread_mutex_unlock(&tls->mutex);
}

void srv_tls_destroy(struct srv_tls **tls_pointer) {
    struct srv_tls *tls = *tls_pointer;
    *tls_pointer = NULL;
    if (!tls)
        return;
    srv_tls_close(tls);
    order(tls, &tls->stop);
    pthread_join(tls->thread, NULL);
    close(tls->options.socket);
    close(tls->epoll);
    close(tls->wake);
    srv_tls_keys_unref(&tls->options.keys);
    pthread_cond_destroy(&tls->changed);
    pthread_mutex_destroy(&tls->mutex);
    free(tls);
}
