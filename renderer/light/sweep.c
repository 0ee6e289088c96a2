/* SPDX-License-Identifier: Apache-2.0
 *
 * Light slice by slice. Every cell of a slice receives what passed the previous slice one step
 * towards the light. The step is the same for all cells, so that four weights interpolate it:
 *
 *   light ╲   ·───·───·   passed(previous)      arrives = Σ weight·passed(neighbour)
 *          ╲  ╲ ╱
 *           ↘  ·          arrives here          passed = 1 − (1 − arrives·e^−depth)·e^−step/R
 */
#include <math.h>
#include <stdlib.h>

#include "base/wide.h"
#include "light/light.h"
#include "splat/exp2.h"
#include "volume/grid.h"

/* Cells of a plane beyond its ends, which pass all light. A direction moves by at most 2 cells per
 * slice. */
enum { MARGIN = 2 };

/* How one direction crosses the slices. */
struct step {
    float weight[4]; /* of the four neighbours in the previous slice */
    int shift[2];    /* of the first one */
    float depth;     /* −log2 e · reference lengths from slice to slice */
    float fading;    /* e^−step/R */
};

struct sweep {
    const struct sp_light_slot *slot;
    const struct step *steps;
    int count;
    int axis[3];      /* of rows, of columns, of slices */
    size_t stride[3]; /* of these axes */
    int dims[3];
    int width;        /* floats per row of a plane, with margins */
    size_t plane;     /* floats per plane */
    float *passed[2]; /* [count][plane]: the previous slice, and this one */
    int slice;
    sp_sweep_fn *write;
    void *user;
    float *rows; /* per worker: extinction, and the sum of light */
    int row_floats;
};

/* Light that arrives at a row of cells from one direction, and what passes it. Both rows of planes
 * have a margin; lanes beyond the row are computed and ignored. */
static void add_direction(const struct sweep *w, const struct step *s, const float *from, float *to,
                          const float *extinction, float *sum) {
    const sp_wide zero = sp_wide_all(0), one = sp_wide_all(1);
    const float *above = from + s->shift[0] + (ptrdiff_t)s->shift[1] * w->width;
    const float *below = above + w->width;
    for (int i = 0; i < w->dims[0]; i += SP_WIDE) {
        sp_wide light =
            s->weight[0] * sp_wide_load(above + i) + s->weight[1] * sp_wide_load(above + i + 1) +
            s->weight[2] * sp_wide_load(below + i) + s->weight[3] * sp_wide_load(below + i + 1);
        sp_wide depth = sp_wide_load(extinction + i);
        sp_wide_store(sum + i, sp_wide_load(sum + i) + light);
        if (sp_wide_any(sp_wide_lt(zero, depth)))
            light *= sp_wide_exp2(depth * s->depth);
        light = one - (one - light) * s->fading;
        if (i + SP_WIDE <= w->dims[0])
            sp_wide_store(to + i, light);
        else
            for (int k = 0; i + k < w->dims[0]; k++)
                to[i + k] = light[k];
    }
}

static void sweep_rows(void *user, size_t begin, size_t end, unsigned worker) {
    const struct sweep *w = user;
    float *extinction = w->rows + (size_t)worker * 2 * (size_t)w->row_floats;
    float *sum = extinction + w->row_floats;
    for (size_t row = begin; row < end; row++) {
        size_t first = row * w->stride[1] + (size_t)w->slice * w->stride[2];
        for (int i = 0; i < w->dims[0]; i++) {
            extinction[i] = w->slot->extinction[first + (size_t)i * w->stride[0]];
            sum[i] = 0;
        }
        size_t at = (row + MARGIN) * (size_t)w->width + MARGIN;
        for (int d = 0; d < w->count; d++)
            add_direction(w, &w->steps[d], w->passed[0] + (size_t)d * w->plane + at,
                          w->passed[1] + (size_t)d * w->plane + at, extinction, sum);
        w->write(w->user, first, w->stride[0], sum, w->dims[0]);
    }
}

/* Cells per world unit in a direction, by axis. */
static void find_direction(const struct sp_light_slot *slot, struct sp_vec3 towards,
                           double cells[3]) {
    const struct sp_grid *grid = &sp_volume_info(slot->volume)->grid;
    struct sp_mat3 from;
    double volume;
    for (int r = 0; r < 3; r++)
        for (int a = 0; a < 3; a++)
            from.m[r][a] = grid->direction[r][a] * grid->spacing[a] * slot->side;
    struct sp_mat3 to = sp_mat3_inverse(&from, &volume);
    struct sp_vec3 d = sp_mat3_apply(&to, towards);
    for (int a = 0; a < 3; a++)
        cells[a] = d.v[a];
}

