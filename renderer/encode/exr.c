/* SPDX-License-Identifier: Apache-2.0 */
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
    void *symbol = sp_module_symbol("splat-exr.so", "splat_exr_encode", "EXR writer", &why);
    if (!symbol)
        return sp_fail(err, SP_ERR_IO, why.place, "%s", why.text);
    encoder->exr = (sp_exr_encode_fn *)symbol;
    return true;
}

static int append_bytes(void *user, const void *bytes, size_t size) {
    struct sp_buffer *output = user;
    return sp_buffer_reserve(output, size, NULL) && sp_buffer_append(output, bytes, size);
}

bool sp_encode_exr(struct sp_encoder *encoder, const struct sp_raster *raster,
                   struct sp_error *err) {
    if (!encoder->exr && !load_bridge(encoder, err))
        return false;
    const struct sp_exr_image image = { .pixels = raster->pixels,
                                        .width = raster->width,
                                        .height = raster->height,
                                        .stride = raster->stride,
                                        .depth = raster->depth,
                                        .spread = raster->spread,
                                        .depth_stride = raster->depth_stride };
    char why[256] = "";
    switch (encoder->exr(&image, append_bytes, &encoder->output, why, sizeof why)) {
    case SP_EXR_DONE:
        return true;
    case SP_EXR_MEMORY:
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory while encoding %u × %u as exr",
                       raster->width, raster->height);
    case SP_EXR_FAILED:
        break;
    }
    return sp_fail(err, SP_ERR_BACKEND, "", "cannot encode %u × %u as exr: %s", raster->width,
                   raster->height, why);
}
