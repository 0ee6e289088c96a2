/* SPDX-License-Identifier: Apache-2.0
 *
 * Limits how many bytes the clients of all streams may send from one tick to the next. One thread
 * reads and handles all of them, and also sends the frames of all clients.
 *
 *   all ──► owners of sessions ──► their sessions ──► their streams
 *
 * The quota has two halves. The first half is divided equally among owners, each owner's part among
 * its sessions, and each session's part among its streams. No other client can use up such a part,
 * so that acknowledgements and drags of a view are read at once. The second half goes to the stream
 * that asks first. The sum is bounded for any number of streams.
 *
 * Each stream also has a limit of its own, which allows one message of the maximal size at once.
 *
 * The unit is bytes, a frame as SRV_INGRESS_FRAME_BYTES of them more: a small
 * message costs the thread about as much as so many bytes of a large one. One thread at a time.
 */
#ifndef SRV_HTTP_INGRESS_QUOTA_H
#define SRV_HTTP_INGRESS_QUOTA_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum {
    SRV_INGRESS_FRAME_BYTES = 512,
    SRV_INGRESS_TICK_BYTES = 512 * 1024,  /* of all streams together */
    SRV_INGRESS_STREAM_BYTES = 32 * 1024, /* of one, on average */
};

struct srv_ingress;
struct srv_ingress_node;

struct srv_ingress_stream { /* private, but for where it lies */
    struct srv_ingress *ingress;
    struct srv_ingress_node *session;
    uint64_t tick; /* that the rest is of */
    int64_t left;  /* less than 0: a piece was larger than what was left */
    int64_t sure;  /* taken of its part of the half that is shared out */
};

/* `message_bytes`: of the longest message. NULL when out of memory. */
struct srv_ingress *srv_ingress_create(size_t message_bytes);
/* After the last stream was closed. */
void srv_ingress_destroy(struct srv_ingress **ingress);
void srv_ingress_tick(struct srv_ingress *ingress);

/* False when out of memory. The names are copied; an owner's may be empty. */
bool srv_ingress_open(struct srv_ingress *ingress, const char *owner, const char *session,
                      struct srv_ingress_stream *stream);
/* Of a stream that was not opened: nothing. */
void srv_ingress_close(struct srv_ingress_stream *stream);

/* May more be read of it before the next tick? */
bool srv_ingress_has(const struct srv_ingress_stream *stream);
void srv_ingress_take(struct srv_ingress_stream *stream, size_t bytes);

#endif
