/* SPDX-License-Identifier: Apache-2.0
 *
 * The stages of sp_surface_tile(): the functions that its source files share.
 */
#ifndef SP_SURFACE_FOOTPRINT_H
#define SP_SURFACE_FOOTPRINT_H

#include "base/wide.h"
#include "draw/layers/surface/surface.h"

enum { SURFACE_LANES = 16 }; /* the largest SP_WIDE */
/* A pixel with at least this weight is covered completely. The ripple inside a surface is smaller
 * than the difference to 1. */
#define SURFACE_FULL 0.94f

/* Footprints of SP_WIDE points in a tile; pixels are counted from its corner. The weight of a pixel
 * at d is peak·2^−p, p = a·dx² + b·dx·dy + c·dy² < frame.cut, and its depth is depth + slope·d. */
struct sp_surface_footprints {
    _Alignas(64) float x[SURFACE_LANES], y[SURFACE_LANES];
    float a[SURFACE_LANES], b[SURFACE_LANES], c[SURFACE_LANES], peak[SURFACE_LANES];
    float depth[SURFACE_LANES], slope[2][SURFACE_LANES]; /* cells behind depth_first; per px */
    float tolerance[SURFACE_LANES]; /* tolerance of depth within a sheet [cells] */
    float normal[3][SURFACE_LANES]; /* unit or 0; camera space */
    /* Box in the tile, half open. */
    int32_t x0[SURFACE_LANES], y0[SURFACE_LANES], x1[SURFACE_LANES], y1[SURFACE_LANES];
    unsigned seen; /* bit k: footprint k touches the tile */
    unsigned back; /* bit k: footprint k is seen from inside */
};

/* The cells of a block, for set-up. Rectilinear axes have tables. */
struct sp_surface_cells {
    const struct sp_surface_points *points; /* of the block */
    float area_step;                        /* sp_surface_area_step() */
    float base[3];                          /* u of the block's corner [cells] */
    bool is_rectilinear;
    /* By cell: its start and its length, and the local spacing at its two samples [mean spacings].
     */
    float start[3][SURFACE_BLOCK], gap[3][SURFACE_BLOCK], size[3][SURFACE_BLOCK + 1];
};

/* Sets up the footprints of the points [first, first + n), n <= SP_WIDE, of a block. corner:
 * position of the tile in the image [px]. */
void sp_surface_set_up(const struct sp_surface *surface, const struct sp_surface_cells *cells,
                       uint64_t first, int n, const int corner[2],
                       struct sp_surface_footprints *out);

/* Converts the sheets of a tile to fragments. */
void sp_surface_resolve(const struct sp_surface *surface, const struct sp_surface_scratch *scratch,
                        struct sp_fragment_tile *tile);

/* Returns the share of each pixel that clipping keeps of a sheet in row y of the image, from column
 * x on. depth: of the sheet [cells]; normal: of the sheet, in camera space. */
sp_wide sp_surface_clip_share(const struct sp_surface *surface, int x, int y, sp_wide depth,
                              const sp_wide normal[3]);

#endif
