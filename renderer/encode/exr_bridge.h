/* SPDX-License-Identifier: Apache-2.0
 *
 * The C interface of the module splat-exr.so, which writes EXR with OpenImageIO. The module is
 * loaded on demand, because OpenImageIO and the libraries of its formats take 115 MiB and one or
 * two seconds.
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
    const float *depth, *spread; /* rows of depth_stride bytes; NULL = the image has no depth */
    size_t depth_stride;
};

enum sp_exr_status { SP_EXR_DONE, SP_EXR_MEMORY, SP_EXR_FAILED };

/* Receives the whole file in one call. Returns 0 if it has no memory for the file, otherwise
 * another value. */
typedef int sp_exr_sink(void *user, const void *bytes, size_t size);

/* Encodes an image and passes the file to `sink`. Thread-safe; throws no exceptions. On failure
 * writes the reason to `error`, a buffer of error_size > 0 bytes. */
typedef enum sp_exr_status sp_exr_encode_fn(const struct sp_exr_image *image, sp_exr_sink *sink,
                                            void *user, char *error, size_t error_size);

__attribute__((visibility("default"))) sp_exr_encode_fn splat_exr_encode;

#ifdef __cplusplus
}
#endif

#endif
