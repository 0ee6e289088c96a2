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
    LIGHT_DIRECTIONS = 20, /* of ambient light: the corners of a dodecahedron */
    LIGHT_PAD = 16,        /* floats beyond each row, so that the last vector fits */
    LIGHT_MARGIN = 4,      /* floats around each slice, which pass all light */
    LIGHT_BINS = 4096,     /* of the values of the transfer function */
    LIGHT_PER_CELL_MAX = 4 /* positions per cell and axis; the next cell begins at the last one */
};

/* What a half space keeps: normal · cell coordinate >= offset. The normal has length 1. */
struct sp_light_half {
    double normal[3], offset;
};

/* How to fill the extinction of cells. The place of a value is t = (value − low)·per_unit; whole t
 * are bins. */
struct sp_light_cells {
    const void *voxels;
    const struct sp_volume_info *info;
    const struct sp_transfer_function *tf;
    double low, per_unit;
    bool fits_floats; /* floats hold these two, and places of 16-bit integers */
    /* Integral of optical depth up to the begin of a bin, and its mean in the bin. The first entry
     * is for what lies below all bins, the last one for what lies above. */
    float sums[LIGHT_BINS + 2], means[LIGHT_BINS + 2];
    float first_visible; /* below this t nothing is visible */
    unsigned per_cell;
    uint32_t *sample[3]; /* sample at each position along the axes, owned */
    double width[3];     /* from position to position, world units */
    bool is_even;        /* each sample of the first axis is a position */
    struct sp_light_half halves[6 + SP_CLIP_PLANES_MAX]; /* clipping */
    int half_count;
    float column_depth[3]; /* −log2 e · reference lengths from position to position */
    float per_column[3];   /* a third of ln 2 · the width of a cell over that along the axis */
    uint32_t dims[3];      /* cells */
    float *extinction;     /* [dims]: optical depth per width of a cell */
    uint32_t *field;       /* [dims]: all light arrives; and how clear cells are */
    float *rows;           /* per worker: sp_light_cells_floats() */
    size_t worker_floats;
};

/* Fills a slice of cells. */
typedef void sp_light_cells_fn(const struct sp_light_cells *cells, uint32_t slice, unsigned worker);
void sp_light_compute_cells(const struct sp_light_cells *cells, uint32_t slice, unsigned worker);

/* Rows of samples that a worker holds: each has four numbers; depths; and sums. */
static inline size_t sp_light_row_floats(uint32_t cells, unsigned per_cell) {
    return (size_t)cells * per_cell + 1 + 2 * LIGHT_PAD;
}

static inline size_t sp_light_cells_floats(uint32_t cells, unsigned per_cell) {
    return (4 * (size_t)(per_cell + 1) * (per_cell + 1) + per_cell * per_cell + 3) *
           sp_light_row_floats(cells, per_cell);
}

/* How light of one direction comes to a slice. */
struct sp_light_step {
    float weight[4];  /* of four rays of the previous slice, at a cell */
    int shift[2];     /* of the first one */
    float between[4]; /* of four cells, at a ray */
    bool is_spread;   /* rays start again from the cells */
    float depth;  /* −log2 e · widths of a cell from slice to slice; the same for all beams */
    float fading; /* e^−step/R */
};

struct sp_light_slice {
    const struct sp_light_step *steps;
    int count;
    bool is_ambient;         /* all steps are spread, and light fades; else none fades */
    const float *extinction; /* of the first cell of the slice */
    uint32_t *field;         /* of that cell: ambient light adds sum·scale, a light sets byte 1 */
    float *staged;           /* sums go there instead, as floats; NULL = to the field */
    float scale;
    size_t stride; /* from row to row of cells */
    int dims[2];
    int width;         /* floats per row of rays, with margins */
    size_t plane;      /* floats per direction */
    const float *from; /* [count][plane]: what passed the previous slice */
    float *to;         /* the same of this slice */
    float *rows;       /* per worker: three rows */
    size_t row_floats;
};

/* Rows of rays [begin, end) of a slice. There is one more row of rays than of cells unless the
 * slice is ambient. */
typedef void sp_light_pass_fn(const struct sp_light_slice *slice, size_t begin, size_t end,
                              unsigned worker);
void sp_light_pass(const struct sp_light_slice *slice, size_t begin, size_t end, unsigned worker);

/* Slices across the first axis are turned, LIGHT_TURN at once, so that their rows are contiguous:
 * rows of the volume's cells that are `length` cells long, `cell` apart. */
struct sp_light_turn {
    const float *extinction; /* of the first cell of the first slice */
    uint32_t *field;
    float *staged;     /* [count][slice] */
    size_t row, cell;  /* from row to row and from cell to cell of a row, in the volume */
    size_t stride;     /* from row to row of a staged slice */
    size_t slice;      /* from slice to slice */
    int length, count; /* of rows; of slices */
    bool is_ambient;
    float scale;
};
enum { LIGHT_TURN = 16 };

typedef void sp_light_turn_fn(const struct sp_light_turn *turn, size_t row);
void sp_light_turn_in(const struct sp_light_turn *turn, size_t row);  /* extinction → staged */
void sp_light_turn_out(const struct sp_light_turn *turn, size_t row); /* staged → field */

struct sp_light_kernels {
    sp_light_cells_fn *compute_cells;
    sp_light_pass_fn *pass;
    sp_light_turn_fn *turn_in, *turn_out;
};

#endif
