/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/room.h"

#include "backend/gl/program.h"
#include "classify/visible.h"

enum { LAYERS_MOST = 1 << 14 }; /* of a batch: a span has 14 bits for one */

void gl_room_init(struct gl_room *room) {
    const struct gl_limits *limits = &room->limits;
    room->pairs = limits->pairs < GL_PAIRS_MIN ? limits->pairs : GL_PAIRS_MIN;
    room->records = limits->records;
    room->layers = LAYERS_MOST;
    room->rows = limits->tiles;
    room->turns = 1;
}

static bool has_turns(const struct gl_pieces *was, const struct gl_bins_head *head) {
    return head->longest <= (uint64_t)was->turn_pairs * was->turns;
}

bool gl_room_is_enough(const struct gl_pieces *was, const struct gl_bins_head *head) {
    return head->needed <= was->pairs && head->crowded <= was->bin_pairs && has_turns(was, head);
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

static bool make_room_for_pairs(struct gl_room *room, const struct gl_pieces *was,
                                const struct gl_bins_head *head, struct sp_error *err) {
    uint64_t most = room->limits.pairs, more = (uint64_t)head->needed + head->needed / 4;
    double factor = (double)most / head->needed;
    if (head->needed <= most)
        room->pairs = more > most ? most : more > room->pairs ? more : room->pairs;
    else if (was->layers > 1)
        room->layers = shrink(was->layers, factor);
    else if (was->records > SP_BRICK_VOXELS)
        shrink_records(room, was, factor);
    else if (was->rows > 1)
        room->rows = shrink(was->rows, factor);
    else
        return fail_pairs(room, head, err);
    return true;
}

bool gl_room_make(struct gl_room *room, const struct gl_pieces *was,
                  const struct gl_bins_head *head, struct sp_error *err) {
    if (head->needed > was->pairs && !make_room_for_pairs(room, was, head, err))
        return false;
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
    if (head->needed > limits->pairs / 4 || head->crowded > was->bin_pairs / 4)
        return;
    room->layers = room->layers < LAYERS_MOST / 2 ? 2 * room->layers : LAYERS_MOST;
    room->records = room->records < limits->records / 2 ? 2 * room->records : limits->records;
    room->rows = room->rows < limits->tiles / 2 ? 2 * room->rows : limits->tiles;
}
