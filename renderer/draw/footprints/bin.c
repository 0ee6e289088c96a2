/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/footprints/bin.h"

#include <assert.h>
#include <string.h>

/* The tiles that a splat's box touches: columns [c0, c1], rows [r0, r1]. */
struct span {
    int c0, r0, c1, r1;
};

static inline struct span compute_span(const struct sp_tile_grid *grid, const struct sp_splat *s) {
    return (struct span){ s->x0 / SP_TILE, (s->y0 - grid->y) / SP_TILE, (s->x1 - 1) / SP_TILE,
                          (s->y1 - 1 - grid->y) / SP_TILE };
}

bool sp_bins_is_hidden(const struct sp_tile_grid *grid, const struct sp_splat *splat) {
    struct span t = compute_span(grid, splat);
    for (int r = t.r0; r <= t.r1; r++)
        for (int c = t.c0; c <= t.c1; c++)
            if (!grid->tiles[r * grid->columns + c].saturated)
                return false;
    return true;
}

void sp_bins_clear(const struct sp_bins *bins, uint32_t block) {
    uint32_t *counts = bins->counts + (size_t)block * bins->tiles;
    memset(counts, 0, bins->tiles * sizeof *counts);
}

void sp_bins_count(const struct sp_bins *bins, uint32_t block, const struct sp_tile_grid *grid,
                   const struct sp_splat *records, uint32_t count) {
    uint32_t *counts = bins->counts + (size_t)block * bins->tiles;
    for (uint32_t i = 0; i < count; i++) {
        struct span t = compute_span(grid, &records[i]);
        for (int r = t.r0; r <= t.r1; r++)
            for (int c = t.c0; c <= t.c1; c++)
                counts[r * grid->columns + c]++;
    }
}

uint64_t sp_bins_block_total(const struct sp_bins *bins, uint32_t block) {
    const uint32_t *counts = bins->counts + (size_t)block * bins->tiles;
    uint64_t total = 0;
    for (uint32_t t = 0; t < bins->tiles; t++)
        total += counts[t];
    return total;
}

void sp_bins_start(struct sp_bins *bins, uint32_t begin, uint32_t end) {
    uint32_t at = 0;
    for (uint32_t t = 0; t < bins->tiles; t++) {
        bins->first[t] = at;
        for (uint32_t b = begin; b < end; b++) {
            uint32_t *count = &bins->counts[(size_t)b * bins->tiles + t], n = *count;
            *count = at;
            at += n;
        }
    }
    bins->first[bins->tiles] = at;
    assert(at <= bins->capacity);
}

void sp_bins_fill(struct sp_bins *bins, uint32_t block, const struct sp_tile_grid *grid,
                  const struct sp_splat *records, uint32_t count, uint32_t first_record) {
    uint32_t *next = bins->counts + (size_t)block * bins->tiles;
    for (uint32_t i = 0; i < count; i++) {
        struct span t = compute_span(grid, &records[i]);
        for (int r = t.r0; r <= t.r1; r++)
            for (int c = t.c0; c <= t.c1; c++)
                bins->entries[next[r * grid->columns + c]++] = first_record + i;
    }
}
