/* SPDX-License-Identifier: Apache-2.0
 *
 * Rate control: how small the moving frames of one client must be for its network. Pure: no clock,
 * no lock.
 *
 * Frames have full quality as long as the link carries 30 of them per second, or the rate that the
 * client asked for if that is lower. Otherwise:
 *
 *   1. video, if the client takes it: about a tenth of the bytes of images. It already replaces
 *      images that take more than 20 ms to send: encoding and decoding video also takes longer.
 *   2. less quality and a smaller frame, in steps
 *
 * Quality comes back when the next finer step needs three quarters of the rate at most, and images
 * when they need half of the time at which video begins, so that neither flickers.
 *
 * A busy client is no slow network: ack_delay.h keeps its wait out of the rate. While all frames
 * have one size the two look alike, until the first smaller or larger one tells them apart: the
 * smaller frames of the steps here do, and so do the frames of a view at rest.
 */
#ifndef SRV_SESSION_RATE_CONTROL_H
#define SRV_SESSION_RATE_CONTROL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { SRV_RATE_SIDES = 8, SRV_RATE_QUALITY_MAX = 60 };

struct srv_rate_step {
    unsigned side; /* side of the frame, in eighths of the full side, [2, 8] */
    int quality;   /* highest quality, [1, SRV_RATE_QUALITY_MAX] */
};

struct srv_rate_control {
    unsigned step;
    bool is_video;    /* video replaces images */
    bool is_lossless; /* the images are lossless: only their size can be reduced */
    int quality;      /* best quality of a moving frame, [1, SRV_RATE_QUALITY_MAX] */
    double bytes[2];  /* expected of a frame of full size at the best quality: image, video; 0 = not
                         known */
};

void srv_rate_control_init(struct srv_rate_control *control);

struct srv_rate_step srv_rate_control_step(const struct srv_rate_control *control);
/* Gets the largest size of a frame in this step, px, [1, full]. */
void srv_rate_control_size(const struct srv_rate_control *control, const uint32_t full[2],
                           uint32_t size[2]);

struct srv_rate_frame { /* a moving frame that was encoded */
    bool is_video;      /* a delta frame; key frames say nothing about the next one */
    bool is_lossless;
    int quality;
    uint32_t size[2], full_size[2]; /* px */
    size_t bytes;
};
void srv_rate_control_learn(struct srv_rate_control *control, const struct srv_rate_frame *frame);

/* Call it when the client asked for other frames. Drops the expected bytes of frames and keeps the
 * step. Images come before video again. */
void srv_rate_control_forget(struct srv_rate_control *control);

struct srv_rate_demand {
    double bytes_per_ms;   /* that the link carries; 0 = not known */
    double interval_ms;    /* the shortest time between frames that the client asked for */
    bool takes_video;      /* in place of images */
    int quality;           /* granted, [1, 100] */
    bool is_video_refused; /* no encoder is free: it gets images all the same */
};
/* Chooses how the next frames are encoded. */
void srv_rate_control_update(struct srv_rate_control *control,
                             const struct srv_rate_demand *demand);

#endif
