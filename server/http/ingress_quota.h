/* SPDX-License-Identifier: Apache-2.0
 *
 * Limits how many bytes the clients of all streams may send from one tick to the next. One thread
 * reads and handles all of them, and also sends the frames of all clients. The same limits hold
 * once more for the notifications that the thread makes for the streams, which may wait: one
 * client's small change can cause a long notification to each participant.
 *
 *   all ──► owners of sessions ──► their sessions ──► their streams
 *
 * A quota has two halves. The first half is divided equally among owners, each owner's part among
 * its sessions, and each session's part among its streams. No other client can use up such a part,
 * so that acknowledgements and drags of a view are read at once. The second half goes to the stream
 * that asks first. The sum is bounded for any number of streams.
 *
 * Each stream also has a limit of its own, which allows one message of the maximal size at once.
 *
 * The unit is bytes. Of what the thread reads, each WebSocket frame counts SRV_INGRESS_FRAME_BYTES
 * more, because a small message costs the thread about as much as that many bytes of a large one. A
 * byte of an answer counts SRV_INGRESS_ANSWER bytes: the thread makes it from numbers and sends it.
 * One thread at a time.
 */
#ifndef SRV_HTTP_INGRESS_QUOTA_H
#define SRV_HTTP_INGRESS_QUOTA_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum {
    SRV_INGRESS_FRAME_BYTES = 512,
    SRV_INGRESS_ANSWER = 4,
    SRV_INGRESS_TICK_BYTES = 512 * 1024,  /* of all streams together, per tick */
    SRV_INGRESS_STREAM_BYTES = 32 * 1024, /* of one stream, per tick on average */
};

enum srv_ingress_kind { SRV_INGRESS_READ, SRV_INGRESS_NOTIFY, SRV_INGRESS_KINDS };

struct srv_ingress;
struct srv_ingress_node;

struct srv_ingress_account { /* private */
    int64_t left;            /* own limit; negative if the last piece was larger than the rest */
    int64_t sure;            /* bytes taken from its own part of the divided half */
};

struct srv_ingress_stream { /* private; the caller owns the memory */
    struct srv_ingress *ingress;
    struct srv_ingress_node *session;
    uint64_t tick; /* to which the accounts belong */
    struct srv_ingress_account accounts[SRV_INGRESS_KINDS];
};

/* `message_bytes`: the size of the longest message. NULL when out of memory. */
struct srv_ingress *srv_ingress_create(size_t message_bytes);
/* After the last stream was closed. */
void srv_ingress_destroy(struct srv_ingress **ingress);
void srv_ingress_tick(struct srv_ingress *ingress);

/* Adds a stream. False when out of memory. Copies the names; the owner's may be empty. */
bool srv_ingress_open(struct srv_ingress *ingress, const char *owner, const char *session,
                      struct srv_ingress_stream *stream);
/* Does nothing for a stream that was not opened. */
void srv_ingress_close(struct srv_ingress_stream *stream);

/* True if more may be read from the stream, or made for it, before the next tick. */
bool srv_ingress_has(const struct srv_ingress_stream *stream, enum srv_ingress_kind kind);
void srv_ingress_charge(struct srv_ingress_stream *stream, enum srv_ingress_kind kind,
                        size_t bytes);

#endif
