/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/resample/axes.h"

#include <math.h>

#include "frame/depth.h"

/* Width of the band [degrees]. The two images may differ by 4 % (rms, of the range); turning the
 * camera by one degree then adds at most 1 % to the change that the motion causes. */
static const double band = 2;

int sp_axes_choose(const double along[3], double share[3]) {
    double sum = 0, degree = M_PI / 180;
    int best = 0;
    for (int a = 1; a < 3; a++)
        if (along[a] >= along[best])
            best = a;
    for (int a = 0; a < 3; a++) {
        double beyond = atan2(along[best], along[a]) - M_PI / 4;
        share[a] = fmax(0, 1 - beyond / (band * degree));
        sum += share[a];
    }
    for (int a = 0; a < 3; a++)
        share[a] /= sum;
    return best;
}

struct mix {
    struct sp_frame *frame;
    const struct sp_frame *from;
    float share;
};

/* Straight alpha: colours count as much as they cover. */
static void mix_bytes(unsigned char *to, const unsigned char *from, uint32_t count, float share) {
    for (uint32_t i = 0; i < count; i++, to += 4, from += 4) {
        float weight[2] = { (1 - share) * (float)to[3], share * (float)from[3] };
        float alpha = weight[0] + weight[1], undo = alpha > 0 ? 1 / alpha : 0;
        for (int c = 0; c < 3; c++) {
            float color = weight[0] * (float)to[c] + weight[1] * (float)from[c];
            to[c] = (unsigned char)(color * undo + 0.5f);
        }
        to[3] = (unsigned char)(alpha + 0.5f);
    }
}

static void mix_floats(float *to, const float *from, uint32_t count, float share) {
    for (uint32_t i = 0; i < 4 * count; i++)
        to[i] += share * (from[i] - to[i]);
}

/* Both images count by their shares of the image, whatever their opacity. */
static void mix_depths(const struct mix *mix, size_t y) {
    const struct sp_frame *frame = mix->frame, *from = mix->from;
    float *depth = sp_depth_row(frame, frame->depth, y);
    float *spread = sp_depth_row(frame, frame->spread, y);
    const float *other_depth = sp_depth_row(from, from->depth, y);
    const float *other_spread = sp_depth_row(from, from->spread, y);
    for (uint32_t x = 0; x < frame->width; x++) {
        struct sp_depth sum = { depth[x], spread[x], 1 - mix->share };
        const struct sp_depth more = { other_depth[x], other_spread[x], mix->share };
        sp_depth_add(&sum, &more);
        depth[x] = sum.mean;
        spread[x] = sum.spread;
    }
}

static void mix_rows(void *user, size_t begin, size_t end, unsigned worker) {
    const struct mix *mix = user;
    struct sp_frame *frame = mix->frame;
    (void)worker;
    for (size_t y = begin; y < end; y++) {
        unsigned char *to = (unsigned char *)frame->pixels + y * frame->stride_bytes;
        const unsigned char *from =
            (const unsigned char *)mix->from->pixels + y * frame->stride_bytes;
        if (frame->depth)
            mix_depths(mix, y);
        if (frame->format == SP_RGBA8)
            mix_bytes(to, from, frame->width, mix->share);
        else
            mix_floats((float *)(void *)to, (const float *)(const void *)from, frame->width,
                       mix->share);
    }
}

void sp_axes_mix(struct sp_frame *frame, const struct sp_frame *from, double share,
                 struct sp_pool *pool) {
    struct mix mix = { .frame = frame, .from = from, .share = (float)share };
    sp_parallel_for(pool, frame->height, 16, mix_rows, &mix);
}
