/* SPDX-License-Identifier: Apache-2.0
 *
 * What the kernels of this stage share: a tile that is being drawn.
 */
#ifndef SP_RESAMPLE_KERNELS_H
#define SP_RESAMPLE_KERNELS_H

#include <math.h>

#include "base/wide.h"
#include "draw/resample/resample.h"
#include "draw/resample/rows.h"

/* Columns of a slice are refined in units of a power of two columns: at least 1 << UNIT_BITS of
 * them, at most UNITS units. */
enum { RESAMPLE_UNITS = 60, RESAMPLE_UNIT_BITS = 2 };

struct sp_resample_open_tile {
    struct sp_resample_open_tile *next; /* of the next channel; NULL = the last one */
    const struct sp_resample *r;
    struct sp_resample_scratch *scratch;
    int x, y, width, height; /* px of the image */
    const void *voxels;      /* of the samples, perhaps turned */
    int axis[3];             /* of the volume: u, v, and the slices' axis */
    size_t stride[3];        /* of these axes [samples] */
    int dims[3];
    bool is_backwards; /* rays cross the slices from the last to the first */
    float reference;   /* slice coordinate at s = 0 */
    int sheets_per_slice;
    int count; /* intervals; number 0 is empty */
    int shift; /* number of a sheet − its number in the first channel */
    const struct sp_resample_axis *map[3]; /* of these axes; NULL = evenly spaced */
    struct sp_rows reader;
    int unit_bits;  /* 1 << unit_bits columns are a unit */
    uint64_t alive; /* blocks with a pixel that is not opaque */
};

struct sp_resample_rays;

/* Finds the rays of all blocks of the tile, of which nothing is drawn. Sets t->alive to those that
 * meet the volume, and returns them. */
uint64_t sp_resample_init_blocks(struct sp_resample_open_tile *t,
                                 const struct sp_resample_rays *rays);

/* Forgets what was drawn of a block, so that it can be drawn again. */
void sp_resample_open_block(const struct sp_resample_open_tile *t, struct sp_resample_block *block);

/* Call it before the first sheet of a set of blocks. */
void sp_resample_start_sheets(struct sp_resample_open_tile *t);

/* Refines what the blocks of `need` see of slice coordinate z, a multiple of ½, into *sheet. */
void sp_resample_refine(const struct sp_resample_open_tile *t, struct sp_resample_sheet *sheet,
                        uint64_t need, float z);

/* Sheets of a channel that are drawn together. */
struct sp_resample_batch {
    int first, last;              /* numbers in the first channel */
    uint64_t now[RESAMPLE_BATCH]; /* by sheet n: blocks that composite interval n − 2 */
};

/* Finds the range of the refined samples that the blocks of `need` see of a sheet, if each of them
 * sees few. */
void sp_resample_near_ranges(const struct sp_resample_open_tile *t, struct sp_resample_sheet *sheet,
                             uint64_t need);

/* Those of the blocks that may see something in interval `number` by the ranges of its sheets. */
uint64_t sp_resample_near_visible(const struct sp_resample_open_tile *t, int number,
                                  uint64_t blocks);

/* Reads the sheets of a batch at the pixels of block b, and composites the intervals behind its
 * pixels: interval n lies between sheets n and n + 1. Channels are mixed: there is a batch for each
 * of them. Returns false if all pixels are opaque. */
bool sp_resample_integrate(const struct sp_resample_open_tile *t,
                           const struct sp_resample_batch *batches, int b);

/* The same for a projection (projection.h) of one channel. Returns false if nothing can change any
 * pixel. */
bool sp_resample_reduce(const struct sp_resample_open_tile *t,
                        const struct sp_resample_batch *batch, int b);

/* Sets the numbers of a block's pixels before anything was seen. */
void sp_resample_reduce_open(const struct sp_resample *r, struct sp_resample_block *block);

/* Turns them into transmittance and colour. */
void sp_resample_reduce_close(const struct sp_resample *r, struct sp_resample_block *block);

/* Adds the colours of another channel's block, which is closed, too. */
void sp_resample_reduce_add(const struct sp_resample_block *from, struct sp_resample_block *to);

/* Writes the pixels of the tile: of the blocks of `drawn`, and the background elsewhere. */
void sp_resample_resolve(const struct sp_resample_open_tile *t, uint64_t drawn);

/* The slice that sheet `number` lies on, a multiple of ½; the first sheets lie before the volume.
 */
static inline float sp_resample_slice(const struct sp_resample_open_tile *t, int number) {
    float ahead = (float)number / (float)t->sheets_per_slice - 2;
    return t->is_backwards ? (float)(t->dims[2] - 1) - ahead : ahead;
}

/* The coordinate of slice z. Beyond the volume slices are so far apart that the first interval
 * holds the outer half of the volume's last cell. */
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

/* s of slice z. */
static inline float sp_resample_s(const struct sp_resample_open_tile *t, float z) {
    float s = sp_resample_place(t, z) - t->reference;
    return t->is_backwards ? -s : s;
}

/* s of a sheet. */
static inline float sp_resample_sheet_s(const struct sp_resample_open_tile *t, int number) {
    return sp_resample_s(t, sp_resample_slice(t, number));
}

/* The sample index at a coordinate of axis 0 or 1 of the tile, kept inside the slice. */
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

/* Fills min and max with the samples that SP_WIDE blocks from `begin` on see at s, per axis. */
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
