/* SPDX-License-Identifier: Apache-2.0
 *
 * Encodes frames as packets of a video stream. Unlike an image file (sp/encode.h), a packet may
 * depend on the packets before it:
 *
 *   key ─► delta ─► delta ─► key ─► delta
 *
 * A decoder needs every packet since the last key frame.
 *
 * Each frame gives exactly one packet at once: none is delayed, dropped or reordered. Quality is
 * constant, so an image that changes little costs few bytes. VP8 and VP9 (libvpx) are linked in.
 * H.264 needs the module splat-x264.so, which is an optional part of the build (SPLATD_X264)
 * because libx264 is under the GPL.
 *
 * Images are converted to 4:2:0, BT.601, limited range, blended over black like a JPEG. H.264
 * images have even sides: an odd side is extended by a copy of its last column or row.
 */
#ifndef SP_VIDEO_H
#define SP_VIDEO_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sp/api.h"
#include "sp/frame.h"
#include "sp/status.h"

#ifdef __cplusplus
extern "C" {
#endif

enum sp_video_codec { SP_VIDEO_VP8, SP_VIDEO_VP9, SP_VIDEO_H264, SP_VIDEO_CODEC_COUNT };

/* "vp8", "vp9", "h264": constant strings. Thread-safe. */
SP_API const char *sp_video_codec_name(enum sp_video_codec codec);
/* Returns SP_VIDEO_CODEC_COUNT if the name is unknown. Thread-safe. */
SP_API enum sp_video_codec sp_video_codec_find(const char *name);
/* True if this installation can encode the codec. Looks for the module's file. Thread-safe. */
SP_API bool sp_video_is_available(enum sp_video_codec codec);

/* Returns an upper bound of the memory of an encoder, in bytes, for frames of at most `size`.
 * Thread-safe. */
SP_API uint64_t sp_video_bytes(enum sp_video_codec codec, const uint32_t size[2]);

/* The encoder of one stream. One thread at a time. */
struct sp_video;

/* Creates an encoder. threads: the number of threads that the encoder may start, [1, 8]. Returns
 * NULL on failure: SP_ERR_MEMORY, or SP_ERR_UNSUPPORTED if the codec is not available. */
SP_API struct sp_video *sp_video_create(enum sp_video_codec codec, unsigned threads,
                                        struct sp_error *err);
/* Accepts a NULL encoder and nulls *video. */
SP_API void sp_video_destroy(struct sp_video **video);

struct sp_video_packet {
    const uint8_t *bytes; /* owned by the encoder; valid until the next call of the encoder */
    size_t size;          /* bytes, > 0 */
    bool is_key;          /* a decoder can start here */
};

/* Encodes one frame. quality: [1, 100]; the image looks about like a JPEG of that quality. is_key:
 * make a key frame. The first frame, a frame of a new size, and the frame after a failure are
 * always key frames. Errors: SP_ERR_MEMORY, SP_ERR_BACKEND (the codec failed). */
SP_API bool sp_video_encode(struct sp_video *video, const struct sp_frame *frame, int quality,
                            bool is_key, struct sp_video_packet *packet, struct sp_error *err);

#ifdef __cplusplus
}
#endif

#endif
