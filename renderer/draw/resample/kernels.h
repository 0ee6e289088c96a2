/* SPDX-License-Identifier: Apache-2.0
 *
 * The state that the kernels of this stage share: a tile that is being drawn.
 */
#ifndef SP_RESAMPLE_KERNELS_H
#define SP_RESAMPLE_KERNELS_H

#include <math.h>

#include "base/wide.h"
#include "draw/resample/resample.h"
#include "draw/resample/rows.h"

/* Columns of a slice are refined in units. The width of a unit is a power of two, at least 1 <<
 * RESAMPLE_UNIT_BITS columns; a slice has at most RESAMPLE_UNITS units. */
enum { RESAMPLE_UNITS = 60, RESAMPLE_UNIT_BITS = 2 };

struct sp_resample_open_tile {
    struct sp_resample_open_tile *next; /* of the next channel; NULL = the last one */
    const struct sp_resample *r;
    struct sp_resample_scratch *scratch;
    int x, y, width, height; /* px of the image */
    const void *voxels;      /* the samples, in their own layout or turned */
    int axis[3];             /* of the volume: u, v, and the slices' axis */
    size_t stride[3];        /* of these axes [samples] */
    int dims[3];
    bool is_backwards; /* rays cross the slices from the last to the first */
    float reference;   /* slice coordinate at s = 0 */
    int sheets_per_slice;
    int count; /* intervals; number 0 is empty */
    int shift; /* number of a sheet in this channel − its number in the first channel */
    const struct sp_resample_axis *map[3]; /* of these axes; NULL = evenly spaced */
    struct sp_rows reader;
    int unit_bits;  /* a unit has 1 << unit_bits columns */
    uint64_t alive; /* blocks with a pixel that is not opaque */
    /* The sides of the silhouette that may cross the tile, in px from its corner. */
    int side_count;
    float sides[RESAMPLE_SIDES_MAX][3];
};

struct sp_resample_rays;

/* Initialises all blocks of the tile and computes their rays. Sets t->alive to the blocks whose
 * rays meet the volume, and returns this mask. */
uint64_t sp_resample_init_blocks(struct sp_resample_open_tile *t,
                                 const struct sp_resample_rays *rays);

/* Resets a block, so that it can be drawn again. */
void sp_resample_open_block(const struct sp_resample_open_tile *t, struct sp_resample_block *block);

/* Sets the tile's sides. */
void sp_resample_open_sides(struct sp_resample_open_tile *t);

/* True if a side of the silhouette may cross the block with its corner at `at` [px of the tile]. */
bool sp_resample_is_crossed(const struct sp_resample_open_tile *t, const int at[2]);

/* Computes how much of the pixels of a block is inside the silhouette, and where their rays go. */
void sp_resample_open_cover(const struct sp_resample_open_tile *t, struct sp_resample_block *block);

/* Mixes the pixels of blocks that sides cross with what the pixels show without the volume. */
void sp_resample_close_cover(const struct sp_resample_open_tile *t, uint64_t blocks);

/* Prepares the sheets. Call the function before the first sheet of a set of blocks. */
void sp_resample_start_sheets(struct sp_resample_open_tile *t);

/* Refines the part of slice coordinate z, a multiple of ½, that the blocks of `need` see. Writes it
 * to *sheet. */
void sp_resample_refine(const struct sp_resample_open_tile *t, struct sp_resample_sheet *sheet,
                        uint64_t need, float z);

/* Sheets of a channel that are drawn together. */
struct sp_resample_batch {
    int first, last;              /* numbers in the first channel */
    uint64_t now[RESAMPLE_BATCH]; /* by sheet n: blocks that composite interval n − 2 */
};

/* Computes, for each block of `need`, the range of the refined samples of a sheet that the block
 * sees; only if each block sees few samples. */
void sp_resample_near_ranges(const struct sp_resample_open_tile *t, struct sp_resample_sheet *sheet,
                             uint64_t need);

/* Returns the blocks out of `blocks` that may see something in interval `number`, according to the
 * ranges of its sheets. */
uint64_t sp_resample_near_visible(const struct sp_resample_open_tile *t, int number,
                                  uint64_t blocks);

/* Reads the sheets of a batch at the pixels of block b, and composites the intervals behind these
 * pixels: interval n lies between the sheets n and n + 1. batches: one per channel; the channels
 * are mixed. Returns false if all pixels are opaque. */
bool sp_resample_integrate(const struct sp_resample_open_tile *t,
                           const struct sp_resample_batch *batches, int b);

