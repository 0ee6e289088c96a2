/* SPDX-License-Identifier: Apache-2.0
 *
 * The policy of quality: how pictures are encoded for a participant while the view moves and when
 * it rests, decided here alone, and told to it (stream.policy in protocol/stream.md). How much
 * detail a picture has is pace.h's.
 */
#ifndef SRV_SESSION_POLICY_H
#define SRV_SESSION_POLICY_H

#include "session/hub_private.h"

struct srv_encoding {
    enum sp_image_format format; /* of stills */
    enum sp_video_codec video;   /* SP_VIDEO_CODEC_COUNT = a still */
    int quality;           /* of a lossless format the granted one, which makes no difference */
    enum sp_chroma chroma; /* of a JPEG; never AUTO */
};

struct srv_encoding srv_policy_encoding(const struct srv_participant *participant,
                                        enum srv_frame_step step);
/* Is a sharp picture of this encoding what is shown at rest, so that nothing need follow? */
bool srv_policy_is_final(const struct srv_participant *participant,
                         const struct srv_encoding *encoding);
/* About what it takes to encode such a picture: what a thousand pixels take on the machine of
 * tests/bench/results, whatever they show. */
double srv_policy_encode_ms(const struct srv_encoding *encoding, const uint32_t size[2]);

/* The rest is called with the hub's mutex held. */

/* A job was made for the participant: it is told if its detail is another one than it was told, at
 * most twice a second while the view moves, and once it rests. */
void srv_policy_taken(struct srv_hub *hub, struct srv_participant *participant,
                      const struct srv_render_job *job, double now_ms);
/* The notification; malloc'ed, NULL when out of memory. */
char *srv_policy_text(struct srv_participant *participant, double now_ms, size_t *size);

#endif
