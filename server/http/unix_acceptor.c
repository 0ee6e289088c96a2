/* SPDX-License-Identifier: Apache-2.0 */
#include "http/unix_acceptor.h"

#include <errno.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include "common/clock.h"
#include "http/connection_limits.h"
#include "http/unix_passing.h"
#include "sp/log.h"

enum { EVENTS = 64, ACCEPTS = 64, TICK_MS = 100 };

struct waiting { /* a connection */
    struct waiting *next;
    int fd; /* −1 = it is over */
    unsigned user;
    double deadline_ms;
    bool is_passing; /* its first byte has come, and it is no HTTP */
    struct srv_passing passing;
};

struct srv_unix_acceptor {
    struct srv_unix_options options;
    struct srv_unix_socket socket;
    int epoll, wake;
    pthread_t thread;
    bool is_started;
    atomic_bool stop;
    /* Owned by the thread. */
    bool is_listening;
    struct waiting *list; /* newest first */
    unsigned count;
};

static bool watch(struct srv_unix_acceptor *a, int fd, void *data) {
    struct epoll_event event = { .events = EPOLLIN, .data.ptr = data };
    return epoll_ctl(a->epoll, EPOLL_CTL_ADD, fd, &event) == 0;
}

static void unwatch(struct srv_unix_acceptor *a, int fd) {
    epoll_ctl(a->epoll, EPOLL_CTL_DEL, fd, NULL);
}

/* Ends a connection; reap() frees it, because an event of this round may still point to it. */
static void end(struct waiting *w) {
    srv_passing_finish(&w->passing);
    if (w->fd >= 0)
        close(w->fd);
    w->fd = -1;
}

static void reap(struct srv_unix_acceptor *a) {
    for (struct waiting **link = &a->list; *link;) {
        struct waiting *w = *link;
        if (w->fd >= 0) {
            link = &w->next;
            continue;
        }
        *link = w->next;
        a->count--;
        free(w);
    }
}

/* Accepting. */

static void end_oldest(struct srv_unix_acceptor *a) {
    struct waiting *oldest = NULL;
    for (struct waiting *w = a->list; w; w = w->next)
        oldest = w->fd >= 0 ? w : oldest;
    srv_connection_refused(a->options.metrics, SRV_REFUSED_FULL,
                           "connection of user %u on the Unix socket ended: more than %d wait "
                           "without a request",
                           oldest->user, SRV_UNIX_WAITING_MAX);
    end(oldest);
}

static void add(struct srv_unix_acceptor *a, int fd, double now_ms) {
    struct ucred peer = { .uid = 0 };
    socklen_t size = sizeof peer;
    const bool is_known = getsockopt(fd, SOL_SOCKET, SO_PEERCRED, &peer, &size) == 0;
    struct waiting *w = is_known ? calloc(1, sizeof *w) : NULL;
    if (!w || !watch(a, fd, w)) {
        srv_connection_refused(a->options.metrics, SRV_REFUSED_FULL,
                               "connection on the Unix socket refused: %s", strerror(errno));
        free(w);
        close(fd);
        return;
    }
    w->fd = fd;
    w->user = peer.uid;
    w->deadline_ms = now_ms + a->options.wait_ms;
    srv_passing_init(&w->passing);
    w->next = a->list;
    a->list = w;
    if (++a->count > SRV_UNIX_WAITING_MAX)
        end_oldest(a);
    reap(a);
}

static void accept_all(struct srv_unix_acceptor *a, double now_ms) {
    for (int i = 0; i < ACCEPTS; i++) {
        int fd = accept4(a->socket.fd, NULL, NULL, SOCK_NONBLOCK | SOCK_CLOEXEC);
        if (fd >= 0) {
            add(a, fd, now_ms);
        } else if (errno == EAGAIN) {
            return;
        } else if (errno != EINTR && errno != ECONNABORTED) {
            srv_connection_refused(a->options.metrics, SRV_REFUSED_FULL,
                                   "no connection can be accepted for now: %s", strerror(errno));
            unwatch(a, a->socket.fd); /* until the next tick */
            a->is_listening = false;
            return;
        }
    }
}

/* Connections. */

