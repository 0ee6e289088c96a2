/* SPDX-License-Identifier: Apache-2.0 */
#include "sp/encode.h"

#include <assert.h>
#include <stdlib.h>
#include <strings.h>

#include "encode/convert.h"
#include "encode/encoder.h"

static const struct sp_image_format_info formats[SP_IMAGE_FORMAT_COUNT] = {
    [SP_IMAGE_JPEG] = { "jpeg", "image/jpeg", ".jpg", false, false },
    [SP_IMAGE_PNG] = { "png", "image/png", ".png", false, true },
    [SP_IMAGE_WEBP] = { "webp", "image/webp", ".webp", false, false },
    [SP_IMAGE_EXR] = { "exr", "image/x-exr", ".exr", true, true },
};

const struct sp_image_format_info *sp_image_format_info(enum sp_image_format format) {
    assert(format < SP_IMAGE_FORMAT_COUNT);
    return &formats[format];
}

enum sp_image_format sp_image_format_find(const char *text) {
    for (int i = 0; i < SP_IMAGE_FORMAT_COUNT; i++)
        if (strcasecmp(text, formats[i].name) == 0 || strcasecmp(text, formats[i].mime) == 0 ||
            strcasecmp(text, formats[i].extension) == 0)
            return (enum sp_image_format)i;
    if (strcasecmp(text, ".jpeg") == 0 || strcasecmp(text, "jpg") == 0)
        return SP_IMAGE_JPEG;
    return SP_IMAGE_FORMAT_COUNT;
}

enum { KEEP_BYTES = 64 << 20 };

bool sp_buffer_reserve(struct sp_buffer *buffer, size_t capacity, struct sp_error *err) {
    /* What one large image needed is not kept for many small ones. */
    size_t keep = capacity > KEEP_BYTES / 8 ? capacity * 8 : KEEP_BYTES;
    if (buffer->capacity >= capacity && buffer->capacity <= keep)
        return true;
    free(buffer->bytes);
    *buffer = (struct sp_buffer){ .bytes = malloc(capacity) };
    if (!buffer->bytes)
        return sp_fail(err, SP_ERR_MEMORY, "", "no memory for an image of %zu bytes", capacity);
    buffer->capacity = capacity;
    return true;
}

struct sp_encoder *sp_encoder_create(struct sp_error *err) {
    struct sp_encoder *encoder = calloc(1, sizeof *encoder);
    if (!encoder)
        sp_fail(err, SP_ERR_MEMORY, "", "no memory for an image encoder");
    return encoder;
}

void sp_encoder_destroy(struct sp_encoder **encoder) {
    struct sp_encoder *e = *encoder;
    if (!e)
        return;
    sp_encode_jpeg_finish(e);
    free(e->pixels.bytes);
    free(e->output.bytes);
    free(e);
    *encoder = NULL;
}

static enum sp_raster_kind raster_kind(const struct sp_frame *frame, enum sp_image_format format) {
    if (format == SP_IMAGE_JPEG)
        return SP_RASTER_RGBX8;
    if (format == SP_IMAGE_EXR)
        return SP_RASTER_RGBAF32;
    return sp_frame_is_opaque(frame) ? SP_RASTER_RGB8 : SP_RASTER_RGBA8;
}

bool sp_encode(struct sp_encoder *encoder, const struct sp_frame *frame,
               enum sp_image_format format, int quality, const uint8_t **bytes, size_t *size,
               struct sp_error *err) {
    assert(format < SP_IMAGE_FORMAT_COUNT && quality >= 1 && quality <= 100);
    struct sp_raster raster;
    encoder->output.size = 0;
    if (!sp_frame_to_raster(encoder, frame, raster_kind(frame, format), &raster, err))
        return false;
    if (!(format == SP_IMAGE_JPEG
              ? sp_encode_jpeg(encoder, &raster, quality, err)
              : sp_encode_oiio(encoder, &raster, &formats[format], quality, err)))
        return false;
    *bytes = encoder->output.bytes;
    *size = encoder->output.size;
    return true;
}
