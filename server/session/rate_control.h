/* SPDX-License-Identifier: Apache-2.0
 *
 * Rate control: how small the moving frames of one client must be for its network. Pure: no clock,
 * no lock.
 *
 * A frame of full quality is wanted as long as the link carries 30 of them per second, or as many
 * as the client asked for if that is less. Otherwise:
 *
 *   1. video, if the client takes it: about a tenth of the bytes of images. It already replaces
 *      images that take more than 20 ms to send: encoding and decoding video takes longer, too.
 *   2. less quality and a smaller frame, in steps
 *
 * Quality comes back when the next finer step needs three quarters of the rate at most, and images
 * when they need half of the time at which video begins, so that neither flickers.
 *
 * Limit: a busy processor looks like a slow link. The time from a frame's last byte to its
 * acknowledgement contains the wait for a processor at both ends, and that wait does not shrink
 * with the frame: the rate that window.h measures falls with the bytes, and the steps go down to
 * the last one. Nothing that the daemon measures tells the two apart. The times to draw and to
 * encode end before the frame is sent; the shortest pong is the least wait, not the usual one; and
 * frames of one size do not show whether a smaller one would come sooner. The round trip of the
 * kernel (TCP_INFO) would, but not behind a proxy. So smaller frames are the answer in both cases;
 * they take less of a busy processor, too. The client knows how long frames wait at its end, and
 * names a slow network only if that explains it (clients/web/core/latency.js).
 */
#ifndef SRV_SESSION_RATE_CONTROL_H
#define SRV_SESSION_RATE_CONTROL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { SRV_RATE_SIDES = 8, SRV_RATE_QUALITY_MAX = 60 };

struct srv_rate_step {
    unsigned side; /* of the frame, in eighths of the full one, [2, 8] */
    int quality;   /* at most, [1, SRV_RATE_QUALITY_MAX] */
};

struct srv_rate_control {
    unsigned step;
    bool is_video;    /* video replaces images */
    bool is_lossless; /* the images are: only their size counts */
    int quality;      /* the best of a moving frame, [1, SRV_RATE_QUALITY_MAX] */
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

/* The client asked for other frames: drops what is known of their bytes, and keeps the step. Images
 * come first again. */
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
