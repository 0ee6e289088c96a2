/* SPDX-License-Identifier: Apache-2.0
 *
 * What layers other than the volume show: per pixel a short list of fragments, sorted by depth.
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
    SP_FRAGMENTS_MAX = 16 /* per pixel; of more, neighbours are merged */
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
    struct sp_fragment list[SP_FRAGMENT_PIXELS][SP_FRAGMENTS_MAX + 1]; /* the last one: scratch */
};

/* The fragments of a band of an image. All of a large image would take gigabytes: a compositor
 * draws band after band, and calls sp_fragments_ensure() before each. */
struct sp_fragments {
    int columns, rows; /* of tiles, in the image */
    int begin, end;    /* rows of tiles that are there; equal = none */
    int most;          /* rows of tiles that may be there at a time, at least 1 */
    /* Drops all fragments, makes the fragments of the tile rows [begin, end), and adds to `ms`. */
    bool (*fill)(void *user, int begin, int end, struct sp_error *err);
    void *user;
    double ms; /* spent in fill() */
    /* [columns · rows]: of each tile where its pixels' fragments start, or NULL = it has none. */
    const uint32_t **first;          /* [SP_FRAGMENT_PIXELS + 1] */
    const struct sp_fragment **list; /* [first[SP_FRAGMENT_PIXELS]], rising depth per pixel */
};

/* Empties the tile whose corner is at (x, y). */
void sp_fragment_tile_clear(struct sp_fragment_tile *tile, int x, int y);

/* sp_fragment_add() of a pixel that is full, or has fragments behind that one. */
void sp_fragment_insert(struct sp_fragment_tile *tile, int pixel,
                        const struct sp_fragment *fragment);

/* Adds a fragment to pixel number `pixel` of the tile, in order of depth; behind those of equal
 * depth. Fragments without alpha are dropped. If the pixel is full, one behind all others joins the
 * last one; for another, two neighbours become one at the depth of the first: those between which a
 * further fragment would matter least. So what has few fragments is added first. */
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

/* Puts a fragment behind `rgbt`: premultiplied red, green, blue, transmittance. */
static inline void sp_fragment_over(const struct sp_fragment *fragment, float rgbt[4]) {
    for (int c = 0; c < 3; c++)
        rgbt[c] += rgbt[3] * fragment->color[c];
    rgbt[3] *= 1 - fragment->alpha;
}

/* Allocates the lists of an image of that size, all empty and all there. False: out of memory. */
bool sp_fragments_init(struct sp_fragments *fragments, const uint32_t size[2],
                       struct sp_arena *arena);

/* Limits the fragments that are there to `bytes`, but not below a row of tiles; none is there. */
void sp_fragments_limit(struct sp_fragments *fragments, size_t bytes);

/* Returns how many rows of pixels a compositor draws at a time: a multiple of `tile`, the height of
 * its tiles, and at least that. fragments: NULL = the whole image, of `height`. */
int sp_fragments_rows(const struct sp_fragments *fragments, int tile, int height);

/* Finds the fragments of pixel rows [begin, end), unless they are there. fragments: NULL = nothing
 * to do. SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED. */
bool sp_fragments_ensure(struct sp_fragments *fragments, int begin, int end, struct sp_error *err);

/* Empties the lists of all tiles. */
void sp_fragments_clear(struct sp_fragments *fragments);

/* Memory that a tile's fragments need, and the copy of a tile to that memory. Tiles may be stored
 * on several threads at a time; `first` is [SP_FRAGMENT_PIXELS + 1], `list` is
 * [sp_fragment_tile_count()]. */
uint32_t sp_fragment_tile_count(const struct sp_fragment_tile *tile);
void sp_fragments_store(struct sp_fragments *fragments, const struct sp_fragment_tile *tile,
                        uint32_t *first, struct sp_fragment *list);

/* Where the fragments of a pixel of the image start in *list; those of the pixels right of it in
 * the same tile follow. NULL = the tile has no fragments. */
static inline const uint32_t *sp_fragments_row(const struct sp_fragments *fragments, int x, int y,
                                               const struct sp_fragment **list) {
    const unsigned side = SP_FRAGMENT_TILE, right = (unsigned)x, down = (unsigned)y;
    const unsigned tile = down / side * (unsigned)fragments->columns + right / side;
    const uint32_t *first = fragments->first[tile];
    *list = fragments->list[tile];
    return first ? first + down % side * side + right % side : NULL;
}

/* The fragments of a pixel of the image, and how many there are. */
static inline const struct sp_fragment *sp_fragments_at(const struct sp_fragments *fragments, int x,
                                                        int y, uint32_t *count) {
    const struct sp_fragment *list;
    const uint32_t *first = sp_fragments_row(fragments, x, y, &list);
    *count = first ? first[1] - first[0] : 0;
    return first ? list + first[0] : NULL;
}

#endif
