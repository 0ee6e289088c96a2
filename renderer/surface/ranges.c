/* SPDX-License-Identifier: Apache-2.0 */
#include "surface/ranges.h"

#include <math.h>
#include <stdlib.h>

/* Widens [*low, *high] by the finite samples of a row. Comparisons with NaN are false. */
#define WIDEN(name, type, limit)                                                                   \
    case name: {                                                                                   \
        const type *x = (const type *)voxels + first;                                              \
        type least = x[0], most = x[0];                                                            \
        for (uint32_t i = 1; i < count && !(limit); i++) {                                         \
            least = x[i] < least ? x[i] : least;                                                   \
            most = x[i] > most ? x[i] : most;                                                      \
        }                                                                                          \
        for (uint32_t i = 0; i < count && (limit); i++) {                                          \
            double f = (double)x[i];                                                               \
            *low = f < *low && f > -INFINITY ? f : *low;                                           \
            *high = f > *high && f < INFINITY ? f : *high;                                         \
        }                                                                                          \
        if (!(limit)) {                                                                            \
            *low = (double)least < *low ? (double)least : *low;                                    \
            *high = (double)most > *high ? (double)most : *high;                                   \
        }                                                                                          \
    } break

static void widen(const void *voxels, enum sp_type type, uint64_t first, uint32_t count,
                  double *low, double *high) {
    switch (type) {
        WIDEN(SP_UINT8, uint8_t, 0);
        WIDEN(SP_INT8, int8_t, 0);
        WIDEN(SP_UINT16, uint16_t, 0);
        WIDEN(SP_INT16, int16_t, 0);
        WIDEN(SP_INT32, int32_t, 0);
        WIDEN(SP_FLOAT32, float, 1);
        WIDEN(SP_FLOAT64, double, 1);
    case SP_TYPE_COUNT:
        break;
    }
}
#undef WIDEN

/* The smallest and the largest finite sample of a block; those of its far faces belong to it. */
static void find_range(const struct sp_volume *volume, const uint32_t corner[3], float range[2]) {
    const struct sp_volume_info *info = sp_volume_info(volume);
    const uint32_t *dims = info->grid.dims;
    uint32_t end[3];
    double low = INFINITY, high = -INFINITY;
    for (int a = 0; a < 3; a++)
        end[a] = dims[a] - corner[a] > SURFACE_BLOCK ? corner[a] + SURFACE_BLOCK + 1 : dims[a];
    for (uint32_t z = corner[2]; z < end[2]; z++)
        for (uint32_t y = corner[1]; y < end[1]; y++)
            widen(sp_volume_voxels(volume), info->type,
                  ((uint64_t)z * dims[1] + y) * dims[0] + corner[0], end[0] - corner[0], &low,
                  &high);
    /* Rounded to floats outwards. */
    range[0] = (double)(float)low <= low ? (float)low : nextafterf((float)low, -INFINITY);
    range[1] = (double)(float)high >= high ? (float)high : nextafterf((float)high, INFINITY);
}

struct range_search {
    const struct sp_surface_job *job;
    struct sp_surface_ranges *ranges;
};

static void find_ranges(void *user, size_t begin, size_t end, unsigned worker) {
    const struct range_search *search = user;
    const uint32_t *blocks = search->ranges->blocks;
    (void)worker;
    for (size_t b = begin; b < end && !sp_interrupt_is_cancelled(&search->job->interrupt); b++) {
        size_t row = b / blocks[0];
        const uint32_t corner[3] = { (uint32_t)(b % blocks[0]) * SURFACE_BLOCK,
                                     (uint32_t)(row % blocks[1]) * SURFACE_BLOCK,
                                     (uint32_t)(row / blocks[1]) * SURFACE_BLOCK };
        find_range(search->job->volume, corner, search->ranges->range[b]);
    }
}

void sp_surface_ranges_finish(struct sp_surface_ranges *ranges) {
    free(ranges->range);
    *ranges = (struct sp_surface_ranges){ 0 };
}

static size_t block_count(const struct sp_surface_ranges *ranges) {
    return (size_t)ranges->blocks[0] * ranges->blocks[1] * ranges->blocks[2];
}

uint64_t sp_surface_ranges_bytes(const struct sp_surface_ranges *ranges) {
    return block_count(ranges) * sizeof *ranges->range;
}

bool sp_surface_ranges_init(struct sp_surface_ranges *ranges, const struct sp_surface_job *job,
                            struct sp_error *err) {
    const uint32_t *dims = sp_volume_info(job->volume)->grid.dims;
    for (int a = 0; a < 3; a++)
        ranges->blocks[a] = (dims[a] + SURFACE_BLOCK - 2) / SURFACE_BLOCK;
    size_t count = block_count(ranges);
    ranges->range = malloc((count ? count : 1) * sizeof *ranges->range);
    if (!ranges->range) {
        sp_surface_ranges_finish(ranges);
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the ranges of the volume");
    }
    struct range_search search = { job, ranges };
    sp_parallel_for(job->pool, count, 64, find_ranges, &search);
    if (sp_interrupt_is_cancelled(&job->interrupt)) {
        sp_surface_ranges_finish(ranges);
        return sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
    }
    return true;
}
