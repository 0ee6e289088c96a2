/* SPDX-License-Identifier: Apache-2.0
 *
 * Frame → bytes of an image file:
 *
 *   frame ─► convert (8 bit or float, alpha kept or not) ─┬─► jpeg.c   libjpeg-turbo, linked in
 *                                                         └─► oiio.c ─► splat-oiio.so
 * (oiio_bridge.cpp)
 *
 * An encoder keeps its handle, its buffers and the loaded bridge from call to call; it has no state
 * outside itself, so that any number of threads may have one each.
 */
#ifndef ENCODE_ENCODER_H
#define ENCODE_ENCODER_H

#include "encode/oiio_bridge.h"
#include "sp/encode.h"

struct sp_buffer { /* memory kept from image to image; {0} is empty */
    uint8_t *bytes;
    size_t size, capacity;
};

struct sp_encoder {
    struct sp_buffer pixels; /* the frame as its format wants it, when it must be converted */
    struct sp_buffer output;
    void *jpeg;            /* tjhandle; NULL until the first JPEG */
    enum sp_chroma chroma; /* of JPEGs */
    sp_share_fn *share;    /* NULL = it makes all stripes of a JPEG itself */
    void *share_user;
    sp_oiio_encode_fn *oiio; /* NULL until the first other image; the library is never unloaded */
};

/* Pixels handed to a format: rows of `stride` bytes, from the top. */
struct sp_raster {
    const void *pixels;
    uint32_t width, height, channels; /* 3 or 4 */
    size_t stride;
    bool is_float;
};

/* Makes room for `capacity` bytes; the content is lost. */
bool sp_buffer_reserve(struct sp_buffer *buffer, size_t capacity, struct sp_error *err);

/* Both write encoder->output. jpeg takes 4 channels of 8 bits and ignores the fourth. */
bool sp_encode_jpeg(struct sp_encoder *encoder, const struct sp_raster *raster, int quality,
                    struct sp_error *err);
void sp_encode_jpeg_finish(struct sp_encoder *encoder);
bool sp_encode_oiio(struct sp_encoder *encoder, const struct sp_raster *raster,
                    const struct sp_image_format_info *format, int quality, struct sp_error *err);

#endif
