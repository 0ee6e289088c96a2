/* SPDX-License-Identifier: Apache-2.0
 *
 * One tile: where its rays cross the slices, which blocks may see something in which slab of
 * regions, and the slices front to back.
 */
#include <math.h>
#include <string.h>

#include "draw/resample/insert.h"
#include "draw/resample/kernels.h"
#include "draw/resample/rays.h"
#include "splat/exp2.h"

enum { ALL_INTERVALS = (1 << SAMPLES_REGION) - 1 };

/* Computes the rays of the tile and sets the fields for reading its slices. */
static void init_rays(struct sp_resample_open_tile *t, struct sp_resample_rays *rays) {
    const struct sp_resample *r = t->r;
    const struct sp_samples *samples = r->samples;
    const size_t strides[3] = { 1, samples->dims[0], (size_t)samples->dims[0] * samples->dims[1] };
    const size_t turned[3] = { 1, samples->dims[1], (size_t)samples->dims[1] * samples->dims[2] };
    sp_resample_rays_init(rays, r, (const int[4]){ t->x, t->y, t->width, t->height });
    bool is_turned = rays->axis[2] == 0 && samples->turned;
    t->voxels = is_turned ? samples->turned : samples->voxels;
    for (int a = 0; a < 3; a++) {
        t->axis[a] = rays->axis[a];
        t->stride[a] = is_turned ? turned[a] : strides[t->axis[a]];
        t->dims[a] = (int)samples->dims[t->axis[a]];
        t->map[a] = r->axes[t->axis[a]].place ? &r->axes[t->axis[a]] : NULL;
    }
    t->is_backwards = rays->is_backwards;
    t->reference = rays->reference;
}

/* A slab of regions: those between two slices of the tile's axis. */
struct slab {
    float s[2];             /* between which rays are in it */
    const uint8_t *visible; /* of its regions */
    const float (*range)[2];
    size_t stride[2]; /* of regions along u and v */
};

/* The regions of a slab that blocks see: first and last, per axis. */
struct regions {
    int32_t first[2][RESAMPLE_BLOCKS], last[2][RESAMPLE_BLOCKS];
};

static void init_slab(const struct sp_resample_open_tile *t, int number, struct slab *slab) {
    const uint32_t *regions = t->r->samples->regions;
    const size_t strides[3] = { 1, regions[0], (size_t)regions[0] * regions[1] };
    float near = (float)(number * SAMPLES_REGION), far = near + SAMPLES_REGION;
    if (number == 0)
        near = -1;
    if (number + 1 == (int)regions[t->axis[2]])
        far = (float)t->dims[2];
    slab->s[0] = sp_resample_s(t, t->is_backwards ? far : near);
    slab->s[1] = sp_resample_s(t, t->is_backwards ? near : far);
    slab->visible = t->r->class->visible + (size_t)number * strides[t->axis[2]];
    slab->range = (const float(*)[2])t->r->samples->range + (size_t)number * strides[t->axis[2]];
    for (int a = 0; a < 2; a++)
        slab->stride[a] = strides[t->axis[a]];
}

/* The intervals in which some of the regions first to last may show something, as bits. */
static unsigned look(const struct slab *slab, const int first[2], const int last[2]) {
    unsigned seen = 0;
    for (int j = first[1]; j <= last[1]; j++)
        for (int i = first[0]; i <= last[0]; i++)
            seen |= slab->visible[(size_t)i * slab->stride[0] + (size_t)j * slab->stride[1]];
    return seen;
}

/* The largest sign·code that a maximum or minimum may find in the regions first to last. Reading
 * rounds. */
static float look_for_most(const struct sp_resample_open_tile *t, const struct slab *slab,
                           const int first[2], const int last[2]) {
    const double rounding = 2, beyond = 1e6;
    const float sign = t->r->reduction.sign;
    const struct sp_curve *curve = &t->r->curve;
    float most = -INFINITY;
    for (int j = first[1]; j <= last[1]; j++)
        for (int i = first[0]; i <= last[0]; i++) {
            const float *range =
                slab->range[(size_t)i * slab->stride[0] + (size_t)j * slab->stride[1]];
            float own = sign > 0 ? range[1] : -range[0];
            most = own > most ? own : most;
        }
    double code = ((double)(sign * most) - curve->base) * curve->codes_per_unit + CURVE_CODE_MIN;
    code = fmin(fmax(code, CURVE_CODE_MIN), CURVE_CODE_MAX); /* as interpolation does */
    return (float)fmin(fmax((double)sign * code + rounding, -beyond), beyond);
}

