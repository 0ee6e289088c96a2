/* SPDX-License-Identifier: Apache-2.0
 *
 * Sheets without footprints: "post-convolved" splatting (after Neophytou and Mueller 2003).
 *
 * In a tile all voxels of a sheet have nearly the same footprint, so its Gaussian need not be drawn
 * once a voxel. Each voxel is deposited on a small grid with a cubic B-spline, 4 × 4 samples, and
 * the rest of the variance is one separable filter a sheet:
 *
 *   V̂ + h²I  =  ⅓ I (deposit)  +  R (filter)  [+ ¼ I (interpolation)],  in units of grid samples
 *
 *   bricks that meet the tile ─► runs by layer ─► for each layer, front to back:
 *       deposit   T, E of a voxel into 4 × 4 samples                        cost: voxels
 *       filter    across (and diagonally, where V̂01 ≠ 0), then down         cost: samples touched
 *       composite what a pixel gets, as tile/blend.h has it                 cost: pixels touched
 *
 * A grid sample is a pixel, or 2^j pixels along an axis where footprints are that wide: then the
 * filtered sheet is interpolated with a quadratic one. What a voxel's own V̂ differs by from the
 * one that the filter was made for goes into its deposit, to first order: B-spline plus ½ δ times
 * its second derivative. So footprints stay exact from voxel to voxel, and tiles have no seams.
 *
 * Nothing is cut at the view's cutoff: from 3 on what lies beyond is too little to matter (54 dB
 * and more on scans, 44 at 2.5), and views whose kernels end nearer are not drawn so.
 *
 * A tile draws alone: no records, no sorting, no step that waits for other tiles. It knows which of
 * its pixels are opaque already, and leaves out what reaches no others: bricks, their slices, and
 * voxels one by one.
 */
#ifndef SP_BACKEND_CPU_SHEETS_H
#define SP_BACKEND_CPU_SHEETS_H

#include "backend/backend.h"
#include "base/arena.h"
#include "base/isa.h"
#include "base/parallel_for.h"
#include "classify/classification.h"
#include "splat/detail.h"
#include "splat/ewa.h"

enum {
    SHEETS_TILE = 96,   /* px, both ways */
    SHEETS_TAPS = 10,   /* a filter reaches at most so many samples to each side */
    SHEETS_MARGIN = 16, /* samples around a tile: for filter and deposit, a multiple of four */
    SHEETS_GRID = SHEETS_TILE + 2 * SHEETS_MARGIN,
    SHEETS_PITCH = SHEETS_GRID + 4, /* samples a row of the grid: rows 4 KiB apart would collide */
    SHEETS_ROW = SHEETS_TILE + 4,   /* pixels a row, likewise */
    SHEETS_SCALES = 6,              /* a sample is at most 2^5 px wide: tiles have whole ones */
    SHEETS_PHASES = 256,            /* of a voxel between two samples */
    SHEETS_STEPS = 16,              /* filters are made for whole multiples of 1/16 of variance */
    SHEETS_VARIANCE = 10,
    SHEETS_FILTERS = SHEETS_VARIANCE * SHEETS_STEPS + 1,
    SHEETS_CELL_WIDTH = 24,
    SHEETS_CELL_HEIGHT = 12, /* px of a cell: what is opaque is known by cells */
    SHEETS_CELLS_ACROSS = SHEETS_TILE / SHEETS_CELL_WIDTH
};

/* A filter along one axis: its variance is exact. */
struct sheets_filter {
    int taps;                          /* to each side */
    float weight[2 * SHEETS_TAPS + 1]; /* from −taps on; their sum is 1 */
};

/* Tables that no view changes. */
struct sheets_tables {
    /* Cubic B-spline at the four samples around a phase, half its second derivative, its first. */
    _Alignas(64) float spline[SHEETS_PHASES][8], slope[SHEETS_PHASES][4];
    /* By scale j, and pixel modulo 2^j: weights of the four samples around it. */
    float between[SHEETS_SCALES][1 << (SHEETS_SCALES - 1)][4];
    /* By variance · SHEETS_STEPS: to three deviations, and a little farther. */
    struct sheets_filter filters[2][SHEETS_FILTERS];
};

