/* SPDX-License-Identifier: Apache-2.0
 *
 * Fragments of other layers between the intervals of a block's rays. An interval that holds a
 * fragment is cut there: each part has the interval's mean colour, and its share of the optical
 * depth is its share of the length. Hence no step of a sheet shows on a surface.
 */
#include "draw/resample/insert.h"

#include "draw/resample/depth.h"
#include "splat/exp2.h"

/* SP_WIDE rays while they are composited. */
struct rays {
    int pixel; /* of the block, the first one */
    sp_wide light, color[3];
};

static inline void load_rays(const struct sp_resample_block *block, int pixel, struct rays *rays) {
    rays->pixel = pixel;
    rays->light = sp_wide_load(block->light + pixel);
    for (int c = 0; c < 3; c++)
        rays->color[c] = sp_wide_load(block->color[c] + pixel);
}

static inline void store_rays(struct sp_resample_block *block, const struct rays *rays) {
    sp_wide_store(block->light + rays->pixel, rays->light);
    for (int c = 0; c < 3; c++)
        sp_wide_store(block->color[c] + rays->pixel, rays->color[c]);
}

/* Adds an interval between two s. depth_of: the block, if its frame has depth; else NULL. */
static inline void add(struct rays *rays, sp_wide opacity, const sp_wide color[3],
                       struct sp_resample_block *depth_of, sp_wide begin, sp_wide end) {
    sp_wide share = rays->light * opacity;
    if (depth_of)
        sp_resample_add_depth(depth_of, rays->pixel, share, 0.5f * (begin + end));
    for (int c = 0; c < 3; c++)
        rays->color[c] += share * color[c];
    rays->light -= share;
}

float sp_resample_fragment_s(const struct sp_resample_open_tile *t,
                             const struct sp_resample_block *block, int i, float depth) {
    const struct sp_resample *r = t->r;
    const int axis = t->axis[2];
    double x = t->x + block->at[0] + i % RESAMPLE_BLOCK + 0.5 - r->camera->centre[0];
    double y = t->y + block->at[1] + i / RESAMPLE_BLOCK + 0.5 - r->camera->centre[1];
    if (block->is_crossed) {
        x += (double)block->moved[0][i];
        y += (double)block->moved[1][i];
    }
    const double aside = x * r->right[axis] + y * r->down[axis];
    double place = r->eye[axis] + (double)depth * r->ray[axis];
    place += r->camera->projection == SP_PERSPECTIVE ? (double)depth * aside : aside;
    double s = place - (double)t->reference;
    return (float)(t->is_backwards ? -s : s);
}

/* Notes the first of the fragments that are left of pixel i of the block. */
static inline void note_next(const struct sp_resample_open_tile *t, struct sp_resample_block *block,
                             int i) {
    const struct sp_fragment *next = block->next[i];
    block->next_s[i] = sp_resample_fragment_s(t, block, i, next->depth);
    block->next_alpha[i] = next->alpha;
    for (int c = 0; c < 3; c++)
        block->next_color[c][i] = next->color[c];
}

void sp_resample_open_fragments(const struct sp_resample_open_tile *t,
                                struct sp_resample_block *block) {
    const struct sp_fragments *all = t->r->fragments;
    block->has_fragments = false;
    for (int y = 0; all && y < RESAMPLE_BLOCK; y++) {
        const struct sp_fragment *list;
        const uint32_t *first =
            sp_fragments_row(all, t->x + block->at[0], t->y + block->at[1] + y, &list);
        block->has_fragments |= first && first[RESAMPLE_BLOCK] > first[0];
    }
    for (int i = 0; block->has_fragments && i < RESAMPLE_PIXELS; i++) {
        const struct sp_fragment *list;
        const int x = i % RESAMPLE_BLOCK;
        const uint32_t *first = sp_fragments_row(all, t->x + block->at[0],
                                                 t->y + block->at[1] + i / RESAMPLE_BLOCK, &list);
        block->next[i] = list + first[x];
        block->left[i] = (uint8_t)(first[x + 1] - first[x]);
        block->next_s[i] = INFINITY;
        if (block->left[i])
            note_next(t, block, i);
    }
}

/* Composites the next fragment of some of the rays. Returns true if one of those behind them lies
 * before until[ray] as well. */
