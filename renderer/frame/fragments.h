/* SPDX-License-Identifier: Apache-2.0
 *
 * The output of the layers other than the volume: per pixel, a short list of fragments sorted by
 * depth.
 *
 *   surface ──┐                        ┌─ no volume layer: composited, front to back
 *   shell  ───┴─► tile of 32 × 32 px ──┤
 *                 sp_fragment_add()    └─ else stored, a band of the image at a time; the volume's
 *                                         compositor takes each fragment before the sheet or slab
 *                                         behind it
 *
 * Depth is u2 of camera space: the distance from the eye along the view direction [world unit]. It
 * may be negative in orthographic projection.
 */
#ifndef SP_FRAME_FRAGMENTS_H
#define SP_FRAME_FRAGMENTS_H

#include <stdbool.h>
#include <stdint.h>

#include "base/arena.h"
#include "sp/status.h"

enum {
    SP_FRAGMENT_TILE = 32, /* px, both ways */
    SP_FRAGMENT_PIXELS = SP_FRAGMENT_TILE * SP_FRAGMENT_TILE,
    SP_FRAGMENTS_MAX = 16 /* per pixel; beyond this number, neighbours are merged */
};

struct sp_fragment {
    float depth;
    float color[3]; /* premultiplied by alpha */
    float alpha;    /* opacity times coverage, [0, 1] */
};

/* The fragments of one tile while its layers are drawn. */
struct sp_fragment_tile {
    int x, y;                          /* top left corner of the tile in the image [px] */
    uint8_t count[SP_FRAGMENT_PIXELS]; /* by pixel, row by row */
    struct sp_fragment list[SP_FRAGMENT_PIXELS][SP_FRAGMENTS_MAX + 1]; /* the last one: scratch */
};

/* The fragments of one band of an image. The fragments of a whole large image would need gigabytes.
 * A compositor therefore draws band after band and calls sp_fragments_ensure() before each one. */
struct sp_fragments {
    int columns, rows; /* tiles of the image per axis */
    int begin, end;    /* rows [begin, end) of tiles whose fragments are stored; equal = none */
    int most;          /* most rows of tiles whose fragments may be stored at a time, at least 1 */
    /* Drops all fragments, makes the fragments of the tile rows [begin, end), and adds its time to
     * `ms`. */
    bool (*fill)(void *user, int begin, int end, struct sp_error *err);
    void *user;
    double ms; /* time spent in fill() [ms] */
    /* [columns · rows], per tile: where the fragments of each of its pixels start in its list. NULL
     * = the tile has no fragments. */
    const uint32_t **first;          /* [SP_FRAGMENT_PIXELS + 1] */
    const struct sp_fragment **list; /* [first[SP_FRAGMENT_PIXELS]], rising depth per pixel */
};

/* Empties the tile whose corner is at (x, y). */
void sp_fragment_tile_clear(struct sp_fragment_tile *tile, int x, int y);

/* The slow path of sp_fragment_add(): the pixel is full, or has fragments behind the new one. */
void sp_fragment_insert(struct sp_fragment_tile *tile, int pixel,
                        const struct sp_fragment *fragment);

/* Adds a fragment to pixel number `pixel` of the tile, in order of depth, and behind fragments of
 * equal depth. A fragment without alpha is dropped. If the pixel is full and the new fragment lies
 * behind all others, it is merged into the last one. If the pixel is full and the new fragment lies
 * in front of another, two neighbours are merged at the depth of the first: the pair between which
 * a further fragment would matter least. Therefore add the layers with few fragments first. */
static inline void sp_fragment_add(struct sp_fragment_tile *tile, int pixel,
                                   const struct sp_fragment *fragment) {
    struct sp_fragment *list = tile->list[pixel];
    const int count = tile->count[pixel];
    if (!(fragment->alpha > 0))
        return;
    if (count == SP_FRAGMENTS_MAX || (count && fragment->depth < list[count - 1].depth)) {
        sp_fragment_insert(tile, pixel, fragment);
        return;
    }
    list[count] = *fragment;
    tile->count[pixel] = (uint8_t)(count + 1);
}

/* Composites a fragment behind `rgbt`, which holds premultiplied red, green and blue, and the
 * transmittance. */
static inline void sp_fragment_over(const struct sp_fragment *fragment, float rgbt[4]) {
    for (int c = 0; c < 3; c++)
        rgbt[c] += rgbt[3] * fragment->color[c];
    rgbt[3] *= 1 - fragment->alpha;
}

/* Allocates the lists of an image of `size` px. All lists are empty and count as stored. False: out
 * of memory. */
bool sp_fragments_init(struct sp_fragments *fragments, const uint32_t size[2],
                       struct sp_arena *arena);

/* Limits the stored fragments to `bytes`, but not to less than one row of tiles. Afterwards no row
 * is stored. */
void sp_fragments_limit(struct sp_fragments *fragments, size_t bytes);

/* Returns how many rows of pixels a compositor draws at a time: a multiple of `tile`, at least
 * `tile`. tile: height of the compositor's tiles [px]; height: of the image [px]. fragments:
 * NULL = the whole image is drawn at once. */
int sp_fragments_rows(const struct sp_fragments *fragments, int tile, int height);

/* Ensures that the fragments of the pixel rows [begin, end) are stored: calls fill() if they are
 * not. fragments: NULL = nothing to do. SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED. */
bool sp_fragments_ensure(struct sp_fragments *fragments, int begin, int end, struct sp_error *err);

/* Empties the lists of all tiles. */
void sp_fragments_clear(struct sp_fragments *fragments);

/* sp_fragment_tile_count() returns the number of fragments of a tile. sp_fragments_store() copies
 * them to first[SP_FRAGMENT_PIXELS + 1] and list[sp_fragment_tile_count()], which it borrows.
 * Several threads may store different tiles at a time. */
uint32_t sp_fragment_tile_count(const struct sp_fragment_tile *tile);
void sp_fragments_store(struct sp_fragments *fragments, const struct sp_fragment_tile *tile,
                        uint32_t *first, struct sp_fragment *list);

/* Returns where the fragments of a pixel of the image start in *list. The next elements are the
 * starts of the pixels to the right in the same tile. NULL = the tile has no fragments. */
static inline const uint32_t *sp_fragments_row(const struct sp_fragments *fragments, int x, int y,
                                               const struct sp_fragment **list) {
    const unsigned side = SP_FRAGMENT_TILE, right = (unsigned)x, down = (unsigned)y;
    const unsigned tile = down / side * (unsigned)fragments->columns + right / side;
    const uint32_t *first = fragments->first[tile];
    *list = fragments->list[tile];
    return first ? first + down % side * side + right % side : NULL;
}

/* Returns the fragments of a pixel of the image, front to back, and their number. */
static inline const struct sp_fragment *sp_fragments_at(const struct sp_fragments *fragments, int x,
                                                        int y, uint32_t *count) {
    const struct sp_fragment *list;
    const uint32_t *first = sp_fragments_row(fragments, x, y, &list);
    *count = first ? first[1] - first[0] : 0;
    return first ? list + first[0] : NULL;
}

#endif
