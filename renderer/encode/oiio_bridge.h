/* SPDX-License-Identifier: Apache-2.0
 *
 * The one function of splat-oiio.so, in C. The library is OpenImageIO behind a bridge: loaded on
 * demand, since linking it costs 0.2 s of start and 130 MB.
 */
#ifndef ENCODE_OIIO_BRIDGE_H
#define ENCODE_OIIO_BRIDGE_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct sp_oiio_image {
    const char *extension; /* ".png", ".webp", ".exr": picks the format */
    const void *pixels;    /* rows of `stride` bytes, from the top */
    uint32_t width, height;
    uint32_t channels; /* 3 or 4; of 8 bit not associated, of float associated */
    size_t stride;
    int is_float;
    int quality; /* [1,100], WebP */
};

enum sp_oiio_status { SP_OIIO_DONE, SP_OIIO_MEMORY, SP_OIIO_FAILED };

/* Receives the whole file once; returns 0 when it has no memory for it. */
typedef int sp_oiio_sink(void *user, const void *bytes, size_t size);

/* Thread-safe. Throws nothing. On failure `error` (of error_size > 0 bytes) says why. */
typedef enum sp_oiio_status sp_oiio_encode_fn(const struct sp_oiio_image *image, sp_oiio_sink *sink,
                                              void *user, char *error, size_t error_size);

__attribute__((visibility("default"))) sp_oiio_encode_fn splat_oiio_encode;

#ifdef __cplusplus
}
#endif

#endif
