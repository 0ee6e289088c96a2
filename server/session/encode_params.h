/* SPDX-License-Identifier: Apache-2.0
 *
 * What decides the bytes of a picture beside the picture itself: of equal forms they are the same.
 */
#ifndef SRV_FORM_H
#define SRV_FORM_H

#include <stdbool.h>

#include "sp/encode.h"

struct srv_form {
    enum sp_image_format format;
    int quality;           /* of a lossless format 100 */
    enum sp_chroma chroma; /* of a JPEG, never AUTO; else AUTO */
};

/* Of what was asked for. */
struct srv_form srv_form_of(enum sp_image_format format, int quality, enum sp_chroma chroma);
bool srv_form_is_same(const struct srv_form *a, const struct srv_form *b);

#endif
