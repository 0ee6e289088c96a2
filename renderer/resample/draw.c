/* SPDX-License-Identifier: Apache-2.0 */
#include <string.h>

#include "resample/prepare.h"

static bool fail_memory(const struct sp_arena *arena, struct sp_error *err) {
    return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the frame's %s",
                   arena->failed ? arena->failed : "data");
}

static bool allocate(struct sp_resample *r, struct sp_resample_scratch **scratch, unsigned workers,
                     struct sp_arena *arena) {
    const uint32_t *dims = r->samples->dims, *regions = r->samples->regions;
    /* Cells at both ends; refined samples of one sheet at most; what vectors read beyond. */
    enum { MARGIN = 64, MOST = 1 << 19, BEYOND = 4096, CELL_MIN = 4 * 8 * 8 };
    size_t largest = 0, intervals = 0;
    for (int a = 0; a < 3; a++) {
        size_t across = dims[a == 0 ? 1 : 0], down = dims[a == 2 ? 1 : 2];
        size_t samples = (2 * across + 2 * MARGIN) * (2 * down + 2 * MARGIN);
        largest = samples > largest ? samples : largest;
        size_t length = (size_t)regions[a] * SAMPLES_REGION;
        intervals = length > intervals ? length : intervals;
    }
    r->refined_max = largest < MOST ? largest : MOST;
    *scratch = sp_arena_alloc(arena, "tiles", workers, sizeof **scratch);
    for (unsigned w = 0; *scratch && w < workers; w++) {
        struct sp_resample_scratch *s = &(*scratch)[w];
        memset(s, 0, sizeof *s);
        s->is_refined = sp_arena_alloc(arena, "cells", r->refined_max / CELL_MIN + 1, 1);
        s->active = sp_arena_alloc(arena, "intervals", intervals, sizeof *s->active);
        for (int i = 0; i < RESAMPLE_SHEETS; i++)
            s->sheets[i].refined =
                sp_arena_alloc(arena, "refined slices", r->refined_max + BEYOND, sizeof(int16_t));
    }
    return !arena->failed;
}

struct tiles {
    const struct sp_resample *r;
    struct sp_resample_scratch *scratch;
    sp_resample_tile_fn *draw;
};

static void draw_tiles(void *user, size_t begin, size_t end, unsigned worker) {
    struct tiles *tiles = user;
    for (size_t i = begin; i < end; i++) {
        if (sp_interrupt_is_cancelled(&tiles->r->interrupt))
            return;
        tiles->draw(tiles->r, &tiles->scratch[worker], (uint32_t)i);
    }
}

static bool draw(const struct sp_resample_input *input, struct sp_resample *r,
                 struct sp_error *err) {
    unsigned workers = sp_pool_threads(input->pool);
    struct sp_frame_stats *stats = &input->frame->stats;
    struct tiles tiles = { r, NULL, input->draw_tile };
    if (!allocate(r, &tiles.scratch, workers, input->arena))
        return fail_memory(input->arena, err);
    sp_parallel_for(input->pool, (size_t)(r->columns * r->rows), 1, draw_tiles, &tiles);
    if (sp_interrupt_is_cancelled(&input->interrupt))
        return sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
    for (unsigned w = 0; w < workers; w++) {
        if (tiles.scratch[w].is_too_wide)
            return sp_fail(err, SP_ERR_BUDGET, "/quality/level_of_detail",
                           "the volume is too small in the image for its samples: set "
                           "quality.level_of_detail to \"auto\", or come nearer");
        stats->splats += tiles.scratch[w].refined;
        stats->fragments += tiles.scratch[w].sampled;
    }
    return true;
}

bool sp_resample_draw(const struct sp_resample_input *input, struct sp_error *err) {
    struct sp_frame_stats *stats = &input->frame->stats;
    double clock = sp_interrupt_clock_ms(&input->interrupt);
    struct sp_resample r;
    if (!sp_resample_prepare(input, &r, err))
        return false;
    double prepared = sp_interrupt_clock_ms(&input->interrupt);
    if (!draw(input, &r, err))
        return false;
    stats->stage_count = 2;
    stats->stages[0] = (struct sp_stage_time){ "classify", prepared - clock };
    stats->stages[1] =
        (struct sp_stage_time){ "tile", sp_interrupt_clock_ms(&input->interrupt) - prepared };
    return true;
}
