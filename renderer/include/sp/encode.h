/* SPDX-License-Identifier: Apache-2.0
 *
 * Frame → bytes of an image file: JPEG by libjpeg-turbo, PNG by libpng, WebP by libwebp. EXR goes
 * through OpenImageIO, which is loaded with `splat-exr.so` when the first one is asked for.
 */
#ifndef SP_ENCODE_H
#define SP_ENCODE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sp/frame.h"
#include "sp/status.h"

enum sp_image_format {
    SP_IMAGE_JPEG,
    SP_IMAGE_PNG,
    SP_IMAGE_WEBP,
    SP_IMAGE_EXR,
    SP_IMAGE_FORMAT_COUNT
};

struct sp_image_format_info {
    const char *name;      /* "jpeg", "png", "webp", "exr": as in ?format= */
    const char *mime;      /* "image/jpeg", … "image/x-exr" */
    const char *extension; /* ".jpg", … */
    bool wants_float;      /* best fed an SP_RGBAF32 frame */
    bool is_lossless;      /* has no quality */
};
const struct sp_image_format_info *sp_image_format_info(enum sp_image_format format);
/* By name, MIME type or file extension (".jpeg" and ".jpg" alike); SP_IMAGE_FORMAT_COUNT if
 * unknown. */
enum sp_image_format sp_image_format_find(const char *text);

/* An encoder holds what one thread reuses from frame to frame. One thread at a time. */
struct sp_encoder;
struct sp_encoder *sp_encoder_create(struct sp_error *err);
void sp_encoder_destroy(struct sp_encoder **encoder);

/* Of how many pixels a JPEG keeps one colour: each, every second in a row, or each of 2 × 2. */
enum sp_chroma { SP_CHROMA_AUTO, SP_CHROMA_444, SP_CHROMA_422, SP_CHROMA_420, SP_CHROMA_COUNT };
const char *sp_chroma_name(enum sp_chroma chroma); /* "auto", "4:4:4", "4:2:2", "4:2:0" */
enum sp_chroma sp_chroma_find(const char *name);   /* SP_CHROMA_COUNT if unknown */
/* What is taken: AUTO stands for 4:2:0 below quality 90, else 4:4:4. */
enum sp_chroma sp_chroma_at(enum sp_chroma chroma, int quality);
/* Of this encoder's next JPEGs; AUTO at first. */
void sp_encoder_set_chroma(struct sp_encoder *encoder, enum sp_chroma chroma);

/* A large JPEG is made of stripes, which several threads may encode at once: a share calls
 * stripe(of, i, with) once for each i < count, on any threads, each with an encoder that nobody
 * uses meanwhile (`own` is the one that was asked for the JPEG), and returns when all have
 * returned. The bytes are the same whoever made which. Without a share the caller of sp_encode()
 * makes all of them. */
typedef void sp_stripe_fn(void *of, unsigned i, struct sp_encoder *with);
typedef void sp_share_fn(void *user, struct sp_encoder *own, unsigned count, sp_stripe_fn *stripe,
                         void *of);
void sp_encoder_set_share(struct sp_encoder *encoder, sp_share_fn *share, void *user);

/* quality in [1,100]; ignored by the lossless formats. JPEG has no alpha: it shows the frame over
 * black.
 * *bytes stay owned by the encoder and valid until its next call. */
bool sp_encode(struct sp_encoder *encoder, const struct sp_frame *frame,
               enum sp_image_format format, int quality, const uint8_t **bytes, size_t *size,
               struct sp_error *err);

#endif