/* Bounds the regions of a slab that each of the blocks sees. Returns the blocks that see any. */
static uint64_t bound_regions(const struct sp_resample_open_tile *t, const struct slab *slab,
                              uint64_t blocks, struct regions *regions) {
    const struct sp_resample_bounds *bounds = &t->scratch->bounds;
    uint64_t meet = 0;
    for (int b = 0; b < RESAMPLE_BLOCKS; b += SP_WIDE) {
        sp_wide s[2], min[2][2], max[2][2];
        if (!(blocks >> b & ((UINT64_C(1) << SP_WIDE) - 1)))
            continue;
        s[0] = sp_wide_max(sp_wide_load(bounds->span[0] + b), sp_wide_all(slab->s[0]));
        s[1] = sp_wide_min(sp_wide_load(bounds->span[1] + b), sp_wide_all(slab->s[1]));
        meet |= (uint64_t)sp_wide_mask_bits(sp_wide_lt(s[0], s[1])) << b;
        for (int k = 0; k < 2; k++)
            sp_resample_extents(t, b, s[k], min[k], max[k]);
        for (int a = 0; a < 2; a++) {
            const float size = 1.0f / SAMPLES_REGION;
            const sp_wide last = sp_wide_all((float)t->r->samples->regions[t->axis[a]] - 1);
            sp_wide low = sp_wide_min(min[0][a], min[1][a]) * size;
            sp_wide high = sp_wide_max(max[0][a], max[1][a]) * size;
            sp_wide_int_store(regions->first[a] + b, sp_wide_to_int(sp_wide_min(low, last)));
            sp_wide_int_store(regions->last[a] + b, sp_wide_to_int(sp_wide_min(high, last)));
        }
    }
    return meet & blocks;
}

/* Does any of the blocks see a visible region? Looks at all that lie between theirs. */
static bool is_any_visible(const struct slab *slab, uint64_t blocks,
                           const struct regions *regions) {
    int first[2] = { INT32_MAX, INT32_MAX }, last[2] = { -1, -1 };
    for (uint64_t left = blocks; left; left &= left - 1) {
        int b = __builtin_ctzll(left);
        for (int a = 0; a < 2; a++) {
            first[a] = regions->first[a][b] < first[a] ? regions->first[a][b] : first[a];
            last[a] = regions->last[a][b] > last[a] ? regions->last[a][b] : last[a];
        }
    }
    return look(slab, first, last);
}

/* Fills `active` and returns the blocks that may see something. */
static uint64_t mark_active(const struct sp_resample_open_tile *t) {
    /* The bits of regions are for the axis of most tiles. */
    const bool is_other = (unsigned)t->axis[2] != t->r->class->axis;
    struct regions regions;
    struct slab slab;
    uint64_t any = 0;
    for (int n = 0; n < (int)t->r->samples->regions[t->axis[2]]; n++) {
        uint64_t *active = t->scratch->active + (size_t)n * SAMPLES_REGION;
        memset(active, 0, SAMPLES_REGION * sizeof *active);
        t->scratch->open[n] = UINT64_MAX;
        init_slab(t, n, &slab);
        uint64_t left = bound_regions(t, &slab, t->alive, &regions);
        if (!is_any_visible(&slab, left, &regions))
            continue;
        for (; left; left &= left - 1) {
            int b = __builtin_ctzll(left);
            const int first[2] = { regions.first[0][b], regions.first[1][b] };
            const int last[2] = { regions.last[0][b], regions.last[1][b] };
            unsigned seen = look(&slab, first, last);
            if (seen && is_other)
                seen = ALL_INTERVALS;
            for (int k = 0; k < SAMPLES_REGION; k++)
                active[k] |= (uint64_t)(seen >> k & 1) << b;
            any |= (uint64_t)(seen != 0) << b;
            if (seen && t->r->reduction.is_extreme)
                t->scratch->most[n][b] = look_for_most(t, &slab, first, last);
        }
    }
    return any;
}

/* The interval between slices that holds interval n, which lies between sheets n and n + 1. */
static int interval_of(const struct sp_resample_open_tile *t, int n) {
    int last = (int)t->r->samples->regions[t->axis[2]] * SAMPLES_REGION - 1;
    int i = (int)floorf(0.5f * (sp_resample_slice(t, n) + sp_resample_slice(t, n + 1)));
    return i < 0 ? 0 : i < last ? i : last;
}

