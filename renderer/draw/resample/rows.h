/* SPDX-License-Identifier: Apache-2.0
 *
 * Reads parts of rows of samples as levels (curve.h). They are raised by ROWS_RAISED, so that no
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
    ROWS_LENGTH = 144,         /* samples that are read at once, at most */
    ROWS_MARGIN = 2 * SP_WIDE, /* what is written before them and behind them */
    ROWS_MEMORY = ROWS_LENGTH + 2 * ROWS_MARGIN
};

/* Narrow integers x, raised as by sp_fetch_…(), to levels: start + ((x − low) << shift)·scale. */
struct sp_rows_scaling {
    uint16_t low, high; /* values are moved into this range */
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
    int size;         /* of a sample [bytes] */
    int count;        /* samples of a row */
    ptrdiff_t stride; /* from sample to sample */
    ptrdiff_t ahead;  /* prefetch distance [samples] */
    struct sp_rows_scaling scaling;
};

/* Fills *rows; all pointers are borrowed. If the samples lie in blocks, the caller then sets
 * `blocks` and `axis`. */
void sp_rows_init(struct sp_rows *rows, const struct sp_curve *curve, const void *voxels,
                  enum sp_type type, int count, size_t stride);

/* Reads samples first to first + count − 1, ROWS_LENGTH at most, of the row that begins at voxel
 * `line` into out[0…]. The number of a voxel is that in an array, also for blocks. Beyond the ends
 * of the row its outermost samples are repeated; some of the samples must lie inside. Also writes
 * ROWS_MARGIN values at most before out[0] and behind out[count − 1]. */
void sp_rows_read(const struct sp_rows *rows, ptrdiff_t line, int first, int count, uint16_t *out);

#endif
