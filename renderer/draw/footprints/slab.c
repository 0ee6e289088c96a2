/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/footprints/slab.h"

#include <math.h>

#include "base/minmax.h"
#include "draw/footprints/footprint.h"

/* Closes all slabs before `layer`. */
static void advance(struct sp_tile *tile, const struct sp_blend *blend, uint32_t layer) {
    if (tile->sheet == SP_NO_SHEET)
        tile->sheet = layer;
    for (uint32_t k = 0; k < blend->slots && tile->sheet < layer; k++, tile->sheet++)
        sp_layer_close(tile, blend, tile->sheet);
    if (tile->sheet < layer)
        tile->sheet = layer; /* the loop has closed all of them */
}

/* The slabs that contain a splat: the first, the last, and the slot of the first. */
struct range {
    uint32_t first, last, slot;
};

static inline struct range bound_slabs(const struct sp_blend *blend, const struct sp_splat *s,
                                       const struct sp_span *span) {
    float from = floorf((span->distance - span->reach - blend->nearest) / blend->thickness);
    float to = floorf((span->distance + span->reach - blend->nearest) / blend->thickness);
    float low = (float)s->sheet, high = (float)(s->sheet + blend->slots - 1);
    from = sp_minf(sp_maxf(from, low), high);
    to = sp_minf(sp_maxf(to, from), high);
    return (struct range){ (uint32_t)from, (uint32_t)to, (uint32_t)from % blend->slots };
}

static inline uint32_t next_slot(const struct sp_blend *blend, uint32_t slot) {
    return slot + 1 == blend->slots ? 0 : slot + 1;
}

/* Adds the splat's values, multiplied by the weights. */
static inline void add_weights(sp_wide weight, const float adds[SP_PLANES + 1], bool is_post,
                               float *sums) {
    for (int p = 0; p < SP_PLANES; p++)
        sp_wide_store(sums + p * SP_TILE, sp_wide_load(sums + p * SP_TILE) + weight * adds[p]);
    if (is_post)
        sp_wide_store(sums + SP_PLANES * SP_TILE,
                      sp_wide_load(sums + SP_PLANES * SP_TILE) + weight * adds[SP_PLANES]);
}

/* Aligned columns of a footprint. All weights outside rows [y0, y1) of the box are zero. */
struct column {
    int x, y0, y1;
    sp_wide count; /* numbers of the columns, counted from the box's first column */
    float first_dx, dy[SP_TILE];
    sp_wide weight[SP_TILE], before[SP_TILE]; /* share of the ray before the next slab */
    sp_wide exponent[SP_TILE],
        high[SP_TILE]; /* high: upper bound of the depth from the planes that cut the splat */
};

static void fill_column(const struct sp_blend *blend, const struct sp_tile *tile,
                        const struct sp_splat *s, const struct sp_cut *cut,
                        const struct sp_box *box, int x, struct column *c) {
    c->x = x;
    c->y0 = box->y1;
    c->y1 = box->y0;
    c->count = sp_wide_from_int(sp_wide_int_count() + (x - box->x0));
    c->first_dx = (float)(box->x0 + tile->x) + 0.5f - s->x;
    for (int y = box->y0; y < box->y1; y++) {
        struct sp_pixels px;
        sp_footprint_pixels(blend, tile, s, cut, box, x, y, &px);
        c->weight[y] = px.weight;
        c->exponent[y] = px.exponent;
        c->dy[y] = px.dy;
        c->before[y] = sp_wide_all(0);
        if (s->cuts) {
            c->before[y] = sp_footprint_share(blend, px.exponent, px.low);
            c->high[y] = px.high;
        }
        if (sp_wide_any(sp_wide_lt(sp_wide_all(0), px.weight))) {
            c->y0 = sp_mini(c->y0, y);
            c->y1 = y + 1;
        }
    }
}

/* Computes the depth of the far face of slab k on the rays of the pixels [standard deviations],
 * limited to the range that the planes keep. */
static inline sp_wide compute_depth(const struct sp_blend *blend, const struct sp_splat *s,
                                    const struct sp_span *span, const struct column *c, uint32_t k,
                                    int y) {
    float face = blend->nearest + (float)(k + 1) * blend->thickness - span->distance;
    float first =
        (face - span->slope[0] * c->first_dx - span->slope[1] * c->dy[y]) * span->sharpness;
    sp_wide depth = first - span->slope[0] * span->sharpness * c->count;
    return s->cuts ? sp_wide_min(depth, c->high[y]) : depth;
}

/* Adds the share of a column that lies in slab k. The far face of the slab cuts the column,
 * unless the column ends in this slab. */
static inline void add_slab(const struct sp_blend *blend, bool is_post, const struct sp_splat *s,
                            const struct sp_span *span, struct column *c, uint32_t k, bool is_last,
                            float *sums) {
    const float adds[] = { s->depth, s->emission[0], s->emission[1], s->emission[2], s->value };
    const sp_wide zero = sp_wide_all(0);
    const size_t step = (size_t)(SP_PLANES + is_post) * SP_TILE;
    for (int y = c->y0; y < c->y1; y++) {
        sp_wide next = sp_wide_all(1); /* never less than the share before the near face */
        if (!is_last)
            next =
                sp_footprint_share(blend, c->exponent[y], compute_depth(blend, s, span, c, k, y));
        else if (s->cuts)
            next = sp_footprint_share(blend, c->exponent[y], c->high[y]);
        next = sp_wide_max(next, c->before[y]);
        sp_wide weight = (next - c->before[y]) * c->weight[y];
        c->before[y] = next;
        if (sp_wide_any(sp_wide_lt(zero, weight)))
            add_weights(weight, adds, is_post, sums + (size_t)y * step);
    }
}

