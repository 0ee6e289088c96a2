/* SPDX-License-Identifier: Apache-2.0
 *
 * Encoded frames on their way to participants:
 *
 *   encode threads ──► srv_hub_deliver, srv_hub_deliver_video ──► outbox ──► srv_hub_next_message
 *
 * All functions are thread-safe: they lock the hub's mutex.
 */
#ifndef SRV_SESSION_DELIVERY_H
#define SRV_SESSION_DELIVERY_H

#include "session/hub.h"
#include "session/outbox.h"
#include "sp/encode.h"
#include "sp/video.h"

/* A frame that was drawn for participants of one session. */
struct srv_drawn_frame {
    uint64_t session; /* its number */
    char id[SRV_SESSION_ID_BYTES];
    uint64_t order;   /* rises from frame to frame */
    bool is_moving;   /* of a view that moves: the rate control learns from its bytes */
    uint32_t full[2]; /* size at rest, px */
};

struct srv_frame_target { /* one participant that gets the frame */
    uint64_t participant;
    uint32_t seq;      /* seq of its newest view.update */
    double updated_ms; /* when that update arrived */
    enum sp_image_format format;
    enum sp_video_codec video; /* SP_VIDEO_CODEC_COUNT = an image */
    int quality;
    enum sp_chroma chroma; /* of a JPEG; never AUTO */
    bool depth;            /* gets the frame's depth and camera */
    bool final;            /* full detail in the granted quality: no other frame follows */
    bool is_guest;         /* joined with another token than the session's owner */
};

/* Puts an encoded image into the outbox of the target. The caller sets size, times, codec and
 * PROTO_FRAME_LOSSLESS in the header; the rest is filled in here. */
void srv_hub_deliver(struct srv_hub *hub, const struct srv_drawn_frame *frame,
                     const struct srv_frame_target *target, const struct proto_frame_header *header,
                     struct srv_blob *blob);

/* Video; render/video.h explains the rules. */

enum srv_video_need {
    SRV_VIDEO_NONE,  /* takes no frame of this order: the participant left, or has a newer frame */
    SRV_VIDEO_WAITS, /* skips this frame, because its last frame still waits for the socket */
    SRV_VIDEO_DELTA, /* has all frames before `next` */
    SRV_VIDEO_KEY    /* needs a key frame */
};
enum srv_video_need srv_hub_video_need(struct srv_hub *hub, const struct srv_drawn_frame *frame,
                                       const struct srv_frame_target *target,
                                       const struct srv_video_mark *next);
/* True if a participant of the session has all frames before `next` but is not a target. */
bool srv_hub_has_video(struct srv_hub *hub, const struct srv_drawn_frame *frame,
                       const struct srv_frame_target *targets, uint32_t count,
                       const struct srv_video_mark *next);
/* Call it when no encoder is free for the targets in `set` (one bit per target). They get images,
 * and stream.policy reports that, until an encoder is free. */
void srv_hub_refuse_video(struct srv_hub *hub, const struct srv_drawn_frame *frame,
                          const struct srv_frame_target *targets, uint32_t count, uint64_t set);
/* As srv_hub_deliver(), for the video frame `mark`; number 0 is a key frame. Does nothing for a
 * target that can no longer use it. */
void srv_hub_deliver_video(struct srv_hub *hub, const struct srv_drawn_frame *frame,
                           const struct srv_frame_target *target,
                           const struct proto_frame_header *header, struct srv_blob *blob,
                           const struct srv_video_mark *mark);

#endif
