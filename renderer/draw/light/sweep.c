/* SPDX-License-Identifier: Apache-2.0
 *
 * Light slice by slice. Every cell of a slice receives what passed the previous slice one step
 * towards the light. The step is the same for all cells, so that four weights interpolate it:
 *
 *   light ╲   ·───·───·   passed(previous)      arrives = Σ weight·passed(neighbour)
 *          ╲  ╲ ╱
 *           ↘  ·          arrives here          passed = 1 − (1 − arrives·e^−depth)·e^−step/R
 *
 * Ambient light is interpolated at each slice, which spreads each direction to a cone. A light's
 * beams would spread much more than its disc. So they are rays, which go on straight from slice to
 * slice, between the cells: cells read four rays, and rays pass the mean of four cells. Only every
 * few slices rays start again from the cells, which spreads them by about their part of the disc.
 */
#include <math.h>
#include <stdlib.h>

#include "data/volume/grid.h"
#include "draw/light/light.h"
#include "splat/exp2.h"

/* Slices from where the rays of a beam begin to where they start again. */
enum { BEAM_SLICES = 8 };

/* One direction. */
struct ray {
    double move[2];    /* cells from slice to slice, towards the light */
    double between[2]; /* of a ray and the cell of the same number, cells, [0, 1) */
};

struct sweep {
    struct sp_light_slice slice;
    struct sp_light_step steps[LIGHT_DIRECTIONS];
    struct ray rays[LIGHT_DIRECTIONS];
    int axis[3];      /* of rows, of columns, of slices */
    size_t stride[3]; /* of these axes */
    int dims[3];
    const struct sp_light_kernels *kernels;
    struct sp_light_turn turn; /* of slices across the first axis */
};

/* Cells per world unit in a direction, by axis. */
static void convert_direction(const struct sp_light_slot *slot, struct sp_vec3 towards,
                              double cells[3]) {
    const struct sp_grid *grid = &sp_volume_info(slot->base.volume)->grid;
    double volume;
    struct sp_mat3 from = sp_grid_steps(grid, slot->side);
    struct sp_mat3 to = sp_mat3_inverse(&from, &volume);
    struct sp_vec3 d = sp_mat3_apply(&to, towards);
    for (int a = 0; a < 3; a++)
        cells[a] = d.v[a];
}

int sp_sweep_axis(const struct sp_light_slot *slot, struct sp_vec3 towards, bool *rises) {
    double cells[3];
    int best = 2;
    convert_direction(slot, towards, cells);
    for (int a = 2; a >= 0; a--)
        if (fabs(cells[a]) > fabs(cells[best]) * (1 + 1e-9))
            best = a;
    *rises = cells[best] > 0;
    return best;
}

static void init_step(struct sweep *w, int d, const struct sp_light_slot *slot,
                      struct sp_vec3 towards, double fading) {
    double cells[3];
    convert_direction(slot, towards, cells);
    double length = 1 / fabs(cells[w->axis[2]]); /* from slice to slice, world units */
    for (int a = 0; a < 2; a++)
        w->rays[d].move[a] = fmin(fmax(cells[w->axis[a]] * length, -2), 2);
    w->steps[d].depth = (float)(-(double)SP_LOG2E * length / sp_light_cell_width(slot));
    w->steps[d].fading = (float)exp(-length / fading);
}

/* Moves the rays of a direction on to slice `number`. */
static void move_on(struct sweep *w, int d, int number) {
    struct sp_light_step *step = &w->steps[d];
    struct ray *ray = &w->rays[d];
    double weight[2], between[2];
    step->is_spread = w->slice.is_ambient || (number + 2 * d) % BEAM_SLICES == 0;
    for (int a = 0; a < 2; a++) {
        double at = ray->between[a] + ray->move[a];
        step->shift[a] = (int)floor(at);
        weight[a] = at - floor(at);
        between[a] = ray->between[a] = step->is_spread ? 0 : weight[a];
    }
    for (int k = 0; k < 4; k++) {
        step->weight[k] =
            (float)((k & 1 ? weight[0] : 1 - weight[0]) * (k & 2 ? weight[1] : 1 - weight[1]));
        step->between[k] =
            (float)((k & 1 ? between[0] : 1 - between[0]) * (k & 2 ? between[1] : 1 - between[1]));
    }
}

static void pass_rows(void *user, size_t begin, size_t end, unsigned worker) {
    const struct sweep *w = user;
    w->kernels->pass(&w->slice, begin, end, worker);
}

static float *get_memory(struct sp_light_scratch *scratch, size_t count) {
    if (scratch->count < count) {
        free(scratch->floats);
        scratch->floats = malloc(count * sizeof *scratch->floats);
        scratch->count = scratch->floats ? count : 0;
    }
    return scratch->floats;
}

static void turn_rows_in(void *user, size_t begin, size_t end, unsigned worker) {
    const struct sweep *w = user;
    (void)worker;
    for (size_t row = begin; row < end; row++)
        w->kernels->turn_in(&w->turn, row);
}

static void turn_rows_out(void *user, size_t begin, size_t end, unsigned worker) {
    const struct sweep *w = user;
    (void)worker;
    for (size_t row = begin; row < end; row++)
        w->kernels->turn_out(&w->turn, row);
}