/* Like sp_resample_integrate(), for a projection (projection.h) of one channel. Returns false if no
 * later value can change any pixel. */
bool sp_resample_reduce(const struct sp_resample_open_tile *t,
                        const struct sp_resample_batch *batch, int b);

/* Sets the numbers of a block's pixels to the start value of a projection. */
void sp_resample_reduce_open(const struct sp_resample *r, struct sp_resample_block *block);

/* Converts the numbers of a block's pixels to transmittance, colour and moments. */
void sp_resample_reduce_close(const struct sp_resample *r, struct sp_resample_block *block);

/* Adds the colours of the same block of another channel. Both blocks must be closed. */
void sp_resample_reduce_add(const struct sp_resample_block *from, bool has_depth,
                            struct sp_resample_block *to);

/* Writes the pixels of the tile: the pixels of the blocks in `drawn`, and the background
 * elsewhere. */
void sp_resample_resolve(const struct sp_resample_open_tile *t, uint64_t drawn);

/* Returns the slice coordinate of sheet `number`, a multiple of ½. The first sheets lie in front of
 * the volume. */
static inline float sp_resample_slice(const struct sp_resample_open_tile *t, int number) {
    float ahead = (float)number / (float)t->sheets_per_slice - 2;
    return t->is_backwards ? (float)(t->dims[2] - 1) - ahead : ahead;
}

/* Returns the coordinate of slice z along the axis of the slices. Beyond the volume, slices are so
 * far apart that the first interval holds the outer half of the volume's last cell. */
static inline float sp_resample_place(const struct sp_resample_open_tile *t, float z) {
    const struct sp_resample_axis *map = t->map[2];
    int last = t->dims[2] - 1, i = (int)floorf(z);
    if (!map)
        return z;
    if (z < 0 || last == 0)
        return map->place[0] + z * (map->widest > 1 ? map->widest : 1);
    if (i >= last)
        return map->place[last] + (z - (float)last) * (map->widest > 1 ? map->widest : 1);
    return map->place[i] + (z - (float)i) * (map->place[i + 1] - map->place[i]);
}

/* Returns s of slice z. */
static inline float sp_resample_s(const struct sp_resample_open_tile *t, float z) {
    float s = sp_resample_place(t, z) - t->reference;
    return t->is_backwards ? -s : s;
}

/* Returns s of a sheet. */
static inline float sp_resample_sheet_s(const struct sp_resample_open_tile *t, int number) {
    return sp_resample_s(t, sp_resample_slice(t, number));
}

/* Returns the sample index at a coordinate of an axis of the tile, limited to the samples. */
static inline float sp_resample_index(const struct sp_resample_open_tile *t, int a, float x) {
    const struct sp_resample_axis *map = t->map[a];
    float last = (float)(t->dims[a] - 1);
    if (map) {
        x = (x - map->first) * map->steps_per_place;
        x = x < 0 ? 0 : x > (float)map->steps ? (float)map->steps : x;
        int i = x < (float)map->steps ? (int)x : map->steps - 1;
        x = map->index[i] + (x - (float)i) * (map->index[i + 1] - map->index[i]);
    }
    return x < 0 ? 0 : x > last ? last : x;
}

/* Fills min and max, per axis, with the first and the last sample that each of SP_WIDE blocks from
 * `begin` on sees at s. */
static inline void sp_resample_extents(const struct sp_resample_open_tile *t, int begin, sp_wide s,
                                       sp_wide min[2], sp_wide max[2]) {
    const struct sp_resample_bounds *bounds = &t->scratch->bounds;
    const sp_wide zero = sp_wide_all(0);
    for (int a = 0; a < 2; a++) {
        min[a] = sp_wide_all(INFINITY);
        max[a] = -min[a];
        for (int i = 0; i < 4; i++) {
            sp_wide change = sp_wide_load(bounds->corner[a + 2][i] + begin);
            sp_wide at = sp_wide_load(bounds->corner[a][i] + begin) + s * change;
            min[a] = sp_wide_min(min[a], at);
            max[a] = sp_wide_max(max[a], at);
        }
        for (int i = 0; t->map[a] && i < SP_WIDE; i++) {
            min[a][i] = sp_resample_index(t, a, min[a][i]);
            max[a][i] = sp_resample_index(t, a, max[a][i]);
        }
        const sp_wide last = sp_wide_all((float)(t->dims[a] - 1));
        min[a] = sp_wide_min(sp_wide_max(min[a], zero), last);
        max[a] = sp_wide_min(sp_wide_max(max[a], zero), last);
    }
}

#endif
