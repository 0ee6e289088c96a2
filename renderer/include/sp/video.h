/* SPDX-License-Identifier: Apache-2.0
 *
 * Frames → packets of a video stream, for pictures that move. Unlike a still (sp/encode.h) a packet
 * may need those before it:
 *
 *   key ─► delta ─► delta ─► key ─► delta        a delta can be decoded by who has every packet
 *                                                since the key before it, and by nobody else
 *
 * Each frame gives exactly one packet, at once; none is held back, dropped or reordered. Quality is
 * constant: what changes little costs few bytes. VP8 and VP9 (libvpx) are linked in; H.264 comes
 * with a module, splat-x264.so, which is built apart (SPLATD_X264: libx264 is under the GPL) and is
 * there or not.
 *
 * Pictures are 4:2:0, BT.601, limited range, over black like a JPEG. Those of H.264 have even
 * sides: the last column and row of an odd one is there twice.
 */
#ifndef SP_VIDEO_H
#define SP_VIDEO_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sp/frame.h"
#include "sp/status.h"

enum sp_video_codec { SP_VIDEO_VP8, SP_VIDEO_VP9, SP_VIDEO_H264, SP_VIDEO_CODEC_COUNT };

const char *sp_video_codec_name(enum sp_video_codec codec); /* "vp8", "vp9", "h264" */
/* SP_VIDEO_CODEC_COUNT if unknown. */
enum sp_video_codec sp_video_codec_find(const char *name);
/* Can it be encoded here? Looks for the module. Thread-safe. */
bool sp_video_is_available(enum sp_video_codec codec);

/* The encoder of one stream. One thread at a time. */
struct sp_video;

/* threads: most that it may use of its own, [1, 8]. NULL with *err set: SP_ERR_MEMORY, or
 * SP_ERR_UNSUPPORTED if the codec is not available. */
struct sp_video *sp_video_create(enum sp_video_codec codec, unsigned threads, struct sp_error *err);
void sp_video_destroy(struct sp_video **video);

struct sp_video_packet {
    const uint8_t *bytes; /* the encoder's, until its next call */
    size_t size;
    bool is_key;
};

/* quality in [1,100], about that of a JPEG of the same number. key: make a key frame; the first
 * picture, and one of another size than the one before, is one in any case. After a failure the
 * next packet is a key frame. */
bool sp_video_encode(struct sp_video *video, const struct sp_frame *frame, int quality, bool key,
                     struct sp_video_packet *packet, struct sp_error *err);

#endif
