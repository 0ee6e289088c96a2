/* SPDX-License-Identifier: Apache-2.0
 *
 * Reads parts of rows of samples as codes (curve.h). ROWS_RAISED is added to each code, so that no
 * overshoot of a filter is negative.
 */
#ifndef SP_RESAMPLE_ROWS_H
#define SP_RESAMPLE_ROWS_H

#include "base/isa.h"
#include "base/wide.h"
#include "data/volume/blocks.h"
#include "draw/resample/curve.h"
#include "sp/volume.h"

enum {
    ROWS_RAISED = 8192,
    ROWS_LENGTH = 144,         /* most samples per call */
    ROWS_MARGIN = 2 * SP_WIDE, /* values that may be written before and behind the samples */
    ROWS_MEMORY = ROWS_LENGTH + 2 * ROWS_MARGIN
};

/* Converts narrow integers x, as sp_fetch_…() returns them, to codes: start + ((x − low) <<
 * shift)·scale. */
struct sp_rows_scaling {
    uint16_t low, high; /* values are limited to this range */
    uint16_t scale;     /* ·65536 */
    uint16_t start;     /* raised by ROWS_RAISED */
    int shift;
};

/* Where rows are read. */
struct sp_rows {
    const struct sp_curve *curve;
    const void *voxels;
    const struct sp_blocks *blocks; /* instead of voxels; NULL = none */
    unsigned axis;                  /* of the rows in the blocks */
    enum sp_type type;
    int size;            /* of a sample [bytes] */
    bool is_float_exact; /* float32, and the curve's numbers are floats that are exact enough */
    int count;           /* samples of a row */
    ptrdiff_t stride;    /* from sample to sample */
    ptrdiff_t ahead;     /* prefetch distance [samples] */
    struct sp_rows_scaling scaling;
};

/* Fills *rows; all pointers are borrowed. If the samples lie in blocks, the caller then sets
 * `blocks` and `axis`. */
void sp_rows_init(struct sp_rows *rows, const struct sp_curve *curve, const void *voxels,
                  enum sp_type type, int count, size_t stride);

/* Reads the samples [first, first + count) of the row that begins at voxel `line` into out[0 …
 * count − 1]; count ≤ ROWS_LENGTH. `line` is an index into an array of voxels, also if the samples
 * lie in blocks. Beyond the ends of the row its outermost samples are repeated; some of the samples
 * must lie inside. Also writes up to ROWS_MARGIN values before out[0] and behind out[count − 1]. */
void sp_rows_read(const struct sp_rows *rows, ptrdiff_t line, int first, int count, uint16_t *out);

#endif
