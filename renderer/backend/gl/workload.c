/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/workload.h"

#include "backend/gl/program.h"
#include "base/minmax.h"
#include "classify/visible.h"

enum {
    LAYERS_MAX = 1 << 14, /* per batch: a span has 14 bits for a layer */
    HALVINGS_MAX = 6,
    SPAN_ROUNDS = 3,   /* loop rounds of a splat in one layer of one tile */
    ORDER_ROUNDS = 24, /* loop rounds per pair while its bin is sorted */
    SHORT = 5          /* short: below 1/5 of the limit, so that twice as much is not long */
};

struct gl_limits gl_workload_limits(const struct gl_workload *workload) {
    struct gl_limits limits = workload->limits;
    limits.records = sp_maxu(limits.records >> workload->halvings, SP_BRICK_VOXELS);
    limits.record_bytes >>= workload->halvings;
    limits.bins = sp_maxu(limits.bins >> workload->halvings, 1);
    limits.tiles = sp_maxu(limits.tiles >> workload->halvings, 1);
    limits.loops = sp_maxu(limits.loops >> workload->halvings, 1);
    limits.pairs = limits.pairs >> workload->halvings > 1 ? limits.pairs >> workload->halvings : 1;
    return limits;
}

static uint32_t records_of(const struct gl_workload *workload, const struct gl_costs *costs) {
    const struct gl_limits limits = gl_workload_limits(workload);
    uint64_t records = workload->records < limits.records ? workload->records : limits.records;
    uint64_t fit = limits.record_bytes / (costs->record_bytes + GL_SPAN_BYTES);
    uint64_t block = costs->block_bytes ? costs->block_bytes / costs->record_bytes : records;
    records = records < fit ? records : fit;
    return sp_maxu((uint32_t)(records < block ? records : block), SP_BRICK_VOXELS);
}

/* A bin of a single brick is sorted however long that takes, because no batch is smaller. */
static uint32_t bin_pairs_of(const struct gl_workload *workload, uint32_t records) {
    const struct gl_limits limits = gl_workload_limits(workload);
    return records > SP_BRICK_VOXELS ? limits.loops / (ORDER_ROUNDS * limits.stall_factor)
                                     : workload->limits.loops / ORDER_ROUNDS;
}

struct gl_pieces gl_workload_plan(const struct gl_workload *workload,
                                  const struct gl_costs *costs) {
    const struct gl_limits limits = gl_workload_limits(workload);
    uint32_t records = records_of(workload, costs);
    uint32_t rounds = costs->pair_rounds + costs->pair_loads * limits.stall_factor;
    return (struct gl_pieces){
        .records = records,
        .pairs = workload->pairs,
        .pass_pairs = sp_maxu(limits.loops / sp_maxu(rounds, 1), 1),
        .passes = workload->passes,
        .element_pairs = sp_maxu(limits.loops / sp_maxu(costs->element_rounds, 1), 1),
        .element_passes = workload->element_passes,
        .bin_pairs = sp_maxu(bin_pairs_of(workload, records), 1),
        /* Each round is an atomic addition; one row of tiles is the minimum. */
        .splat_rounds = sp_maxu(limits.loops / limits.stall_factor, SPAN_ROUNDS * costs->columns),
        .halvings = workload->halvings
    };
}

bool gl_workload_halve(struct gl_workload *workload) {
    if (workload->halvings == HALVINGS_MAX)
        return false;
    workload->halvings++;
    workload->short_bands = 0;
    uint64_t pairs = gl_workload_limits(workload).pairs;
    workload->pairs = workload->pairs < pairs ? workload->pairs : pairs;
    return true;
}

void gl_workload_adapt(struct gl_workload *workload, const struct gl_pieces *was,
                       double longest_ms) {
    if (longest_ms > workload->limits.dispatch_ms) {
        workload->short_bands = 0;
        if (was->halvings == workload->halvings) /* otherwise the sizes have changed since then */
            gl_workload_halve(workload);
        return;
    }
    workload->short_bands =
        longest_ms < workload->limits.dispatch_ms / SHORT ? workload->short_bands + 1 : 0;
    if (workload->short_bands < GL_SHORT_BANDS)
        return;
    workload->short_bands = 0;
    workload->halvings -= workload->halvings > 0;
}

void gl_workload_init(struct gl_workload *workload) {
    const struct gl_limits *limits = &workload->limits;
    workload->pairs = limits->pairs < GL_PAIRS_MIN ? limits->pairs : GL_PAIRS_MIN;
    workload->records = limits->records;
    workload->layers = LAYERS_MAX;
    workload->rows = limits->tiles;
    workload->passes = workload->element_passes = 1;
    workload->halvings = workload->short_bands = 0;
}

static bool has_passes(const struct gl_pieces *was, const struct gl_bins_head *head) {
    return head->longest <= (uint64_t)was->pass_pairs * was->passes &&
           head->longest_elements <= (uint64_t)was->element_pairs * was->element_passes;
}

bool gl_workload_fits(const struct gl_pieces *was, const struct gl_bins_head *head) {
    return head->needed <= was->pairs && head->crowded <= was->bin_pairs &&
           head->widest <= was->splat_rounds && has_passes(was, head);
}

