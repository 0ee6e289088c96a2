/* SPDX-License-Identifier: Apache-2.0 */
#include "http/streams.h"

#include <errno.h>
#include <math.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "common/clock.h"
#include "common/timer_heap.h"
#include "http/address.h"
#include "http/websocket.h"
#include "sp/log.h"

enum { EVENTS = 8, UNSENT_BYTES = 128 * 1024, DISCARD_BYTES = 64 * 1024 };
#define LINGER_MS 2000.0 /* for the peer to read the close frame and to close its side */

/* After the last byte was sent, a stream lingers: the socket is shut down for writing, and bytes
 * that still arrive are discarded until the peer closes. Otherwise a reset could destroy the close
 * frame before the peer reads it. */
struct stream {
    struct stream *next, **link; /* the list; `link` is the pointer that points to this stream */
    struct stream *next_dead;
    struct srv_timer timer; /* the next check by a tick */
    struct srv_stream_start start;
    struct srv_ws *ws; /* NULL while the stream lingers */
    uint8_t *extra;
    size_t extra_at, extra_size;
    uint32_t events;  /* watched by epoll */
    double linger_ms; /* when lingering began */
    bool dead;
};

struct srv_streams {
    struct srv_streams_options options;
    pthread_t thread;
    int epoll, wake;
    atomic_bool has_tick;        /* srv_streams_tick() was called and not handled yet */
    _Atomic double alive_ms;     /* when a tick was handled last */
    struct srv_ingress *ingress; /* used by the stream thread only */
    pthread_mutex_t mutex;
    pthread_cond_t gone;
    struct stream *inbox; /* guarded by mutex */
    size_t count;         /* streams of both lists; guarded by mutex */
    bool drain, stop;     /* guarded by mutex */
    /* The rest belongs to the stream thread. No event and no tick iterates over all streams. */
    struct stream *list, *dead;
    struct srv_timer_heap timers;
};

static void wake(struct srv_streams *s) {
    uint64_t one = 1;
    ssize_t written = write(s->wake, &one, sizeof one);
    (void)written; /* if the counter is full, the thread is awake already */
}

void srv_streams_ready(void *user) {
    wake(user);
}

void srv_streams_tick(struct srv_streams *s) {
    atomic_store(&s->has_tick, true);
    wake(s);
}

double srv_streams_alive_ms(const struct srv_streams *s) {
    return atomic_load(&s->alive_ms);
}

static void end(struct srv_streams *s, struct stream *stream) {
    if (stream->dead)
        return;
    stream->dead = true;
    stream->next_dead = s->dead;
    s->dead = stream;
}

static ssize_t stream_recv(void *user, uint8_t *bytes, size_t size) {
    struct stream *stream = user;
    size_t left = stream->extra_size - stream->extra_at;
    if (left == 0)
        return recv(stream->start.socket, bytes, size, 0);
    size_t take = left < size ? left : size;
    memcpy(bytes, stream->extra + stream->extra_at, take);
    stream->extra_at += take;
    return (ssize_t)take;
}

static ssize_t stream_send(void *user, const struct iovec *parts, size_t count, bool is_more) {
    struct stream *stream = user;
    const struct msghdr message = { .msg_iov = (struct iovec *)parts, .msg_iovlen = count };
    return sendmsg(stream->start.socket, &message, MSG_NOSIGNAL | (is_more ? MSG_MORE : 0));
}

static void watch(struct srv_streams *s, struct stream *stream) {
    uint32_t events = EPOLLRDHUP;
    if (!stream->ws || srv_ws_wants_read(stream->ws))
        events = EPOLLIN;
    else if (srv_ws_is_paused(stream->ws))
        events = EPOLLERR; /* reads the rest after the next tick, then the end */
    if (stream->ws && srv_ws_wants_write(stream->ws))
        events |= EPOLLOUT;
    if (events == stream->events)
        return;
    struct epoll_event event = { .events = events, .data.ptr = stream };
    int operation = stream->events ? EPOLL_CTL_MOD : EPOLL_CTL_ADD;
    if (epoll_ctl(s->epoll, operation, stream->start.socket, &event) != 0)
        end(s, stream);
    stream->events = events;
}

