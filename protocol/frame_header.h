/* SPDX-License-Identifier: Apache-2.0
 *
 * The 32 bytes in front of every image of a stream, little-endian (stream.md):
 *
 *   0 "SPF1"  4 codec u8  5 flags u8  6 header bytes u16  8 frame u32  12 seq u32
 *   16 width u16  18 height u16  20 render µs u32  24 encode µs u32  28 payload bytes u32
 */
#ifndef PROTO_FRAME_HEADER_H
#define PROTO_FRAME_HEADER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { PROTO_FRAME_HEADER_BYTES = 32 };

enum proto_codec {
    PROTO_CODEC_JPEG = 1,
    PROTO_CODEC_PNG = 2,
    PROTO_CODEC_WEBP = 3,
    PROTO_CODEC_H264 = 4,
    PROTO_CODEC_VP9 = 5,
    PROTO_CODEC_AV1 = 6,
    PROTO_CODEC_VP8 = 7
};
/* May a frame of it need those before? */
static inline bool proto_codec_is_video(uint8_t codec) {
    return codec >= PROTO_CODEC_H264 && codec <= PROTO_CODEC_VP8;
}

enum proto_frame_flags {
    PROTO_FRAME_KEY = 1,     /* can be decoded without earlier frames; always set on still images */
    PROTO_FRAME_FINAL = 2,   /* final quality: nothing better follows while the view rests */
    PROTO_FRAME_LOSSLESS = 4 /* pixels as rendered */
};

struct proto_frame_header {
    uint8_t codec;          /* enum proto_codec */
    uint8_t flags;          /* enum proto_frame_flags, or-ed */
    uint32_t frame;         /* number within the stream, from 1 */
    uint32_t seq;           /* of the newest view.update that this frame shows; 0 = none yet */
    uint16_t width, height; /* px */
    uint32_t render_us, encode_us;
    uint32_t payload_bytes; /* that follow the header */
};

/* Fills `out`. Pure; cannot fail. */
void proto_frame_header_encode(const struct proto_frame_header *header,
                               uint8_t out[PROTO_FRAME_HEADER_BYTES]);

/* Reads the header at the start of a message of `size` bytes. False if the message is shorter than
 * the header, does not begin with "SPF1", states fewer than 32 header bytes or more than the
 * message has, a codec of 0, or another payload size than what follows. A longer header of a later
 * version is accepted; the payload is always the last payload_bytes of the message. */
bool proto_frame_header_decode(const uint8_t *bytes, size_t size,
                               struct proto_frame_header *header);

#endif
