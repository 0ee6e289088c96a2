/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/surface/extract.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "draw/layers/surface/batch.h"
#include "draw/layers/surface/samples.h"

struct extraction {
    const struct sp_surface_job *job;
    struct sp_surface_points *points;
    struct sp_surface_batch_frame frame;
    struct sp_surface_parts parts[256]; /* by the inside corners of a cell; 0 and 255: none */
    float weights[SURFACE_SPLIT_MAX * SURFACE_SPLIT_MAX * SURFACE_SPLIT_MAX][8][8];
};

/* The samples of a row of cells. */
struct cell_row {
    unsigned crossed;      /* bit x: the surface crosses cell x */
    unsigned inside[2][2]; /* [z][y], bit x: the sample is inside */
};

static struct cell_row compute_row(const struct sp_surface_bits *bits, int y, int z) {
    const uint16_t(*in)[SURFACE_SLOPES] = &bits->inside[z];
    const uint16_t(*finite)[SURFACE_SLOPES] = &bits->finite[z];
    unsigned any = in[0][y] | in[0][y + 1] | in[1][y] | in[1][y + 1];
    unsigned all = in[0][y] & in[0][y + 1] & in[1][y] & in[1][y + 1];
    unsigned good = finite[0][y] & finite[0][y + 1] & finite[1][y] & finite[1][y + 1];
    unsigned crossed = (any | any >> 1) & ~(all & all >> 1) & good & good >> 1;
    return (struct cell_row){ crossed & ((1 << SURFACE_BLOCK) - 1),
                              { { in[0][y], in[0][y + 1] }, { in[1][y], in[1][y + 1] } } };
}

static unsigned inside_corners(const struct cell_row *row, int x) {
    return (row->inside[0][0] >> x & 3) | (row->inside[0][1] >> x & 3) << 2 |
           (row->inside[1][0] >> x & 3) << 4 | (row->inside[1][1] >> x & 3) << 6;
}

static void read_corners(const struct sp_surface_samples *samples, int x, int y, int z,
                         float f[8]) {
    for (int c = 0; c < 8; c++)
        f[c] = samples->f[z + 1 + (c >> 2)][y + 1 + (c >> 1 & 1)][x + 1 + (c & 1)];
}

/* The weights of a cell's corners k at the corners c of its parts. */
static void compute_weights(struct extraction *e, const uint8_t split[3]) {
    for (int p = 0; p < split[0] * split[1] * split[2]; p++)
        for (int k = 0; k < 8; k++)
            for (int c = 0; c < 8; c++) {
                const int i[3] = { p % split[0], p / split[0] % split[1], p / split[0] / split[1] };
                e->weights[p][k][c] = 1;
                for (int a = 0; a < 3; a++) {
                    float share = (float)(i[a] + (c >> a & 1)) / (float)split[a];
                    e->weights[p][k][c] *= k >> a & 1 ? share : 1 - share;
                }
            }
}

/* Visits the parts that a cell is split into. batch: NULL = pieces are only counted. Returns their
 * number. */
static uint32_t split_cell(const struct extraction *e, const struct sp_surface_samples *samples,
                           const int cell[3], struct sp_surface_batch *batch) {
    const uint8_t *split = e->points->split;
    const int parts = split[0] * split[1] * split[2];
    uint32_t count = 0;
    float f[8], own[8];
    read_corners(samples, cell[0], cell[1], cell[2], f);
    for (int p = 0; p < parts; p++) {
        const int i[3] = { p % split[0], p / split[0] % split[1], p / split[0] / split[1] };
        unsigned inside = 0;
        for (int c = 0; c < 8; c++)
            own[c] = 0;
        for (int k = 0; k < 8; k++)
            for (int c = 0; c < 8; c++)
                own[c] += e->weights[p][k][c] * f[k];
        for (int c = 0; c < 8; c++)
            inside |= (unsigned)(own[c] >= 0) << c;
        count += e->parts[inside].count;
        if (batch)
            sp_surface_batch_add(batch, own, &e->parts[inside], cell, i);
    }
    return count;
}

/* Counts the points of the blocks. */
static void count_blocks(void *user, size_t begin, size_t end, unsigned worker) {
    const struct extraction *e = user;
    const uint8_t *split = e->points->split;
    const bool is_split = split[0] * split[1] * split[2] > 1;
    (void)worker;
    for (size_t b = begin; b < end && !sp_interrupt_is_cancelled(&e->job->interrupt); b++) {
        struct sp_surface_samples samples;
        struct sp_surface_bits bits;
        struct sp_surface_block *block = &e->points->blocks[b];
        sp_surface_samples_read(&samples, e->job->volume, e->job->value, block->corner);
        sp_surface_samples_compare(&samples, &bits);
        block->count = 0;
        for (int z = 0; z < SURFACE_BLOCK; z++)
            for (int y = 0; y < SURFACE_BLOCK; y++) {
                const struct cell_row row = compute_row(&bits, y, z);
                for (unsigned left = row.crossed; left; left &= left - 1) {
                    const int cell[3] = { __builtin_ctz(left), y, z };
                    block->count += is_split ? split_cell(e, &samples, cell, NULL)
                                             : e->parts[inside_corners(&row, cell[0])].count;
                }
            }
    }
}