static void linger(struct srv_streams *s, struct stream *stream, double now_ms) {
    bool lost = srv_ws_is_lost(stream->ws);
    srv_ws_destroy(&stream->ws, now_ms);
    stream->linger_ms = now_ms;
    if (lost)
        sp_log_with(SP_LOG_INFO, SP_LOG_FIELDS({ "session", stream->start.session }),
                    "stream of session %s ended without a close frame", stream->start.session);
    if (lost || shutdown(stream->start.socket, SHUT_WR) != 0)
        end(s, stream);
}

/* Sends what the socket takes, then updates the events to watch. */
static void send_and_watch(struct srv_streams *s, struct stream *stream, double now_ms) {
    if (stream->ws)
        srv_ws_write(stream->ws, now_ms);
    if (stream->ws && srv_ws_is_over(stream->ws))
        linger(s, stream, now_ms);
    if (!stream->dead)
        watch(s, stream);
}

/* Call after every event of a stream. The next tick checks its time limits. */
static void settle(struct srv_streams *s, struct stream *stream, double now_ms) {
    send_and_watch(s, stream, now_ms);
    srv_timer_set_by(&s->timers, &stream->timer, now_ms);
}

static void discard(struct srv_streams *s, struct stream *stream) {
    uint8_t bytes[DISCARD_BYTES / 16];
    ssize_t got;
    size_t left = DISCARD_BYTES;
    do {
        got = recv(stream->start.socket, bytes, sizeof bytes, 0);
        left -= got > 0 ? (size_t)got : 0;
    } while (got > 0 && left >= sizeof bytes);
    if (got == 0 || (got < 0 && errno != EAGAIN && errno != EINTR))
        end(s, stream);
}

static void on_event(struct srv_streams *s, struct stream *stream, uint32_t events, double now_ms) {
    if (!stream->ws)
        discard(s, stream);
    else if (events & (EPOLLERR | EPOLLHUP) ||
             ((events & EPOLLRDHUP) && !srv_ws_wants_read(stream->ws))) {
        sp_log_with(SP_LOG_INFO, SP_LOG_FIELDS({ "session", stream->start.session }),
                    "stream of session %s cut off by its client (events %x)", stream->start.session,
                    events);
        end(s, stream); /* the client cannot read an answer any more */
    } else if (events & EPOLLIN)
        srv_ws_read(stream->ws, now_ms);
    if (!stream->dead)
        settle(s, stream, now_ms);
}

/* Reads bytes that arrived with the handshake: epoll does not report bytes that are already
 * buffered. */
static void read_extra(struct stream *stream, double now_ms) {
    while (stream->ws && stream->extra_at < stream->extra_size && srv_ws_wants_read(stream->ws))
        srv_ws_read(stream->ws, now_ms);
}

static double stream_clock_ms(void *user) {
    (void)user;
    return srv_clock_ms();
}