int sp_sweep_axis(const struct sp_light_slot *slot, struct sp_vec3 towards, bool *rises) {
    double cells[3];
    int best = 2;
    find_direction(slot, towards, cells);
    for (int a = 2; a >= 0; a--)
        if (fabs(cells[a]) > fabs(cells[best]) * (1 + 1e-9))
            best = a;
    *rises = cells[best] > 0;
    return best;
}

static void init_step(const struct sweep *w, struct sp_vec3 towards, double fading,
                      struct step *step) {
    double cells[3], weight[2];
    find_direction(w->slot, towards, cells);
    double length = 1 / fabs(cells[w->axis[2]]); /* from slice to slice, world units */
    for (int a = 0; a < 2; a++) {
        double move = cells[w->axis[a]] * length, low = floor(move);
        low = fmin(fmax(low, -MARGIN), MARGIN - 1);
        step->shift[a] = (int)low;
        weight[a] = fmin(fmax(move - low, 0), 1);
    }
    for (int k = 0; k < 4; k++)
        step->weight[k] =
            (float)((k & 1 ? weight[0] : 1 - weight[0]) * (k & 2 ? weight[1] : 1 - weight[1]));
    const double most = 1e30; /* so that the product with 0 is 0 */
    double depth = (double)SP_LOG2E * length / w->slot->tf.reference_length;
    step->depth = (float)-fmin(depth, most);
    step->fading = (float)exp(-length / fading);
}

static float *get_memory(struct sp_light_scratch *scratch, size_t count) {
    if (scratch->count < count) {
        free(scratch->floats);
        scratch->floats = malloc(count * sizeof *scratch->floats);
        scratch->count = scratch->floats ? count : 0;
    }
    return scratch->floats;
}

bool sp_sweep_run(const struct sp_light_slot *slot, const struct sp_sweep *sweep,
                  const struct sp_light_job *job, struct sp_light_scratch *scratch,
                  sp_sweep_fn *write, void *user, struct sp_error *err) {
    struct step steps[LIGHT_DIRECTIONS];
    bool rises;
    int axis = sp_sweep_axis(slot, sweep->towards[0], &rises);
    const size_t strides[3] = { 1, slot->dims[0], (size_t)slot->dims[0] * slot->dims[1] };
    struct sweep w = { .slot = slot,
                       .steps = steps,
                       .count = sweep->count,
                       .axis = { axis == 0 ? 1 : 0, axis == 2 ? 1 : 2, axis },
                       .write = write,
                       .user = user };
    for (int a = 0; a < 3; a++) {
        w.stride[a] = strides[w.axis[a]];
        w.dims[a] = (int)slot->dims[w.axis[a]];
    }
    w.width = w.dims[0] + 2 * MARGIN + SP_WIDE;
    w.plane = (size_t)w.width * (size_t)(w.dims[1] + 2 * MARGIN + 1);
    w.row_floats = w.dims[0] + 2 * SP_WIDE;
    for (int d = 0; d < sweep->count; d++)
        init_step(&w, sweep->towards[d], sweep->fading, &steps[d]);
    size_t planes = (size_t)w.count * w.plane;
    size_t rows = 2 * (size_t)w.row_floats * sp_pool_threads(job->pool);
    float *memory = get_memory(scratch, 2 * planes + rows);
    if (!memory)
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the light's slices");
    for (size_t i = 0; i < 2 * planes; i++)
        memory[i] = 1;
    for (size_t i = 2 * planes; i < 2 * planes + rows; i++)
        memory[i] = 0;
    w.rows = memory + 2 * planes;
    for (int i = 0; i < w.dims[2] && !sp_interrupt_is_cancelled(&job->interrupt); i++) {
        w.slice = rises ? w.dims[2] - 1 - i : i;
        w.passed[0] = memory + (i & 1 ? planes : 0);
        w.passed[1] = memory + (i & 1 ? 0 : planes);
        sp_parallel_for(job->pool, (size_t)w.dims[1], 16, sweep_rows, &w);
    }
    return !sp_interrupt_is_cancelled(&job->interrupt) ||
           sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
}
