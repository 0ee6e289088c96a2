/* SPDX-License-Identifier: Apache-2.0
 *
 * Converts the pixels of a frame to the layout that an image format needs.
 *
 * A frame has 8-bit pixels with straight alpha, or floats with premultiplied alpha. JPEG, PNG and
 * WebP need 8 bits, EXR needs floats. Colours stay display values (sRGB); they are not linearised.
 */
#ifndef ENCODE_CONVERT_H
#define ENCODE_CONVERT_H

#include "encode/encoder.h"

/* True if every alpha is 1 (or rounds to 255). Reads the pixels unless the frame already has the
 * answer. */
bool sp_frame_is_opaque(const struct sp_frame *frame);

enum sp_raster_kind {
    SP_RASTER_RGBX8,  /* 4 bytes, over black; the fourth is not used */
    SP_RASTER_RGBA8,  /* 4 bytes, straight alpha */
    SP_RASTER_RGBAF32 /* 4 floats, premultiplied alpha */
};

/* Fills *raster with the pixels of the frame in the layout `kind`. The raster borrows the frame's
 * own pixels if they have this layout; otherwise they are converted into encoder->pixels. NaN
 * becomes 0 in 8 bits. False with *err set if memory runs out. */
bool sp_frame_to_raster(struct sp_encoder *encoder, const struct sp_frame *frame,
                        enum sp_raster_kind kind, struct sp_raster *raster, struct sp_error *err);

#endif
