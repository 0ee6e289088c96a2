/* SPDX-License-Identifier: Apache-2.0
 *
 * The list of open connections, and a deadline for each. The time limit of the HTTP library starts
 * again with every byte, so that a client that sends one byte per second would stay forever. Here
 * each phase of a connection has a deadline:
 *
 *   accepted ──header-time──► headers ──request-time──► body │ rendering: none │
 *      ──request-time──► answer read ──idle-time──► next headers …
 *
 * A connection past its deadline is shut down. All functions are thread-safe.
 */
#ifndef SRV_HTTP_DEADLINES_H
#define SRV_HTTP_DEADLINES_H

#include <stdbool.h>
#include <stddef.h>
#include <sys/socket.h>

#include "http/address.h"
#include "sp/status.h"

struct srv_deadlines;
struct srv_connection; /* one connection */

struct srv_deadlines *srv_deadlines_create(struct sp_error *err);
void srv_deadlines_destroy(
    struct srv_deadlines **deadlines); /* after the last connection was closed */

/* Adds a connection; NULL when out of memory. `peer` NULL = unknown. deadline_ms as in
 * srv_deadlines_set(). */
struct srv_connection *srv_deadlines_open(struct srv_deadlines *deadlines, int socket,
                                          const struct sockaddr *peer, double deadline_ms);
void srv_deadlines_close(struct srv_deadlines *deadlines, struct srv_connection *connection);
/* True if the peer closed its side or the connection is broken. Reads nothing. */
bool srv_connection_is_gone(const struct srv_connection *connection);
/* Sets the deadline, in milliseconds of srv_clock_ms(); 0 = no deadline. */
void srv_deadlines_set(struct srv_deadlines *deadlines, struct srv_connection *connection,
                       double deadline_ms);
/* Shuts down the connections whose deadline has passed. */
void srv_deadlines_sweep(struct srv_deadlines *deadlines, double now_ms);
/* Counts all open connections, and those from the address `host`. */
void srv_deadlines_count(struct srv_deadlines *deadlines, const struct sockaddr *host, size_t *all,
                         size_t *same_host);

size_t srv_deadlines_connections(struct srv_deadlines *deadlines);

/* Makes `owner`, the sender of the newest request, the owner of the connection. False if the owner
 * is limited and already has its share of `most` connections (common/fair_share.h). *own is the
 * number of its connections. */
bool srv_deadlines_own(struct srv_deadlines *deadlines, struct srv_connection *connection,
                       const char *owner, bool is_limited, size_t most, size_t *own);

/* Counts one more request and returns the number of requests of the connection so far. Only for the
 * thread that serves the connection. */
unsigned srv_connection_count_request(struct srv_connection *connection);
/* Address of the peer; constant while the connection is open. */
const char *srv_connection_peer(const struct srv_connection *connection);
const struct sockaddr_storage *srv_connection_address(const struct srv_connection *connection);

#endif
