/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/surface/ranges.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>

enum {
    CHUNK = 64, /* blocks along axis 0 that are searched together */
    SAMPLES = CHUNK * SURFACE_BLOCK + 1
};

/* The samples that a chunk of blocks has in one row of the volume. */
struct chunk {
    const struct sp_volume *volume;
    uint32_t start[3], end[3]; /* samples */
    float (*range)[2];
};

/* The smallest and the largest samples of columns across axis 0, then of blocks; the samples of far
 * faces belong to both blocks. Comparisons with NaN are false. Rounded to floats outwards. */
#define MEASURE(name, type, lowest, highest, low_end, high_end)                                    \
    static void measure_##name(const struct chunk *chunk) {                                        \
        const uint32_t *dims = sp_volume_info(chunk->volume)->grid.dims;                           \
        const type *voxels = sp_volume_voxels(chunk->volume);                                      \
        const uint32_t count = chunk->end[0] - chunk->start[0];                                    \
        type low[SAMPLES], high[SAMPLES];                                                          \
        for (uint32_t i = 0; i < count; i++) {                                                     \
            low[i] = highest;                                                                      \
            high[i] = lowest;                                                                      \
        }                                                                                          \
        for (uint32_t z = chunk->start[2]; z < chunk->end[2]; z++)                                 \
            for (uint32_t y = chunk->start[1]; y < chunk->end[1]; y++) {                           \
                const type *x = voxels + ((uint64_t)z * dims[1] + y) * dims[0] + chunk->start[0];  \
                for (uint32_t i = 0; i < count; i++) {                                             \
                    low[i] = x[i] < low[i] && x[i] >= low_end ? x[i] : low[i];                     \
                    high[i] = x[i] > high[i] && x[i] <= high_end ? x[i] : high[i];                 \
                }                                                                                  \
            }                                                                                      \
        for (uint32_t b = 0; b * SURFACE_BLOCK + 1 < count; b++) {                                 \
            type least = highest, most = lowest;                                                   \
            for (uint32_t i = b * SURFACE_BLOCK; i <= (b + 1) * SURFACE_BLOCK && i < count; i++) { \
                least = low[i] < least ? low[i] : least;                                           \
                most = high[i] > most ? high[i] : most;                                            \
            }                                                                                      \
            store_range(chunk->range[b], (double)least, (double)most);                             \
        }                                                                                          \
    }
#define MEASURE_INTEGERS(name, type, lowest, highest)                                              \
    MEASURE(name, type, lowest, highest, lowest, highest)

static void store_range(float range[2], double low, double high) {
    range[0] = (double)(float)low <= low ? (float)low : nextafterf((float)low, -INFINITY);
    range[1] = (double)(float)high >= high ? (float)high : nextafterf((float)high, INFINITY);
}

MEASURE_INTEGERS(uint8, uint8_t, 0, UINT8_MAX)
MEASURE_INTEGERS(int8, int8_t, INT8_MIN, INT8_MAX)
MEASURE_INTEGERS(uint16, uint16_t, 0, UINT16_MAX)
MEASURE_INTEGERS(int16, int16_t, INT16_MIN, INT16_MAX)
MEASURE_INTEGERS(int32, int32_t, INT32_MIN, INT32_MAX)
MEASURE(float32, float, -INFINITY, INFINITY, -FLT_MAX, FLT_MAX)
MEASURE(float64, double, (double)-INFINITY, (double)INFINITY, -DBL_MAX, DBL_MAX)
#undef MEASURE
#undef MEASURE_INTEGERS

static void measure_chunk(const struct chunk *chunk) {
    static void (*const measure[SP_TYPE_COUNT])(const struct chunk *chunk) = {
        [SP_UINT8] = measure_uint8,     [SP_INT8] = measure_int8,   [SP_UINT16] = measure_uint16,
        [SP_INT16] = measure_int16,     [SP_INT32] = measure_int32, [SP_FLOAT32] = measure_float32,
        [SP_FLOAT64] = measure_float64,
    };
    measure[sp_volume_info(chunk->volume)->type](chunk);
}

struct range_search {
    const struct sp_surface_job *job;
    struct sp_surface_ranges *ranges;
};

static uint32_t end_sample(uint32_t block, uint32_t blocks, uint32_t dim) {
    const uint32_t end = (block + blocks) * SURFACE_BLOCK + 1;
    return end < dim ? end : dim;
}

/* Searches rows of blocks along axis 0. */
static void measure_ranges(void *user, size_t begin, size_t end, unsigned worker) {
    const struct range_search *search = user;
    const uint32_t *blocks = search->ranges->blocks;
    const uint32_t *dims = sp_volume_info(search->job->volume)->grid.dims;
    (void)worker;
    for (size_t row = begin; row < end && !sp_interrupt_is_cancelled(&search->job->interrupt);
         row++)
        for (uint32_t x = 0; x < blocks[0]; x += CHUNK) {
            const uint32_t at[3] = { x, (uint32_t)(row % blocks[1]), (uint32_t)(row / blocks[1]) };
            struct chunk chunk = { .volume = search->job->volume,
                                   .range = search->ranges->range + row * blocks[0] + x };
            for (int a = 0; a < 3; a++) {
                chunk.start[a] = at[a] * SURFACE_BLOCK;
                chunk.end[a] = end_sample(at[a], a ? 1 : CHUNK, dims[a]);
            }
            measure_chunk(&chunk);
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
    sp_parallel_for(job->pool, count ? count / ranges->blocks[0] : 0, 4, measure_ranges, &search);
    if (sp_interrupt_is_cancelled(&job->interrupt)) {
        sp_surface_ranges_finish(ranges);
        return sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
    }
    return true;
}