static void begin(struct srv_streams *s, struct stream *stream, double now_ms) {
    int on = 1, unsent = UNSENT_BYTES;
    char peer[SRV_ADDRESS_TEXT];
    struct sp_error err;
    srv_address_to_text((const struct sockaddr *)&stream->start.peer, peer);
    setsockopt(stream->start.socket, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    /* A newer frame cannot replace bytes that are already in the kernel. */
    setsockopt(stream->start.socket, IPPROTO_TCP, TCP_NOTSENT_LOWAT, &unsent, sizeof unsent);
    struct srv_ws_options options = { .hub = s->options.hub,
                                      .ingress = s->ingress,
                                      .metrics = s->options.metrics,
                                      .session = stream->start.session,
                                      .role = stream->start.role,
                                      .token = stream->start.token,
                                      .user = stream,
                                      .peer = peer,
                                      .message_bytes = s->options.message_bytes,
                                      .ping_ms = s->options.ping_ms,
                                      .stall_ms = s->options.stall_ms,
                                      .transport = { stream, stream_recv, stream_send,
                                                     stream_clock_ms } };
    stream->ws = srv_ws_create(&options, now_ms, &err);
    if (!stream->ws) {
        sp_log_with(SP_LOG_WARN,
                    SP_LOG_FIELDS({ "session", stream->start.session }, { "peer", peer }),
                    "stream of %s refused: %s", peer, err.text);
        end(s, stream);
        return;
    }
    sp_log_with(SP_LOG_INFO, SP_LOG_FIELDS({ "session", stream->start.session }, { "peer", peer }),
                "stream of %s joined session %s for %s", peer, stream->start.session,
                stream->start.role == SRV_ROLE_CONTROL ? "control" : "view");
    read_extra(stream, now_ms);
    settle(s, stream, now_ms);
}

static void reap(struct srv_streams *s, double now_ms) {
    size_t gone = 0;
    while (s->dead) {
        struct stream *stream = s->dead;
        s->dead = stream->next_dead;
        *stream->link = stream->next;
        if (stream->next)
            stream->next->link = stream->link;
        srv_timer_clear(&s->timers, &stream->timer);
        srv_ws_destroy(&stream->ws, now_ms);
        if (stream->events)
            epoll_ctl(s->epoll, EPOLL_CTL_DEL, stream->start.socket, NULL);
        stream->start.close(stream->start.owner);
        free(stream->extra);
        free(stream);
        gone++;
    }
    if (gone == 0)
        return;
    pthread_mutex_lock(&s->mutex);
    s->count -= gone;
    pthread_cond_broadcast(&s->gone);
    pthread_mutex_unlock(&s->mutex);
}

static void tick_stream(struct srv_streams *s, struct stream *stream, double now_ms) {
    if (stream->ws) {
        srv_ws_tick(stream->ws, now_ms);
        read_extra(stream, now_ms);
    } else if (now_ms - stream->linger_ms > LINGER_MS) {
        end(s, stream);
    }
    if (stream->dead)
        return;
    send_and_watch(s, stream, now_ms);
    bool has_extra = stream->extra_at < stream->extra_size;
    double due_ms = !stream->ws ? stream->linger_ms + LINGER_MS
                    : has_extra ? now_ms
                                : srv_ws_deadline_ms(stream->ws);
    srv_timer_set(&s->timers, &stream->timer, fmax(due_ms, now_ms + SRV_STREAMS_TICK_MS / 2));
}

static void tick(struct srv_streams *s, double now_ms) {
    srv_ingress_tick(s->ingress);
    for (struct stream *stream; (stream = srv_timer_pop(&s->timers, now_ms));)
        if (!stream->dead)
            tick_stream(s, stream, now_ms);
    atomic_store(&s->alive_ms, now_ms);
}

/* Takes over new streams, and closes all when draining. False: stop. */
static bool apply_orders(struct srv_streams *s, bool *draining, double now_ms) {
    pthread_mutex_lock(&s->mutex);
    struct stream *inbox = s->inbox;
    s->inbox = NULL;
    bool stop = s->stop, drain = s->drain;
    pthread_mutex_unlock(&s->mutex);
    while (inbox) {
        struct stream *stream = inbox;
        inbox = stream->next;
        stream->next = s->list;
        stream->link = &s->list;
        if (s->list)
            s->list->link = &stream->next;
        s->list = stream;
        begin(s, stream, now_ms);
        if (*draining && stream->ws)
            srv_ws_close(stream->ws, 1001, "the daemon is shutting down", now_ms);
    }
    if (drain && !*draining) {
        *draining = true;
        for (struct stream *stream = s->list; stream; stream = stream->next)
            if (stream->ws) {
                srv_ws_write(stream->ws, now_ms); /* sends the notification of the shutdown first */
                srv_ws_close(stream->ws, 1001, "the daemon is shutting down", now_ms);
                settle(s, stream, now_ms);
            }
    }
    return !stop;
}

static void *stream_main(void *user) {
    struct srv_streams *s = user;
    struct epoll_event events[EVENTS];
    bool draining = false;
    for (;;) {
        int count = epoll_wait(s->epoll, events, EVENTS, -1);
        for (int i = 0; i < count; i++) {
            uint64_t counter;
            if (events[i].data.ptr)
                on_event(s, events[i].data.ptr, events[i].events, srv_clock_ms());
            else if (read(s->wake, &counter, sizeof counter) < 0 && errno != EAGAIN)
                sp_log(SP_LOG_ERROR, "the stream thread's wake-up failed: %s", strerror(errno));
        }
        double now_ms = srv_clock_ms(); /* not before the time at which bytes were read */
        if (!apply_orders(s, &draining, now_ms))
            break;
        for (struct stream *stream; (stream = srv_hub_pop_ready(s->options.hub));)
            settle(s, stream, now_ms);
        if (atomic_exchange(&s->has_tick, false))
            tick(s, now_ms);
        reap(s, now_ms);
    }
    for (struct stream *stream = s->list; stream; stream = stream->next)
        end(s, stream);
    reap(s, srv_clock_ms());
    return NULL;
}

struct srv_streams *srv_streams_create(const struct srv_streams_options *options,
                                       struct sp_error *err) {
    struct srv_streams *s = calloc(1, sizeof *s);
    if (!s || !(s->ingress = srv_ingress_create(options->message_bytes))) {
        free(s);
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for the stream thread");
        return NULL;
    }
    s->options = *options;
    atomic_init(&s->has_tick, false);
    atomic_init(&s->alive_ms, srv_clock_ms());
    pthread_mutex_init(&s->mutex, NULL);
    srv_clock_cond_init(&s->gone);
    s->epoll = epoll_create1(EPOLL_CLOEXEC);
    s->wake = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    struct epoll_event event = { .events = EPOLLIN, .data.ptr = NULL };
    int failed =
        s->epoll < 0 || s->wake < 0 || epoll_ctl(s->epoll, EPOLL_CTL_ADD, s->wake, &event) != 0
            ? errno
            : pthread_create(&s->thread, NULL, stream_main, s);
    if (!failed)
        return s;
    sp_fail(err, SP_ERR_IO, NULL, "cannot start the stream thread: %s", strerror(failed));
    if (s->epoll >= 0)
        close(s->epoll);
    if (s->wake >= 0)
        close(s->wake);
    srv_ingress_destroy(&s->ingress);
    free(s);
    return NULL;
}

bool srv_streams_add(struct srv_streams *s, const struct srv_stream_start *start) {
    struct stream *stream = calloc(1, sizeof *stream);
    if (!stream)
        return false;
    stream->start = *start;
    stream->timer.of = stream;
    if (start->extra_size > 0) {
        stream->extra = malloc(start->extra_size);
        if (!stream->extra) {
            free(stream);
            return false;
        }
        memcpy(stream->extra, start->extra, start->extra_size);
        stream->extra_size = start->extra_size;
    }
    stream->start.extra = NULL;
    pthread_mutex_lock(&s->mutex);
    stream->next = s->inbox;
    s->inbox = stream;
    s->count++;
    pthread_mutex_unlock(&s->mutex);
    wake(s);
    return true;
}

void srv_streams_drain(struct srv_streams *s) {
    struct timespec until;
    clock_gettime(CLOCK_MONOTONIC, &until);
    until.tv_sec += 3;
    pthread_mutex_lock(&s->mutex);
    s->drain = true;
    wake(s);
    while (s->count > 0)
        if (pthread_cond_timedwait(&s->gone, &s->mutex, &until) == ETIMEDOUT)
            break;
    pthread_mutex_unlock(&s->mutex);
}

void srv_streams_destroy(struct srv_streams **streams) {
    struct srv_streams *s = *streams;
    *streams = NULL;
    if (!s)
        return;
    pthread_mutex_lock(&s->mutex);
    s->stop = true;
    pthread_mutex_unlock(&s->mutex);
    wake(s);
    pthread_join(s->thread, NULL);
    close(s->epoll);
    close(s->wake);
    pthread_cond_destroy(&s->gone);
    pthread_mutex_destroy(&s->mutex);
    srv_ingress_destroy(&s->ingress);
    free(s);
}
