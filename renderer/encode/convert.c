/* SPDX-License-Identifier: Apache-2.0 */
#include "encode/convert.h"

#include <string.h>

static uint8_t to_byte(float v) {
    return v > 0 ? v < 1 ? (uint8_t)(v * 255 + 0.5f) : 255 : 0; /* NaN: 0 */
}

static const uint8_t *row8(const struct sp_frame *frame, uint32_t y) {
    return (const uint8_t *)frame->pixels + y * frame->stride_bytes;
}

static const float *row32(const struct sp_frame *frame, uint32_t y) {
    return (const float *)(const void *)row8(frame, y);
}

/* True if all alphas of one row are 255. The pixels are combined with AND as 32-bit words, because
 * a compiler vectorises that loop, but not a loop over every fourth byte. */
static bool is_row_opaque(const struct sp_frame *frame, uint32_t y) {
    const size_t width = frame->width;
    if (frame->format == SP_RGBA8) {
        const uint8_t *bytes = row8(frame, y);
        uint32_t common = UINT32_MAX;
        for (size_t x = 0; x < width; x++) {
            uint32_t pixel;
            memcpy(&pixel, bytes + 4 * x, sizeof pixel);
            common &= pixel;
        }
        return ((const uint8_t *)&common)[3] == 255;
    }
    const float *floats = row32(frame, y);
    bool opaque = true;
    for (size_t x = 0; x < width; x++)
        opaque &= to_byte(floats[4 * x + 3]) == 255;
    return opaque;
}

bool sp_frame_is_opaque(const struct sp_frame *frame) {
    uint32_t y = frame->is_opaque ? frame->height : 0;
    while (y < frame->height && is_row_opaque(frame, y))
        y++;
    return y == frame->height;
}

/* Converts one row to RGBA of 8 bits with straight alpha, or blended over black if over_black. */
static void row_to_bytes(const struct sp_frame *frame, uint32_t y, bool over_black, uint8_t *out) {
    const uint8_t *in8 = row8(frame, y);
    const float *in32 = row32(frame, y);
    for (uint32_t x = 0; x < frame->width; x++, out += 4) {
        if (frame->format == SP_RGBA8) {
            unsigned alpha = in8[4 * x + 3];
            for (int c = 0; c < 3; c++) {
                unsigned v = in8[4 * x + c];
                out[c] = (uint8_t)(over_black ? (v * alpha + 127) / 255 : v);
            }
            out[3] = (uint8_t)alpha;
        } else {
            float alpha = in32[4 * x + 3];
            float scale = over_black ? 1 : alpha > 0 ? 1 / alpha : 0;
            for (int c = 0; c < 3; c++)
                out[c] = to_byte(in32[4 * x + c] * scale);
            out[3] = to_byte(alpha);
        }
    }
}

/* Converts one row of 8 bits to floats with premultiplied alpha. */
static void row_to_floats(const struct sp_frame *frame, uint32_t y, float *out) {
    const uint8_t *in = row8(frame, y);
    for (uint32_t x = 0; x < frame->width; x++) {
        float alpha = (float)in[4 * x + 3] / 255;
        for (int c = 0; c < 3; c++)
            out[4 * x + c] = (float)in[4 * x + c] / 255 * alpha;
        out[4 * x + 3] = alpha;
    }
}

/* True if the frame's own pixels already have the layout of `kind`. */
static bool serves(const struct sp_frame *frame, enum sp_raster_kind kind, bool is_opaque) {
    if (kind == SP_RASTER_RGBAF32)
        return frame->format == SP_RGBAF32;
    if (frame->format != SP_RGBA8)
        return false;
    return kind == SP_RASTER_RGBA8 || is_opaque;
}

bool sp_frame_to_raster(struct sp_encoder *encoder, const struct sp_frame *frame,
                        enum sp_raster_kind kind, struct sp_raster *raster, struct sp_error *err) {
    const bool is_float = kind == SP_RASTER_RGBAF32;
    *raster = (struct sp_raster){
        .pixels = frame->pixels,
        .width = frame->width,
        .height = frame->height,
        .stride = frame->stride_bytes,
        .depth = frame->depth,
        .spread = frame->spread,
        .depth_stride = frame->depth_stride_bytes,
        .is_opaque = !is_float && sp_frame_is_opaque(frame),
    };
    if (serves(frame, kind, raster->is_opaque))
        return true;
    size_t stride = (size_t)frame->width * 4 * (is_float ? sizeof(float) : 1);
    if (!sp_buffer_reserve(&encoder->pixels, stride * frame->height, err))
        return false;
    for (uint32_t y = 0; y < frame->height; y++) {
        uint8_t *out = encoder->pixels.bytes + y * stride;
        if (is_float)
            row_to_floats(frame, y, (float *)(void *)out);
        else
            row_to_bytes(frame, y, kind == SP_RASTER_RGBX8, out);
    }
    raster->pixels = encoder->pixels.bytes;
    raster->stride = stride;
    return true;
}
