/* SPDX-License-Identifier: Apache-2.0
 *
 * A frame's pixels in the layout that an image format wants.
 *
 * Frames hold 8 bits with straight alpha, or floats with premultiplied alpha. Image formats of 8
 * bits need the former, EXR needs the latter. Colours stay display values (sRGB); they are not
 * linearised.
 */
#ifndef ENCODE_CONVERT_H
#define ENCODE_CONVERT_H

#include "encode/encoder.h"

/* True if every alpha is 1 (or rounds to 255). Reads the pixels unless the frame already knows. */
bool sp_frame_is_opaque(const struct sp_frame *frame);

enum sp_raster_kind {
    SP_RASTER_RGBX8,  /* 4 bytes, over black; the fourth is not used */
    SP_RASTER_RGBA8,  /* 4 bytes, straight alpha */
    SP_RASTER_RGBAF32 /* 4 floats, premultiplied alpha */
};

/* Describes the frame as `kind` in *raster: its own pixels if they serve, else converted into
 * encoder->pixels. NaN becomes 0 in 8 bit. False with *err set when out of memory. */
bool sp_frame_to_raster(struct sp_encoder *encoder, const struct sp_frame *frame,
                        enum sp_raster_kind kind, struct sp_raster *raster, struct sp_error *err);

#endif
