/* SPDX-License-Identifier: Apache-2.0 */
#include "sp/encode.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>
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

enum {
    KEEP_BYTES = 64 << 20,
    SMALL_BYTES = 1 << 20 /* kept by sp_encoder_trim() */
};

/* Bytes per pixel: converted pixels, what the library takes, the file in a buffer that doubles as
 * it grows, and its copy. */
uint64_t sp_encode_bytes(enum sp_image_format format, const uint32_t size[2]) {
    static const unsigned per_pixel[SP_IMAGE_FORMAT_COUNT] = {
        [SP_IMAGE_JPEG] = 14, [SP_IMAGE_PNG] = 12, [SP_IMAGE_WEBP] = 40, [SP_IMAGE_EXR] = 88
    };
    const uint64_t least = 256 << 10;
    return least + (uint64_t)size[0] * size[1] * per_pixel[format];
}

bool sp_buffer_reserve(struct sp_buffer *buffer, size_t capacity, struct sp_error *err) {
    /* Memory for one large image is freed when the images after it are far smaller. */
    size_t keep = capacity > KEEP_BYTES / 8 ? capacity * 8 : KEEP_BYTES;
    buffer->size = 0;
    if (buffer->capacity >= capacity && buffer->capacity <= keep)
        return true;
    free(buffer->bytes);
    *buffer = (struct sp_buffer){ .bytes = malloc(capacity) };
    if (!buffer->bytes)
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for an image of %zu bytes", capacity);
    buffer->capacity = capacity;
    return true;
}

bool sp_buffer_append(struct sp_buffer *buffer, const void *bytes, size_t size) {
    size_t needed = buffer->size + size;
    if (needed > buffer->capacity) {
        size_t capacity = needed > 2 * buffer->capacity ? needed : 2 * buffer->capacity;
        uint8_t *grown = realloc(buffer->bytes, capacity);
        if (!grown)
            return false;
        buffer->bytes = grown;
        buffer->capacity = capacity;
    }
    memcpy(buffer->bytes + buffer->size, bytes, size);
    buffer->size = needed;
    return true;
}

struct sp_encoder *sp_encoder_create(struct sp_error *err) {
    struct sp_encoder *encoder = calloc(1, sizeof *encoder);
    if (!encoder)
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory for an image encoder");
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

static void trim(struct sp_buffer *buffer) {
    if (buffer->capacity <= SMALL_BYTES)
        return;
    free(buffer->bytes);
    *buffer = (struct sp_buffer){ .bytes = NULL };
}

void sp_encoder_trim(struct sp_encoder *encoder) {
    trim(&encoder->pixels);
    trim(&encoder->output);
}

static bool encode_raster(struct sp_encoder *encoder, const struct sp_raster *raster,
                          enum sp_image_format format, int quality, struct sp_error *err) {
    switch (format) {
    case SP_IMAGE_JPEG:
        return sp_encode_jpeg(encoder, raster, quality, err);
    case SP_IMAGE_PNG:
        return sp_encode_png(encoder, raster, err);
    case SP_IMAGE_WEBP:
        return sp_encode_webp(encoder, raster, quality, err);
    default:
        return sp_encode_exr(encoder, raster, err);
    }
}

bool sp_encode(struct sp_encoder *encoder, const struct sp_frame *frame,
               enum sp_image_format format, int quality, const uint8_t **bytes, size_t *size,
               struct sp_error *err) {
    assert(format < SP_IMAGE_FORMAT_COUNT && quality >= 1 && quality <= 100);
    static const enum sp_raster_kind kinds[SP_IMAGE_FORMAT_COUNT] = {
        [SP_IMAGE_JPEG] = SP_RASTER_RGBX8,
        [SP_IMAGE_PNG] = SP_RASTER_RGBA8,
        [SP_IMAGE_WEBP] = SP_RASTER_RGBA8,
        [SP_IMAGE_EXR] = SP_RASTER_RGBAF32,
    };
    struct sp_raster raster;
    if (!sp_frame_to_raster(encoder, frame, kinds[format], &raster, err) ||
        !encode_raster(encoder, &raster, format, quality, err))
        return false;
    *bytes = encoder->output.bytes;
    *size = encoder->output.size;
    return true;
}
