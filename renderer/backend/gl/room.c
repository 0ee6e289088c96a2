/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/room.h"

#include "backend/gl/program.h"
#include "classify/visible.h"

enum {
    LAYERS_MOST = 1 << 14, /* of a batch: a span has 14 bits for one */
    HALVINGS_MOST = 6,
    SPAN_ROUNDS = 3,   /* of a splat in one layer of one tile */
    ORDER_ROUNDS = 24, /* for a pair while its bin is put in order */
    SHORT = 5          /* of what is long: doubled, it is not long yet */
};

static uint32_t most(uint32_t a, uint32_t b) {
    return a > b ? a : b;
}

struct gl_limits gl_room_limits(const struct gl_room *room) {
    struct gl_limits limits = room->limits;
    limits.records = most(limits.records >> room->halvings, SP_BRICK_VOXELS);
    limits.record_bytes >>= room->halvings;
    limits.bins = most(limits.bins >> room->halvings, 1);
    limits.tiles = most(limits.tiles >> room->halvings, 1);
    limits.loops = most(limits.loops >> room->halvings, 1);
    limits.pairs = limits.pairs >> room->halvings > 1 ? limits.pairs >> room->halvings : 1;
    return limits;
}

static uint32_t records_of(const struct gl_room *room, const struct gl_costs *costs) {
    const struct gl_limits limits = gl_room_limits(room);
    uint64_t records = room->records < limits.records ? room->records : limits.records;
    uint64_t fit = limits.record_bytes / (costs->record_bytes + GL_SPAN_BYTES);
    uint64_t block = costs->block_bytes ? costs->block_bytes / costs->record_bytes : records;
    records = records < fit ? records : fit;
    return most((uint32_t)(records < block ? records : block), SP_BRICK_VOXELS);
}

/* The crowd of a single brick is put in order however long that takes: no batch is smaller. */
static uint32_t bin_pairs_of(const struct gl_room *room, uint32_t records) {
    const struct gl_limits limits = gl_room_limits(room);
    return records > SP_BRICK_VOXELS ? limits.loops / (ORDER_ROUNDS * limits.dear)
                                     : room->limits.loops / ORDER_ROUNDS;
}

struct gl_pieces gl_room_plan(const struct gl_room *room, const struct gl_costs *costs) {
    const struct gl_limits limits = gl_room_limits(room);
    uint32_t records = records_of(room, costs);
    uint32_t rounds = costs->pair_rounds + costs->pair_loads * limits.dear;
    return (struct gl_pieces){ .records = records,
                               .pairs = room->pairs,
                               .turn_pairs = most(limits.loops / rounds, 1),
                               .turns = room->turns,
                               .bin_pairs = most(bin_pairs_of(room, records), 1),
                               /* Each is an atomic addition; a row of tiles is the least. */
                               .splat_rounds =
                                   most(limits.loops / limits.dear, SPAN_ROUNDS * costs->columns),
                               .halvings = room->halvings };
}

bool gl_room_halve(struct gl_room *room) {
    if (room->halvings == HALVINGS_MOST)
        return false;
    room->halvings++;
    room->calm = 0;
    uint64_t pairs = gl_room_limits(room).pairs;
    room->pairs = room->pairs < pairs ? room->pairs : pairs;
    return true;
}

void gl_room_pace(struct gl_room *room, const struct gl_pieces *was, double longest_ms) {
    if (longest_ms > room->limits.dispatch_ms) {
        room->calm = 0;
        if (was->halvings == room->halvings) /* else that was answered already */
            gl_room_halve(room);
        return;
    }
    room->calm = longest_ms < room->limits.dispatch_ms / SHORT ? room->calm + 1 : 0;
    if (room->calm < GL_CALM)
        return;
    room->calm = 0;
    room->halvings -= room->halvings > 0;
}

void gl_room_init(struct gl_room *room) {
    const struct gl_limits *limits = &room->limits;
    room->pairs = limits->pairs < GL_PAIRS_MIN ? limits->pairs : GL_PAIRS_MIN;
    room->records = limits->records;
    room->layers = LAYERS_MOST;
    room->rows = limits->tiles;
    room->turns = 1;
    room->halvings = room->calm = 0;
}

static bool has_turns(const struct gl_pieces *was, const struct gl_bins_head *head) {
    return head->longest <= (uint64_t)was->turn_pairs * was->turns;
}

bool gl_room_is_enough(const struct gl_pieces *was, const struct gl_bins_head *head) {
    return head->needed <= was->pairs && head->crowded <= was->bin_pairs &&
           head->widest <= was->splat_rounds && has_turns(was, head);
}

