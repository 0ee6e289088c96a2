/* SPDX-License-Identifier: Apache-2.0
 *
 * Pixels that a side of the silhouette crosses (silhouette.h). The ray goes through the middle of
 * the part of the pixel's area that is inside, so it shows about the mean of this part, and the
 * volume counts by the size of the part:
 *
 *   ┌───────┐
 *   │    ╱▒▒│   cover = the area of ▒, from four lines across the pixel, which the nearest side
 *   │   ╱▒·▒│           crosses rather than runs along
 *   │  ╱▒▒▒▒│   ·     = where the ray goes
 *   └───────┘
 */
#include <string.h>

#include "draw/resample/depth.h"
#include "draw/resample/insert.h"

enum { LINES = 4 };

static const float half_diagonal = 0.70710678f;

/* The silhouette of the image: all channels have the same. */
static inline const struct sp_silhouette *silhouette_of(const struct sp_resample *r) {
    return r->first ? &r->first->silhouette : &r->silhouette;
}

void sp_resample_open_sides(struct sp_resample_open_tile *t) {
    const struct sp_silhouette *all = silhouette_of(t->r);
    const double half = 0.5 * RESAMPLE_TILE, reach = RESAMPLE_TILE * (double)half_diagonal;
    t->side_count = 0;
    for (int i = 0; i < all->count; i++) {
        const double *line = all->line[i];
        const double at = line[0] * t->x + line[1] * t->y + line[2];
        if (!(at + (line[0] + line[1]) * half < reach))
            continue;
        float *side = t->sides[t->side_count++];
        side[0] = (float)line[0];
        side[1] = (float)line[1];
        side[2] = (float)at;
    }
}

bool sp_resample_is_crossed(const struct sp_resample_open_tile *t, const int at[2]) {
    const float half = 0.5f * RESAMPLE_BLOCK, reach = RESAMPLE_BLOCK * half_diagonal;
    bool is_crossed = false;
    for (int i = 0; i < t->side_count; i++) {
        const float *side = t->sides[i];
        const float inside =
            side[0] * ((float)at[0] + half) + side[1] * ((float)at[1] + half) + side[2];
        if (inside < -reach)
            return false;
        is_crossed |= inside < reach;
    }
    return is_crossed;
}

/* True for the pixels, with their centres at (x, y), whose nearest side rises more across than
 * along the x axis. */
static inline sp_wide_mask is_nearest_level(const struct sp_resample_open_tile *t, sp_wide x,
                                            sp_wide y) {
    sp_wide nearest = sp_wide_all(INFINITY), is_level = sp_wide_all(0);
    for (int i = 0; i < t->side_count; i++) {
        const float *side = t->sides[i];
        sp_wide far = sp_wide_abs(side[0] * x + side[1] * y + side[2]);
        sp_wide own = sp_wide_all(fabsf(side[0]) < fabsf(side[1]) ? 1 : 0);
        is_level = sp_wide_select(sp_wide_lt(far, nearest), own, is_level);
        nearest = sp_wide_min(nearest, far);
    }
    return sp_wide_lt(sp_wide_all(0), is_level);
}

/* Limits the lines across the pixels to what is inside a side. */
static inline void limit(const float side[3], sp_wide x, sp_wide y, sp_wide_mask is_level,
                         sp_wide low[LINES], sp_wide high[LINES]) {
    const float least = 1e-6f; /* of a factor, so that one can divide by it */
    const sp_wide zero = sp_wide_all(0);
    sp_wide at = side[0] * x + side[1] * y + side[2];
    sp_wide along = sp_wide_select(is_level, sp_wide_all(side[1]), sp_wide_all(side[0]));
    sp_wide across = sp_wide_select(is_level, sp_wide_all(side[0]), sp_wide_all(side[1]));
    along = sp_wide_select(sp_wide_lt(sp_wide_abs(along), sp_wide_all(least)), sp_wide_all(least),
                           along);
    sp_wide_mask rises = sp_wide_lt(zero, along);
    sp_wide inverse = -1 / along;
    for (int k = 0; k < LINES; k++) {
        const float line = ((float)k + 0.5f) / LINES - 0.5f;
        sp_wide end = (at + across * line) * inverse;
        low[k] = sp_wide_select(rises, sp_wide_max(low[k], end), low[k]);
        high[k] = sp_wide_select(rises, high[k], sp_wide_min(high[k], end));
    }
}

