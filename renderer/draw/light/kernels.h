/* SPDX-License-Identifier: Apache-2.0
 *
 * The loops over samples and cells, compiled once per instruction set (base/isa.h).
 */
#ifndef SP_LIGHT_KERNELS_H
#define SP_LIGHT_KERNELS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/isa.h"
#include "sp/view.h"
#include "sp/volume.h"

enum {
    LIGHT_AROUND = 4, /* directions of ambient light per edge of a cube around a point */
    LIGHT_DIRECTIONS = 6 * LIGHT_AROUND * LIGHT_AROUND,
    LIGHT_MOMENTS = 9,     /* of the occlusion over the sphere (light.h) */
    LIGHT_WORDS = 3,       /* per cell of the field: one, and two of moments */
    LIGHT_PAD = 16,        /* floats beyond each row, so that the last vector fits */
    LIGHT_MARGIN = 4,      /* floats around each slice; the margin passes all light */
    LIGHT_BINS = 4096,     /* of the values of the transfer function */
    LIGHT_PER_CELL_MAX = 4 /* positions per cell and axis; the next cell begins at the last one */
};

/* Units per moment: |D| <= 1/4, |Q| <= 0.13, for sums over any of the directions as well. A
 * hemisphere reaches 118 of the 127 units, so that sums that are rounded for each sweep fit. */
#define LIGHT_DIPOLE 472.0f
#define LIGHT_QUADRUPOLE 900.0f

/* Four moments that are 0, as biased bytes. */
#define LIGHT_MOMENT_ZERO 0x80808080u

/* A half space: keeps the points with normal · cell coordinate >= offset. The normal has length
 * 1. */
struct sp_light_half {
    double normal[3], offset;
};

/* The inputs and outputs of the loop that computes the extinction of cells. A value has the place
 * t = (value − low)·per_unit among the bins; bin n begins at t = n. */
struct sp_light_cells {
    const void *voxels;
    const struct sp_volume_info *info;
    const struct sp_transfer_function *tf;
    double low, per_unit;
    bool fits_floats; /* single precision is enough for `low`, `per_unit` and the places of 16-bit
                         integers */
    /* The integral of optical depth up to the begin of a bin, and its mean in the bin. The first
     * entry serves values below all bins, the last entry values above all bins. */
    float sums[LIGHT_BINS + 2], means[LIGHT_BINS + 2];
    float first_visible; /* values below this t are not visible */
    unsigned per_cell;
    uint32_t *sample[3]; /* sample at each position along the axes, owned */
    double width[3];     /* distance of two positions [world unit] */
    bool is_even;        /* each sample of the first axis is a position */
    struct sp_light_half halves[6 + SP_CLIP_PLANES_MAX]; /* clipping */
    int half_count;
    float column_depth[3]; /* −log2 e · reference lengths from position to position */
    float per_column[3];   /* a third of ln 2 · the width of a cell over that along the axis */
    uint32_t dims[3];      /* cells */
    float *extinction;     /* [dims]: optical depth per width of a cell */
    /* [dims]: output: all light arrives, and the clearness of the cell (light.h). */
    uint32_t *field;
    float *rows; /* per worker: sp_light_cells_floats() */
    size_t worker_floats;
};

/* Fills a slice of cells. */
typedef void sp_light_cells_fn(const struct sp_light_cells *cells, uint32_t slice, unsigned worker);
void sp_light_compute_cells(const struct sp_light_cells *cells, uint32_t slice, unsigned worker);

/* Return the floats of a row of samples, and the floats per worker: rows of samples with four
 * numbers each, rows of depths and rows of sums. */
static inline size_t sp_light_row_floats(uint32_t cells, unsigned per_cell) {
    return (size_t)cells * per_cell + 1 + 2 * LIGHT_PAD;
}

static inline size_t sp_light_cells_floats(uint32_t cells, unsigned per_cell) {
    return (4 * (size_t)(per_cell + 1) * (per_cell + 1) + per_cell * per_cell + 3) *
           sp_light_row_floats(cells, per_cell);
}

/* How light of one direction passes from one slice to the next. */
struct sp_light_step {
    float weight[4];  /* weights of four rays of the previous slice, at a cell */
    int shift[2];     /* offset of the first of the four */
    float between[4]; /* weights of four cells, at a ray */
    bool is_spread;   /* rays start again from the cells */
    float depth;  /* −log2 e · path between two slices [widths of a cell]; equal for all beams */
    float fading; /* e^−step/R */
};

struct sp_light_slice {
    const struct sp_light_step *steps;
    int count;
    bool is_ambient;         /* all steps are spread and light fades; false: no step fades */
    const float *extinction; /* of the first cell of the slice */
    /* Ambient light: what a direction adds to each moment where it is dark, in units of the field.
     * A light: the first number scales the sum of its beams. */
    const float (*moment)[LIGHT_MOMENTS];
    uint32_t *field;        /* of the same cell: ambient light adds to it, a light sets byte 1 */
    uint32_t (*moments)[2]; /* of the same cell: ambient light adds to them */
    uint32_t *staged;       /* gets the words instead of `field` and `moments`, if not NULL */
    size_t staged_next;     /* from the first words of all cells to the second ones */
    size_t stride;          /* from row to row of cells */
    int dims[2];
    int width;         /* floats per row of rays, with margins */
    size_t plane;      /* floats per direction */
    const float *from; /* [count][plane]: light behind the previous slice */
    float *to;         /* [count][plane]: light behind this slice */
    float *rows;       /* per worker: two rows */
    uint32_t *words;   /* per worker: LIGHT_WORDS rows */
    size_t row_floats;
};

/* Passes light through the rows of rays [begin, end) of a slice. A slice has one more row of rays
 * than of cells, unless it is ambient. */
typedef void sp_light_pass_fn(const struct sp_light_slice *slice, size_t begin, size_t end,
                              unsigned worker);
void sp_light_pass(const struct sp_light_slice *slice, size_t begin, size_t end, unsigned worker);

/* Copies slices that are perpendicular to the first axis, LIGHT_TURN at a time, so that the rows of
 * a slice are contiguous. A row has `length` cells, which lie `cell` elements apart in the
 * volume. */
struct sp_light_turn {
    const float *extinction; /* of the first cell of the first slice */
    uint32_t *field, (*moments)[2];
    float *depth;      /* [count][slice]: staged extinction */
    uint32_t *words;   /* [LIGHT_WORDS][LIGHT_TURN][slice]: staged words of the field */
    size_t row, cell;  /* strides in the volume: from row to row, and from cell to cell of a row
                          [elements] */
    size_t stride;     /* from row to row of a staged slice [elements] */
    size_t slice;      /* from slice to slice [elements] */
    int length, count; /* of rows; of slices */
    bool is_ambient;
};
enum { LIGHT_TURN = 16 };

typedef void sp_light_turn_fn(const struct sp_light_turn *turn, size_t row);
void sp_light_turn_in(const struct sp_light_turn *turn, size_t row);  /* extinction → depth */
void sp_light_turn_out(const struct sp_light_turn *turn, size_t row); /* words → field */

struct sp_light_kernels {
    sp_light_cells_fn *compute_cells;
    sp_light_pass_fn *pass;
    sp_light_turn_fn *turn_in, *turn_out;
};

#endif