/* Hands the connection over. */
static void give(struct srv_unix_acceptor *a, struct waiting *w) {
    struct sockaddr_un address;
    const socklen_t size = srv_address_of_user(w->user, &address);
    const int fd = w->fd;
    unwatch(a, fd);
    w->fd = -1;
    a->options.give(a->options.user, fd, (const struct sockaddr *)&address, size);
}

static void on_event(struct srv_unix_acceptor *a, struct waiting *w, double now_ms) {
    uint8_t first;
    if (w->fd < 0)
        return;
    if (!w->is_passing) {
        const ssize_t came = recv(w->fd, &first, 1, MSG_PEEK | MSG_DONTWAIT);
        if (came < 0 && (errno == EAGAIN || errno == EINTR))
            return;
        if (came <= 0) {
            end(w);
            return;
        }
        w->is_passing = proto_array_is_hello(first);
        if (!w->is_passing) {
            give(a, w);
            return;
        }
    }
    if (srv_passing_receive(&w->passing, w->fd, w->user, a->options.arrays, a->options.tokens,
                            now_ms))
        end(w);
}

static void tick(struct srv_unix_acceptor *a, double now_ms) {
    for (struct waiting *w = a->list; w; w = w->next)
        if (w->fd >= 0 && now_ms >= w->deadline_ms) {
            sp_log(SP_LOG_INFO,
                   "connection of user %u on the Unix socket closed: it exceeded --header-time",
                   w->user);
            end(w);
        }
    srv_arrays_tick(a->options.arrays, now_ms);
    if (!a->is_listening)
        a->is_listening = watch(a, a->socket.fd, &a->socket);
}

static void *run(void *user) {
    struct srv_unix_acceptor *a = user;
    struct epoll_event events[EVENTS];
    while (!atomic_load(&a->stop)) {
        const int count = epoll_wait(a->epoll, events, EVENTS, TICK_MS);
        const double now_ms = srv_clock_ms();
        /* Connections first: the oldest one may end when others are accepted. */
        for (int i = 0; i < count; i++)
            if (events[i].data.ptr && events[i].data.ptr != &a->socket)
                on_event(a, events[i].data.ptr, now_ms);
        for (int i = 0; i < count; i++)
            if (events[i].data.ptr == &a->socket)
                accept_all(a, now_ms);
        tick(a, now_ms);
        reap(a);
    }
    return NULL;
}

/* Start and stop. */

static bool start(struct srv_unix_acceptor *a, struct sp_error *err) {
    a->epoll = epoll_create1(EPOLL_CLOEXEC);
    a->wake = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    int failed = a->epoll < 0 || a->wake < 0 || !watch(a, a->wake, NULL)
                     ? errno
                     : pthread_create(&a->thread, NULL, run, a);
    a->is_started = !failed;
    return !failed || sp_fail(err, SP_ERR_IO, NULL,
                              "cannot start the thread of the Unix socket: %s", strerror(failed));
}

struct srv_unix_acceptor *srv_unix_acceptor_create(const struct srv_unix_options *options,
                                                   struct sp_error *err) {
    struct srv_unix_acceptor *a = calloc(1, sizeof *a);
    if (!a) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for the Unix socket");
        return NULL;
    }
    a->options = *options;
    a->epoll = a->wake = -1;
    atomic_init(&a->stop, false);
    if (!srv_unix_socket_open(options->path, &a->socket, err) || !start(a, err))
        srv_unix_acceptor_destroy(&a);
    return a;
}

void srv_unix_acceptor_destroy(struct srv_unix_acceptor **acceptor) {
    struct srv_unix_acceptor *a = *acceptor;
    *acceptor = NULL;
    if (!a)
        return;
    if (a->is_started) {
        const uint64_t one = 1;
        atomic_store(&a->stop, true);
        const ssize_t written = write(a->wake, &one, sizeof one);
        (void)written; /* if the counter is full, the thread is awake already */
        pthread_join(a->thread, NULL);
    }
    for (struct waiting *w = a->list; w; w = w->next)
        end(w);
    reap(a);
    if (a->epoll >= 0)
        close(a->epoll);
    if (a->wake >= 0)
        close(a->wake);
    srv_unix_socket_close(&a->socket);
    free(a);
}
