/* SPDX-License-Identifier: Apache-2.0
 *
 * The stream of one client: translates its WebSocket messages into calls of the session hub, and
 * the frames and messages of its outbox into WebSocket messages.
 *
 *   open ──(close queued, peer closed, error)──► closing ──(sent)──► closed
 *
 * Everything is bounded. Reading stops while 64 messages wait to be sent, and until the next tick
 * when the client has used up its ingress quota (ingress_quota.h). Notifications wait for the next
 * tick when their quota is used up. One srv_ws_read() reads only a few KiB, so that frames are sent
 * even during a flood. One frame is in the socket's buffer and one in the outbox; clients that get
 * the same image share both.
 *
 * wslay frames and queues text messages. An image bypasses it: it is sent from its blob, without a
 * copy, after all queued messages and before any later one. One thread at a time.
 */
#ifndef SRV_HTTP_WEBSOCKET_H
#define SRV_HTTP_WEBSOCKET_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>
#include <sys/uio.h>

#include "http/ingress_quota.h"
#include "session/participant.h"

struct srv_ws;

struct srv_ws_transport { /* like recv() and sendmsg() on a non-blocking socket, with errno */
    void *user;
    ssize_t (*recv)(void *user, uint8_t *bytes, size_t size);
    /* is_more: more bytes follow at once, so that one packet may hold both. */
    ssize_t (*send)(void *user, const struct iovec *parts, size_t count, bool is_more);
    /* The time in ms after recv() returned bytes, which may have arrived after the caller took its
     * own time: a round trip ends when its bytes were read. */
    double (*clock_ms)(void *user);
};

struct srv_ws_options {
    struct srv_hub *hub;
    struct srv_ingress *ingress;
    struct srv_metrics *metrics; /* NULL = no metrics */
    const char *session;
    enum srv_role role;
    const char *token; /* for srv_hub_join(); copied */
    void *user;        /* what srv_hub_pop_ready() returns for it */
    const char *peer;  /* for the log; copied */
    size_t message_bytes;
    double ping_ms, stall_ms;
    struct srv_ws_transport transport;
};

/* Joins the session. NULL with *err set. */
struct srv_ws *srv_ws_create(const struct srv_ws_options *options, double now_ms,
                             struct sp_error *err);
void srv_ws_destroy(struct srv_ws **ws, double now_ms); /* leaves the session */

void srv_ws_read(struct srv_ws *ws, double now_ms); /* the transport may have bytes */
void srv_ws_write(struct srv_ws *ws,
                  double now_ms); /* the transport may take bytes, or there are messages */
/* Checks pings and time limits. Call after srv_ingress_tick(). */
void srv_ws_tick(struct srv_ws *ws, double now_ms);
/* Returns when srv_ws_tick() has work if nothing else happens until then. A time in the past means
 * the next tick. After any event the caller ticks at the next tick at the latest. */
double srv_ws_deadline_ms(const struct srv_ws *ws);
/* Queues a close frame; `reason` is a constant string of at most 123 bytes. */
void srv_ws_close(struct srv_ws *ws, uint16_t code, const char *reason, double now_ms);

bool srv_ws_wants_read(const struct srv_ws *ws);
bool srv_ws_is_paused(const struct srv_ws *ws); /* it will read again after the next tick */
bool srv_ws_wants_write(const struct srv_ws *ws);
bool srv_ws_is_over(const struct srv_ws *ws); /* nothing left to send or receive */
bool srv_ws_is_lost(const struct srv_ws *ws); /* over, and the peer cannot be reached any more */

#endif
