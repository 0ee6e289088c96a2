/* SPDX-License-Identifier: Apache-2.0
 *
 * What layers other than the volume show: per pixel a short list of fragments, sorted by depth.
 *
 *   surface ──┐                        ┌─ no volume layer: composited, front to back
 *   shell  ───┴─► tile of 32 × 32 px ──┤
 *                 sp_fragment_add()    └─ else stored; the volume's compositor takes each fragment
 *                                         before the sheet or slab behind it
 *
 * Depth is u2 of camera space: the distance from the eye along the view direction [world unit]. It
 * may be negative in orthographic projection.
 */
#ifndef SP_FRAME_FRAGMENTS_H
#define SP_FRAME_FRAGMENTS_H

#include <stdbool.h>
#include <stdint.h>

#include "base/arena.h"

enum {
    SP_FRAGMENT_TILE = 32, /* px, both ways */
    SP_FRAGMENT_PIXELS = SP_FRAGMENT_TILE * SP_FRAGMENT_TILE,
    SP_FRAGMENTS_MAX = 16 /* per pixel; more are merged into the last one */
};

struct sp_fragment {
    float depth;
    float color[3]; /* premultiplied by alpha */
    float alpha;    /* opacity times coverage, [0, 1] */
};

/* The fragments of one tile while its layers are drawn. */
struct sp_fragment_tile {
    int x, y;                          /* of its corner in the image [px] */
    uint8_t count[SP_FRAGMENT_PIXELS]; /* by pixel, row by row */
    struct sp_fragment list[SP_FRAGMENT_PIXELS][SP_FRAGMENTS_MAX];
};

/* The fragments of an image. */
struct sp_fragments {
    int columns, rows; /* of tiles */
    /* [columns · rows]: of each tile where its pixels' fragments start, or NULL = it has none. */
    const uint32_t **first;          /* [SP_FRAGMENT_PIXELS + 1] */
    const struct sp_fragment **list; /* [first[SP_FRAGMENT_PIXELS]], rising depth per pixel */
};

/* Empties the tile whose corner is at (x, y). */
void sp_fragment_tile_clear(struct sp_fragment_tile *tile, int x, int y);

/* Adds a fragment to pixel number `pixel` of the tile, in order of depth; behind those of equal
 * depth. Fragments without alpha are dropped. If the pixel is full, its two farthest fragments
 * become one. */
void sp_fragment_add(struct sp_fragment_tile *tile, int pixel, const struct sp_fragment *fragment);

/* Puts a fragment behind `rgbt`: premultiplied red, green, blue, transmittance. */
static inline void sp_fragment_over(const struct sp_fragment *fragment, float rgbt[4]) {
    for (int c = 0; c < 3; c++)
        rgbt[c] += rgbt[3] * fragment->color[c];
    rgbt[3] *= 1 - fragment->alpha;
}

/* Allocates the lists of an image of that size, all empty. False: out of memory. */
bool sp_fragments_init(struct sp_fragments *fragments, const uint32_t size[2],
                       struct sp_arena *arena);

/* Memory that a tile's fragments need, and the copy of a tile to that memory. Tiles may be stored
 * on several threads at a time; `first` is [SP_FRAGMENT_PIXELS + 1], `list` is
 * [sp_fragment_tile_count()]. */
uint32_t sp_fragment_tile_count(const struct sp_fragment_tile *tile);
void sp_fragments_store(struct sp_fragments *fragments, const struct sp_fragment_tile *tile,
                        uint32_t *first, struct sp_fragment *list);

/* The fragments of a pixel of the image, and how many there are. */
static inline const struct sp_fragment *sp_fragments_at(const struct sp_fragments *fragments, int x,
                                                        int y, uint32_t *count) {
    int tile = y / SP_FRAGMENT_TILE * fragments->columns + x / SP_FRAGMENT_TILE;
    int pixel = y % SP_FRAGMENT_TILE * SP_FRAGMENT_TILE + x % SP_FRAGMENT_TILE;
    const uint32_t *first = fragments->first[tile];
    *count = first ? first[pixel + 1] - first[pixel] : 0;
    return first ? fragments->list[tile] + first[pixel] : NULL;
}

#endif
