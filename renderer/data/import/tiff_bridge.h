/* SPDX-License-Identifier: Apache-2.0
 *
 * The part of libtiff that tiff.c needs: it unpacks strips and tiles. It is a module of its own,
 * which is loaded for a TIFF that has passed the checks of tiff_chain.c. One thread.
 */
#ifndef SP_IMPORT_TIFF_BRIDGE_H
#define SP_IMPORT_TIFF_BRIDGE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sp/status.h"

struct tiff_bridge;

struct tiff_bridge_functions {
    /* Reads the file of the descriptor, which stays the caller's. NULL on failure, with *err set
     * but for its place. */
    struct tiff_bridge *(*open)(int fd, struct sp_error *err);
    void (*close)(struct tiff_bridge *bridge);
    /* Reads `count` rows of a plane of the page whose directory is at byte `page`, from row `first`
     * on, into `row_bytes` each: the samples of a row are packed as in the file, in native byte
     * order. `first` is the first row of a strip or tile. Colours of JPEG become RGB. */
    bool (*rows)(struct tiff_bridge *bridge, uint64_t page, unsigned plane, uint32_t first,
                 uint32_t count, size_t row_bytes, void *out, struct sp_error *err);
};

#define TIFF_BRIDGE_MODULE "splat-import-tiff.so"
#define TIFF_BRIDGE_SYMBOL "splat_tiff_bridge"
extern const struct tiff_bridge_functions splat_tiff_bridge;

#endif
