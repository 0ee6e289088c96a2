/* SPDX-License-Identifier: Apache-2.0 */
#include <assert.h>
#include <string.h>
#include <turbojpeg.h>

#include "encode/encoder.h"

enum { FULL_COLOUR_QUALITY = 90 }; /* from here on colour is not subsampled by itself */

static const struct {
    const char *name;
    int sampling;
} chromas[SP_CHROMA_COUNT] = {
    [SP_CHROMA_AUTO] = { "auto", -1 },
    [SP_CHROMA_444] = { "4:4:4", TJSAMP_444 },
    [SP_CHROMA_422] = { "4:2:2", TJSAMP_422 },
    [SP_CHROMA_420] = { "4:2:0", TJSAMP_420 },
};

const char *sp_chroma_name(enum sp_chroma chroma) {
    assert(chroma < SP_CHROMA_COUNT);
    return chromas[chroma].name;
}

enum sp_chroma sp_chroma_find(const char *name) {
    int i = 0;
    while (i < SP_CHROMA_COUNT && strcmp(chromas[i].name, name) != 0)
        i++;
    return (enum sp_chroma)i;
}

enum sp_chroma sp_chroma_at(enum sp_chroma chroma, int quality) {
    enum sp_chroma by_quality = quality < FULL_COLOUR_QUALITY ? SP_CHROMA_420 : SP_CHROMA_444;
    return chroma == SP_CHROMA_AUTO ? by_quality : chroma;
}

void sp_encoder_set_chroma(struct sp_encoder *encoder, enum sp_chroma chroma) {
    encoder->chroma = chroma;
}

bool sp_encode_jpeg(struct sp_encoder *encoder, const struct sp_raster *raster, int quality,
                    struct sp_error *err) {
    if (!encoder->jpeg)
        encoder->jpeg = tjInitCompress();
    if (!encoder->jpeg)
        return sp_fail(err, SP_ERR_MEMORY, "", "no memory for a JPEG encoder: %s",
                       tjGetErrorStr2(NULL));
    int width = (int)raster->width, height = (int)raster->height;
    int sampling = chromas[sp_chroma_at(encoder->chroma, quality)].sampling;
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
