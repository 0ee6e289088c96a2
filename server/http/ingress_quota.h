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
 * What is said is counted in bytes, a frame as SRV_INTAKE_FRAME of them more: a small message costs
 * the thread about as much as so many bytes of a large one. One thread at a time.
 */
#ifndef SRV_HTTP_INTAKE_H
#define SRV_HTTP_INTAKE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum {
    SRV_INTAKE_FRAME = 512,
    SRV_INTAKE_ALL = 512 * 1024,   /* of all streams together */
    SRV_INTAKE_STREAM = 32 * 1024, /* of one, on average */
};

struct srv_intake;
struct srv_intake_node;

struct srv_intake_stream { /* private, but for where it lies */
    struct srv_intake *intake;
    struct srv_intake_node *session;
    uint64_t tick; /* that the rest is of */
    int64_t left;  /* less than 0: a piece was larger than what was left */
    int64_t sure;  /* taken of its part of the half that is shared out */
};

/* `message_bytes`: of the longest message. NULL when out of memory. */
struct srv_intake *srv_intake_create(size_t message_bytes);
/* After the last stream was closed. */
void srv_intake_destroy(struct srv_intake **intake);
void srv_intake_tick(struct srv_intake *intake);

/* False when out of memory. The names are copied; an owner's may be empty. */
bool srv_intake_open(struct srv_intake *intake, const char *owner, const char *session,
                     struct srv_intake_stream *stream);
/* Of a stream that was not opened: nothing. */
void srv_intake_close(struct srv_intake_stream *stream);

/* May more be read of it before the next tick? */
bool srv_intake_has(const struct srv_intake_stream *stream);
void srv_intake_take(struct srv_intake_stream *stream, size_t bytes);

#endif