static uint64_t active_at(const struct sp_resample_open_tile *t, int n) {
    if (n < 1 || n >= t->count)
        return 0;
    int i = interval_of(t, n);
    return t->scratch->active[i] & t->scratch->open[i / SAMPLES_REGION];
}

/* Marks which blocks the slabs of intervals first to last may still change. */
static void mark_open(const struct sp_resample_open_tile *t, int first, int last) {
    struct sp_resample_scratch *scratch = t->scratch;
    for (int n = first; n <= last; n++) {
        int slab = interval_of(t, n) / SAMPLES_REGION;
        uint64_t open = 0;
        for (int b = 0; b < RESAMPLE_BLOCKS; b += SP_WIDE)
            open |= (uint64_t)sp_wide_mask_bits(sp_wide_lt(sp_wide_load(scratch->least + b),
                                                           sp_wide_load(scratch->most[slab] + b)))
                    << b;
        scratch->open[slab] = open;
    }
}

/* Blocks that need sheet n: they are active in one of the two intervals before it or of the two
 * behind it. */
static uint64_t need_of(const struct sp_resample_open_tile *t, int n) {
    return t->alive &
           (active_at(t, n - 2) | active_at(t, n - 1) | active_at(t, n) | active_at(t, n + 1));
}

/* Refines the sheets of a batch where blocks need them. Returns the blocks that composite an
 * interval. */
static uint64_t refine_sheets(const struct sp_resample_open_tile *t,
                              struct sp_resample_batch *batch) {
    uint64_t any = 0;
    for (int i = 0; i <= batch->last - batch->first; i++) {
        const int n = batch->first + i + t->shift;
        batch->now[i] = 0;
        if (n < 0 || n > t->count + 1)
            continue;
        struct sp_resample_sheet *sheet = &t->scratch->sheets[n % RESAMPLE_SHEETS];
        uint64_t need = need_of(t, n), now = t->alive & active_at(t, n - 2);
        sheet->s = sp_resample_sheet_s(t, n);
        sheet->decay = sp_exp2(-2 * (sp_resample_sheet_s(t, n + 1) - sheet->s));
        if (need) {
            sp_resample_refine(t, sheet, need, sp_resample_slice(t, n));
            sp_resample_near_ranges(t, sheet, need);
        }
        batch->now[i] = now ? sp_resample_near_visible(t, n - 2, now) : 0;
        any |= batch->now[i];
    }
    return any;
}

/* Batches: of all channels. */
static bool draw_batch(const struct sp_resample_open_tile *t,
                       const struct sp_resample_batch *batches, int b) {
    return t->r->reduction.is_on ? sp_resample_reduce(t, batches, b)
                                 : sp_resample_integrate(t, batches, b);
}

/* The sheet of the batch from which a maximum or minimum begins: it belongs to the slab that
 * promises the blocks most. Once it is drawn, the others can seldom change a block. */
static int choose_start(const struct sp_resample_open_tile *t) {
    const struct sp_resample_scratch *scratch = t->scratch;
    int best = 0, best_slab = -1;
    float most = -INFINITY;
    for (int n = 1; n < t->count; n++) {
        int interval = interval_of(t, n), slab = interval / SAMPLES_REGION;
        uint64_t left = t->alive & scratch->active[interval];
        float sum = 0;
        if (slab == best_slab)
            continue;
        for (; left; left &= left - 1)
            sum += scratch->most[slab][__builtin_ctzll(left)] - t->r->reduction.start;
        if (sum > most) {
            most = sum;
            best = n;
            best_slab = slab;
        }
    }
    return best / RESAMPLE_BATCH * RESAMPLE_BATCH;
}

/* Draws the intervals of the sheets from first to last, whole batches, of those from `begin` on.
 * Each block draws a few sheets at a time, so that its state stays in the nearest cache. */
static void draw_batches(struct sp_resample_open_tile *t, int begin, int first, int last) {
    struct sp_resample_batch batches[SP_LAYERS_MAX];
    for (struct sp_resample_open_tile *c = t; c; c = c->next)
        sp_resample_start_sheets(c);
    /* The batch before makes the sheets that the first interval needs. */
    for (int n = first > begin ? first - RESAMPLE_BATCH : begin; n <= last && t->alive;
         n += RESAMPLE_BATCH) {
        struct sp_resample_batch *batch = batches;
        uint64_t left = 0;
        if (sp_interrupt_is_cancelled(&t->r->interrupt))
            return;
        for (struct sp_resample_open_tile *c = t; c; c = c->next, batch++) {
            c->alive = t->alive;
            batch->first = n;
            batch->last = n + RESAMPLE_BATCH - 1 < last ? n + RESAMPLE_BATCH - 1 : last;
            if (c->r->reduction.is_extreme)
                mark_open(c, batch->first - 2, batch->last + 1);
            left |= refine_sheets(c, batch);
        }
        for (; n >= first && left; left &= left - 1)
            if (!draw_batch(t, batches, __builtin_ctzll(left)))
                t->alive &= ~(left & -left);
    }
}

