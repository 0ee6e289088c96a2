/* SPDX-License-Identifier: Apache-2.0 */
#include "classify/depths.h"

#include <stdlib.h>

#include "base/minmax.h"

enum { BRICKS_GRAIN = 64 };

/* Returns the largest opacity of a value among the entries [first, end). */
static float measure_opacity(const struct sp_level *level, uint64_t first, uint64_t end) {
    const struct sp_pieces *pieces = level->transfer.pieces;
    float most = 0;
    for (uint64_t e = first; e < end; e++) {
        float value = sp_transfer_value(&level->transfer, sp_visible_key(&level->visible, e));
        uint32_t s = 0;
        while (s + 1 < pieces->count && value >= pieces->start[s + 1])
            s++;
        most = sp_maxf(most, pieces->at[3][s] + (value - pieces->start[s]) * pieces->slope[3][s]);
    }
    return most < 1 ? most : 1;
}

/* Returns the largest depth of a class among the entries [first, end). */
static float measure_depth(const struct sp_level *level, uint64_t first, uint64_t end) {
    const struct sp_visible *list = &level->visible;
    const struct sp_class *table = level->transfer.table;
    float most = 0;
    if (table && list->key_bytes == 1)
        for (uint64_t e = first; e < end; e++)
            most = sp_maxf(most, table[((const uint8_t *)list->key)[e]].depth);
    else if (table && list->key_bytes == 2)
        for (uint64_t e = first; e < end; e++)
            most = sp_maxf(most, table[((const uint16_t *)list->key)[e]].depth);
    else if (level->transfer.pieces)
        most = -log1pf(-measure_opacity(level, first, end));
    else
        for (uint64_t e = first; e < end; e++)
            most =
                sp_maxf(most, sp_transfer_class(&level->transfer, sp_visible_key(list, e)).depth);
    return most;
}

struct work {
    struct sp_level *level;
    const struct sp_classify_job *job;
    float (*depths)[SP_BRICK];
};

static void measure_depths(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    const struct work *f = user;
    const struct sp_visible *list = &f->level->visible;
    if (sp_classify_cancelled(f->job, NULL))
        return;
    for (size_t b = begin; b < end; b++)
        for (uint32_t k = 0; k < SP_BRICK; k++)
            f->depths[b][k] = measure_depth(f->level, list->first[b] + list->start[b][k],
                                            list->first[b] + list->start[b][k + 1]);
}

bool sp_depths_update(struct sp_level *level, const struct sp_classify_job *job,
                      struct sp_error *err) {
    uint32_t bricks = sp_visible_bricks(&level->visible);
    unsigned axis = bricks ? level->visible.axis[0] : 0;
    if (level->depths[axis])
        return true;
    struct work work = { level, job, malloc((bricks ? bricks : 1) * sizeof *work.depths) };
    if (!work.depths)
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the depths of %u bricks", bricks);
    sp_parallel_for(job->pool, bricks, BRICKS_GRAIN, measure_depths, &work);
    if (sp_classify_cancelled(job, err)) {
        free(work.depths);
        return false;
    }
    level->depths[axis] = work.depths;
    return true;
}