static void fill_block(const struct extraction *e, struct sp_surface_batch *batch) {
    const uint8_t *split = e->points->split;
    const bool is_split = split[0] * split[1] * split[2] > 1;
    struct sp_surface_samples samples;
    struct sp_surface_bits bits;
    sp_surface_samples_read(&samples, e->job->volume, e->job->value, batch->block->corner);
    sp_surface_samples_compare(&samples, &bits);
    sp_surface_samples_slopes(&samples, &batch->slopes);
    memcpy(batch->gap, samples.gap, sizeof batch->gap);
    for (int z = 0; z < SURFACE_BLOCK; z++)
        for (int y = 0; y < SURFACE_BLOCK; y++) {
            const struct cell_row row = compute_row(&bits, y, z);
            for (unsigned left = row.crossed; left; left &= left - 1) {
                const int cell[3] = { __builtin_ctz(left), y, z }, whole[3] = { 0 };
                float f[8];
                if (is_split) {
                    split_cell(e, &samples, cell, batch);
                    continue;
                }
                read_corners(&samples, cell[0], y, z, f);
                sp_surface_batch_add(batch, f, &e->parts[inside_corners(&row, cell[0])], cell,
                                     whole);
            }
        }
}

static void fill_blocks(void *user, size_t begin, size_t end, unsigned worker) {
    const struct extraction *e = user;
    struct sp_surface_batch batch = { .frame = &e->frame };
    (void)worker;
    for (size_t b = begin; b < end && !sp_interrupt_is_cancelled(&e->job->interrupt); b++) {
        sp_surface_batch_begin(&batch, &e->points->blocks[b]);
        fill_block(e, &batch);
        sp_surface_batch_end(&batch);
    }
}

/* Lists the blocks whose range has the value. */
static bool list_blocks(struct sp_surface_points *points, const struct sp_surface_ranges *ranges,
                        double value) {
    uint64_t all = (uint64_t)ranges->blocks[0] * ranges->blocks[1] * ranges->blocks[2], n = 0;
    for (int pass = 0; pass < 2; pass++) {
        n = 0;
        for (uint64_t b = 0; b < all; b++) {
            const float *range = ranges->range[b];
            if (!((double)range[0] <= value && value <= (double)range[1]))
                continue;
            if (pass) {
                struct sp_surface_block *block = &points->blocks[n];
                *block = (struct sp_surface_block){ 0 };
                block->corner[0] = (uint32_t)(b % ranges->blocks[0]) * SURFACE_BLOCK;
                block->corner[1] =
                    (uint32_t)(b / ranges->blocks[0] % ranges->blocks[1]) * SURFACE_BLOCK;
                block->corner[2] =
                    (uint32_t)(b / ranges->blocks[0] / ranges->blocks[1]) * SURFACE_BLOCK;
            }
            n++;
        }
        if (!pass && !(points->blocks = malloc((n ? n : 1) * sizeof *points->blocks)))
            return false;
    }
    points->block_count = (uint32_t)n;
    return true;
}

/* Drops empty blocks, and numbers the points of the others. */
static void number_points(struct sp_surface_points *points) {
    uint32_t kept = 0;
    points->count = 0;
    for (uint32_t b = 0; b < points->block_count; b++) {
        struct sp_surface_block *block = &points->blocks[kept];
        if (!points->blocks[b].count)
            continue;
        *block = points->blocks[b];
        block->first = points->count;
        points->count += block->count;
        kept++;
    }
    points->block_count = kept;
}

static bool fail(struct sp_surface_points *points, enum sp_code code, struct sp_error *err) {
    sp_surface_points_finish(points);
    return code == SP_ERR_CANCELLED
               ? sp_fail(err, code, "", "cancelled")
               : sp_fail(err, code, "", "out of memory for the points of a surface");
}

bool sp_surface_extract(struct sp_surface_points *points, const struct sp_surface_job *job,
                        const struct sp_surface_ranges *ranges, uint64_t bytes_max,
                        struct sp_error *err) {
    const struct sp_grid *grid = &sp_volume_info(job->volume)->grid;
    struct extraction e = { .job = job, .points = points };
    *points = (struct sp_surface_points){ 0 };
    sp_surface_points_split(grid, points->split);
    sp_surface_batch_frame_init(&e.frame, points, grid);
    compute_weights(&e, points->split);
    for (unsigned inside = 1; inside < 255; inside++)
        sp_surface_parts_init(inside, &e.parts[inside]);
    if (!list_blocks(points, ranges, job->value))
        return fail(points, SP_ERR_MEMORY, err);
    sp_parallel_for(job->pool, points->block_count, 16, count_blocks, &e);
    if (sp_interrupt_is_cancelled(&job->interrupt))
        return fail(points, SP_ERR_CANCELLED, err);
    number_points(points);
    uint64_t bytes = sp_surface_points_bytes(points);
    if (bytes > bytes_max) {
        sp_surface_points_finish(points);
        return sp_fail(err, SP_ERR_BUDGET, "",
                       "the points of a surface need %llu bytes of the %llu that may be used",
                       (unsigned long long)bytes, (unsigned long long)bytes_max);
    }
    if (!sp_surface_points_allocate(points))
        return fail(points, SP_ERR_MEMORY, err);
    sp_parallel_for(job->pool, points->block_count, 16, fill_blocks, &e);
    if (sp_interrupt_is_cancelled(&job->interrupt))
        return fail(points, SP_ERR_CANCELLED, err);
    return true;
}
