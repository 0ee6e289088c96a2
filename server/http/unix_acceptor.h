/* SPDX-License-Identifier: Apache-2.0
 *
 * Accepts the connections of the Unix socket (UNIX.md).
 *
 *   accepted ─► first byte ─► HTTP: handed to give()
 *                   └───────► array: received and answered here (unix_passing.h)
 *
 * One thread does this with one epoll, so a slow client delays no other. A connection has a
 * deadline for its first byte, and for the whole message of an array. If too many wait, the oldest
 * one ends.
 */
#ifndef SRV_HTTP_UNIX_ACCEPTOR_H
#define SRV_HTTP_UNIX_ACCEPTOR_H

#include "http/arrays.h"
#include "http/unix_socket.h"
#include "ops/metrics.h"

struct srv_unix_acceptor;
struct srv_tokens;

enum { SRV_UNIX_WAITING_MAX = 64 };

struct srv_unix_options {
    const char *path;
    double wait_ms; /* deadline of a connection that waits here */
    struct srv_arrays *arrays;
    struct srv_tokens *tokens;
    struct srv_metrics *metrics; /* NULL = refusals are not counted */
    void *user;
    /* Takes ownership of the connection, also on failure. */
    void (*give)(void *user, int socket, const struct sockaddr *peer, socklen_t size);
};

/* Listens and starts the thread. NULL with *err set. */
struct srv_unix_acceptor *srv_unix_acceptor_create(const struct srv_unix_options *options,
                                                   struct sp_error *err);
/* Ends the thread and the connections that wait, and removes the socket's file. give() is not
 * called after it returns. Accepts NULL. */
void srv_unix_acceptor_destroy(struct srv_unix_acceptor **acceptor);

#endif