/* What has to shrink by this factor, < 1, so that something fits. */
static uint32_t shrink(uint32_t size, double factor) {
    uint32_t less = (uint32_t)(0.9 * factor * size);
    return less > 1 ? less : 1;
}

static bool fail_pairs(const struct gl_room *room, const struct gl_bins_head *head,
                       struct sp_error *err) {
    return sp_fail(err, SP_ERR_BUDGET, "",
                   "a row of tiles has %lu pairs of splats and tiles in one slice, and there is "
                   "room for %llu: use a smaller kernel or picture",
                   (unsigned long)head->needed, (unsigned long long)room->limits.pairs);
}

static bool fail_order(const struct gl_pieces *was, const struct gl_bins_head *head,
                       struct sp_error *err) {
    return sp_fail(err, SP_ERR_BUDGET, "",
                   "%lu splats at one distance lie over the same %d px, and the GPU puts %lu in "
                   "order: use a larger picture, or let the level of detail be chosen",
                   (unsigned long)head->crowded, (int)GL_TILE, (unsigned long)was->bin_pairs);
}

static void shrink_records(struct gl_room *room, const struct gl_pieces *was, double factor) {
    uint32_t less = shrink(was->records, factor);
    room->records = less > SP_BRICK_VOXELS ? less : SP_BRICK_VOXELS;
}

static void grow_pairs(struct gl_room *room, const struct gl_bins_head *head, uint64_t limit) {
    uint64_t more = (uint64_t)head->needed + head->needed / 4;
    room->pairs = more > limit ? limit : more > room->pairs ? more : room->pairs;
}

static bool make_room_for_pairs(struct gl_room *room, const struct gl_pieces *was,
                                const struct gl_bins_head *head, struct sp_error *err) {
    uint64_t wanted = gl_room_limits(room).pairs;
    double factor = (double)wanted / head->needed;
    if (head->needed <= wanted)
        grow_pairs(room, head, wanted);
    else if (was->layers > 1)
        room->layers = shrink(was->layers, factor);
    else if (was->records > SP_BRICK_VOXELS)
        shrink_records(room, was, factor);
    else if (was->rows > 1)
        room->rows = shrink(was->rows, factor);
    else if (head->needed <= room->limits.pairs) /* a long dispatch is better than no picture */
        grow_pairs(room, head, room->limits.pairs);
    else
        return fail_pairs(room, head, err);
    return true;
}

/* A row of tiles in one layer has the rounds that a splat is allowed at least. */
static void make_narrower(struct gl_room *room, const struct gl_pieces *was,
                          const struct gl_bins_head *head) {
    double factor = (double)was->splat_rounds / head->widest;
    if (was->rows > 1)
        room->rows = shrink(was->rows, factor);
    else
        room->layers = shrink(was->layers, factor);
}

bool gl_room_make(struct gl_room *room, const struct gl_pieces *was,
                  const struct gl_bins_head *head, struct sp_error *err) {
    if (head->needed > was->pairs && !make_room_for_pairs(room, was, head, err))
        return false;
    if (head->widest > was->splat_rounds)
        make_narrower(room, was, head);
    if (head->crowded > was->bin_pairs) {
        if (was->records <= SP_BRICK_VOXELS)
            return fail_order(was, head, err);
        shrink_records(room, was, (double)was->bin_pairs / head->crowded);
    }
    if (!has_turns(was, head)) {
        uint32_t turns = gl_divide_up(head->longest, was->turn_pairs);
        turns += turns / 4;
        room->turns = turns > room->turns ? turns : room->turns;
    }
    return true;
}

void gl_room_grow(struct gl_room *room, const struct gl_pieces *was,
                  const struct gl_bins_head *head) {
    const struct gl_limits *limits = &room->limits;
    if (head->longest <= (uint64_t)was->turn_pairs * was->turns / 4 && room->turns > 1)
        room->turns -= room->turns / 2;
    if (head->needed > gl_room_limits(room).pairs / 4 || head->crowded > was->bin_pairs / 4 ||
        head->widest > was->splat_rounds / 4)
        return;
    room->layers = room->layers < LAYERS_MOST / 2 ? 2 * room->layers : LAYERS_MOST;
    room->records = room->records < limits->records / 2 ? 2 * room->records : limits->records;
    room->rows = room->rows < limits->tiles / 2 ? 2 * room->rows : limits->tiles;
}
