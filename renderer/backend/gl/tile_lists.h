/* SPDX-License-Identifier: Apache-2.0
 *
 * Which blocks of points or voxels lie on which tile, front to back: the words that
 * shaders/entries.glsl reads.
 */
#ifndef GL_TILE_LISTS_H
#define GL_TILE_LISTS_H

#include "tile/bin.h"

struct gl_entry {
    uint32_t block, before; /* points of the tile before it */
};

/* Points of a block. */
typedef uint32_t gl_block_size_fn(const void *user, uint32_t block);

/* Writes the first entry of each tile and the end, and the entries; returns the most points of a
 * tile. */
uint32_t gl_tile_lists_write(uint32_t *first, struct gl_entry *entries, const struct sp_bins *bins,
                             gl_block_size_fn *size, const void *user);

/* Words of both. */
uint32_t gl_tile_lists_words(const struct sp_bins *bins);

#endif
