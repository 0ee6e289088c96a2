/* SPDX-License-Identifier: Apache-2.0
 *
 * Sorts the splats of a batch into tiles: a counting sort that lists each tile's splats in the
 * order of the records. The records are divided into blocks. One worker writes each block; blocks
 * are counted and filled in parallel.
 *
 *   count (per block and tile) ─► starts (prefix sums, tile by tile, block by block) ─► fill
 */
#ifndef SP_FOOTPRINTS_BIN_H
#define SP_FOOTPRINTS_BIN_H

#include "draw/footprints/tile.h"

struct sp_bins {
    uint32_t tiles;
    uint32_t blocks;
    uint32_t
        *counts; /* [blocks][tiles]: entries; after sp_bins_start(): where the next entry goes */
    uint32_t *first;   /* [tiles + 1]: entries of tile t are [first[t], first[t+1]) */
    uint32_t *entries; /* record numbers */
    uint32_t capacity; /* of entries */
};

/* Empties a block. */
void sp_bins_clear(const struct sp_bins *bins, uint32_t block);

/* Counts the next records of a block. */
void sp_bins_count(const struct sp_bins *bins, uint32_t block, const struct sp_tile_grid *grid,
                   const struct sp_splat *records, uint32_t count);

/* Returns the number of entries of a block. */
uint64_t sp_bins_block_total(const struct sp_bins *bins, uint32_t block);

/* Turns the counts of the blocks [begin, end) into starts. All their entries together must fit the
 * capacity. */
void sp_bins_start(struct sp_bins *bins, uint32_t begin, uint32_t end);

/* Writes the entries of the next records of a block; `first_record` is the number of records[0]. */
void sp_bins_fill(struct sp_bins *bins, uint32_t block, const struct sp_tile_grid *grid,
                  const struct sp_splat *records, uint32_t count, uint32_t first_record);

/* True if every tile that the splat touches is saturated: then the splat need not be drawn. */
bool sp_bins_is_hidden(const struct sp_tile_grid *grid, const struct sp_splat *splat);

#endif
