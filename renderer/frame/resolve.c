/* SPDX-License-Identifier: Apache-2.0 */
#include "frame/resolve.h"

void sp_resolve_rgbaf32(const float *const planes[4], uint32_t count, const float background[4],
                        float *out) {
    for (uint32_t i = 0; i < count; i++) {
        float through = planes[0][i], share = through * background[3];
        for (int c = 0; c < 3; c++)
            out[4 * i + c] = planes[1 + c][i] + share * background[c];
        out[4 * i + 3] = 1 - through + share;
    }
}

static inline unsigned char to_byte(float x) {
    float y = x > 0 ? x : 0;
    y = y < 1 ? y : 1;
    return (unsigned char)(y * 255 + 0.5f);
}

void sp_resolve_rgba8(const float *const planes[4], uint32_t count, const float background[4],
                      unsigned char *out) {
    for (uint32_t i = 0; i < count; i++) {
        float through = planes[0][i], share = through * background[3], alpha = 1 - through + share;
        float undo = alpha > 1e-6f ? 1 / alpha : 0;
        for (int c = 0; c < 3; c++)
            out[4 * i + c] = to_byte((planes[1 + c][i] + share * background[c]) * undo);
        out[4 * i + 3] = to_byte(alpha);
    }
}
