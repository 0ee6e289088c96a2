/* SPDX-License-Identifier: Apache-2.0
 *
 * A stream without a socket: the test is the client and passes the time.
 */
#ifndef UNIT_SERVER_HTTP_WEBSOCKET_FIXTURE_H
#define UNIT_SERVER_HTTP_WEBSOCKET_FIXTURE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "http/websocket.h"

enum { CAPACITY = 1 << 20 };

struct wire { /* bytes from the client, and bytes to it */
    uint8_t *in, *out;
    size_t in_size, in_at, out_size;
    double clock_ms; /* when bytes were read, if later than the time that the test passes */
    bool is_full;    /* the transport is full */
    size_t piece;    /* bytes taken by every second send(); 0 = everything, each time */
    bool took;
};

struct stream {
    void *fixture;
    struct srv_ingress *ingress;
    struct wire wire;
    struct srv_ws *ws;
};

struct sent { /* one frame of RFC 6455 */
    uint8_t first;
    const uint8_t *bytes;
    size_t size;
};

/* Decodes the frame at *at and moves *at past it. False at the end of the bytes. */
bool next_sent(const struct wire *wire, size_t *at, struct sent *sent);
/* Joins a client to a session of the hub. */
struct srv_ws *stream_join(struct stream *s, const char *session, struct wire *wire);
int stream_set_up(void **state);
int stream_tear_down(void **state);
/* Appends a masked text frame from the client; the mask is zero. */
void send_text(struct wire *wire, const char *text, size_t size);
void send_pings(struct wire *wire, unsigned count);
/* Returns the number of answers sent so far. */
unsigned answers(const struct wire *wire);
void stream_tick(struct stream *s, double now_ms);
/* Runs everything that the stream thread does until the next tick. */
void stream_run(struct stream *s, double now_ms);
/* Returns the code of the close frame, which must be the last frame; 0 = no close frame. */
unsigned close_code(const struct wire *wire);
/* Delivers an image of `size` bytes to the participant. The caller owns the reference. */
struct srv_blob *deliver(struct stream *s, size_t size, double now_ms);

#endif
