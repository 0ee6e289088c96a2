/* SPDX-License-Identifier: Apache-2.0
 *
 * Every open connection, from accept to close: who may stay, and until when. The HTTP library's own
 * time limit starts anew with each byte, so that a client which sends one byte a second would stay
 * for ever; here each phase has a deadline:
 *
 *   accepted ──header-time──► headers ──request-time──► body │ rendering: none │
 *      ──request-time──► answer read ──idle-time──► next headers …
 *
 * A connection past its deadline is shut down. All functions are thread-safe.
 */
#ifndef SRV_HTTP_GUARD_H
#define SRV_HTTP_GUARD_H

#include <stdbool.h>
#include <stddef.h>
#include <sys/socket.h>

#include "http/address.h"
#include "sp/status.h"

struct srv_guard;
struct srv_guarded; /* one connection */

struct srv_guard *srv_guard_create(struct sp_error *err);
void srv_guard_destroy(struct srv_guard **guard); /* after the last connection was closed */

/* NULL when out of memory. */
struct srv_guarded *srv_guard_open(struct srv_guard *guard, int socket, const struct sockaddr *peer,
                                   double deadline_ms);
void srv_guard_close(struct srv_guard *guard, struct srv_guarded *connection);
/* Did the peer close its side, or is it gone altogether? Does not read what it sent. */
bool srv_guard_is_gone(const struct srv_guarded *connection);
/* 0 = none. */
void srv_guard_set_deadline(struct srv_guard *guard, struct srv_guarded *connection,
                            double deadline_ms);
/* Shuts down what is past its deadline. */
void srv_guard_sweep(struct srv_guard *guard, double now_ms);
/* Open connections, and those from this host. */
void srv_guard_count(struct srv_guard *guard, const struct sockaddr *host, size_t *all,
                     size_t *same_host);

size_t srv_guard_all(struct srv_guard *guard);

/* Constant while the connection is open. */
/* Counts one more request of a connection; returns how many there were with it. For the thread that
 * has the connection. */
unsigned srv_guard_count_request(struct srv_guarded *connection);
const char *srv_guard_peer(const struct srv_guarded *connection);
const struct sockaddr_storage *srv_guard_address(const struct srv_guarded *connection);

#endif
