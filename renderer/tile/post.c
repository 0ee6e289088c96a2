/* SPDX-License-Identifier: Apache-2.0 */
#include "tile/post.h"

#include "tile/tile.h"

/* The unit vector towards the eye along the ray of a pixel, in camera space. */
static void eye_direction(const struct sp_post *post, int x, int y, float to_eye[3]) {
    float u = 0, v = 0;
    if (post->perspective) {
        u = ((float)x + 0.5f - post->centre[0]) / post->scale;
        v = ((float)y + 0.5f - post->centre[1]) / post->scale;
    }
    float inv = -1 / sqrtf(u * u + v * v + 1);
    to_eye[0] = u * inv;
    to_eye[1] = v * inv;
    to_eye[2] = inv;
}

void sp_post_classify(const struct sp_post *post, int x, int y, float *sums, int n) {
    enum { S = SP_TILE * SP_TILE_ROW };
    for (int i = 0; i < n; i++) {
        float w = sums[i], gradient[3];
        struct sp_class c = { { 0 }, 0 };
        if (w > 1e-12f) {
            for (int k = 0; k < 3; k++)
                gradient[k] = sums[(k + 1) * S + i] / w;
            float length = sqrtf(gradient[0] * gradient[0] + gradient[1] * gradient[1] +
                                 gradient[2] * gradient[2]);
            c = sp_transfer_post_class(post->transfer, sums[4 * S + i] / w,
                                       (double)length * post->gradient_unit);
            if (post->shade && c.depth > 0) {
                float to_eye[3], normal[3], inv = length > 1e-12f ? 1 / length : 0;
                eye_direction(post, x + i, y, to_eye);
                for (int k = 0; k < 3; k++)
                    normal[k] = gradient[k] * inv;
                sp_shade_direction(post->shade, normal, to_eye, c.color);
            }
        }
        float depth = c.depth * w;
        sums[i] = depth;
        for (int k = 0; k < 3; k++)
            sums[(k + 1) * S + i] = c.color[k] * depth;
    }
}
