/* SPDX-License-Identifier: Apache-2.0 */
#include "http/deadlines.h"

#include <math.h>
#include <netinet/in.h>
#include <poll.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/fair_owners.h"
#include "common/fair_share.h"
#include "common/timer_heap.h"
#include "sp/log.h"

struct srv_connection {
    struct srv_connection *next, *previous;
    int socket;
    struct sockaddr_storage address;
    char peer[SRV_ADDRESS_TEXT];
    double deadline_ms;     /* INFINITY = none */
    struct srv_timer timer; /* fires at the deadline, or earlier if the deadline was moved */
    unsigned requests;
    bool is_owned;
    char owner[SRV_FAIR_OWNER_BYTES]; /* "": guests and requests without a token */
};

struct srv_deadlines {
    pthread_mutex_t mutex;
    struct srv_connection *list;
    struct srv_timer_heap timers;
    size_t count;
};

struct srv_deadlines *srv_deadlines_create(struct sp_error *err) {
    struct srv_deadlines *deadlines = calloc(1, sizeof *deadlines);
    if (!deadlines)
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for the list of connections");
    else
        pthread_mutex_init(&deadlines->mutex, NULL);
    return deadlines;
}

void srv_deadlines_destroy(struct srv_deadlines **deadlines) {
    if (*deadlines)
        pthread_mutex_destroy(&(*deadlines)->mutex);
    free(*deadlines);
    *deadlines = NULL;
}

/* Call with the mutex held. 0 = no deadline. */
static void set_deadline(struct srv_deadlines *deadlines, struct srv_connection *c,
                         double deadline_ms) {
    c->deadline_ms = deadline_ms > 0 ? deadline_ms : INFINITY;
    srv_timer_set_by(&deadlines->timers, &c->timer, c->deadline_ms);
}

struct srv_connection *srv_deadlines_open(struct srv_deadlines *deadlines, int socket,
                                          const struct sockaddr *peer, double deadline_ms) {
    struct srv_connection *c = calloc(1, sizeof *c);
    if (!c)
        return NULL;
    c->socket = socket;
    c->timer.of = c;
    if (peer)
        memcpy(&c->address, peer, srv_address_size(peer));
    srv_address_to_text((const struct sockaddr *)&c->address, c->peer);
    pthread_mutex_lock(&deadlines->mutex);
    c->next = deadlines->list;
    if (c->next)
        c->next->previous = c;
    deadlines->list = c;
    deadlines->count++;
    set_deadline(deadlines, c, deadline_ms);
    pthread_mutex_unlock(&deadlines->mutex);
    return c;
}

void srv_deadlines_close(struct srv_deadlines *deadlines, struct srv_connection *c) {
    pthread_mutex_lock(&deadlines->mutex);
    if (c->previous)
        c->previous->next = c->next;
    else
        deadlines->list = c->next;
    if (c->next)
        c->next->previous = c->previous;
    deadlines->count--;
    srv_timer_clear(&deadlines->timers, &c->timer);
    pthread_mutex_unlock(&deadlines->mutex);
    free(c);
}

void srv_deadlines_set(struct srv_deadlines *deadlines, struct srv_connection *c,
                       double deadline_ms) {
    pthread_mutex_lock(&deadlines->mutex);
    set_deadline(deadlines, c, deadline_ms);
    pthread_mutex_unlock(&deadlines->mutex);
}

void srv_deadlines_sweep(struct srv_deadlines *deadlines, double now_ms) {
    pthread_mutex_lock(&deadlines->mutex);
    for (struct srv_connection *c; (c = srv_timer_pop(&deadlines->timers, now_ms));) {
        if (c->deadline_ms > now_ms) {
            srv_timer_set(&deadlines->timers, &c->timer, c->deadline_ms);
            continue;
        }
        sp_log(SP_LOG_INFO,
               "connection of %s closed: it exceeded --header-time, --request-time or --idle-time",
               c->peer);
        shutdown(c->socket, SHUT_RDWR);
    }
    pthread_mutex_unlock(&deadlines->mutex);
}

void srv_deadlines_count(struct srv_deadlines *deadlines, const struct sockaddr *host, size_t *all,
                         size_t *same_host) {
    *same_host = 0;
    pthread_mutex_lock(&deadlines->mutex);
    *all = deadlines->count;
    for (const struct srv_connection *c = deadlines->list; c; c = c->next)
        if (srv_address_same_host((const struct sockaddr *)&c->address, host))
            (*same_host)++;
    pthread_mutex_unlock(&deadlines->mutex);
}

size_t srv_deadlines_connections(struct srv_deadlines *deadlines) {
    pthread_mutex_lock(&deadlines->mutex);
    size_t all = deadlines->count;
    pthread_mutex_unlock(&deadlines->mutex);
    return all;
}

static bool is_of(const struct srv_connection *c, const char *owner) {
    return c->is_owned && strcmp(c->owner, owner) == 0;
}

bool srv_deadlines_own(struct srv_deadlines *deadlines, struct srv_connection *connection,
                       const char *owner, bool is_limited, size_t most, size_t *own) {
    pthread_mutex_lock(&deadlines->mutex);
    bool ok = is_of(connection, owner);
    *own = 0;
    for (const struct srv_connection *c = deadlines->list; c && !ok; c = c->next)
        *own += is_of(c, owner);
    if (!ok) { /* the connection itself counts as free */
        const struct srv_pool pool = { most, deadlines->count - 1, *own };
        ok = srv_fair_left(&pool, is_limited) > 0;
    }
    if (ok) {
        connection->is_owned = true;
        snprintf(connection->owner, sizeof connection->owner, "%s", owner);
    }
    pthread_mutex_unlock(&deadlines->mutex);
    return ok;
}

bool srv_connection_is_gone(const struct srv_connection *connection) {
    struct pollfd look = { .fd = connection->socket, .events = POLLRDHUP };
    return poll(&look, 1, 0) > 0 && look.revents & (POLLRDHUP | POLLHUP | POLLERR);
}

unsigned srv_connection_count_request(struct srv_connection *connection) {
    return ++connection->requests;
}

const char *srv_connection_peer(const struct srv_connection *connection) {
    return connection->peer;
}

const struct sockaddr_storage *srv_connection_address(const struct srv_connection *connection) {
    return &connection->address;
}
