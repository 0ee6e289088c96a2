/* SPDX-License-Identifier: Apache-2.0
 *
 * The memory of frames (--render-bytes): working memory of renderers, pixels, encoders, cached
 * images, and encoded frames and answers that clients have not read yet. Sessions and the encoders
 * of movies have one half; snapshots and frames of camera paths have the other half. So neither can
 * take all the memory. Bytes are acquired before they are allocated (sp/budget.h). Encoded frames
 * of sessions have at most a quarter of the sessions' half, and each owner its share of that
 * (session/blob.h).
 *
 *   what does not fit     then
 *   -------------------   ------------------------------------------------------------------------
 *   frame of a session    its clients' frames have half as many pixels (srv_schedule_shrink)
 *   snapshot, by others   it waits for them, at most SRV_MEMORY_WAIT_MS, then 503
 *   snapshot, alone       422
 *   video encoder         images instead of video
 *   encoded frame         the frame cache's encodings are dropped; then as a frame of a session
 *
 * At rest, SRV_REST_MS after the last frame, the memory is given back to the system.
 */
#ifndef SRV_RENDER_FRAME_MEMORY_H
#define SRV_RENDER_FRAME_MEMORY_H

#include "sp/budget.h"
#include "sp/encode.h"

#define SRV_REST_MS 2000.0
#define SRV_MEMORY_WAIT_MS 30000.0

struct srv_frame_memory {
    struct sp_budget *sessions, *snapshots; /* NULL = no limit */
};

/* bytes: both halves together; 0 = a quarter of the machine's memory, at least 2 GiB. */
bool srv_frame_memory_init(struct srv_frame_memory *memory, uint64_t bytes, struct sp_error *err);
/* All bytes must have been given back. */
void srv_frame_memory_finish(struct srv_frame_memory *memory);

/* Returns an upper bound of the pixels and the encoder of an image [bytes]. */
uint64_t srv_frame_memory_of(enum sp_image_format format, const uint32_t size[2]);

#endif
