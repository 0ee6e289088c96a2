/* SPDX-License-Identifier: Apache-2.0 */
#ifndef READ_IMAGE_H
#define READ_IMAGE_H

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

struct decoded_image {
    int width, height, channels, is_float;
    float *pixels; /* width·height·channels, rows from the top, 8 bit as 0 … 1; free() */
};

/* Decodes a file in memory, alpha as the file has it. Returns 0 and prints why on failure. */
int read_image(const char *extension, const void *bytes, size_t size, struct decoded_image *image);

#ifdef __cplusplus
}
#endif

#endif
