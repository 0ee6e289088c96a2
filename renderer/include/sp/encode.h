/* SPDX-License-Identifier: Apache-2.0
 *
 * Encodes a frame as an image file: JPEG with libjpeg-turbo, PNG with libpng, WebP with libwebp.
 * EXR uses OpenImageIO in the module `splat-exr.so`, which is loaded for the first EXR image.
 */
#ifndef SP_ENCODE_H
#define SP_ENCODE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sp/api.h"
#include "sp/frame.h"
#include "sp/status.h"
#include "sp/view.h"

#ifdef __cplusplus
extern "C" {
#endif

enum sp_image_format {
    SP_IMAGE_JPEG,
    SP_IMAGE_PNG,
    SP_IMAGE_WEBP,
    SP_IMAGE_EXR,
    SP_IMAGE_FORMAT_COUNT
};

/* All strings are constants. */
struct sp_image_format_info {
    const char *name;      /* "jpeg", "png", "webp", "exr" */
    const char *mime;      /* "image/jpeg", … "image/x-exr" */
    const char *extension; /* ".jpg", … */
    bool wants_float;      /* prefers an SP_RGBAF32 frame */
    bool is_lossless;      /* ignores the quality */
};
/* format < SP_IMAGE_FORMAT_COUNT. Thread-safe; constant data. */
SP_API const struct sp_image_format_info *sp_image_format_info(enum sp_image_format format);
/* Finds a format by name, MIME type or file extension (".jpeg" and ".jpg" alike). Returns
 * SP_IMAGE_FORMAT_COUNT if none matches. Thread-safe. */
SP_API enum sp_image_format sp_image_format_find(const char *text);

/* Returns an upper bound of the memory that encoding an image takes, in bytes: without its pixels,
 * but with a copy of the encoded file. Thread-safe. */
SP_API uint64_t sp_encode_bytes(enum sp_image_format format, const uint32_t size[2]);

/* An encoder keeps the memory that it reuses from frame to frame. One thread at a time. */
struct sp_encoder;
/* Returns NULL on failure: SP_ERR_MEMORY. */
SP_API struct sp_encoder *sp_encoder_create(struct sp_error *err);
/* Accepts a NULL encoder and nulls *encoder. */
SP_API void sp_encoder_destroy(struct sp_encoder **encoder);
/* Frees the memory that the encoder keeps for large images. The bytes of the last image become
 * invalid.
 */
SP_API void sp_encoder_trim(struct sp_encoder *encoder);

/* Chroma subsampling of a JPEG: one colour per pixel (4:4:4), per 2 × 1 (4:2:2) or per 2 × 2 pixels
 * (4:2:0). */
enum sp_chroma { SP_CHROMA_AUTO, SP_CHROMA_444, SP_CHROMA_422, SP_CHROMA_420, SP_CHROMA_COUNT };
/* "auto", "4:4:4", "4:2:2", "4:2:0": constant strings. Thread-safe. */
SP_API const char *sp_chroma_name(enum sp_chroma chroma);
/* Returns SP_CHROMA_COUNT if the name is unknown. Thread-safe. */
SP_API enum sp_chroma sp_chroma_find(const char *name);
/* Replaces AUTO by 4:2:0 below quality 90 and by 4:4:4 from 90 on; returns any other value
 * unchanged. Thread-safe. */
SP_API enum sp_chroma sp_chroma_at(enum sp_chroma chroma, int quality);
/* Sets the subsampling of this encoder's next JPEG images; default SP_CHROMA_AUTO. */
SP_API void sp_encoder_set_chroma(struct sp_encoder *encoder, enum sp_chroma chroma);

/* A large JPEG is encoded in stripes, which several threads can work on. sp_encode() calls
 *   share(user, own, count, stripe, of)
 * once per JPEG. The callback calls stripe(of, i, with) once for each i < count, on any threads,
 * and returns when all of these calls have returned. `with` is an encoder that no other call uses
 * meanwhile; `own` is the encoder that sp_encode() was called with. The bytes do not depend on
 * which thread encodes which stripe. */
typedef void sp_stripe_fn(void *of, unsigned i, struct sp_encoder *with);
typedef void sp_share_fn(void *user, struct sp_encoder *own, unsigned count, sp_stripe_fn *stripe,
                         void *of);
/* NULL (default) = the caller of sp_encode() encodes all stripes itself. `user` must outlive the
 * encoder or the next call of this function. */
SP_API void sp_encoder_set_share(struct sp_encoder *encoder, sp_share_fn *share, void *user);

/* Encodes the frame. An EXR file of a frame with depth (sp/frame.h) has two more channels of floats
 * [world unit]: "Z", +infinity where a pixel shows nothing, and "Z.spread". Other formats leave
 * depth out. quality: [1, 100]; lossless formats ignore it. JPEG has no alpha: the image is
 * blended over black. On success *bytes and *size describe the encoded file. The encoder owns the
 * bytes; they are valid until the next call of the encoder. Errors: SP_ERR_MEMORY, SP_ERR_BACKEND
 * (the library failed), SP_ERR_IO (the EXR module cannot be loaded). */
SP_API bool sp_encode(struct sp_encoder *encoder, const struct sp_frame *frame,
                      enum sp_image_format format, int quality, const uint8_t **bytes, size_t *size,
                      struct sp_error *err);

/* The depth of a frame as a small image, for clients that draw the frame from another camera. One
 * cell stands for SP_DEPTH_CELL × SP_DEPTH_CELL pixels of the frame (fewer at the right and the
 * lower border). Where the depths of a cell lie on both sides of a silhouette, the nearer side
 * counts. It is a grey PNG of 8 bits, with twice as many rows as there are cells:
 *
 *   upper half  0 = the cell shows nothing; else v in [1, 255], the depth: from far (1) to near
 *               (255), in equal steps of 1 / depth in perspective, and of depth in orthographic
 *               projection
 *   lower half  the spread, in 255ths of far − near, rounded down to a multiple of
 *               SP_DEPTH_SPREAD_STEP; the largest one means that or more */
enum { SP_DEPTH_CELL = 4, SP_DEPTH_SPREAD_STEP = 32 };
struct sp_depth_image {
    uint32_t cells[2];    /* columns, rows */
    float near, far;      /* depths of 255 and of 1 [world unit]; in perspective > 0 */
    const uint8_t *bytes; /* the PNG; owned by the encoder, valid until its next call */
    size_t byte_count;    /* 0 = the frame shows nothing, and all is 0 */
};
/* Encodes the depth of a frame that has one (sp_frame.depth). Errors: SP_ERR_MEMORY,
 * SP_ERR_BACKEND. */
SP_API bool sp_encode_depth(struct sp_encoder *encoder, const struct sp_frame *frame,
                            enum sp_projection projection, struct sp_depth_image *image,
                            struct sp_error *err);

#ifdef __cplusplus
}
#endif

#endif