/* Shrinks a size by this factor, < 1, with some margin. */
static uint32_t scaled_size(uint32_t size, double factor) {
    uint32_t less = (uint32_t)(0.9 * factor * size);
    return less > 1 ? less : 1;
}

static bool fail_pairs(const struct gl_workload *workload, const struct gl_bins_head *head,
                       struct sp_error *err) {
    return sp_fail(err, SP_ERR_BUDGET, "",
                   "the splats of one slice cover %lu tiles in one row, and the limit is %llu; "
                   "reduce filter.sigma, filter.cutoff or size",
                   (unsigned long)head->needed, (unsigned long long)workload->limits.pairs);
}

static bool fail_order(const struct gl_pieces *was, const struct gl_bins_head *head,
                       struct sp_error *err) {
    return sp_fail(
        err, SP_ERR_BUDGET, "",
        "%lu splats at one distance cover the same %d px, and the GPU sorts at most %lu: "
        "use a larger image, or let the level of detail be chosen",
        (unsigned long)head->crowded, (int)GL_TILE, (unsigned long)was->bin_pairs);
}

static void shrink_records(struct gl_workload *workload, const struct gl_pieces *was,
                           double factor) {
    uint32_t less = scaled_size(was->records, factor);
    workload->records = less > SP_BRICK_VOXELS ? less : SP_BRICK_VOXELS;
}

static void grow_pairs(struct gl_workload *workload, const struct gl_bins_head *head,
                       uint64_t limit) {
    uint64_t more = (uint64_t)head->needed + head->needed / 4;
    workload->pairs = more > limit ? limit : more > workload->pairs ? more : workload->pairs;
}

static bool make_room_for_pairs(struct gl_workload *workload, const struct gl_pieces *was,
                                const struct gl_bins_head *head, struct sp_error *err) {
    uint64_t wanted = gl_workload_limits(workload).pairs;
    double factor = (double)wanted / head->needed;
    if (head->needed <= wanted)
        grow_pairs(workload, head, wanted);
    else if (was->layers > 1)
        workload->layers = scaled_size(was->layers, factor);
    else if (was->records > SP_BRICK_VOXELS)
        shrink_records(workload, was, factor);
    else if (was->rows > 1)
        workload->rows = scaled_size(was->rows, factor);
    else if (head->needed <= workload->limits.pairs) /* a long dispatch is better than no image */
        grow_pairs(workload, head, workload->limits.pairs);
    else
        return fail_pairs(workload, head, err);
    return true;
}

/* One row of tiles in one layer never exceeds the rounds of a splat. */
static void make_narrower(struct gl_workload *workload, const struct gl_pieces *was,
                          const struct gl_bins_head *head) {
    double factor = (double)was->splat_rounds / head->widest;
    if (was->rows > 1)
        workload->rows = scaled_size(was->rows, factor);
    else
        workload->layers = scaled_size(was->layers, factor);
}

/* Allows as many pairs of a tile, with some margin. */
static void raise_passes(uint32_t *passes, uint32_t longest, uint32_t pass_pairs) {
    uint32_t needed = gl_divide_up(longest, pass_pairs);
    if (needed > *passes)
        *passes = needed + needed / 4;
}

static void lower_passes(uint32_t *passes, uint32_t longest, uint32_t pass_pairs) {
    if (longest <= (uint64_t)pass_pairs * *passes / 4)
        *passes -= *passes / 2;
}

bool gl_workload_retry(struct gl_workload *workload, const struct gl_pieces *was,
                       const struct gl_bins_head *head, struct sp_error *err) {
    if (head->needed > was->pairs && !make_room_for_pairs(workload, was, head, err))
        return false;
    if (head->widest > was->splat_rounds)
        make_narrower(workload, was, head);
    if (head->crowded > was->bin_pairs) {
        if (was->records <= SP_BRICK_VOXELS)
            return fail_order(was, head, err);
        shrink_records(workload, was, (double)was->bin_pairs / head->crowded);
    }
    if (!has_passes(was, head)) {
        raise_passes(&workload->passes, head->longest, was->pass_pairs);
        raise_passes(&workload->element_passes, head->longest_elements, was->element_pairs);
    }
    return true;
}

void gl_workload_grow(struct gl_workload *workload, const struct gl_pieces *was,
                      const struct gl_bins_head *head) {
    const struct gl_limits *limits = &workload->limits;
    lower_passes(&workload->passes, head->longest, was->pass_pairs);
    lower_passes(&workload->element_passes, head->longest_elements, was->element_pairs);
    if (head->needed > gl_workload_limits(workload).pairs / 4 ||
        head->crowded > was->bin_pairs / 4 || head->widest > was->splat_rounds / 4)
        return;
    workload->layers = workload->layers < LAYERS_MAX / 2 ? 2 * workload->layers : LAYERS_MAX;
    workload->records =
        workload->records < limits->records / 2 ? 2 * workload->records : limits->records;
    workload->rows = workload->rows < limits->tiles / 2 ? 2 * workload->rows : limits->tiles;
}
