/* SPDX-License-Identifier: Apache-2.0
 *
 * What decides the bytes of a picture beside the picture itself: of equal forms they are the same.
 */
#ifndef SRV_FORM_H
#define SRV_FORM_H

#include <stdbool.h>

#include "sp/encode.h"

struct srv_encode_params {
    enum sp_image_format format;
    int quality;           /* of a lossless format 100 */
    enum sp_chroma chroma; /* of a JPEG, never AUTO; else AUTO */
};

/* Of what was asked for. */
struct srv_encode_params srv_encode_params_from(enum sp_image_format format, int quality,
                                                enum sp_chroma chroma);
bool srv_encode_params_equal(const struct srv_encode_params *a, const struct srv_encode_params *b);

#endif
