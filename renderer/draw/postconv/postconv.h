/* SPDX-License-Identifier: Apache-2.0
 *
 * Post-convolved sheets: the CPU's fast path for sheet compositing (after Neophytou and Mueller,
 * Post-Convolved Splatting, 2003). README.md beside this file explains the method and its error.
 *
 * Inside one image tile all voxels of a sheet have nearly the same footprint. Therefore the
 * Gaussian is not drawn once per voxel. Each voxel is deposited on a small grid of samples with a
 * cubic B-spline, and one separable filter per sheet adds the rest of the variance:
 *
 *   V̂ + h²I  =  ⅓ I (deposit)  +  R (filter)  [+ ¼ I (interpolation)],  in units of grid samples
 *
 *   bricks that meet the tile ─► runs by layer ─► for each layer, front to back:
 *       deposit.c  emission and optical depth of a voxel → 4 × 4 samples   cost: voxels
 *       filter.c   across (and diagonally, where V̂01 ≠ 0), then down       cost: touched samples
 *       filter.c   composite, with the formulas of blend.h            cost: touched pixels
 *
 * Files: postconv.c prepares a frame and runs its tiles. group.c chooses the filters. tile.c draws
 * one tile layer by layer. deposit.c, filter.c and tile.c are kernels: they are compiled once per
 * instruction set (base/isa.h), and their scalar build is the reference.
 */
#ifndef SP_POSTCONV_POSTCONV_H
#define SP_POSTCONV_POSTCONV_H

#include "base/arena.h"
#include "base/interrupt.h"
#include "base/isa.h"
#include "base/parallel_for.h"
#include "classify/classification.h"
#include "sp/frame.h"
#include "splat/detail.h"
#include "splat/layer_places.h"
#include "splat/level_frame.h"

enum {
    POSTCONV_TILE = 96,   /* width and height of a tile [px] */
    POSTCONV_TAPS = 10,   /* most samples that a filter reaches to each side */
    POSTCONV_MARGIN = 16, /* samples around a tile, for filter and deposit; a multiple of four */
    POSTCONV_GRID = POSTCONV_TILE + 2 * POSTCONV_MARGIN,
    POSTCONV_PITCH =
        POSTCONV_GRID + 4,            /* samples per row: rows 4 KiB apart would share cache sets */
    POSTCONV_ROW = POSTCONV_TILE + 4, /* pixels per row, for the same reason */
    POSTCONV_SCALES = 6,              /* a sample is at most 2^5 px wide, which divides a tile */
    POSTCONV_PHASES = 256,            /* positions of a voxel between two samples */
    POSTCONV_STEPS = 16,    /* filters exist for multiples of 1/16 samples² of variance */
    POSTCONV_VARIANCE = 10, /* largest variance of a filter [samples²] */
    POSTCONV_FILTERS = POSTCONV_VARIANCE * POSTCONV_STEPS + 1,
    POSTCONV_CELL_WIDTH = 24, /* px of a cell; opaque pixels are tracked per cell */
    POSTCONV_CELL_HEIGHT = 12,
    POSTCONV_CELLS_ACROSS = POSTCONV_TILE / POSTCONV_CELL_WIDTH
};

/* A filter along one axis. Its variance is exact. */
struct sp_postconv_filter {
    int taps;                            /* samples to each side */
    float weight[2 * POSTCONV_TAPS + 1]; /* from −taps to taps; their sum is 1 */
};

/* Tables that do not depend on the view. */
struct sp_postconv_tables {
    /* By phase: the cubic B-spline at the four samples around the voxel, then half its second
     * derivative. */
    _Alignas(64) float spline[POSTCONV_PHASES][8];
    float slope[POSTCONV_PHASES][4]; /* first derivative of the B-spline */
    /* By scale j and pixel modulo 2^j: weights of the four samples around the pixel. */
    float between[POSTCONV_SCALES][1 << (POSTCONV_SCALES - 1)][4];
    /* By variance · POSTCONV_STEPS. Element 0 reaches three standard deviations, element 1 four. */
    struct sp_postconv_filter filters[2][POSTCONV_FILTERS];
};

void sp_postconv_tables_init(struct sp_postconv_tables *tables);

/* The filter for bricks of a layer that have similar footprints. */
struct sp_postconv_group {
    float reference[2];    /* variance for which the filter is made [px²]: xx, yy */
    float middle;          /* 1/u2 at that variance */
    float range[2];        /* the group serves voxels with 1/u2 in this range */
    int scale[2];          /* j: a sample is 2^j px wide */
    float per_px[2];       /* 2^−j */
    float base[2];         /* variance of deposit and filter together [samples²] */
    float offset[2];       /* sample number of the tile's first corner */
    float low[2], high[2]; /* voxels between these sample numbers matter to the tile */
    const struct sp_postconv_filter *filter[2], *diagonal; /* diagonal: NULL = none */
    int sign;                                              /* of the diagonal's slope */
    float end[2];   /* sample number of the tile's other corner */
    float area;     /* of one footprint [px²] */
    float cross;    /* covariance xy that the diagonal filter adds [samples²] */
    bool has_cross; /* deposits add the remaining covariance */
};

