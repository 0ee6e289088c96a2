/* SPDX-License-Identifier: Apache-2.0 */
#include "session/encode_params.h"

struct srv_form srv_form_of(enum sp_image_format format, int quality, enum sp_chroma chroma) {
    return (struct srv_form){
        .format = format,
        .quality = sp_image_format_info(format)->is_lossless ? 100 : quality,
        .chroma = format == SP_IMAGE_JPEG ? sp_chroma_at(chroma, quality) : SP_CHROMA_AUTO,
    };
}

bool srv_form_is_same(const struct srv_form *a, const struct srv_form *b) {
    return a->format == b->format && a->quality == b->quality && a->chroma == b->chroma;
}
