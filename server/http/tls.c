/* SPDX-License-Identifier: Apache-2.0 */
#include "http/tls.h"

#include <assert.h>
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "http/tls_private.h"
#include "sp/log.h"

#define LINGER_MS 2000.0 /* for a client to close its side after the daemon closed its own */

/* For both threads. */

void srv_tls_watch(struct srv_tls_connection *c, int which, uint32_t events) {
    struct srv_tls_side *side = &c->sides[which];
    if (events == side->events || side->fd < 0)
        return;
    struct epoll_event event = { .events = events, .data.ptr = side };
    int operation = !side->events ? EPOLL_CTL_ADD : events ? EPOLL_CTL_MOD : EPOLL_CTL_DEL;
    if (epoll_ctl(c->epoll, operation, side->fd, &event) != 0)
        c->state = SRV_TLS_DEAD;
    side->events = events;
}

bool srv_tls_is_again(int error) {
    return error == EAGAIN || error == EWOULDBLOCK || error == EINTR;
}

void srv_tls_linger(struct srv_tls_connection *c, double now_ms) {
    bool is_shut = shutdown(c->sides[SRV_TLS_CLIENT].fd, SHUT_WR) == 0;
    c->state = is_shut ? SRV_TLS_LINGERS : SRV_TLS_DEAD;
    c->deadline_ms = now_ms + LINGER_MS;
    srv_tls_watch(c, SRV_TLS_SERVER, 0);
    srv_tls_watch(c, SRV_TLS_CLIENT, EPOLLIN);
}

void srv_tls_discard(struct srv_tls_connection *c) {
    uint8_t bytes[4096];
    ssize_t got;
    int turns = 16;
    do
        got = recv(c->sides[SRV_TLS_CLIENT].fd, bytes, sizeof bytes, 0);
    while (got > 0 && --turns > 0);
    if (got == 0 || (got < 0 && !srv_tls_is_again(errno)))
        c->state = SRV_TLS_DEAD;
}

void srv_tls_end(struct srv_tls_connection *c) {
    for (int i = 0; i < SRV_TLS_SIDES; i++) {
        if (c->sides[i].fd >= 0)
            close(c->sides[i].fd); /* also removes it from epoll */
        c->sides[i].fd = -1;
    }
    if (c->session)
        gnutls_deinit(c->session);
    c->session = NULL;
}

/* The threads. */

void srv_tls_wake(struct srv_tls_thread *thread) {
    uint64_t one = 1;
    ssize_t written = write(thread->wake, &one, sizeof one);
    (void)written; /* if the counter is full, the thread is awake already */
}

void srv_tls_woken(struct srv_tls_thread *thread) {
    uint64_t counter;
    if (read(thread->wake, &counter, sizeof counter) < 0 && !srv_tls_is_again(errno))
        sp_log(SP_LOG_ERROR, "a TLS thread's wake-up failed: %s", strerror(errno));
}

static bool start(struct srv_tls *tls, struct srv_tls_thread *thread, void *(*main)(void *),
                  struct sp_error *err) {
    thread->epoll = epoll_create1(EPOLL_CLOEXEC);
    thread->wake = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    struct epoll_event event = { .events = EPOLLIN, .data.ptr = NULL };
    int failed = thread->epoll < 0 || thread->wake < 0 ||
                         epoll_ctl(thread->epoll, EPOLL_CTL_ADD, thread->wake, &event) != 0
                     ? errno
                     : pthread_create(&thread->id, NULL, main, tls);
    thread->is_there = !failed;
    return !failed ||
           sp_fail(err, SP_ERR_IO, NULL, "cannot start a TLS thread: %s", strerror(failed));
}

static void stop(struct srv_tls_thread *thread) {
    if (!thread->is_there)
        return;
    atomic_store(&thread->stop, true);
    srv_tls_wake(thread);
    pthread_join(thread->id, NULL);
    thread->is_there = false;
}

/* Call after both threads have ended. */
static void release(struct srv_tls *tls) {
    while (tls->list) {
        struct srv_tls_connection *c = tls->list;
        tls->list = c->next;
        srv_tls_end(c);
        srv_tls_keys_unref(&c->keys);
        free(c);
    }
    const int descriptors[] = { tls->acceptor.epoll, tls->acceptor.wake, tls->relay.epoll,
                                tls->relay.wake, tls->spare };
    for (size_t i = 0; i < sizeof descriptors / sizeof *descriptors; i++)
        if (descriptors[i] >= 0)
            close(descriptors[i]);
    pthread_mutex_destroy(&tls->mutex);
    free(tls);
}

struct srv_tls *srv_tls_create(const struct srv_tls_options *options, struct sp_error *err) {
    struct srv_tls *tls = calloc(1, sizeof *tls);
    if (!tls) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for the TLS threads");
        return NULL;
    }
    assert(options->handshakes_max >= 1 && options->give);
    tls->options = *options;
    tls->rate.per_second = options->handshakes_per_s;
    tls->acceptor = tls->relay = (struct srv_tls_thread){ .epoll = -1, .wake = -1 };
    pthread_mutex_init(&tls->mutex, NULL);
    tls->spare = open("/dev/null", O_RDONLY | O_CLOEXEC);
    if (start(tls, &tls->relay, srv_tls_relay_main, err) &&
        start(tls, &tls->acceptor, srv_tls_acceptor_main, err))
        return tls;
    stop(&tls->relay);
    release(tls);
    return NULL;
}

void srv_tls_set_keys(struct srv_tls *tls, struct srv_tls_keys *keys) {
    pthread_mutex_lock(&tls->mutex);
    srv_tls_keys_unref(&tls->options.keys);
    tls->options.keys = keys;
    pthread_mutex_unlock(&tls->mutex);
}

void srv_tls_close(struct srv_tls *tls) {
    stop(&tls->acceptor);
    pthread_mutex_lock(&tls->mutex);
    tls->is_closed = true;
    pthread_mutex_unlock(&tls->mutex);
}

void srv_tls_destroy(struct srv_tls **tls_pointer) {
    struct srv_tls *tls = *tls_pointer;
    *tls_pointer = NULL;
    if (!tls)
        return;
    srv_tls_close(tls);
    stop(&tls->relay);
    close(tls->options.socket);
    srv_tls_keys_unref(&tls->options.keys);
    release(tls);
}
