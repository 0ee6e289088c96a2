/* SPDX-License-Identifier: Apache-2.0
 *
 * Encoded frames on their way to one client's socket. The outbox holds one frame, the newest; the
 * stream thread writes another one to the socket. Clients that see the same image share its bytes
 * (blob.h); only the header differs.
 */
#ifndef SRV_SESSION_OUTBOX_H
#define SRV_SESSION_OUTBOX_H

#include <stdbool.h>
#include <stdint.h>

#include "protocol/frame_header.h"
#include "session/blob.h"

/* A frame of a video: `number` since the key frame that began the epoch. Epochs are unique and
 * never 0. */
struct srv_video_mark {
    uint64_t epoch;
    uint32_t number;
};

struct srv_outbox {
    struct srv_blob *blob; /* NULL = empty */
    struct proto_frame_header header;
    double updated_ms; /* when the update header.seq arrived */
    uint64_t order;    /* of the newest frame ever put */
    uint64_t dropped;  /* frames that a newer one replaced */
};

void srv_outbox_init(struct srv_outbox *outbox);
void srv_outbox_finish(struct srv_outbox *outbox);

/* Newest wins: replaces the waiting frame if `order` is newer, else drops the frame. Takes a
 * reference. True if the frame waits now. */
bool srv_outbox_put(struct srv_outbox *outbox, uint64_t order,
                    const struct proto_frame_header *header, struct srv_blob *blob);

/* Hands over the waiting frame with its reference; NULL = none. */
struct srv_blob *srv_outbox_pop(struct srv_outbox *outbox, struct proto_frame_header *header);

#endif
