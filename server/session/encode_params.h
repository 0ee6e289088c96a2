/* SPDX-License-Identifier: Apache-2.0
 *
 * How frames are encoded. Pure functions.
 */
#ifndef SRV_SESSION_ENCODE_PARAMS_H
#define SRV_SESSION_ENCODE_PARAMS_H

#include <stdbool.h>
#include <stdint.h>

#include "sp/encode.h"
#include "sp/video.h"

/* What decides the bytes of an image besides its pixels: equal pixels and equal parameters give
 * equal bytes. */
struct srv_encode_params {
    enum sp_image_format format;
    int quality;           /* 100 for a lossless format */
    enum sp_chroma chroma; /* of a JPEG, never AUTO; else AUTO */
    bool depth;            /* the bytes begin with the depth of the frame */
};

/* Without depth. */
struct srv_encode_params srv_encode_params_from(enum sp_image_format format, int quality,
                                                enum sp_chroma chroma);
bool srv_encode_params_equal(const struct srv_encode_params *a, const struct srv_encode_params *b);

/* A client that gets depth warps frames, and shows them at the rate of its display: large frames
 * are worth more to it than more of them per second. */
#define SRV_WARP_INTERVAL_MS (1000.0 / 13)

/* What a frame is for, in the order in which a view that came to rest gets them. */
enum srv_frame_step {
    SRV_STEP_MOVING,       /* keeps up with the moving view */
    SRV_STEP_INTERMEDIATE, /* at rest, before a sharp frame that takes long */
    SRV_STEP_FINAL,        /* full size, all voxels, granted quality */
    SRV_STEPS
};

/* How the frames of one step are encoded for one participant. */
struct srv_encoding {
    enum sp_image_format format; /* if it is not video */
    enum sp_video_codec video;   /* SP_VIDEO_CODEC_COUNT = an image */
    int quality;                 /* as granted, also for a lossless format */
    enum sp_chroma chroma;       /* of a JPEG; never AUTO */
};
/* Estimates the time to encode such a frame, ms: the time per pixel on the machine of
 * tests/bench/results, whatever the frame shows. */
double srv_encoding_expected_ms(const struct srv_encoding *encoding, const uint32_t size[2]);

/* The detail of a participant's last moving frame, for stream.policy. */
struct srv_moving_detail {
    uint32_t full_size[2]; /* at rest, px */
    uint32_t size[2];      /* px; 0 = there was no moving frame yet */
    unsigned mip_level;    /* as in sp/renderer.h */
    bool is_draft;         /* as in sp/frame.h, as far as it is known when the frame is begun */
    double budget_ms;      /* time that the frame had */
    double sharp_ms;       /* expected time of a sharp frame; 0 = not known */
    bool is_shared;        /* others took a part of the time */
    unsigned rate_step;    /* of the rate control (session/rate_control.h) */
    bool is_video;         /* the rate control replaces images by video */
};
struct srv_policy {
    struct srv_moving_detail moving;   /* of the last moving frame */
    struct srv_moving_detail reported; /* as the client knows it */
    double told_ms;
};

#endif
