/* SPDX-License-Identifier: Apache-2.0
 *
 * Video of moving views: one encoder serves all participants of a session that receive the same
 * frame size in the same codec.
 *
 *   Invariant: a participant receives a delta frame only if it received every frame since the key
 *   frame.
 *
 * Elsewhere in the daemon the newest frame replaces older ones, so any frame may be dropped. A
 * video frame may be skipped before it is encoded; dropping it later costs a key frame.
 *
 *   - Each key frame begins an epoch, in which frames are numbered from 0. A participant's mark
 *     says which frame it can decode next. A frame that enters its outbox advances the mark. A
 *     video frame that is removed from the outbox again clears the mark: the final image of a view
 *     at rest replaces it.
 *   - Before a frame is encoded, each participant's need is asked for (srv_hub_video_need). A
 *     participant whose last frame still waits for the socket skips this one, and wants a newer one
 *     once the socket has taken it. A participant with the matching mark takes a delta frame; every
 *     other one needs a key frame.
 *   - If no participant of the session can use a delta frame, of this job or a later one, the frame
 *     becomes a key frame. Otherwise key frames are at least KEY_MS apart; until then, participants
 *     that need one receive JPEG. This bounds what a client costs the others by joining, losing
 *     frames, taking fewer frames or asking for key frames all the time.
 *   - A job older than the newest frame of the encoder is not sent as video. Its targets that still
 *     want it receive JPEG.
 *   - A frame is encoded and put into outboxes under the encoder's lock, so that frames enter the
 *     outboxes in the order in which they were encoded, on whatever thread.
 *
 * A view at rest is sent as an image, which depends on no other frame and is lossless if the client
 * wants that. When the encoders of all sessions together would exceed their bound of pixels, the
 * participants of a further encoder receive JPEG, and stream.policy says so
 * (srv_hub_refuse_video).
 *
 * Locks: an encoder's, then the hub's or the frame cache's.
 */
#ifndef SRV_RENDER_VIDEO_H
#define SRV_RENDER_VIDEO_H

#include <stdint.h>

#include "ops/metrics.h"
#include "schedule/schedule.h"
#include "sp/budget.h"
#include "sp/frame.h"

struct srv_video_encoders;

/* px: limit of the frame sizes of all encoders together, at rest; each encoder counts for at least
 * SRV_VIDEO_PX_MIN. budget: the memory of the encoders is acquired from it. blobs: the pool of
 * their encoded frames. metrics: may be NULL. NULL with *err set: SP_ERR_MEMORY. */
enum { SRV_VIDEO_PX_MIN = 256 * 1024 };
struct srv_video_encoders *srv_video_encoders_create(uint64_t px, struct sp_budget *budget,
                                                     struct srv_blob_pool *blobs,
                                                     struct srv_metrics *metrics,
                                                     struct sp_error *err);
/* After the encode threads have ended. Accepts NULL. */
void srv_video_encoders_destroy(struct srv_video_encoders **encoders);

/* Encodes the job's frame for those of its targets that want video, and delivers it. Returns the
 * set of targets that need an image instead (one bit per target): those that did not ask for video,
 * and those that cannot have it now. Adds the time to *encode_ms. now_ms: the clock of key frames
 * and idle encoders. Encode threads. */
uint64_t srv_video_encoders_encode(struct srv_video_encoders *encoders,
                                   struct srv_schedule *schedule, const struct srv_render_job *job,
                                   const struct sp_frame *frame, double now_ms, double *encode_ms);

/* True if some encoder was not used for a while. Any thread; returns quickly. */
bool srv_video_encoders_are_idle(struct srv_video_encoders *encoders, double now_ms);
/* Destroys the idle encoders. Waits until their threads end. Call it on encode threads. */
void srv_video_encoders_tick(struct srv_video_encoders *encoders, double now_ms);

#endif
