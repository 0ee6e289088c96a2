/* SPDX-License-Identifier: Apache-2.0 */
#include "http/deadlines.h"

#include <math.h>
#include <netinet/in.h>
#include <poll.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "common/timer_heap.h"
#include "sp/log.h"

struct srv_guarded {
    struct srv_guarded *next, *previous;
    int socket;
    struct sockaddr_storage address;
    char peer[SRV_ADDRESS_TEXT];
    double deadline_ms; /* INFINITY = none */
    struct srv_due due; /* the sweep looks at it no later than that */
    unsigned requests;
};

struct srv_guard {
    pthread_mutex_t mutex;
    struct srv_guarded *list;
    struct srv_dues dues;
    size_t count;
};

struct srv_guard *srv_guard_create(struct sp_error *err) {
    struct srv_guard *guard = calloc(1, sizeof *guard);
    if (!guard)
        sp_fail(err, SP_ERR_MEMORY, NULL, "no memory for the list of connections");
    else
        pthread_mutex_init(&guard->mutex, NULL);
    return guard;
}

void srv_guard_destroy(struct srv_guard **guard) {
    if (*guard)
        pthread_mutex_destroy(&(*guard)->mutex);
    free(*guard);
    *guard = NULL;
}

/* With the mutex held. 0 = none. */
static void set_deadline(struct srv_guard *guard, struct srv_guarded *c, double deadline_ms) {
    c->deadline_ms = deadline_ms > 0 ? deadline_ms : INFINITY;
    srv_due_set_by(&guard->dues, &c->due, c->deadline_ms);
}

struct srv_guarded *srv_guard_open(struct srv_guard *guard, int socket, const struct sockaddr *peer,
                                   double deadline_ms) {
    struct srv_guarded *c = calloc(1, sizeof *c);
    if (!c)
        return NULL;
    c->socket = socket;
    c->due.of = c;
    if (peer)
        memcpy(&c->address, peer,
               peer->sa_family == AF_INET6 ? sizeof(struct sockaddr_in6)
                                           : sizeof(struct sockaddr_in));
    srv_address_to_text((const struct sockaddr *)&c->address, c->peer);
    pthread_mutex_lock(&guard->mutex);
    c->next = guard->list;
    if (c->next)
        c->next->previous = c;
    guard->list = c;
    guard->count++;
    set_deadline(guard, c, deadline_ms);
    pthread_mutex_unlock(&guard->mutex);
    return c;
}

void srv_guard_close(struct srv_guard *guard, struct srv_guarded *c) {
    pthread_mutex_lock(&guard->mutex);
    if (c->previous)
        c->previous->next = c->next;
    else
        guard->list = c->next;
    if (c->next)
        c->next->previous = c->previous;
    guard->count--;
    srv_due_clear(&guard->dues, &c->due);
    pthread_mutex_unlock(&guard->mutex);
    free(c);
}

void srv_guard_set_deadline(struct srv_guard *guard, struct srv_guarded *c, double deadline_ms) {
    pthread_mutex_lock(&guard->mutex);
    set_deadline(guard, c, deadline_ms);
    pthread_mutex_unlock(&guard->mutex);
}

void srv_guard_sweep(struct srv_guard *guard, double now_ms) {
    pthread_mutex_lock(&guard->mutex);
    for (struct srv_guarded *c; (c = srv_due_take(&guard->dues, now_ms));) {
        if (c->deadline_ms > now_ms) {
            srv_due_set(&guard->dues, &c->due, c->deadline_ms);
            continue;
        }
        sp_log(SP_LOG_INFO,
               "connection of %s closed: past --header-time, --request-time or --idle-time",
               c->peer);
        shutdown(c->socket, SHUT_RDWR);
    }
    pthread_mutex_unlock(&guard->mutex);
}

void srv_guard_count(struct srv_guard *guard, const struct sockaddr *host, size_t *all,
                     size_t *same_host) {
    *same_host = 0;
    pthread_mutex_lock(&guard->mutex);
    *all = guard->count;
    for (const struct srv_guarded *c = guard->list; c; c = c->next)
        if (srv_address_same_host((const struct sockaddr *)&c->address, host))
            (*same_host)++;
    pthread_mutex_unlock(&guard->mutex);
}

size_t srv_guard_all(struct srv_guard *guard) {
    pthread_mutex_lock(&guard->mutex);
    size_t all = guard->count;
    pthread_mutex_unlock(&guard->mutex);
    return all;
}

bool srv_guard_is_gone(const struct srv_guarded *connection) {
    struct pollfd look = { .fd = connection->socket, .events = POLLRDHUP };
    return poll(&look, 1, 0) > 0 && look.revents & (POLLRDHUP | POLLHUP | POLLERR);
}

unsigned srv_guard_count_request(struct srv_guarded *connection) {
    return ++connection->requests;
}

const char *srv_guard_peer(const struct srv_guarded *connection) {
    return connection->peer;
}

const struct sockaddr_storage *srv_guard_address(const struct srv_guarded *connection) {
    return &connection->address;
}
