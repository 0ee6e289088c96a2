/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/surface/extract.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "draw/layers/surface/batch.h"
#include "draw/layers/surface/samples.h"

/* The weights of a cube's corners k at the corners c of its parts. */
typedef float part_weights[8][8];

struct extraction {
    const struct sp_surface_job *job;
    const struct sp_surface_focus *focus; /* NULL: all parts have the same size */
    struct sp_surface_points *points;
    struct sp_surface_batch_frame frame;
    struct sp_surface_parts parts[256]; /* by the inside corners of a cell; 0 and 255: none */
    part_weights weights[SURFACE_SPLIT_MAX * SURFACE_SPLIT_MAX * SURFACE_SPLIT_MAX];
    part_weights halves[8]; /* of the eight parts with half the edges */
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

static void compute_weights(part_weights *weights, const uint8_t split[3]) {
    for (int p = 0; p < split[0] * split[1] * split[2]; p++)
        for (int k = 0; k < 8; k++)
            for (int c = 0; c < 8; c++) {
                const int i[3] = { p % split[0], p / split[0] % split[1], p / split[0] / split[1] };
                weights[p][k][c] = 1;
                for (int a = 0; a < 3; a++) {
                    float share = (float)(i[a] + (c >> a & 1)) / (float)split[a];
                    weights[p][k][c] *= k >> a & 1 ? share : 1 - share;
                }
            }
}

static void compute_corners(const part_weights weights, const float f[8], float own[8]) {
    for (int c = 0; c < 8; c++)
        own[c] = 0;
    for (int k = 0; k < 8; k++)
        for (int c = 0; c < 8; c++)
            own[c] += weights[k][c] * f[k];
}

/* A cell that is being split. */
struct split {
    const struct extraction *e;
    int cell[3];
    struct sp_surface_frame_cell frame; /* set if there is a focus */
    struct sp_surface_batch *batch;     /* NULL = pieces are only counted */
    uint32_t count;
};

/* True if a cube that starts at `start` and has edges of `size` [parts] is larger than its discs.
 */
static bool is_too_large(const struct split *s, const float start[3], float size) {
    const float *share = s->e->frame.share;
    float from[3], edges[3], sizes[2];
    for (int a = 0; a < 3; a++) {
        from[a] = start[a] * share[a];
        edges[a] = size * share[a];
    }
    sp_surface_focus_sizes(s->e->focus, &s->frame, from, edges, sizes);
    return size > SURFACE_SIZE_MIN && sizes[0] < 1 && size > sizes[0] * s->e->focus->coarse;
}

/* Adds the pieces in a cube whose corners have the values f, halved as often as it is necessary. */
static void add_cube(struct split *s, const float f[8], const float start[3], float size) {
    unsigned inside = 0;
    for (int c = 0; c < 8; c++)
        inside |= (unsigned)(f[c] >= 0) << c;
    if (inside == 0 || inside == 255)
        return;
    if (s->e->focus && is_too_large(s, start, size)) {
        const float half = size / 2;
        for (int i = 0; i < 8; i++) {
            const float from[3] = { start[0] + (float)(i & 1) * half,
                                    start[1] + (float)(i >> 1 & 1) * half,
                                    start[2] + (float)(i >> 2) * half };
            float own[8];
            compute_corners(s->e->halves[i], f, own);
            add_cube(s, own, from, half);
        }
        return;
    }
    s->count += s->e->parts[inside].count;
    if (s->batch)
        sp_surface_batch_add(s->batch, f, &s->e->parts[inside], s->cell, start, size);
}

/* Visits the parts that a cell of the block at `corner` is split into. batch: NULL = pieces are
 * only counted. Returns their number. */
static uint32_t split_cell(const struct extraction *e, const struct sp_surface_samples *samples,
                           const uint32_t corner[3], const int cell[3],
                           struct sp_surface_batch *batch) {
    const uint8_t *split = e->points->split;
    const int parts = split[0] * split[1] * split[2];
    struct split s = { .e = e, .cell = { cell[0], cell[1], cell[2] }, .batch = batch };
    float f[8];
    if (e->focus) {
        const uint32_t at[3] = { corner[0] + (uint32_t)cell[0], corner[1] + (uint32_t)cell[1],
                                 corner[2] + (uint32_t)cell[2] };
        sp_surface_focus_place(e->focus, at, 1, &s.frame);
    }
    read_corners(samples, cell[0], cell[1], cell[2], f);
    for (int p = 0; p < parts; p++) {
        const float start[3] = { (float)(p % split[0]), (float)(p / split[0] % split[1]),
                                 (float)(p / split[0] / split[1]) };
        float own[8];
        compute_corners(e->weights[p], f, own);
        add_cube(&s, own, start, 1);
    }
    return s.count;
}

static bool splits_cells(const struct extraction *e) {
    const uint8_t *split = e->points->split;
    return e->focus || split[0] * split[1] * split[2] > 1;
}

/* Counts the points of the blocks. */
static void count_blocks(void *user, size_t begin, size_t end, unsigned worker) {
    const struct extraction *e = user;
    const bool is_split = splits_cells(e);
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
                    block->count += is_split ? split_cell(e, &samples, block->corner, cell, NULL)
                                             : e->parts[inside_corners(&row, cell[0])].count;
                }
            }
    }
}

