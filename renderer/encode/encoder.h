/* SPDX-License-Identifier: Apache-2.0
 *
 * Encodes a frame as the bytes of an image file:
 *
 *   frame ─► convert (8 bit or float, alpha kept or not) ─┬─► jpeg.c   libjpeg-turbo
 *                                                         ├─► png.c    libpng
 *                                                         ├─► webp.c   libwebp
 *                                                         └─► exr.c    exr_bridge.cpp, a module
 *
 * An encoder keeps its library handle, its buffers and the loaded bridge from call to call.
 * Encoders share no state: threads may encode at the same time, each with its own encoder.
 */
#ifndef ENCODE_ENCODER_H
#define ENCODE_ENCODER_H

#include "encode/exr_bridge.h"
#include "sp/encode.h"

struct sp_buffer { /* memory that is reused from image to image; {0} is empty */
    uint8_t *bytes;
    size_t size, capacity;
};

struct sp_encoder {
    struct sp_buffer pixels; /* the converted frame, if its format needs a conversion */
    struct sp_buffer output;
    void *jpeg;            /* tjhandle; NULL until the first JPEG */
    enum sp_chroma chroma; /* of JPEGs */
    sp_share_fn *share;    /* NULL = the calling thread encodes all stripes of a JPEG */
    void *share_user;
    sp_exr_encode_fn *exr; /* NULL until the first EXR; the library is never unloaded */
};

/* The pixels that a format encodes: rows of `stride` bytes, from the top; four channels, or one. */
struct sp_raster {
    const void *pixels;
    uint32_t width, height;
    size_t stride;
    const float *depth, *spread; /* of the frame, for EXR; NULL = none */
    size_t depth_stride;         /* bytes */
    bool is_opaque; /* 8 bits only: the fourth channel is 255 everywhere and can be left out */
    bool is_grey;   /* PNG only: one channel of 8 bits */
};

/* Empties the buffer and reserves `capacity` bytes. Frees the old memory if it is far larger than
 * needed. False with *err set if memory runs out. */
bool sp_buffer_reserve(struct sp_buffer *buffer, size_t capacity, struct sp_error *err);

/* Grows the buffer as needed and keeps its content. False when out of memory. */
bool sp_buffer_append(struct sp_buffer *buffer, const void *bytes, size_t size);

/* The encode functions write encoder->output. JPEG, PNG and WebP need a raster of 8 bits, EXR needs
 * floats. JPEG ignores the fourth channel; PNG and WebP leave it out if the raster is opaque. */
bool sp_encode_jpeg(struct sp_encoder *encoder, const struct sp_raster *raster, int quality,
                    struct sp_error *err);
void sp_encode_jpeg_finish(struct sp_encoder *encoder);
bool sp_encode_png(struct sp_encoder *encoder, const struct sp_raster *raster,
                   struct sp_error *err);
bool sp_encode_webp(struct sp_encoder *encoder, const struct sp_raster *raster, int quality,
                    struct sp_error *err);
bool sp_encode_exr(struct sp_encoder *encoder, const struct sp_raster *raster,
                   struct sp_error *err);

#endif
