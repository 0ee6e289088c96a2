/* SPDX-License-Identifier: Apache-2.0 */
#include <string.h>

#include "draw/resample/axes.h"
#include "draw/resample/prepare.h"

/* Allocates the memory of the workers for a channel. */
static bool allocate(struct sp_resample *r, struct sp_resample_scratch **scratch, unsigned workers,
                     struct sp_arena *arena) {
    const uint32_t *dims = r->samples->dims, *regions = r->samples->regions;
    /* Refined samples of one sheet at most; what vectors read beyond. */
    enum { MOST = 1 << 19, BEYOND = 4096 };
    size_t largest = 0, slabs = 0;
    for (int a = 0; a < 3; a++) {
        size_t across = dims[a == 0 ? 1 : 0], down = dims[a == 2 ? 1 : 2];
        size_t units = 2 * RESAMPLE_SLACK + across / 8; /* the columns of units that are cut */
        size_t samples = 2 * (across + units) * 2 * (down + RESAMPLE_SLACK);
        largest = samples > largest ? samples : largest;
        slabs = regions[a] > slabs ? regions[a] : slabs;
    }
    r->refined_max = largest < MOST ? largest : MOST;
    *scratch = sp_arena_alloc(arena, "tiles", workers, sizeof **scratch);
    for (unsigned w = 0; *scratch && w < workers; w++) {
        struct sp_resample_scratch *s = &(*scratch)[w];
        const size_t rows = r->refined_max / (4 * RESAMPLE_SLACK);
        memset(s, 0, sizeof *s);
        s->active = sp_arena_alloc(arena, "intervals", slabs * SAMPLES_REGION, sizeof *s->active);
        s->open = sp_arena_alloc(arena, "slabs", slabs, sizeof *s->open);
        if (r->reduction.is_extreme)
            s->most = sp_arena_alloc(arena, "slabs", slabs, sizeof *s->most);
        s->seen = sp_arena_alloc(arena, "rows", rows, sizeof *s->seen);
        s->around = sp_arena_alloc(arena, "rows", rows, sizeof *s->around);
        for (int i = 0; i < RESAMPLE_SHEETS; i++)
            s->sheets[i].refined =
                sp_arena_alloc(arena, "refined slices", r->refined_max + BEYOND, sizeof(int16_t));
        for (int i = 0; i <= RESAMPLE_TAPS; i++) {
            s->rows[i].doubled = sp_arena_alloc(arena, "rows of slices",
                                                r->refined_max / 2 + BEYOND, sizeof(uint16_t));
            s->rows[i].filled = sp_arena_alloc(arena, "rows of slices", rows, sizeof(uint64_t));
        }
    }
    return !arena->failed;
}

/* Allocates the memory of the workers for all channels; returns the memory for the first one. NULL:
 * out of memory.
 */
static struct sp_resample_scratch *allocate_all(const struct sp_resample_input *input,
                                                struct sp_resample *r) {
    const unsigned workers = sp_pool_threads(input->pool);
    struct sp_resample_scratch *first = NULL, *last = NULL;
    for (; r; r = r->next) {
        struct sp_resample_scratch *own;
        if (!allocate(r, &own, workers, input->arena))
            return NULL;
        for (unsigned w = 0; last && w < workers; w++)
            last[w].next = &own[w];
        first = first ? first : own;
        last = own;
    }
    return first;
}

struct tiles {
    uint32_t first; /* number of the first tile */
    const struct sp_resample *r;
    struct sp_resample_scratch *scratch;
    sp_resample_tile_fn *draw;
};

static void draw_tiles(void *user, size_t begin, size_t end, unsigned worker) {
    struct tiles *tiles = user;
    for (size_t i = begin; i < end; i++) {
        if (sp_interrupt_is_cancelled(&tiles->r->interrupt))
            return;
        tiles->draw(tiles->r, &tiles->scratch[worker], tiles->first + (uint32_t)i);
    }
}

