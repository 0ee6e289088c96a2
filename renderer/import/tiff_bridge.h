/* SPDX-License-Identifier: Apache-2.0
 *
 * The part of OpenImageIO that tiff.c needs, for C. One file at a time, one thread.
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
    int bytes, bits;                    /* per sample: as returned; as stored (0 = the same) */
    bool floating, is_signed;
    double x_resolution, y_resolution; /* px per unit; 0 = unknown */
    char resolution_unit[8];           /* "in", "cm", "none", "" */
    char description[4096];            /* a longer text is cut; ends with 0 */
};

struct tiff_bridge;

/* Opens a file. NULL on failure, with the reason in `why` (`capacity` bytes). */
struct tiff_bridge *tiff_bridge_open(const char *path, char *why, size_t capacity);
void tiff_bridge_close(struct tiff_bridge *bridge);

/* Describes page n, from 0. Returns 1, 0 if there is no such page, or -1 with the reason in `why`.
 */
int tiff_bridge_page(struct tiff_bridge *bridge, int n, struct tiff_page *page, char *why,
                     size_t capacity);

/* Reads the samples of page n into width · height · bytes of memory. */
bool tiff_bridge_read(struct tiff_bridge *bridge, int n, void *out, char *why, size_t capacity);

#ifdef __cplusplus
}
#endif
#endif
