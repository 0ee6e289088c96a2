/* SPDX-License-Identifier: Apache-2.0
 *
 * Video of views that move: one encoder for all participants of a session who see the same picture
 * in the same codec.
 *
 *   The law: a participant gets a delta frame only if it got every frame since the key frame.
 *
 * Newest wins everywhere else in the daemon, so that a frame may be lost on its way. Here it may be
 * left out before it is encoded, and afterwards only at a price:
 *
 *   - Each key frame begins an epoch, in which frames are numbered from 0. A participant's mark
 *     says which frame it can take next; putting one in its outbox moves the mark, and whatever
 *     takes a video frame out of it again (the still of a view that came to rest) clears it.
 *   - Before encoding, each taker is asked (srv_schedule_video_need): one whose last frame still
 * waits for the socket is left out, and wants a newer one as soon as the socket took that; one that
 *     has the mark takes the delta; any other needs a key frame.
 *   - If nobody of the session could use a delta, now or of a later job, the frame is a key frame.
 *     Else there is one at most every KEY_MS: until then who needs one gets JPEG. So a client that
 *     joins, loses frames, takes fewer or asks for key frames all the time costs the others at most
 *     that.
 *   - A job older than the newest frame of the encoder is no video at all: JPEG, if still wanted.
 *   - Encoding and putting in outboxes are done under the encoder's lock, so that frames are put in
 *     the order in which they were encoded, whichever thread does it.
 *
 * A view at rest is a still, lossless if asked for: it depends on nothing. Where there is no
 * encoder to be had, because all together would have more pixels than allowed, everybody gets JPEG
 * and is told so (srv_schedule_refuse_video). Locks: an encoder's, then the hub's.
 */
#ifndef SRV_RENDER_VIDEO_H
#define SRV_RENDER_VIDEO_H

#include <stdint.h>

#include "ops/metrics.h"
#include "session/hub.h"
#include "sp/frame.h"

struct srv_video_encoders;

/* px: bound on the pictures of all encoders together, by their size at rest; each counts for at
 * least SRV_VIDEO_PX_MIN. metrics: may be NULL. */
enum { SRV_VIDEO_PX_MIN = 256 * 1024 };
struct srv_video_encoders *srv_video_encoders_create(uint64_t px, struct srv_metrics *metrics,
                                                     struct sp_error *err);
/* After the threads that encode. */
void srv_video_encoders_destroy(struct srv_video_encoders **videos);

/* Encodes the job's frame for those of its targets who want video, and delivers it. Returns who
 * shall get a still, a bit each: those who did not ask for video, and those who cannot have it now.
 * Adds to *encode_ms. Encode threads. */
uint64_t srv_video_encoders_encode(struct srv_video_encoders *videos, struct srv_hub *hub,
                                   const struct srv_render_job *job, const struct sp_frame *frame,
                                   double *encode_ms);

/* Are there encoders that were not used for a while? Any thread; never waits long. */
bool srv_video_encoders_are_idle(struct srv_video_encoders *videos, double now_ms);
/* Gives them back, which takes its time: their threads end. Encode threads. */
void srv_video_encoders_tick(struct srv_video_encoders *videos, double now_ms);

#endif
