/* SPDX-License-Identifier: Apache-2.0
 *
 * How much the clients of all streams may say from one tick to the next: what they say is read and
 * judged by one thread, which also sends everybody's frames.
 *
 *   all ──► owners of sessions ──► their sessions ──► their streams
 *
 * There are two halves. One is shared out: an owner's part is the same as another one's, so is that
 * of a session among its owner's and of a stream among its session's, and nobody else can use it
 * up. So acknowledgements and the drag of a view are read at once, whatever others send. The other
 * half is for whoever comes first. However many streams there are, the sum has a bound.
 *
 * A stream has a bound of its own, too, with room for one long message at once.
 *
 * What is said is counted in bytes, a frame as SRV_INGRESS_FRAME_BYTES of them more: a small
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