void sheets_tables_init(struct sheets_tables *tables);

/* Bricks of a layer whose footprints are alike, and the filter for them. */
struct sheets_group {
    float reference[2];    /* variance that it is made for, px²: xx, yy */
    float middle;          /* 1/u2 there */
    float range[2];        /* of 1/u2 of the voxels that it serves */
    int scale[2];          /* j: a sample is 2^j px wide */
    float per_px[2];       /* 2^−j */
    float base[2];         /* variance that deposit and filter give, samples² */
    float offset[2];       /* sample number of the tile's corner */
    float low[2], high[2]; /* samples from which voxels matter */
    const struct sheets_filter *filter[2], *diagonal; /* NULL = none */
    int sign;                                         /* of the diagonal */
    float end[2];                                     /* sample number of the tile's other corner */
    float area;                                       /* of a footprint, px */
    float cross;    /* variance across that the diagonal gives, samples² */
    bool has_cross; /* deposits have to give the rest of it */
};

/* A level of the pyramid: for bricks that are small enough in the picture, and for enlarged ones.
 */
struct cpu_part {
    const struct sp_level *level; /* NULL = not drawn */
    struct sp_ewa_frame ewa[2];
    const uint8_t *modes[2]; /* by brick: adaptive; else NULL */
};

/* One brick that may be seen. */
struct sheets_brick {
    uint32_t brick;
    uint8_t level, mode;    /* enum sp_filter_mode */
    bool is_enlarged;       /* as in sp_detail_brick */
    uint8_t scale_max[2];   /* samples of 2^j px do not beat with the voxels up to this j */
    bool is_unfit;          /* no filter serves its footprints: they are drawn one by one */
    int16_t x0, y0, x1, y1; /* px that its voxels may reach, inside the picture */
    float reach[2];         /* px to each side that a voxel may */
    float base[3];          /* u of its first voxel, cells */
    float range[2];         /* of 1/u2 of its voxels, orthographic: 1 [1/cells] */
    float spread[3];        /* of the footprint, times u2²: xx, yy, xy [px²], without … */
    float step[2][2];       /* of the slices' axes in the picture, there [px] */
    float lowpass2;         /* … this much of low-pass filter, px² */
    float scale;            /* what V̂ was multiplied by: swan; 0 = lowpass */
    float depth[SP_BRICK];  /* most that each of its slices can add to a pixel */
};

struct sheets_run {
    uint32_t brick;      /* of sheets.bricks */
    uint16_t begin, end; /* its entries */
    uint8_t slice;       /* of the brick, along the axis */
    float range[2];      /* of 1/u2 that is still to be drawn */
    uint32_t cells;      /* of the tile that it meets: bit row · SHEETS_CELLS_ACROSS + column */
};

/* A tile, and how many voxels it meets. */
struct sheets_turn {
    uint64_t voxels;
    uint32_t tile;
};

/* A frame. */
struct sheets {
    const struct sp_backend_job *job;
    const struct sheets_tables *tables;
    const struct sp_shade *shade; /* NULL = none */
    bool linear;                  /* attenuation */
    bool exact;  /* not adaptive: filters reach farther, for less different footprints */
    float reach; /* deviations from a voxel to the pixels that it matters to */
    /* Samples become two pixels wide, and wider, while footprints keep that variance, samples². */
    float smooth[2];
    unsigned axis;
    uint32_t layers;
    const struct cpu_part *parts; /* [SP_LEVELS] */
    uint32_t *layer; /* of each slice of the volume along the axis; several may share one */
    struct sheets_brick *bricks;
    uint32_t brick_count;
    int columns, rows;         /* of tiles */
    uint32_t *first;           /* [tiles + 1]: what a tile meets */
    uint32_t *met;             /* bricks */
    struct sheets_turn *order; /* [tiles]: those with most voxels first, so that none is late */
    double work[2];            /* voxels that tiles meet: with filters, and one by one */
    double prepare_ms;
    struct sheets_scratch *scratch; /* by worker */
};

