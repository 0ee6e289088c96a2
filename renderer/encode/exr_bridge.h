/* SPDX-License-Identifier: Apache-2.0
 *
 * The one function of splat-exr.so, in C. OpenImageIO writes the EXR. It is loaded on demand,
 * because with the libraries of all its formats it takes 115 MiB and one or two seconds.
 */
#ifndef ENCODE_EXR_BRIDGE_H
#define ENCODE_EXR_BRIDGE_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct sp_exr_image {
    const void *pixels; /* rows of `stride` bytes, from the top; RGBA floats, premultiplied alpha */
    uint32_t width, height;
    size_t stride;
};

enum sp_exr_status { SP_EXR_DONE, SP_EXR_MEMORY, SP_EXR_FAILED };

/* Receives the whole file in one call; returns 0 if it has no memory for it. */
typedef int sp_exr_sink(void *user, const void *bytes, size_t size);

/* Thread-safe. Throws no exceptions. On failure writes the reason to `error` (error_size > 0
 * bytes). */
typedef enum sp_exr_status sp_exr_encode_fn(const struct sp_exr_image *image, sp_exr_sink *sink,
                                            void *user, char *error, size_t error_size);

__attribute__((visibility("default"))) sp_exr_encode_fn splat_exr_encode;

#ifdef __cplusplus
}
#endif

#endif
