/* SPDX-License-Identifier: Apache-2.0
 *
 * The range of values of each block of cells. The extraction of a surface skips blocks whose range
 * does not contain its value.
 */
#ifndef SP_SURFACE_RANGES_H
#define SP_SURFACE_RANGES_H

#include <stdint.h>

#include "base/interrupt.h"
#include "base/parallel_for.h"
#include "sp/volume.h"

enum { SURFACE_BLOCK = 8 }; /* cells per axis */

/* The smallest and the largest sample of each block of a volume; low > high = the block has no
 * finite sample. */
struct sp_surface_ranges {
    uint32_t blocks[3]; /* per axis, axis 0 fastest; 0 = an axis has a single sample: no cells */
    float (*range)[2];
};

struct sp_surface_job {
    const struct sp_volume *volume;
    double value;
    struct sp_pool *pool;
    struct sp_interrupt interrupt;
};

/* Computes the ranges. SP_ERR_MEMORY, SP_ERR_CANCELLED; *ranges is then empty. */
bool sp_surface_ranges_init(struct sp_surface_ranges *ranges, const struct sp_surface_job *job,
                            struct sp_error *err);
void sp_surface_ranges_finish(struct sp_surface_ranges *ranges);
uint64_t sp_surface_ranges_bytes(const struct sp_surface_ranges *ranges);

#endif
