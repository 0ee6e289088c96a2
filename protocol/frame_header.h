/* SPDX-License-Identifier: Apache-2.0
 *
 * The header of every image of a stream: 36 bytes, little-endian (stream.md).
 *
 *   0 "SPF1"  4 codec u8  5 flags u8  6 header bytes u16  8 frame u32  12 seq u32
 *   16 width u16  18 height u16  20 render µs u32  24 encode µs u32  28 payload bytes u32
 *   32 queue µs u32
 *
 * The image is the last `payload bytes` of the message. With PROTO_FRAME_DEPTH the header has 100
 * more bytes, and a depth image may precede the image:
 *
 *   36 depth bytes u32  40 columns u16  42 rows u16  44 near f32  48 far f32
 *   52 projection u32 (0 perspective, 1 orthographic)  56 position 3 × f64  80 target 3 × f64
 *   104 up 3 × f64  128 fov_y (degrees) or height (world units) f64
 *
 *   header of 136 bytes │ depth image │ image
 */
#ifndef PROTO_FRAME_HEADER_H
#define PROTO_FRAME_HEADER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sp/view.h"

enum { PROTO_FRAME_HEADER_BYTES = 36, PROTO_FRAME_DEPTH_BYTES = 100 };

enum proto_codec {
    PROTO_CODEC_JPEG = 1,
    PROTO_CODEC_PNG = 2,
    PROTO_CODEC_WEBP = 3,
    PROTO_CODEC_H264 = 4,
    PROTO_CODEC_VP9 = 5,
    PROTO_CODEC_AV1 = 6,
    PROTO_CODEC_VP8 = 7
};
/* True if a frame of this codec may depend on earlier frames. */
static inline bool proto_codec_is_video(uint8_t codec) {
    return codec >= PROTO_CODEC_H264 && codec <= PROTO_CODEC_VP8;
}

enum proto_frame_flags {
    PROTO_FRAME_KEY = 1,      /* decodes without earlier frames; always set on JPEG, PNG and WebP */
    PROTO_FRAME_FINAL = 2,    /* final quality: no better image follows while the view rests */
    PROTO_FRAME_LOSSLESS = 4, /* lossless: the pixels are as rendered */
    PROTO_FRAME_INCOMPLETE = 8, /* of a volume that is larger than memory, it has coarser samples
                                   than its pixels ask for (sp_frame_bricks_is_complete()) */
    PROTO_FRAME_DEPTH = 16      /* the header has the fields of struct proto_frame_depth */
};

struct proto_frame_header {
    uint8_t codec;          /* enum proto_codec */
    uint8_t flags;          /* enum proto_frame_flags, or-ed */
    uint32_t frame;         /* number in the stream, from 1 */
    uint32_t seq;           /* of the newest view.update that the frame shows; 0 = none */
    uint16_t width, height; /* px */
    uint32_t render_us, encode_us;
    uint32_t payload_bytes; /* of the image, the end of the message */
    /* From the arrival of the update `seq` until the image is sent, less render_us and encode_us:
     * the time that it waited. 0 if an earlier frame showed this update. */
    uint32_t queue_us;
};

/* Fills `out`. Cannot fail. Thread-safe. */
void proto_frame_header_encode(const struct proto_frame_header *header,
                               uint8_t out[PROTO_FRAME_HEADER_BYTES]);

/* With PROTO_FRAME_DEPTH: the camera and the depth of the frame. */
struct proto_frame_depth {
    uint32_t depth_bytes;    /* of the PNG that follows the header; 0 = the frame has no depth */
    uint16_t columns, rows;  /* cells of the depth; 0 without depth */
    float near, far;         /* depths of its brightest and its darkest value (sp/encode.h) */
    struct sp_camera camera; /* that the frame was drawn for; `near` is not sent */
};
/* Fills `out`, which follows the header of 36 bytes. Cannot fail. Thread-safe. */
void proto_frame_depth_encode(const struct proto_frame_depth *depth,
                              uint8_t out[PROTO_FRAME_DEPTH_BYTES]);
/* Decodes it from the start of a message of `size` bytes. False if proto_frame_header_decode()
 * refuses the message, or it has no PROTO_FRAME_DEPTH. camera.near is 0. Thread-safe. */
bool proto_frame_depth_decode(const uint8_t *bytes, size_t size, struct proto_frame_depth *depth);

/* Decodes the header at the start of a message of `size` bytes. False if the message is shorter
 * than the header, does not start with "SPF1", has a header size below 36 (with
 * PROTO_FRAME_DEPTH below 136) or above the message size, codec 0, or sizes of depth and payload
 * whose sum differs from the rest of the message. A longer header of a later version is accepted;
 * the payload is always the last payload_bytes of the message. Thread-safe. */
bool proto_frame_header_decode(const uint8_t *bytes, size_t size,
                               struct proto_frame_header *header);

#endif
