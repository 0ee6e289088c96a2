/* SPDX-License-Identifier: Apache-2.0 */
#include "frame/resolve.h"

#include "base/wide.h"

void sp_resolve_rgbaf32(const float *const planes[4], uint32_t count, const float background[4],
                        float *out) {
    for (uint32_t i = 0; i < count; i++) {
        float through = planes[0][i], share = through * background[3];
        for (int c = 0; c < 3; c++)
            out[4 * i + c] = planes[1 + c][i] + share * background[c];
        out[4 * i + 3] = 1 - through + share;
    }
}

static inline sp_wide_bits to_bytes(sp_wide x) {
    sp_wide y = sp_wide_clamp(x, 0, 1);
    return (sp_wide_bits)sp_wide_to_int(y * 255 + 0.5f);
}

/* SP_WIDE pixels; the first byte in memory is red. */
static inline sp_wide_bits resolve(const sp_wide plane[4], const float background[4]) {
    sp_wide share = plane[0] * background[3], alpha = 1 - plane[0] + share;
    sp_wide undo = sp_wide_keep(sp_wide_lt(sp_wide_all(1e-6f), alpha), 1 / alpha);
    sp_wide_bits pixel = to_bytes(alpha);
    for (int c = 2; c >= 0; c--)
        pixel = pixel << 8 | to_bytes((plane[1 + c] + share * background[c]) * undo);
#if __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
    pixel = pixel >> 24 | (pixel >> 8 & 0xff00) | (pixel << 8 & 0xff0000) | pixel << 24;
#endif
    return pixel;
}

void sp_resolve_rgba8(const float *const planes[4], uint32_t count, const float background[4],
                      unsigned char *out) {
    uint32_t i = 0;
    sp_wide plane[4];
    for (; i + SP_WIDE <= count; i += SP_WIDE) {
        for (int p = 0; p < 4; p++)
            plane[p] = sp_wide_load(planes[p] + i);
        sp_wide_bits pixels = resolve(plane, background);
        memcpy(out + 4 * (size_t)i, &pixels, sizeof pixels);
    }
    size_t left = count - i;
    if (!left)
        return;
    for (int p = 0; p < 4; p++) {
        plane[p] = sp_wide_all(0);
        memcpy(&plane[p], planes[p] + i, left * sizeof(float));
    }
    sp_wide_bits pixels = resolve(plane, background);
    memcpy(out + 4 * (size_t)i, &pixels, 4 * left);
}
