/* SPDX-License-Identifier: Apache-2.0
 *
 * The compressors of Zarr that need a library of their own, Blosc and Zstandard, as a module that
 * zarr_chunk.c loads when an array uses one. gzip and zlib need no module.
 */
#ifndef SP_IMPORT_ZARR_BRIDGE_H
#define SP_IMPORT_ZARR_BRIDGE_H

#include <stdbool.h>
#include <stddef.h>

#include "sp/status.h"

struct zarr_bridge_functions {
    /* Unpack `size` bytes into at most `capacity` bytes. False with *err set but for its place. One
     * thread. */
    bool (*blosc)(const void *in, size_t size, void *out, size_t capacity, size_t *got,
                  struct sp_error *err);
    bool (*zstd)(const void *in, size_t size, void *out, size_t capacity, size_t *got,
                 struct sp_error *err);
};

#define ZARR_BRIDGE_MODULE "splat-import-zarr.so"
#define ZARR_BRIDGE_SYMBOL "splat_zarr_bridge"
extern const struct zarr_bridge_functions splat_zarr_bridge;

#endif
