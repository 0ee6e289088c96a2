/* SPDX-License-Identifier: Apache-2.0
 *
 * Post-convolved sheets of dense volumes, drawn on a plane parallel to the slices (after Lacroute
 * and Levoy, Fast Volume Rendering Using a Shear-Warp Factorization, 1994).
 *
 *      eye ·                    X = centre + scale · (i − eye_i) / |k − eye_k|
 *         /|\
 *        / | \                  i, j, k: index of a voxel, k across the slices
 *    ───┼──┼──┼───  plane       X, Y: sample of the plane
 *      /   |   \
 *   ──┼────┼────┼──  slice k    all slices meet the plane's samples in straight rows
 *
 * Seen from the eye, each slice covers the plane by a scale and a shift. So a slice is resampled by
 * two 1-D passes, whose weights depend only on the column and only on the row. The passes use a
 * cubic B-spline in units of voxels. The rest of a footprint's variance is that of filters:
 *
 *   R = s²·(σ² − ⅓)·I + s²σ²·t tᵀ + h²·N      [samples²]
 *
 *   s: samples per voxel; t: slope of the ray, (X − centre)/scale; h: low-pass filter [px];
 *   N = G Gᵀ, G: samples per pixel of the image; on a lattice of unequal spacing by axis
 *
 *   rows of a slice ─► classes ─► pass along i ─► pass along j ─► samples      cost: voxels
 *   samples ─► filter along a diagonal (R01) ─► across ─► down ─► composite    cost: samples
 *   composited plane ─► interpolated at the pixels of the image                once per frame
 *
 * t and N change over the plane, so filters do, too: their weights are vectors. The plane's samples
 * are as dense as the sheets need, which are smooth. The cost per voxel is a tenth of a deposit's,
 * but the frame pays for invisible voxels as well.
 *
 * Files: shear.c decides and prepares. shear_tile.c draws one tile of the plane, shear_filter.c
 * filters and composites its sheets, shear_warp.c makes the image; these three are kernels.
 */
#ifndef SP_POSTCONV_SHEAR_H
#define SP_POSTCONV_SHEAR_H

#include "base/vec.h"
#include "draw/postconv/postconv.h"

enum {
    SHEAR_WIDTH = 176, /* largest width of a tile [samples]; a multiple of vectors and blocks */
    SHEAR_HEIGHT = 144,
    SHEAR_MARGIN = 16, /* largest reach of the filters beyond a tile [samples] */
    SHEAR_PITCH = SHEAR_WIDTH + 2 * SHEAR_MARGIN,
    SHEAR_ROWS = SHEAR_HEIGHT + 2 * SHEAR_MARGIN,
    SHEAR_TAPS = 7,  /* most samples that a filter reaches to each side */
    SHEAR_BLOCK = 8, /* rows that share weights */
    SHEAR_BLOCKS = SHEAR_ROWS / SHEAR_BLOCK,
    SHEAR_RING = 2 * SP_BRICK, /* rows of voxels after the first pass */
    SHEAR_BAND = 4,            /* rows of voxels at a time */
    SHEAR_SOURCE = 416         /* voxels of a row of a tile, and padding for the last vector */
};

/* Filters for one direction: weights by block of rows, tap and column. */
struct sp_shear_weights {
    int taps;
    _Alignas(64) float at[SHEAR_BLOCKS][SHEAR_TAPS + 1][SHEAR_PITCH];
};

/* What a worker needs for one tile. Rows of samples hold four planes: red, green, blue, depth. */
struct sp_shear_scratch {
    _Alignas(64) float source[SHEAR_BAND][4][SHEAR_SOURCE];
    _Alignas(64) float ring[SHEAR_RING][4][SHEAR_PITCH];
    _Alignas(64) float grid[SHEAR_ROWS][4][SHEAR_PITCH];
    _Alignas(64) float block[SHEAR_BLOCK][4][SHEAR_PITCH]; /* after the diagonal filter */
    _Alignas(64) float across[SHEAR_ROWS][4][SHEAR_WIDTH]; /* filtered across; without margins */
    _Alignas(64) float done[SHEAR_HEIGHT][4][SHEAR_WIDTH]; /* red, green, blue, transmittance */
    _Alignas(64) float length[SHEAR_HEIGHT][SHEAR_WIDTH];  /* of a ray in a slice */
    struct sp_shear_weights diagonal, horizontal, vertical;
    int8_t sign[SHEAR_BLOCKS][SHEAR_PITCH / 16]; /* of the diagonal, by block and 16 columns */
    uint64_t splats;
};

/* One frame on the plane. All pointers are valid until the frame is finished. */
struct sp_shear {
    const struct sp_postconv *postconv;
    const struct sp_level *level;
    unsigned axis, across[2]; /* k, and i and j, as axes of the grid */
    double eye[3];            /* of i, j, k [voxels] */
    double scale[2], centre[2];
    double unit[2];       /* scale of the tangents: X = centre + unit·t [samples] */
    struct sp_mat3 ray;   /* pixel of the image (x, y, 1) → direction along i, j, k */
    struct sp_mat3 pixel; /* its inverse */
    int side;             /* 1 or -1: slices lie at rising or falling k, seen from the eye */
    double sigma2;        /* variance of the kernel [voxels²] */
    double lowpass2;      /* [px²] */
    float length;         /* of a ray that crosses one slice straight, reference lengths */
    int size[2];          /* samples of the plane */
    int columns, rows;    /* of tiles */
    int tile[2];          /* samples of a tile: a multiple of 16, and of SHEAR_BLOCK */
    int margin;           /* samples around a tile: a multiple of SHEAR_BLOCK */
    uint32_t *first;      /* [layers + 1]: where a layer's slices begin in `slices` */
    uint32_t *slices;
    float *plane; /* [size[1]][size[0]][4]: red, green, blue, transmittance */
    float filter[POSTCONV_FILTERS][SHEAR_TAPS + 1]; /* by variance · POSTCONV_STEPS, from the
                                                       middle on */
    int taps[POSTCONV_FILTERS];                     /* of these filters */
    struct sp_shear_scratch *scratch;               /* by worker */
};

/* Residual variances at a sample of the plane [samples²]: along X, along Y and the covariance. */
void sp_shear_residual(const struct sp_shear *shear, double x, double y, double distance,
                       double out[3]);

/* Draws one tile into the plane. */
typedef void sp_shear_tile_fn(const struct sp_shear *shear, struct sp_shear_scratch *scratch,
                              uint32_t tile);
sp_shear_tile_fn sp_shear_tile;

/* Draws rows [begin, end) of the image from the plane, whose samples are B-spline coefficients. */
typedef void sp_shear_warp_fn(const struct sp_shear *shear, int begin, int end);
sp_shear_warp_fn sp_shear_warp;

/* Both of an instruction set. */
struct sp_shear_kernels {
    sp_shear_tile_fn *tile;
    sp_shear_warp_fn *warp;
};

/* True if this stage can draw a prepared frame, and does so faster than tiles of the image: dense
 * voxels of one mip level in front of the eye, not lit. Fills *shear. */
bool sp_shear_can_draw(const struct sp_postconv_input *input, const struct sp_postconv *postconv,
                       struct sp_shear *shear);

/* Draws every pixel and fills the stats. SP_ERR_MEMORY, SP_ERR_CANCELLED. */
bool sp_shear_draw(const struct sp_postconv_input *input, const struct sp_shear_kernels *kernels,
                   struct sp_shear *shear, struct sp_error *err);

#endif