/* Adds a splat whose shares differ between pixels. */
static void add_uneven(struct sp_tile *tile, const struct sp_blend *blend,
                       const struct sp_splats *records, uint32_t n, const struct range *slabs,
                       const struct sp_box *box) {
    const struct sp_splat *s = &records->splat[n];
    const struct sp_cut *cut = records->cut ? &records->cut[n] : NULL;
    for (int x = sp_column_first(box); x < box->x1; x += SP_WIDE) {
        struct column c;
        fill_column(blend, tile, s, cut, box, x, &c);
        uint32_t slot = slabs->slot;
        for (uint32_t k = slabs->first; k <= slabs->last; k++, slot = next_slot(blend, slot)) {
            float *sums = sp_sums_row(tile, blend, slot, 0) + x;
            if (blend->post)
                add_slab(blend, true, s, &records->span[n], &c, k, k == slabs->last, sums);
            else
                add_slab(blend, false, s, &records->span[n], &c, k, k == slabs->last, sums);
        }
    }
}

/* True if all rays meet the splat at the same depth, within a thousandth of its standard deviation.
 * This is always so with isotropic kernels. */
static bool is_even(const struct sp_blend *blend, const struct sp_splat *s,
                    const struct sp_span *span) {
    float across = fabsf(span->slope[0]) * (float)(s->x1 - s->x0) +
                   fabsf(span->slope[1]) * (float)(s->y1 - s->y0);
    return !blend->cubic && !s->cuts && across * span->sharpness < 1e-3f;
}

/* Computes the shares that all pixels of such a splat have in common. */
static void compute_shares(const struct sp_blend *blend, const struct sp_span *span,
                           const struct range *slabs, float share[SP_SLOTS_MAX + SP_WIDE]) {
    int last = (int)(slabs->last - slabs->first);
    for (int i = 0; i < last; i += SP_WIDE) {
        sp_wide k = sp_wide_from_int(sp_wide_int_count() + (int32_t)(slabs->first + 1) + i);
        sp_wide face = blend->nearest + k * blend->thickness - span->distance;
        sp_wide_store(share + i, sp_wide_normal_share(face * span->sharpness));
    }
    share[last] = 1;
    for (int i = last; i > 0; i--)
        share[i] -= share[i - 1];
}

/* Adds rows [y0, y1) of weights to one slab. */
static inline void add_rows(const sp_wide *weight, int y0, int y1, const float adds[SP_PLANES + 1],
                            bool is_post, float *sums) {
    const size_t step = (size_t)(SP_PLANES + is_post) * SP_TILE;
    for (int y = y0; y < y1; y++)
        add_weights(weight[y], adds, is_post, sums + (size_t)y * step);
}

static void add_even(struct sp_tile *tile, const struct sp_blend *blend, const struct sp_splat *s,
                     const struct sp_span *span, const struct range *slabs,
                     const struct sp_box *box) {
    float share[SP_SLOTS_MAX + SP_WIDE];
    compute_shares(blend, span, slabs, share);
    for (int x = sp_column_first(box); x < box->x1; x += SP_WIDE) {
        sp_wide weight[SP_TILE];
        int y0 = box->y1, y1 = box->y0; /* outside these rows all weights are zero */
        for (int y = box->y0; y < box->y1; y++) {
            struct sp_pixels px;
            sp_footprint_pixels(blend, tile, s, NULL, box, x, y, &px);
            weight[y] = px.weight;
            if (sp_wide_any(sp_wide_lt(sp_wide_all(0), px.weight))) {
                y0 = sp_mini(y0, y);
                y1 = y + 1;
            }
        }
        uint32_t slot = slabs->slot;
        for (uint32_t k = slabs->first; k <= slabs->last; k++, slot = next_slot(blend, slot)) {
            float part = share[k - slabs->first], *sums = sp_sums_row(tile, blend, slot, 0) + x;
            const float adds[] = { s->depth * part, s->emission[0] * part, s->emission[1] * part,
                                   s->emission[2] * part, s->value * part };
            if (blend->post)
                add_rows(weight, y0, y1, adds, true, sums);
            else
                add_rows(weight, y0, y1, adds, false, sums);
        }
    }
}

void sp_slab_add(struct sp_tile *tile, const struct sp_blend *blend,
                 const struct sp_splats *records, uint32_t n) {
    const struct sp_splat *s = &records->splat[n];
    const struct sp_span *span = &records->span[n];
    advance(tile, blend, s->sheet);
    if (tile->saturated)
        return;
    struct sp_box box = sp_tile_box(tile, s);
    struct range slabs = bound_slabs(blend, s, span);
    if (is_even(blend, s, span))
        add_even(tile, blend, s, span, &slabs, &box);
    else
        add_uneven(tile, blend, records, n, &slabs, &box);
    uint32_t slot = slabs.slot;
    for (uint32_t k = slabs.first; k <= slabs.last; k++, slot = next_slot(blend, slot))
        sp_slot_touch(&tile->dirty[slot], &box);
}
