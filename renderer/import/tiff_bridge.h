/* SPDX-License-Identifier: Apache-2.0
 *
 * The part of OpenImageIO that tiff.c needs, for C. OpenImageIO takes 130 MB of memory and half a
 * second to load. It is therefore a module of its own, TIFF_BRIDGE_MODULE beside the program, which
 * tiff.c loads when a TIFF has passed its own checks. The module exports one table of functions,
 * TIFF_BRIDGE_SYMBOL. One file at a time, one thread.
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

struct tiff_bridge_functions {
    /* Opens a file. NULL on failure, with the reason in `why` (`capacity` bytes). */
    struct tiff_bridge *(*open)(const char *path, char *why, size_t capacity);
    void (*close)(struct tiff_bridge *bridge);
    /* Describes page n, from 0. Returns 1, 0 if there is no such page, or -1 with the reason in
     * `why`. */
    int (*page)(struct tiff_bridge *bridge, int n, struct tiff_page *page, char *why,
                size_t capacity);
    /* Reads the samples of page n into width · height · bytes of memory. */
    bool (*read)(struct tiff_bridge *bridge, int n, void *out, char *why, size_t capacity);
};

#define TIFF_BRIDGE_MODULE "splat-import-tiff.so"
#define TIFF_BRIDGE_SYMBOL "splat_tiff_bridge"
extern const struct tiff_bridge_functions splat_tiff_bridge;

#ifdef __cplusplus
}
#endif
#endif
