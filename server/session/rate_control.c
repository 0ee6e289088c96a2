/* SPDX-License-Identifier: Apache-2.0 */
#include "session/rate_control.h"

#include <math.h>
#include <string.h>

#define SEND_MS (1000.0 / 30) /* quality is not reduced for more frames per second */
#define VIDEO_MS 20.0         /* an image that takes longer to send is replaced by video */
#define RAISE 0.75
#define IMAGES_AGAIN 0.5
#define DECAY 0.75 /* weight of the past with each new frame */

static const struct srv_rate_step steps[] = {
    { 8, SRV_RATE_QUALITY_MAX },
    { 8, 40 },
    { 7, 40 },
    { 6, 40 },
    { 5, 40 },
    { 4, 40 },
    { 4, 25 },
    { 3, 25 },
    { 2, 25 },
};
enum { STEPS = sizeof steps / sizeof *steps };

void srv_rate_control_init(struct srv_rate_control *control) {
    memset(control, 0, sizeof *control);
    control->quality = SRV_RATE_QUALITY_MAX;
}

static struct srv_rate_step step_at(const struct srv_rate_control *control, unsigned i) {
    struct srv_rate_step step = steps[i];
    if (step.quality > control->quality)
        step.quality = control->quality;
    return step;
}

struct srv_rate_step srv_rate_control_step(const struct srv_rate_control *control) {
    return step_at(control, control->step);
}

void srv_rate_control_size(const struct srv_rate_control *control, const uint32_t full[2],
                           uint32_t size[2]) {
    for (int i = 0; i < 2; i++)
        size[i] =
            (uint32_t)fmax(round((double)full[i] * steps[control->step].side / SRV_RATE_SIDES), 1);
}

/* Returns the bytes of a JPEG in relation to one of the best quality: a power of the factor by
 * which the quality scales the tables of libjpeg, fitted to tests/bench/results. Video codecs use a
 * quantiser of similar quality. */
static double portion_of_quality(int quality) {
    double scale = quality < 50 ? 5000.0 / quality : 200 - 2 * fmin(quality, 97);
    return pow(scale / (200 - 2 * SRV_RATE_QUALITY_MAX), -0.32);
}

/* The same of a smaller frame: its pixels have more detail. */
static double portion_of_size(double pixels) {
    return pow(pixels, 0.75);
}

static double portion_of_step(const struct srv_rate_control *control, unsigned i) {
    const struct srv_rate_step step = step_at(control, i);
    double side = (double)step.side / SRV_RATE_SIDES;
    double portion = portion_of_size(side * side);
    bool is_lossless = control->is_lossless && !control->is_video;
    return is_lossless ? portion : portion * portion_of_quality(step.quality);
}

void srv_rate_control_learn(struct srv_rate_control *control, const struct srv_rate_frame *frame) {
    double pixels = (double)frame->size[0] * frame->size[1];
    double portion = portion_of_size(pixels / ((double)frame->full_size[0] * frame->full_size[1]));
    if (!frame->is_lossless)
        portion *= portion_of_quality(frame->quality);
    if (!frame->is_video)
        control->is_lossless = frame->is_lossless;
    double *mean = &control->bytes[frame->is_video], bytes = (double)frame->bytes / portion;
    *mean = *mean == 0 ? bytes : DECAY * *mean + (1 - DECAY) * bytes;
}

/* Returns the first step whose frames need at most limit_ms, else the last one. */
static unsigned finest(const struct srv_rate_control *control, double full_ms, double limit_ms) {
    unsigned step = 0;
    while (step + 1 < STEPS && full_ms * portion_of_step(control, step) > limit_ms)
        step++;
    return step;
}

void srv_rate_control_forget(struct srv_rate_control *control) {
    control->bytes[false] = control->bytes[true] = 0;
    control->is_video = false;
}

static bool is_video_better(const struct srv_rate_control *control, double bytes_per_ms) {
    double quality = control->is_lossless ? 1 : portion_of_quality(control->quality);
    double image_ms = control->bytes[false] * quality / bytes_per_ms;
    return image_ms > (control->is_video ? IMAGES_AGAIN : 1) * VIDEO_MS;
}

void srv_rate_control_update(struct srv_rate_control *control,
                             const struct srv_rate_demand *demand) {
    double limit_ms = fmax(SEND_MS, demand->interval_ms);
    control->quality =
        demand->quality < SRV_RATE_QUALITY_MAX ? demand->quality : SRV_RATE_QUALITY_MAX;
    if (demand->bytes_per_ms <= 0)
        return;
    control->is_video = demand->takes_video && is_video_better(control, demand->bytes_per_ms);
    double full_ms =
        control->bytes[control->is_video && !demand->is_video_refused] / demand->bytes_per_ms;
    if (full_ms == 0)
        return;
    unsigned best = finest(control, full_ms, limit_ms * RAISE);
    if (best < control->step || full_ms * portion_of_step(control, control->step) > limit_ms)
        control->step = best;
}