/* Draws the sheets from two slices before the volume to two slices behind it. The outer sheets
 * repeat the border slices. */
static void draw_sheets(struct sp_resample_open_tile *t) {
    int begin = 0, end = t->count + 1, start = 0;
    for (const struct sp_resample_open_tile *c = t->next; c; c = c->next) {
        begin = -c->shift < begin ? -c->shift : begin;
        end = c->count + 1 - c->shift > end ? c->count + 1 - c->shift : end;
    }
    if (t->r->reduction.is_extreme)
        start = choose_start(t);
    for (int b = 0; b < RESAMPLE_BLOCKS; b++)
        t->scratch->least[b] = t->r->reduction.start;
    draw_batches(t, begin, start > 0 ? start : begin, end);
    if (start > 0)
        draw_batches(t, begin, begin, start - 1);
}

/* True if the memory holds the part of a sheet that a set of blocks sees. The extent of straight
 * rays is largest at one of their ends. Sets the unit of columns. */
static bool fits(struct sp_resample_open_tile *t, uint64_t set) {
    const struct sp_resample_bounds *bounds = &t->scratch->bounds;
    float margin = t->map[2] ? 3 * t->map[2]->widest : 3; /* sheets are read beyond the span */
    float span[2] = { INFINITY, -INFINITY }, size[2];
    for (uint64_t left = set; left; left &= left - 1) {
        span[0] = fminf(span[0], bounds->span[0][__builtin_ctzll(left)] - margin);
        span[1] = fmaxf(span[1], bounds->span[1][__builtin_ctzll(left)] + margin);
    }
    for (int a = 0; a < 2; a++) {
        float extent = 0, change = 0;
        for (int k = 0; k < 2; k++) {
            float low = INFINITY, high = -INFINITY;
            for (uint64_t left = set; left; left &= left - 1)
                for (int i = 0; i < 4; i++) {
                    int b = __builtin_ctzll(left);
                    float at = bounds->corner[a][i][b] + span[k] * bounds->corner[a + 2][i][b];
                    low = fminf(low, at);
                    high = fmaxf(high, at);
                    change = fmaxf(change, fabsf(bounds->corner[a + 2][i][b]));
                }
            extent = fmaxf(extent, high - low);
        }
        if (t->sheets_per_slice > 1) /* slices keep what the sheets around them see */
            extent += 2 * margin * change;
        size[a] = fminf(t->map[a] ? extent / t->map[a]->narrowest : extent, (float)t->dims[a]);
    }
    t->unit_bits = RESAMPLE_UNIT_BITS;
    while (size[0] + 8 > (float)((RESAMPLE_UNITS - 2) << t->unit_bits))
        t->unit_bits++;
    return (size_t)(2 * (size[0] + (float)(RESAMPLE_SLACK + (2 << t->unit_bits)))) *
               (size_t)(2 * (size[1] + RESAMPLE_SLACK)) <=
           t->r->refined_max;
}

/* Draws a set of blocks, for which there is memory. Channels are mixed sheet by sheet; each of them
 * has a projection of its own. */
static void draw_channels(struct sp_resample_open_tile *t, uint64_t set) {
    for (struct sp_resample_open_tile *c = t; c; c = c->next) {
        const double offset = c->r->offset[c->axis[2]];
        const double slices = c->is_backwards ? c->dims[2] - t->dims[2] - offset : offset;
        c->alive = set;
        c->count = (c->dims[2] + 2) * c->sheets_per_slice;
        c->shift = (int)lround(slices * c->sheets_per_slice);
    }
    for (struct sp_resample_open_tile *c = t; c && t->r->reduction.is_on; c = c->next) {
        struct sp_resample_open_tile alone = *c;
        alone.next = NULL;
        alone.shift = 0;
        draw_sheets(&alone);
    }
    if (!t->r->reduction.is_on)
        draw_sheets(t);
}

