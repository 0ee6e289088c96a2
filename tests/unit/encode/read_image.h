/* SPDX-License-Identifier: Apache-2.0 */
#ifndef READ_IMAGE_H
#define READ_IMAGE_H

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

struct decoded_image {
    int width, height, channels, is_float;
    char names[6][16]; /* of the first channels */
    float *pixels; /* width·height·channels, top row first, 8-bit values as 0 … 1; the caller frees
                      them */
};

/* Decodes a file in memory; does not change its alpha. Prints the reason and returns 0 on
 * failure. */
int read_image(const char *extension, const void *bytes, size_t size, struct decoded_image *image);

#ifdef __cplusplus
}
#endif

#endif
