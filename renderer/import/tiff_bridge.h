/* SPDX-License-Identifier: Apache-2.0
 *
 * The little of OpenImageIO that tiff.c needs, for C. One file at a time, one thread.
 */
#ifndef SP_IMPORT_TIFF_BRIDGE_H
#define SP_IMPORT_TIFF_BRIDGE_H

#include <stdbool.h>
#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

struct tiff_page {
    int width, height, depth, channels; /* px */
    int bytes, bits;                    /* a sample: as delivered, as stored (0 = the same) */
    bool floating, is_signed;
    double x_resolution, y_resolution; /* px a unit; 0 = not said */
    char resolution_unit[8];           /* "in", "cm", "none", "" */
    char description[4096];            /* cut off when longer; ends with 0 */
};

struct tiff_bridge;

/* NULL with `why` (of `room` bytes) filled. */
struct tiff_bridge *tiff_bridge_open(const char *path, char *why, size_t room);
void tiff_bridge_close(struct tiff_bridge *bridge);

/* 1 = *page is page n (from 0), 0 = there is no such page, -1 = `why` is filled. */
int tiff_bridge_page(struct tiff_bridge *bridge, int n, struct tiff_page *page, char *why,
                     size_t room);

/* Reads page n as it is stored into width · height · bytes of memory. */
bool tiff_bridge_read(struct tiff_bridge *bridge, int n, void *out, char *why, size_t room);

#ifdef __cplusplus
}
#endif
#endif
