/* SPDX-License-Identifier: Apache-2.0 */
#include "session/encode_params.h"

struct srv_encode_params srv_encode_params_from(enum sp_image_format format, int quality,
                                                enum sp_chroma chroma) {
    return (struct srv_encode_params){
        .format = format,
        .quality = sp_image_format_info(format)->is_lossless ? 100 : quality,
        .chroma = format == SP_IMAGE_JPEG ? sp_chroma_at(chroma, quality) : SP_CHROMA_AUTO,
    };
}

bool srv_encode_params_equal(const struct srv_encode_params *a, const struct srv_encode_params *b) {
    return a->format == b->format && a->quality == b->quality && a->chroma == b->chroma &&
           a->depth == b->depth;
}

double srv_encoding_expected_ms(const struct srv_encoding *e, const uint32_t size[2]) {
    static const double images[SP_IMAGE_FORMAT_COUNT] = { [SP_IMAGE_JPEG] = 3.5e-6,
                                                          [SP_IMAGE_PNG] = 15e-6,
                                                          [SP_IMAGE_WEBP] = 48e-6,
                                                          [SP_IMAGE_EXR] = 120e-6 };
    const double videos = 7.5e-6;
    double px_ms = e->video == SP_VIDEO_CODEC_COUNT ? images[e->format] : videos;
    return px_ms * size[0] * size[1];
}
