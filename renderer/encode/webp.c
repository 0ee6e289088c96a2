/* SPDX-License-Identifier: Apache-2.0 */
#include <webp/encode.h>

#include "encode/encoder.h"

struct sink {
    struct sp_buffer *output;
    bool is_short; /* out of memory; the library does not always report that a write failed */
};

static int append(const uint8_t *bytes, size_t size, const WebPPicture *image) {
    struct sink *sink = image->custom_ptr;
    sink->is_short = !sp_buffer_append(sink->output, bytes, size);
    return !sink->is_short;
}

static bool write_webp(WebPPicture *image, const WebPConfig *config,
                       const struct sp_raster *raster) {
    const uint8_t *pixels = raster->pixels;
    int stride = (int)raster->stride;
    return (raster->is_opaque ? WebPPictureImportRGBX(image, pixels, stride)
                              : WebPPictureImportRGBA(image, pixels, stride)) &&
           WebPEncode(config, image);
}

bool sp_encode_webp(struct sp_encoder *encoder, const struct sp_raster *raster, int quality,
                    struct sp_error *err) {
    struct sink sink = { .output = &encoder->output };
    WebPConfig config;
    WebPPicture image;
    if (!WebPConfigPreset(&config, WEBP_PRESET_DEFAULT, (float)quality) || !WebPPictureInit(&image))
        return sp_fail(err, SP_ERR_BACKEND, "",
                       "cannot encode as webp: this program was built for another libwebp");
    if (!sp_buffer_reserve(sink.output, (size_t)raster->width * raster->height, err))
        return false;
    image.width = (int)raster->width;
    image.height = (int)raster->height;
    image.writer = append;
    image.custom_ptr = &sink;
    bool ok = write_webp(&image, &config, raster);
    WebPEncodingError why = image.error_code;
    WebPPictureFree(&image);
    if (sink.is_short || why == VP8_ENC_ERROR_OUT_OF_MEMORY ||
        why == VP8_ENC_ERROR_BITSTREAM_OUT_OF_MEMORY)
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory while encoding %u × %u as webp",
                       raster->width, raster->height);
    return ok ||
           sp_fail(err, SP_ERR_BACKEND, "", "cannot encode %u × %u as webp: error %d of libwebp",
                   raster->width, raster->height, (int)why);
}
