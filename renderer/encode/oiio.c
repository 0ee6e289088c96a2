/* SPDX-License-Identifier: Apache-2.0 */
#include <string.h>

#include "encode/encoder.h"
#include "encode/module.h"

#if defined(__SANITIZE_THREAD__)
/* The library guards its thread pool and its table of formats with spin locks, which TSan cannot
 * see in a library that was not built with it. */
__attribute__((visibility("default"))) const char *__tsan_default_suppressions(void);
const char *__tsan_default_suppressions(void) {
    return "called_from_lib:libOpenImageIO_Util.so\ncalled_from_lib:libOpenImageIO.so\n";
}
#endif

static bool load_bridge(struct sp_encoder *encoder, struct sp_error *err) {
    struct sp_error why;
    void *symbol = sp_module_symbol("splat-oiio.so", "splat_oiio_encode", "image library", &why);
    if (!symbol)
        return sp_fail(err, SP_ERR_IO, why.place, "%s%s", why.text,
                       why.code == SP_ERR_NOT_FOUND ? "; every format but JPEG needs it" : "");
    encoder->oiio = (sp_oiio_encode_fn *)symbol;
    return true;
}

static int keep(void *user, const void *bytes, size_t size) {
    struct sp_buffer *output = user;
    if (!sp_buffer_reserve(output, size, NULL))
        return 0;
    memcpy(output->bytes, bytes, size);
    output->size = size;
    return 1;
}

bool sp_encode_oiio(struct sp_encoder *encoder, const struct sp_raster *raster,
                    const struct sp_image_format_info *format, int quality, struct sp_error *err) {
    if (!encoder->oiio && !load_bridge(encoder, err))
        return false;
    const struct sp_oiio_image image = {
        .extension = format->extension,
        .pixels = raster->pixels,
        .width = raster->width,
        .height = raster->height,
        .channels = raster->channels,
        .stride = raster->stride,
        .is_float = raster->is_float,
        .quality = quality,
    };
    char why[256] = "";
    switch (encoder->oiio(&image, keep, &encoder->output, why, sizeof why)) {
    case SP_OIIO_DONE:
        return true;
    case SP_OIIO_MEMORY:
        return sp_fail(err, SP_ERR_MEMORY, "", "no memory to encode %u × %u as %s", raster->width,
                       raster->height, format->name);
    case SP_OIIO_FAILED:
        break;
    }
    return sp_fail(err, SP_ERR_BACKEND, "", "cannot encode %u × %u as %s: %s", raster->width,
                   raster->height, format->name, why);
}