/* Draws a set of blocks, in parts if need be. */
static void draw_blocks(struct sp_resample_open_tile *t, uint64_t set) {
    uint64_t part = set;
    bool fits_all = true;
    if (!set)
        return;
    for (struct sp_resample_open_tile *c = t; c; c = c->next) {
        c->sheets_per_slice = t->sheets_per_slice;
        fits_all &= fits(c, set);
    }
    if (fits_all) {
        draw_channels(t, set);
        return;
    }
    for (int i = __builtin_popcountll(set) / 2; i > 0; i--)
        part &= part - 1;
    if (part == set) {
        t->scratch->is_too_wide = true;
        return;
    }
    draw_blocks(t, set & ~part);
    draw_blocks(t, part);
}

/* The share that half sheets have of the pixels from i on (rays.h). */
static inline sp_wide halves_share(const struct sp_resample_open_tile *t,
                                   const struct sp_resample_block *block, int i) {
    const float begin = t->r->steep[0], end = t->r->steep[1];
    const float per_length = 1 / sqrtf((float)t->r->metric[t->axis[2]]);
    sp_wide du = sp_wide_load(block->du + i), dv = sp_wide_load(block->dv + i);
    sp_wide speed = sp_wide_sqrt(1 + du * du + dv * dv);
    speed = sp_wide_max(speed, sp_wide_load(block->length + i) * per_length);
    sp_wide share = (speed - begin) * (1 / (end - begin));
    return sp_wide_clamp(share, 0, 1);
}

/* Marks the blocks that need a sheet per slice in need[0], and the blocks that need half sheets in
 * need[1]. */
static void mark_steep(const struct sp_resample_open_tile *t, uint64_t blocks, uint64_t need[2]) {
    const sp_wide zero = sp_wide_all(0), one = sp_wide_all(1);
    need[0] = need[1] = 0;
    for (uint64_t left = blocks; left; left &= left - 1) {
        int b = __builtin_ctzll(left);
        bool is_flat = false, is_steep = false;
        for (int i = 0; i < RESAMPLE_PIXELS; i += SP_WIDE) {
            sp_wide share = halves_share(t, &t->scratch->blocks[b], i);
            is_flat |= sp_wide_any(sp_wide_lt(share, one));
            is_steep |= sp_wide_any(sp_wide_lt(zero, share));
        }
        need[0] |= (uint64_t)is_flat << b;
        need[1] |= (uint64_t)is_steep << b;
    }
}

/* Puts a block's pixels aside, to draw it again. */
static void put_aside(const struct sp_resample_open_tile *t, int b) {
    struct sp_resample_scratch *scratch = t->scratch;
    struct sp_resample_block *block = &scratch->blocks[b];
    memcpy(scratch->aside[b][0], block->light, sizeof block->light);
    for (int c = 0; c < 3; c++)
        memcpy(scratch->aside[b][c + 1], block->color[c], sizeof block->color[c]);
    for (int k = 0; t->r->has_depth && k < 2; k++)
        memcpy(scratch->aside[b][k + 4], block->moment[k], sizeof block->moment[k]);
    sp_resample_open_block(t, block);
}

/* Composites the fragments behind the volume. */
static void finish_fragments(const struct sp_resample_open_tile *t, uint64_t blocks) {
    for (uint64_t left = blocks; left; left &= left - 1) {
        struct sp_resample_block *block = &t->scratch->blocks[__builtin_ctzll(left)];
        if (block->has_fragments)
            sp_resample_insert_before(t, block, INFINITY);
    }
}

/* Mixes a block's pixels with the pixels that were put aside. */
static void mix_aside(const struct sp_resample_open_tile *t, int b) {
    struct sp_resample_block *block = &t->scratch->blocks[b];
    float *to[6] = { block->light,    block->color[0],  block->color[1],
                     block->color[2], block->moment[0], block->moment[1] };
    for (int i = 0; i < RESAMPLE_PIXELS; i += SP_WIDE) {
        sp_wide share = halves_share(t, block, i);
        for (int c = 0; c < (t->r->has_depth ? 6 : 4); c++) {
            sp_wide first = sp_wide_load(t->scratch->aside[b][c] + i);
            sp_wide_store(to[c] + i, first + share * (sp_wide_load(to[c] + i) - first));
        }
    }
}

/* Draws a set of blocks whose rays need these sheets: each block with a sheet per slice, with half
 * sheets, or both ways. */