/* What a worker needs for one tile. */
struct sheets_scratch {
    _Alignas(64) float grid[SHEETS_GRID][SHEETS_PITCH][4]; /* deposited; zero between layers */
    _Alignas(64) float skew[SHEETS_GRID][SHEETS_PITCH][4]; /* filtered along a diagonal */
    _Alignas(64) float across[SHEETS_GRID][SHEETS_ROW][4]; /* filtered across; zero likewise */
    _Alignas(64) float sum[SHEETS_TILE][SHEETS_ROW][4];    /* of several groups of a layer */
    /* Composited so far: red, green, blue, transmittance; pixels in the order of the kernels. */
    _Alignas(64) float done[4][SHEETS_TILE][SHEETS_TILE];
    struct sheets_run *runs; /* of the tile, by layer */
    uint32_t *starts;        /* [layers + 1]: where a layer's runs may begin */
    uint32_t *ends;          /* [layers] */
    uint64_t splats, fragments;
};

/* Draws one tile into the frame. */
void sheets_tile(const struct sheets *sheets, struct sheets_scratch *scratch, uint32_t tile);

/* What a brick is drawn with. */
static inline const struct sp_level *sheets_level(const struct sheets *sheets,
                                                  const struct sheets_brick *brick) {
    return sheets->parts[brick->level].level;
}

static inline const struct sp_ewa_frame *sheets_ewa(const struct sheets *sheets,
                                                    const struct sheets_brick *brick) {
    return &sheets->parts[brick->level].ewa[brick->is_enlarged];
}

#define SHEETS_ALIKE 0.25f /* relative difference of variances in a group */

/* Variance of a brick's footprints at 1/u2 = w, px²: xx, yy, xy. */
static inline void sheets_variance(const struct sheets_brick *brick, float w, float v[3]) {
    for (int i = 0; i < 3; i++)
        v[i] = brick->spread[i] * w * w + (i < 2 ? brick->lowpass2 : 0);
}

/* Chooses how wide a brick's samples may be. False when there are no filters for all of its voxels.
 */
bool sheets_find_filters(const struct sheets *sheets, struct sheets_brick *brick);

/* The filters for a brick's voxels from `range` on, with samples as wide as they allow; false when
 * there are none. */
bool sheets_group_make(const struct sheets *sheets, const struct sheets_brick *brick,
                       const float range[2], struct sheets_group *group);

/* Whether those filters serve other voxels too: 0 = none of them, 1 = some, 2 = all. */
int sheets_group_fits(const struct sheets_group *group, const struct sheets_brick *brick,
                      const float range[2]);

/* What a frame is made from. */
struct sheets_frame {
    const struct sp_backend_job *job;
    const struct sheets_tables *tables;
    const struct sp_camera_frame *camera;
    const struct sp_shade *shade;   /* NULL = none */
    const struct sp_grid *grid;     /* its slices are the sheets */
    const struct cpu_part *parts;   /* [SP_LEVELS] */
    const struct sp_detail *detail; /* the bricks */
    unsigned axis;
    double classify_ms; /* spent before, for the stats */
    void (*draw_tile)(const struct sheets *sheets, struct sheets_scratch *scratch, uint32_t tile);
    struct sp_pool *pool;
    struct sp_arena *arena;
};

/* Whether the view asks for something that this can draw. */
bool sheets_can(const struct sp_view *view, const struct sp_grid *grid);

/* Finds the bricks that may be seen and the tiles that they meet; SP_ERR_MEMORY, SP_ERR_CANCELLED.
 */
bool sheets_prepare(const struct sheets_frame *frame, struct sheets *sheets, struct sp_error *err);

/* Whether so many bricks have filters that a frame drawn by tiles is sooner done than one whose
 * footprints are all set up once and sorted: not where the eye is close to the voxels. */
bool sheets_pay(const struct sheets *sheets);

/* Draws all of it and adds to the stats; SP_ERR_MEMORY, SP_ERR_CANCELLED. */
bool sheets_draw(const struct sheets_frame *frame, struct sheets *sheets, struct sp_error *err);

#endif