static inline bool composite_next(const struct sp_resample_open_tile *t,
                                  struct sp_resample_block *block, struct rays *rays,
                                  sp_wide_mask which, const float until[SP_WIDE]) {
    bool is_again = false;
    for (int c = 0; c < 3; c++) {
        sp_wide color = sp_wide_load(block->next_color[c] + rays->pixel);
        rays->color[c] += sp_wide_keep(which, rays->light * color);
    }
    sp_wide alpha = sp_wide_load(block->next_alpha + rays->pixel);
    sp_wide share = sp_wide_keep(which, rays->light * alpha);
    rays->light -= share;
    if (t->r->has_depth) {
        const sp_wide s = sp_wide_keep(which, sp_wide_load(block->next_s + rays->pixel));
        sp_resample_open_depth(block, s[__builtin_ctz(sp_wide_mask_bits(which))]);
        sp_resample_add_depth(block, rays->pixel, share, s);
    }
    for (unsigned bits = sp_wide_mask_bits(which); bits; bits &= bits - 1) {
        const int k = __builtin_ctz(bits), i = rays->pixel + k;
        block->next[i]++;
        block->next_s[i] = INFINITY;
        if (--block->left[i]) {
            note_next(t, block, i);
            is_again |= block->next_s[i] < until[k];
        }
    }
    return is_again;
}

/* The rays whose next fragment lies before s. */
static inline sp_wide_mask mask_before(const struct sp_resample_block *block, int pixel,
                                       sp_wide s) {
    return sp_wide_lt(sp_wide_load(block->next_s + pixel), s);
}

void sp_resample_prefetch_fragments(const struct sp_resample_block *block, float s) {
    for (int i = 0; i < RESAMPLE_PIXELS; i += SP_WIDE) {
        unsigned bits = sp_wide_mask_bits(mask_before(block, i, sp_wide_all(s)));
        for (; bits; bits &= bits - 1)
            __builtin_prefetch(block->next[i + __builtin_ctz(bits)] + 1);
    }
}

void sp_resample_insert(const struct sp_resample_open_tile *t, struct sp_resample_block *block,
                        const struct sp_resample_part *part) {
    const sp_wide zero = sp_wide_all(0), one = sp_wide_all(1);
    const int pixel = part->pixel;
    struct sp_resample_block *depth_of = t->r->has_depth ? block : NULL;
    sp_wide to = sp_wide_min(sp_wide_all(part->end), sp_wide_load(block->end + pixel));
    sp_wide at = sp_wide_max(sp_wide_all(part->begin), sp_wide_load(block->begin + pixel));
    sp_wide_mask is_inside = sp_wide_lt(at, to), before = mask_before(block, pixel, to);
    sp_wide per_length = 1 / sp_wide_select(is_inside, to - at, one);
    sp_wide depth = sp_wide_log2(sp_wide_max(1 - part->opacity, sp_wide_all(1e-30f)));
    sp_wide left = one; /* of the interval's length */
    _Alignas(64) float until[SP_WIDE];
    struct rays rays;
    sp_wide_store(until, to);
    load_rays(block, pixel, &rays);
    for (bool is_again = sp_wide_any(before); is_again;) {
        sp_wide next = sp_wide_max(sp_wide_load(block->next_s + pixel), at);
        next = sp_wide_select(before, next, at);
        sp_wide share = sp_wide_min(sp_wide_keep(is_inside, (next - at) * per_length), left);
        share = sp_wide_keep(before, share);
        add(&rays, t->r->is_linear ? part->opacity * share : 1 - sp_wide_exp2(depth * share),
            part->color, depth_of, at, next);
        left -= share;
        at = next;
        is_again = composite_next(t, block, &rays, before, until);
        if (is_again)
            before = mask_before(block, pixel, to);
    }
    sp_wide rest = t->r->is_linear ? part->opacity * left : 1 - sp_wide_exp2(depth * left);
    rest = sp_wide_select(sp_wide_lt(left, one), rest, part->opacity);
    add(&rays, sp_wide_keep(sp_wide_lt(zero, left), rest), part->color, depth_of, at, to);
    store_rays(block, &rays);
}

void sp_resample_insert_before(const struct sp_resample_open_tile *t,
                               struct sp_resample_block *block, float s) {
    _Alignas(64) float until[SP_WIDE];
    sp_wide_store(until, sp_wide_all(s));
    for (int i = 0; i < RESAMPLE_PIXELS; i += SP_WIDE) {
        sp_wide_mask before = mask_before(block, i, sp_wide_all(s));
        struct rays rays;
        if (!sp_wide_any(before))
            continue;
        load_rays(block, i, &rays);
        while (composite_next(t, block, &rays, before, until))
            before = mask_before(block, i, sp_wide_all(s));
        store_rays(block, &rays);
    }
}