/* A brick that may be visible. */
struct sp_postconv_brick {
    uint32_t brick;
    uint8_t level, mode;    /* mip level, enum sp_filter_mode */
    bool is_enlarged;       /* as in sp_detail_brick */
    uint8_t scale_max[2];   /* largest j at which samples do not alias with the voxel lattice */
    bool is_unfit;          /* no filter serves its footprints: each one is drawn on its own */
    int16_t x0, y0, x1, y1; /* pixels that its voxels may reach, inside the image */
    float reach[2];         /* pixels to each side that one voxel may reach */
    float base[3];          /* u of its first voxel [cells] */
    float range[2];         /* of 1/u2 of its voxels [1/cell]; 1 in orthographic projection */
    float spread[3]; /* variance xx, yy, xy of footprints times u2², without lowpass2 [px²·cell²] */
    float step[2][2];      /* the slices' two axes, projected [px] */
    float lowpass2;        /* variance of the low-pass filter [px²] */
    float scale;           /* factor of V̂: 1; above 1 = swan; 0 = lowpass */
    float depth[SP_BRICK]; /* largest optical depth that each slice can add to a pixel */
};

/* The entries of one slice of one brick, as a layer draws them. */
struct sp_postconv_run {
    uint32_t brick;      /* index into sp_postconv.bricks */
    uint16_t begin, end; /* its entries */
    uint8_t slice;       /* of the brick, along the axis */
    float range[2];      /* 1/u2 of the voxels that are not drawn yet */
    uint32_t cells; /* cells of the tile that it meets: bit row · POSTCONV_CELLS_ACROSS + column */
};

/* A tile and the number of voxels that it meets. */
struct sp_postconv_tile_cost {
    uint64_t voxels;
    uint32_t tile;
};

struct sp_postconv_insert;
struct sp_postconv_inserted;

/* One frame of this stage. All pointers are valid until the frame is finished. */
struct sp_postconv {
    const struct sp_view *view;
    struct sp_frame *frame;
    struct sp_interrupt interrupt;
    const struct sp_postconv_tables *tables;
    const struct sp_shade *shade; /* NULL = not lit */
    bool linear;                  /* SP_ATTENUATION_LINEAR */
    bool exact; /* not adaptive: filters reach farther, and the footprints of a group differ less */
    float reach; /* standard deviations from a voxel to the pixels that it matters to */
    /* The variances from which samples become two pixels wide, and wider [samples²]. */
    float smooth[2];
    unsigned axis;                      /* of the sheets */
    bool is_backwards;                  /* layers begin with the last slice */
    bool is_ordered;                    /* the eye is not between slices */
    uint32_t layers;                    /* composited front to back */
    const struct sp_level_frame *parts; /* [SP_LEVELS] */
    uint32_t *layer; /* by slice of the volume along the axis; several slices may share a layer */
    struct sp_postconv_brick *bricks;
    uint32_t brick_count;
    int columns, rows;                   /* of tiles */
    uint32_t *first;                     /* [tiles + 1]: where a tile's bricks begin in `met` */
    uint32_t *met;                       /* bricks by tile */
    struct sp_postconv_tile_cost *order; /* [tiles]: most voxels first, so that no tile ends late */
    double work[2]; /* voxels that tiles meet: served by filters, and drawn one by one */
    const struct sp_postconv_insert *insert; /* fragments of other layers; NULL = none */
    const struct sp_layer_places *places;    /* of layers; NULL = the frame has no depth */
    double prepare_ms;
    struct sp_postconv_scratch *scratch; /* by worker */
};

/* The memory of a worker for one tile. */
struct sp_postconv_scratch {
    float (*grid)[POSTCONV_PITCH][4]; /* [POSTCONV_GRID]: deposits; all zero between layers */
    _Alignas(64) float skew[POSTCONV_GRID][POSTCONV_PITCH][4]; /* after the diagonal filter; same */
    _Alignas(64) float across[POSTCONV_GRID][POSTCONV_ROW][4]; /* after the filter across; same */
    _Alignas(64) float sum[POSTCONV_TILE][POSTCONV_ROW][4]; /* sum of several groups of a layer */
    /* Composited so far: red, green, blue, transmittance; pixels in the kernels' order. */
    _Alignas(64) float done[4][POSTCONV_TILE][POSTCONV_TILE];
    /* Only if the frame has depth: moments of d − origin (frame/depth.h), as `done`; origin: NaN =
     * nothing is shown yet. */
    _Alignas(64) float moment[2][POSTCONV_TILE][POSTCONV_TILE];
    float origin;
    struct sp_postconv_inserted *inserted; /* NULL without fragments */
    struct sp_postconv_run *runs;          /* of the tile, by layer */
    uint32_t *starts;                      /* [layers + 1]: where a layer's runs begin */
    uint32_t *ends;                        /* [layers] */
    uint64_t splats, fragments;
};

