/* SPDX-License-Identifier: Apache-2.0
 *
 * The depth of a session's frame, as bytes that precede its image in a message: the camera, and a
 * small image of the depth (protocol/stream.md, "Depth"). It is made once per frame.
 */
#ifndef SRV_RENDER_FRAME_DEPTH_H
#define SRV_RENDER_FRAME_DEPTH_H

#include <stdbool.h>

#include "session/blob.h"
#include "sp/encode.h"

/* Allocates the bytes. A frame without depth gives the camera alone. Errors: SP_ERR_MEMORY,
 * SP_ERR_BACKEND. */
bool srv_frame_depth_init(struct srv_bytes *depth, struct sp_encoder *encoder,
                          const struct sp_frame *frame, const struct sp_camera *camera,
                          struct sp_error *err);
void srv_frame_depth_finish(struct srv_bytes *depth); /* accepts an empty one, and leaves one */

/* Returns an upper bound of the memory that this takes for a frame of this size [px], in bytes. */
uint64_t srv_frame_depth_bytes(const uint32_t size[2]);

#endif