static void draw_sheets_of(struct sp_resample_open_tile *t, int sheets, uint64_t set) {
    uint64_t need[2] = { sheets & RESAMPLE_WHOLE ? set : 0, sheets & RESAMPLE_HALVES ? set : 0 };
    if (need[0] && need[1])
        mark_steep(t, set, need);
    t->sheets_per_slice = 1;
    draw_blocks(t, need[0]);
    finish_fragments(t, need[0]);
    for (struct sp_resample_open_tile *c = t; c; c = c->next)
        for (uint64_t left = need[0] & need[1]; left; left &= left - 1)
            put_aside(c, __builtin_ctzll(left));
    t->sheets_per_slice = 2;
    draw_blocks(t, need[1]);
    finish_fragments(t, need[1]);
    for (struct sp_resample_open_tile *c = t; c; c = c->next)
        for (uint64_t left = need[0] & need[1]; left; left &= left - 1)
            mix_aside(c, __builtin_ctzll(left));
}

/* The blocks with fragments of other layers. */
static uint64_t mark_fragments(const struct sp_resample_open_tile *t) {
    uint64_t found = 0;
    for (int v = 0; v < t->height; v += RESAMPLE_BLOCK)
        for (int u = 0; u < t->width; u += RESAMPLE_BLOCK) {
            int b = v / RESAMPLE_BLOCK * RESAMPLE_ACROSS_MAX + u / RESAMPLE_BLOCK;
            found |= (uint64_t)t->scratch->blocks[b].has_fragments << b;
        }
    return found;
}

/* Turns the numbers of a projection into colours: the sum of all channels. */
static void close_projection(const struct sp_resample_open_tile *t, uint64_t met) {
    for (uint64_t left = met; left; left &= left - 1) {
        const int b = __builtin_ctzll(left);
        struct sp_resample_block *to = &t->scratch->blocks[b];
        sp_resample_reduce_close(t->r, to);
        for (const struct sp_resample_open_tile *c = t->next; c; c = c->next) {
            sp_resample_reduce_close(c->r, &c->scratch->blocks[b]);
            sp_resample_reduce_add(&c->scratch->blocks[b], t->r->has_depth, to);
        }
    }
}

/* Draws a square of the tile. A wide view's rays may differ so much that some never cross the
 * slices which the middle one crosses; then in four parts. */
static void draw_square(const struct sp_resample *r, struct sp_resample_scratch *scratch, int x,
                        int y, int side) {
    int right = (int)r->frame->width - x, below = (int)r->frame->height - y;
    struct sp_resample_open_tile channels[SP_LAYERS_MAX], *t = NULL;
    struct sp_resample_rays rays[SP_LAYERS_MAX];
    uint64_t met = 0, drawn = 0;
    if (right <= 0 || below <= 0)
        return;
    for (const struct sp_resample *own = r; own; own = own->next, scratch = scratch->next) {
        struct sp_resample_open_tile *last = t;
        t = last ? last + 1 : channels;
        *t = (struct sp_resample_open_tile){ .r = own,
                                             .scratch = scratch,
                                             .x = x,
                                             .y = y,
                                             .width = right < side ? right : side,
                                             .height = below < side ? below : side };
        init_rays(t, &rays[t - channels]);
        if (last)
            last->next = t;
    }
    t = channels;
    if (rays->is_too_wide && side > RESAMPLE_BLOCK) {
        for (int i = 0; i < 4; i++)
            draw_square(r, t->scratch, x + (i & 1) * side / 2, y + (i >> 1) * side / 2, side / 2);
        return;
    }
    for (struct sp_resample_open_tile *c = t; c; c = c->next) {
        met |= sp_resample_init_blocks(c, &rays[c - channels]);
        drawn |= mark_active(c);
    }
    draw_sheets_of(t, rays->sheets, drawn);
    if (r->reduction.is_on) {
        close_projection(t, met);
        sp_resample_close_cover(t, met);
        sp_resample_resolve(t, met);
        return;
    }
    sp_resample_close_cover(t, drawn);
    uint64_t with_fragments = mark_fragments(t);
    finish_fragments(t, with_fragments & ~drawn);
    sp_resample_resolve(t, drawn | with_fragments);
}

void sp_resample_tile(const struct sp_resample *r, struct sp_resample_scratch *scratch,
                      uint32_t number) {
    draw_square(r, scratch, (int)number % r->columns * RESAMPLE_TILE,
                (int)number / r->columns * RESAMPLE_TILE, RESAMPLE_TILE);
}