/* Draws one tile into the frame. */
typedef void sp_postconv_tile_fn(const struct sp_postconv *postconv,
                                 struct sp_postconv_scratch *scratch, uint32_t tile);
sp_postconv_tile_fn sp_postconv_tile;

/* The mip level of a brick. */
static inline const struct sp_level *sp_postconv_level(const struct sp_postconv *postconv,
                                                       const struct sp_postconv_brick *brick) {
    return postconv->parts[brick->level].level;
}

static inline const struct sp_ewa_frame *sp_postconv_ewa(const struct sp_postconv *postconv,
                                                         const struct sp_postconv_brick *brick) {
    return &postconv->parts[brick->level].ewa[brick->is_enlarged];
}

#define POSTCONV_ALIKE 0.25f /* largest relative difference of variances in a group */

/* Fills v with the variance xx, yy, xy of a brick's footprints at 1/u2 = w [px²]. */
static inline void sp_postconv_variance(const struct sp_postconv_brick *brick, float w,
                                        float v[3]) {
    for (int i = 0; i < 3; i++)
        v[i] = brick->spread[i] * w * w + (i < 2 ? brick->lowpass2 : 0);
}

/* Chooses brick->scale_max. False if no filters serve all voxels of the brick. */
bool sp_postconv_choose_filters(const struct sp_postconv *postconv,
                                struct sp_postconv_brick *brick);

/* Chooses filters for the voxels of a brick from 1/u2 = range[0] on, with samples as wide as the
 * footprints allow. False if no filters serve them. */
bool sp_postconv_group_init(const struct sp_postconv *postconv,
                            const struct sp_postconv_brick *brick, const float range[2],
                            struct sp_postconv_group *group);

/* Returns how many of a brick's voxels with 1/u2 in `range` the filters of the group serve:
 * 0 = none, 1 = some, 2 = all. */
int sp_postconv_group_fits(const struct sp_postconv_group *group,
                           const struct sp_postconv_brick *brick, const float range[2]);

/* The input of a frame. */
struct sp_postconv_input {
    const struct sp_view *view;
    struct sp_frame *frame;
    struct sp_interrupt interrupt;
    const struct sp_postconv_tables *tables;
    const struct sp_camera_transform *camera;
    const struct sp_shade *shade;       /* NULL = not lit */
    const struct sp_grid *grid;         /* its slices are the sheets */
    const struct sp_level_frame *parts; /* [SP_LEVELS] */
    const struct sp_detail *detail;     /* the bricks */
    struct sp_fragments *fragments;     /* of other layers, in sheets; NULL = none */
    unsigned axis;
    double classify_ms;             /* time of the stage before, for the stats */
    sp_postconv_tile_fn *draw_tile; /* sp_postconv_tile() of an instruction set */
    struct sp_pool *pool;
    struct sp_arena *arena;
};

/* fragments.c: relates the depths of a frame's fragments to its layers, whose numbers rise or fall
 * with the slices. NULL if the arena cannot allocate. */
const struct sp_postconv_insert *sp_postconv_insert_create(const struct sp_postconv_input *input,
                                                           const struct sp_postconv *postconv);

/* Allocates memory for the fragments of a tile; NULL if the arena cannot allocate. */
struct sp_postconv_inserted *sp_postconv_inserted_create(struct sp_arena *arena);

/* True if this stage can draw the view: sheets of Gaussians on an evenly spaced grid, classified
 * before splatting, with a cutoff of at least 3 and nothing clipped. */
bool sp_postconv_can_draw(const struct sp_view *view, const struct sp_grid *grid);

/* Finds the visible bricks and the tiles that they meet. SP_ERR_MEMORY, SP_ERR_CANCELLED. */
bool sp_postconv_prepare(const struct sp_postconv_input *input, struct sp_postconv *postconv,
                         struct sp_error *err);

/* True if drawing this frame tile by tile is faster than the general path, which sets up and sorts
 * each footprint once. False if the eye is close to the voxels, because filters then serve too few
 * bricks. Also false if the eye lies between slices and the frame has fragments. */
bool sp_postconv_is_worthwhile(const struct sp_postconv *postconv);

/* Draws every pixel and fills the stats. SP_ERR_MEMORY, SP_ERR_CANCELLED. */
bool sp_postconv_draw(const struct sp_postconv_input *input, struct sp_postconv *postconv,
                      struct sp_error *err);

#endif
