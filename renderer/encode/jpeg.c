/* SPDX-License-Identifier: Apache-2.0 */
#include <turbojpeg.h>

#include "encode/encoder.h"

enum { FULL_COLOUR_QUALITY = 90 }; /* from here on colour is not subsampled */

bool sp_encode_jpeg(struct sp_encoder *encoder, const struct sp_raster *raster, int quality,
                    struct sp_error *err) {
    if (!encoder->jpeg)
        encoder->jpeg = tjInitCompress();
    if (!encoder->jpeg)
        return sp_fail(err, SP_ERR_MEMORY, "", "no memory for a JPEG encoder: %s",
                       tjGetErrorStr2(NULL));
    int width = (int)raster->width, height = (int)raster->height;
    int sampling = quality < FULL_COLOUR_QUALITY ? TJSAMP_420 : TJSAMP_444;
    if (!sp_buffer_reserve(&encoder->output, tjBufSize(width, height, sampling), err))
        return false;
    unsigned long size = encoder->output.capacity;
    if (tjCompress2(encoder->jpeg, raster->pixels, width, (int)raster->stride, height, TJPF_RGBX,
                    &encoder->output.bytes, &size, sampling, quality, TJFLAG_NOREALLOC) != 0)
        return sp_fail(err, SP_ERR_BACKEND, "", "cannot encode a JPEG image of %d × %d: %s", width,
                       height, tjGetErrorStr2(encoder->jpeg));
    encoder->output.size = size;
    return true;
}

void sp_encode_jpeg_finish(struct sp_encoder *encoder) {
    if (encoder->jpeg)
        tjDestroy(encoder->jpeg);
    encoder->jpeg = NULL;
}
