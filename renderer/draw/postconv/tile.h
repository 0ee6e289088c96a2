/* SPDX-License-Identifier: Apache-2.0
 *
 * The state of one tile while it is drawn. The files tile.c (runs by layer), deposit.c (voxels →
 * samples), filter.c (samples → pixels) and insert.c (fragments of other layers) share it. They are
 * compiled once per instruction set (base/isa.h).
 */
#ifndef SP_POSTCONV_TILE_H
#define SP_POSTCONV_TILE_H

#include <math.h>

#include "base/isa.h"
#include "base/quad.h"
#include "draw/postconv/postconv.h"
#include "frame/depth.h"

enum {
    W = SP_WIDE,
    PX = W / 4,       /* pixels per vector: red, green, blue, depth of each */
    CHUNK = 16,       /* voxels at a time */
    BLOCK = 4,        /* samples per bit of a mask */
    VECTORS = 16 / W, /* of a block */
    ORIGIN = POSTCONV_MARGIN,
    CHECK_EVERY = 2,
    POSTCONV_WANTED = 32 /* at least POSTCONV_GRID / BLOCK; a lookup in registers needs 32 */
};

enum { MOST_TAPS = 2 * POSTCONV_TAPS + 6 };

/* A filter combined with the interpolation after it, for samples of 2^scale pixels. */
struct zoom {
    const struct sp_postconv_filter *filter; /* NULL = not made */
    int scale, taps; /* samples that a pixel, or a vector of pixels, reads */
    float down[1 << (POSTCONV_SCALES - 1)][MOST_TAPS]; /* by pixel modulo 2^scale */
    _Alignas(64) float across[1 << (POSTCONV_SCALES - 1)][MOST_TAPS][W]; /* by vector, likewise */
};

struct sp_postconv_open_tile {
    const struct sp_postconv *postconv;
    struct sp_postconv_scratch *scratch;
    int x, y, width, height;              /* the tile in the image [px] */
    uint32_t alive;                       /* bit per cell that is not opaque */
    uint32_t live[POSTCONV_TILE / BLOCK]; /* the same per block of 4 × 4 pixels */
    bool has_dead;                        /* some blocks are opaque */
    int layer;   /* number of the current sheet, counted from where the volume begins */
    float place; /* of the sheet: d − origin */
    struct sp_postconv_inserted *inserted; /* NULL = no fragments */
    uint32_t closed;
    bool is_open; /* `group` has deposits */
    struct sp_postconv_group group;
    struct zoom *zoom[2];
    /* By block of pixels: bits of the blocks of samples that its pixels read, across. */
    uint32_t needs[POSTCONV_TILE / BLOCK];
    /* By row: bit per block that is not zero. */
    uint32_t deposited[POSTCONV_GRID], skewed[POSTCONV_GRID], crossed[POSTCONV_GRID],
        summed[POSTCONV_TILE];
    int row0, row1; /* range of rows of `deposited` that are not empty */
    /* Per four rows of the grid: the blocks in which a voxel matters to pixels that are not opaque.
     * Valid only if has_dead. */
    _Alignas(64) uint32_t wanted[POSTCONV_WANTED];
};

/* Opens a group: chooses filters for the footprints of the first run. The filters may also serve
 * other runs. False if no filters serve these footprints. */
bool sp_postconv_start_group(struct sp_postconv_open_tile *tile, const struct sp_postconv_run *runs,
                             uint32_t count);

/* Deposits all voxels of a run, or only those in the group's range. */
void sp_postconv_add_run(struct sp_postconv_open_tile *tile, const struct sp_postconv_run *run,
                         bool all);

/* Adds the voxels of a run that are not drawn yet to the layer's sum, one footprint at a time. */
void sp_postconv_add_footprints(struct sp_postconv_open_tile *tile,
                                const struct sp_postconv_run *run);

/* Filters the deposits of the group. If the group is the `last` one of its layer, composites it at
 * once; otherwise adds it to the layer's sum, which sp_postconv_close_sum() composites. */
void sp_postconv_close_group(struct sp_postconv_open_tile *tile, bool last);
void sp_postconv_close_sum(struct sp_postconv_open_tile *tile);

/* Finds the cells that have become opaque. */
void sp_postconv_check_cells(struct sp_postconv_open_tile *tile);

/* Finds the first fragment of each pixel of the tile. tile->inserted stays NULL if the tile has no
 * fragments. */
void sp_postconv_open_fragments(struct sp_postconv_open_tile *tile);

/* Composites the next fragments of the pixels in `bits` of the vector at (x, y). */
void sp_postconv_composite_fragments(struct sp_postconv_open_tile *tile, int y, int x,
                                     unsigned bits);

/* Composites the remaining fragments of the tile. */
void sp_postconv_finish_fragments(struct sp_postconv_open_tile *tile);

/* Returns which pixel of a group of W pixels is element i of its planes. */
static inline int sp_postconv_pixel_at(int i) {
    return i % 4 * PX + i / 4;
}

/* Returns d − origin for what is shown at d. The first one sets the origin. */
static inline float sp_postconv_place(struct sp_postconv_scratch *scratch, float d) {
    scratch->origin = isnan(scratch->origin) ? d : scratch->origin;
    return d - scratch->origin;
}

/* Writes the tile into the frame. */
void sp_postconv_resolve(const struct sp_postconv_open_tile *tile);

#endif