static void fill_block(const struct extraction *e, struct sp_surface_batch *batch) {
    const bool is_split = splits_cells(e);
    const float whole[3] = { 0 };
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
                const int cell[3] = { __builtin_ctz(left), y, z };
                float f[8];
                if (is_split) {
                    split_cell(e, &samples, batch->block->corner, cell, batch);
                    continue;
                }
                read_corners(&samples, cell[0], y, z, f);
                sp_surface_batch_add(batch, f, &e->parts[inside_corners(&row, cell[0])], cell,
                                     whole, 1);
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

/* points: the extraction's, with `split` set. */
static void begin(struct extraction *e) {
    const struct sp_grid *grid = &sp_volume_info(e->job->volume)->grid;
    sp_surface_batch_frame_init(&e->frame, e->points, grid);
    compute_weights(e->weights, e->points->split);
    compute_weights(e->halves, (uint8_t[]){ 2, 2, 2 });
    for (unsigned inside = 1; inside < 255; inside++)
        sp_surface_parts_init(inside, &e->parts[inside]);
}

bool sp_surface_extract(struct sp_surface_points *points, const struct sp_surface_job *job,
                        const struct sp_surface_ranges *ranges, uint64_t bytes_max,
                        struct sp_error *err) {
    struct extraction e = { .job = job, .points = points };
    *points = (struct sp_surface_points){ 0 };
    sp_surface_points_split(&sp_volume_info(job->volume)->grid, points->split);
    begin(&e);
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

/* Lists the blocks of `far` that are close to the eye. */
static bool list_near(struct sp_surface_points *points, const struct sp_surface_focus *focus,
                      const struct sp_surface_points *far, struct sp_arena *arena) {
    const uint32_t *dims = focus->frame->grid->dims, first[3] = { 0 };
    const float start[3] = { 0 }, whole[3] = { 1, 1, 1 };
    struct sp_surface_frame_cell volume;
    float sizes[2];
    uint32_t n = 0, most = dims[0] > dims[1] ? dims[0] : dims[1];
    sp_surface_focus_place(focus, first, most > dims[2] ? most : dims[2], &volume);
    sp_surface_focus_sizes(focus, &volume, start, whole, sizes);
    if (sizes[0] >= 1) /* the eye is far away, as for most frames */
        return true;
    for (uint32_t b = 0; b < far->block_count; b++)
        n += sp_surface_focus_has(focus, far->blocks[b].corner);
    points->blocks = sp_arena_alloc(arena, "near blocks", n ? n : 1, sizeof *points->blocks);
    if (!points->blocks)
        return false;
    for (uint32_t b = 0; b < far->block_count; b++)
        if (sp_surface_focus_has(focus, far->blocks[b].corner)) {
            struct sp_surface_block *block = &points->blocks[points->block_count++];
            *block = (struct sp_surface_block){ 0 };
            memcpy(block->corner, far->blocks[b].corner, sizeof block->corner);
        }
    return true;
}

bool sp_surface_extract_near(const struct sp_surface_job *job, const struct sp_surface_focus *focus,
                             const struct sp_surface_points *far, struct sp_arena *arena,
                             struct sp_surface_points *points, struct sp_error *err) {
    struct extraction e = { .job = job, .focus = focus, .points = points };
    *points = (struct sp_surface_points){ 0 };
    memcpy(points->split, far->split, sizeof points->split);
    if (!list_near(points, focus, far, arena))
        return sp_arena_fail(arena, "near points", err);
    if (!points->block_count)
        return true;
    begin(&e);
    sp_parallel_for(job->pool, points->block_count, 1, count_blocks, &e);
    number_points(points);
    uint16_t *memory =
        sp_arena_alloc(arena, "near points", sp_surface_points_words(points), sizeof *memory);
    if (!memory)
        return sp_arena_fail(arena, "near points", err);
    sp_surface_points_lay_out(points, memory);
    sp_parallel_for(job->pool, points->block_count, 1, fill_blocks, &e);
    return !sp_interrupt_is_cancelled(&job->interrupt) ||
           sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
}