static inline void cover(const struct sp_resample_open_tile *t, struct sp_resample_block *block,
                         int i) {
    const int *at = block->at;
    const sp_wide_int n = sp_wide_int_count() + i;
    sp_wide x = sp_wide_from_int(n & (RESAMPLE_BLOCK - 1)) + ((float)at[0] + 0.5f);
    sp_wide y = sp_wide_from_int(n >> 3) + ((float)at[1] + 0.5f);
    const sp_wide zero = sp_wide_all(0);
    sp_wide low[LINES], high[LINES], area = zero, right = zero, down = zero;
    sp_wide_mask is_level = is_nearest_level(t, x, y);
    for (int k = 0; k < LINES; k++) {
        low[k] = sp_wide_all(-0.5f);
        high[k] = sp_wide_all(0.5f);
    }
    for (int s = 0; s < t->side_count; s++)
        limit(t->sides[s], x, y, is_level, low, high);
    for (int k = 0; k < LINES; k++) {
        sp_wide length = sp_wide_max(high[k] - low[k], zero);
        area += length;
        right += length * 0.5f * (low[k] + high[k]);
        down += length * (((float)k + 0.5f) / LINES - 0.5f);
    }
    sp_wide inverse = 1 / sp_wide_max(area, sp_wide_all(1e-6f));
    sp_wide_store(block->cover + i, area * (1.0f / LINES));
    sp_wide_store(block->moved[0] + i, inverse * sp_wide_select(is_level, down, right));
    sp_wide_store(block->moved[1] + i, inverse * sp_wide_select(is_level, right, down));
}

void sp_resample_open_cover(const struct sp_resample_open_tile *t,
                            struct sp_resample_block *block) {
    for (int i = 0; i < RESAMPLE_PIXELS; i += SP_WIDE)
        cover(t, block, i);
}

/* Composites all fragments of pixel i of a block without the volume, as colour and transmittance.
 */
static void composite_fragments(const struct sp_resample_open_tile *t,
                                struct sp_resample_block *block, int i, float rgbt[4],
                                float moment[2]) {
    const struct sp_fragment *list;
    const int x = i % RESAMPLE_BLOCK, y = i / RESAMPLE_BLOCK;
    const uint32_t *first =
        sp_fragments_row(t->r->fragments, t->x + block->at[0], t->y + block->at[1] + y, &list);
    memcpy(rgbt, (const float[4]){ 0, 0, 0, 1 }, 4 * sizeof *rgbt);
    for (uint32_t k = first ? first[x] : 0; first && k < first[x + 1]; k++) {
        const float share = rgbt[3] * list[k].alpha;
        sp_fragment_over(&list[k], rgbt);
        if (!t->r->has_depth || !(share > 0))
            continue;
        const float s = sp_resample_fragment_s(t, block, i, list[k].depth);
        sp_resample_open_depth(block, s);
        moment[0] += share * (s - block->origin);
        moment[1] += share * (s - block->origin) * (s - block->origin);
    }
}

void sp_resample_close_cover(const struct sp_resample_open_tile *t, uint64_t blocks) {
    for (uint64_t left = t->side_count ? blocks : 0; left; left &= left - 1) {
        struct sp_resample_block *block = &t->scratch->blocks[__builtin_ctzll(left)];
        for (int i = 0; block->is_crossed && i < RESAMPLE_PIXELS; i++) {
            const float own = block->cover[i];
            float other[4] = { 0, 0, 0, 1 }, moment[2] = { 0, 0 };
            if (!(own < 1))
                continue;
            if (block->has_fragments)
                composite_fragments(t, block, i, other, moment);
            block->light[i] = own * block->light[i] + (1 - own) * other[3];
            for (int c = 0; c < 3; c++)
                block->color[c][i] = own * block->color[c][i] + (1 - own) * other[c];
            for (int k = 0; t->r->has_depth && k < 2; k++)
                block->moment[k][i] = own * block->moment[k][i] + (1 - own) * moment[k];
        }
    }
}
