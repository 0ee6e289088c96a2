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
    return a->format == b->format && a->quality == b->quality && a->chroma == b->chroma;
}
