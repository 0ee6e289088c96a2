/* SPDX-License-Identifier: Apache-2.0
 *
 * One frame on the CPU.
 *
 *   classify ─► for each band of tiles:
 *                 for each batch of visible voxels, front to back, until every tile is saturated:
 *                   splat   blocks of voxels → records              parallel over blocks
 *                   bin     records → lists a tile                  parallel over blocks
 *                   tile    lists → sheet sums → composited         parallel over tiles
 *                 resolve   composited → pixels                     parallel over tiles
 *
 * Batches bound the memory of records, bands that of tiles, whatever the volume and the picture;
 * where they are cut depends on neither threads nor time, and so neither does the image.
 */
#ifndef SP_BACKEND_CPU_DRAW_H
#define SP_BACKEND_CPU_DRAW_H

#include "backend/backend.h"
#include "backend/cpu/kernels.h"
#include "base/arena.h"
#include "classify/cache.h"
#include "postconv/postconv.h"

struct cpu_state {
    struct sp_pool *pool;
    struct sp_arena arena; /* of one frame */
    struct cpu_kernels kernels;
    struct sp_classify_cache cache;
    struct sp_cubic_table cubic;
    struct sp_postconv_tables postconv;
    char device[SP_DEVICE_NAME];
};

bool cpu_draw(struct cpu_state *state, const struct sp_backend_job *job, struct sp_error *err);

#endif