/* Draws all tiles, in bands if the fragments of other layers come in bands. */
static bool draw_bands(const struct sp_resample_input *input, const struct sp_resample *r,
                       struct sp_resample_scratch *scratch, struct sp_error *err) {
    const int height = r->rows * RESAMPLE_TILE;
    const int step = sp_fragments_rows(input->fragments, RESAMPLE_TILE, height);
    for (int y = 0; y < height; y += step) {
        const int end = y + step < height ? y + step : height;
        struct tiles tiles = { (uint32_t)(y / RESAMPLE_TILE * r->columns), r, scratch,
                               input->draw_tile };
        if (!sp_fragments_ensure(input->fragments, y, end, err))
            return false;
        sp_parallel_for(input->pool, (size_t)((end - y) / RESAMPLE_TILE * r->columns), 1,
                        draw_tiles, &tiles);
        if (sp_interrupt_is_cancelled(&input->interrupt))
            return sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
    }
    return true;
}

/* Draws all tiles with slices of axis r->axis. */
static bool draw(const struct sp_resample_input *input, const struct sp_resample *r,
                 struct sp_resample_scratch *scratch, struct sp_error *err) {
    unsigned workers = sp_pool_threads(input->pool);
    struct sp_frame_stats *stats = &input->frame->stats;
    if (!draw_bands(input, r, scratch, err))
        return false;
    for (unsigned w = 0; w < workers; w++)
        for (struct sp_resample_scratch *s = &scratch[w]; s; s = s->next) {
            if (s->is_too_wide)
                return sp_fail(err, SP_ERR_BUDGET, "/quality/level_of_detail",
                               "the volume is too small in the image for its samples: set "
                               "quality.level_of_detail to \"auto\", or come nearer");
            stats->splats += s->refined;
            stats->fragments += s->sampled;
            s->refined = s->sampled = 0;
        }
    return true;
}

/* Gets the samples of all channels for slices of another axis. */
static bool turn_all(const struct sp_resample_input *input, struct sp_resample *r, int axis,
                     struct sp_error *err) {
    for (; input; input = input->next, r = r->next)
        if (!sp_resample_turn(input, r, axis, err))
            return false;
    return true;
}

/* Draws the image of another axis and mixes it into the frame. Without memory for it, the frame
 * does not change. */
static bool add_axis(const struct sp_resample_input *input, struct sp_resample *r, int axis,
                     struct sp_resample_scratch *scratch, double share, struct sp_error *err) {
    struct sp_frame second = *input->frame;
    struct sp_error why = { 0 };
    second.pixels =
        sp_arena_alloc(input->arena, "second image", second.height, second.stride_bytes);
    if (second.depth) {
        const size_t stride = second.depth_stride_bytes;
        second.depth = sp_arena_alloc(input->arena, "second depth", second.height, stride);
        second.spread = sp_arena_alloc(input->arena, "second depth", second.height, stride);
    }
    if (input->arena->failed)
        return sp_arena_fail(input->arena, "data", err);
    r->frame = &second;
    bool is_drawn = turn_all(input, r, axis, &why) && draw(input, r, scratch, &why);
    r->frame = input->frame;
    if (is_drawn)
        sp_axes_mix(input->frame, &second, share, input->pool);
    else if (why.code != SP_ERR_BUDGET && err)
        *err = why;
    return is_drawn || why.code == SP_ERR_BUDGET;
}

/* Draws the frame with the slices of each axis that has a share of it; a draft with those of one
 * axis. */
static bool draw_axes(const struct sp_resample_input *input, struct sp_resample *r,
                      struct sp_error *err) {
    struct sp_resample_scratch *scratch = allocate_all(input, r);
    int best = r->axis;
    double sum = r->share[best];
    if (!scratch)
        return sp_arena_fail(input->arena, "data", err);
    if (!draw(input, r, scratch, err))
        return false;
    for (int a = 0; a < 3 && !input->frame->stats.is_draft; a++) {
        if (a == best || !(r->share[a] > 0))
            continue;
        sum += r->share[a];
        if (!add_axis(input, r, a, scratch, r->share[a] / sum, err))
            return false;
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
    const double classified_ms = prepared - clock;
    const double layers_ms = input->fragments ? input->fragments->ms : 0;
    if (!draw_axes(input, &r, err))
        return false;
    if (input->fragments)
        prepared += input->fragments->ms - layers_ms;
    stats->stage_count = 2;
    stats->stages[0] = (struct sp_stage_time){ "classify", classified_ms };
    stats->stages[1] =
        (struct sp_stage_time){ "tile", sp_interrupt_clock_ms(&input->interrupt) - prepared };
    return true;
}