/* Begins slice `at` of the volume, the i-th of the sweep, if slices are turned. */
static void turn_to(struct sweep *w, const struct sp_light_slot *slot, struct sp_pool *pool, int i,
                    int at, bool rises) {
    struct sp_light_turn *turn = &w->turn;
    if (i % LIGHT_TURN == 0) {
        int left = w->dims[2] - i, first;
        turn->count = left < LIGHT_TURN ? left : LIGHT_TURN;
        first = rises ? at - turn->count + 1 : at;
        turn->extinction = slot->extinction + first;
        turn->field = slot->field + first;
        turn->moments = slot->moments + first;
        sp_parallel_for(pool, (size_t)w->dims[1], 8, turn_rows_in, w);
    }
    int k = i % LIGHT_TURN;
    size_t offset = (size_t)(rises ? turn->count - 1 - k : k) * turn->slice;
    w->slice.extinction = turn->depth + offset;
    w->slice.staged = turn->words + offset;
}

/* Sets up the slices; returns the floats that they need. */
static size_t init_sweep(struct sweep *w, const struct sp_light_slot *slot,
                         const struct sp_sweep *sweep, const struct sp_light_job *job,
                         bool *rises) {
    struct sp_light_slice *slice = &w->slice;
    const size_t strides[3] = { 1, slot->dims[0], (size_t)slot->dims[0] * slot->dims[1] };
    int axis = sp_sweep_axis(slot, sweep->towards[0], rises);
    *w = (struct sweep){ .axis = { axis == 0 ? 1 : 0, axis == 2 ? 1 : 2, axis },
                         .kernels = job->kernels };
    *slice = (struct sp_light_slice){ .count = sweep->count,
                                      .is_ambient = sweep->is_ambient,
                                      .moment = sweep->moment };
    for (int a = 0; a < 3; a++) {
        w->stride[a] = strides[w->axis[a]];
        w->dims[a] = (int)slot->dims[w->axis[a]];
    }
    for (int a = 0; a < 2; a++)
        slice->dims[a] = w->dims[a];
    slice->stride = w->stride[0] == 1 ? w->stride[1] : (size_t)w->dims[0];
    slice->width = w->dims[0] + 2 * LIGHT_MARGIN + LIGHT_PAD;
    slice->plane = (size_t)slice->width * (size_t)(w->dims[1] + 2 * LIGHT_MARGIN);
    slice->row_floats = (size_t)w->dims[0] + 3 * LIGHT_PAD;
    for (int d = 0; d < sweep->count; d++)
        init_step(w, d, slot, sweep->towards[d], sweep->fading);
    float mean = 0; /* beams are nearly parallel */
    for (int d = 0; d < sweep->count; d++)
        mean += w->steps[d].depth / (float)sweep->count;
    for (int d = 0; d < sweep->count && !sweep->is_ambient; d++)
        w->steps[d].depth = mean;
    w->turn = (struct sp_light_turn){ .row = w->stride[1],
                                      .cell = w->stride[0],
                                      .stride = (size_t)w->dims[0],
                                      .slice = (size_t)w->dims[0] * (size_t)w->dims[1],
                                      .length = w->dims[0],
                                      .is_ambient = sweep->is_ambient };
    slice->staged_next = LIGHT_TURN * w->turn.slice;
    size_t turned = w->stride[0] == 1 ? 0 : (1 + LIGHT_WORDS) * slice->staged_next;
    return 2 * (size_t)slice->count * slice->plane +
           (2 + LIGHT_WORDS) * slice->row_floats * sp_pool_threads(job->pool) + turned;
}

bool sp_sweep_run(const struct sp_light_slot *slot, const struct sp_sweep *sweep,
                  const struct sp_light_job *job, struct sp_light_scratch *scratch,
                  struct sp_error *err) {
    struct sweep w;
    bool rises;
    size_t floats = init_sweep(&w, slot, sweep, job, &rises);
    size_t planes = (size_t)w.slice.count * w.slice.plane;
    float *memory = get_memory(scratch, floats);
    if (!memory)
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the light's slices");
    for (size_t i = 0; i < 2 * planes; i++)
        memory[i] = 1;
    const size_t threads = sp_pool_threads(job->pool);
    w.slice.rows = memory + 2 * planes;
    w.slice.words = (uint32_t *)(w.slice.rows + 2 * w.slice.row_floats * threads);
    w.slice.steps = w.steps;
    bool is_turned = w.stride[0] != 1;
    w.turn.words = w.slice.words + LIGHT_WORDS * w.slice.row_floats * threads;
    w.turn.depth = (float *)(w.turn.words + LIGHT_WORDS * w.slice.staged_next);
    for (int i = 0; i < w.dims[2] && !sp_interrupt_is_cancelled(&job->interrupt); i++) {
        int number = rises ? w.dims[2] - 1 - i : i;
        size_t at = (size_t)number * w.stride[2];
        w.slice.extinction = slot->extinction + at;
        w.slice.field = slot->field + at;
        w.slice.moments = slot->moments + at;
        if (is_turned)
            turn_to(&w, slot, job->pool, i, number, rises);
        w.slice.from = memory + (i & 1 ? planes : 0);
        w.slice.to = memory + (i & 1 ? 0 : planes);
        for (int d = 0; d < w.slice.count; d++)
            move_on(&w, d, i);
        size_t rows = (size_t)w.dims[1] + (sweep->is_ambient ? 0 : 1);
        sp_parallel_for(job->pool, rows, 16, pass_rows, &w);
        if (is_turned && (i % LIGHT_TURN == LIGHT_TURN - 1 || i + 1 == w.dims[2]))
            sp_parallel_for(job->pool, (size_t)w.dims[1], 8, turn_rows_out, &w);
    }
    return !sp_interrupt_is_cancelled(&job->interrupt) ||
           sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
}
