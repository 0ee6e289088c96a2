/* SPDX-License-Identifier: Apache-2.0
 *
 * The part of OpenImageIO that image.c and vdb.c need, for C. OpenImageIO takes 130 MB of memory
 * and half a second to load. It is therefore a module of its own, IMAGE_BRIDGE_MODULE beside the
 * program, which is loaded for an image.
 * The module exports one table of functions, IMAGE_BRIDGE_SYMBOL. One thread.
 */
#ifndef SP_IMPORT_IMAGE_BRIDGE_H
#define SP_IMPORT_IMAGE_BRIDGE_H

#include <stdbool.h>
#include <stddef.h>

#include "sp/status.h"

#ifdef __cplusplus
extern "C" {
#endif

struct image_page {
    int width, height, channels; /* px */
    int bytes;                   /* per sample */
    bool floating, is_signed;
};

/* A grid of an OpenVDB file, with the box of its active voxels. */
struct image_grid {
    char name[128];
    int channels;
    bool is_double;    /* float otherwise */
    bool is_other;     /* of another type, or not linear: it cannot be read */
    bool is_level_set; /* distances from a surface at 0, negative inside */
    int first[3];      /* smallest index of the box, x fastest */
    int dims[3];       /* [voxels] */
    double rows[4][3]; /* world = index · the first three rows + the last one */
};

struct image_bridge;

struct image_bridge_functions {
    /* Opens a file of the format "png", "jpeg" or "openvdb". NULL on failure, with *err set but
     * for its place. */
    struct image_bridge *(*open)(const char *path, const char *format, struct sp_error *err);
    void (*close)(struct image_bridge *bridge);
    /* Describes page n, from 0. Returns 1, 0 if there is no such page, or -1 with *err set. */
    int (*page)(struct image_bridge *bridge, int n, struct image_page *page, struct sp_error *err);
    /* Reads the samples of page n into width · height · channels · bytes of memory. */
    bool (*read)(struct image_bridge *bridge, int n, void *out, struct sp_error *err);
    /* Describes grid n of an OpenVDB file, from 0. As page(). */
    int (*grid)(struct image_bridge *bridge, int n, struct image_grid *grid, struct sp_error *err);
    /* Reads the voxels of the box of grid n, x fastest, of one channel. `report` gets how many
     * voxels are done. */
    bool (*voxels)(struct image_bridge *bridge, int n, void *out,
                   void (*report)(void *user, size_t done), void *user, struct sp_error *err);
};

#define IMAGE_BRIDGE_MODULE "splat-import-image.so"
#define IMAGE_BRIDGE_SYMBOL "splat_image_bridge"
extern const struct image_bridge_functions splat_image_bridge;

#ifdef __cplusplus
}
#endif
#endif
