/* SPDX-License-Identifier: Apache-2.0 */
#include "tile/slab.h"

#include <math.h>

#include "tile/footprint.h"

/* Closes every slab before `layer`. */
static void advance(struct sp_tile *tile, const struct sp_blend *blend, uint32_t layer) {
    if (tile->sheet == SP_NO_SHEET)
        tile->sheet = layer;
    for (uint32_t k = 0; k < blend->slots && tile->sheet < layer; k++, tile->sheet++)
        sp_layer_close(tile, blend, (uint32_t)((uint64_t)tile->sheet % blend->slots));
    if (tile->sheet < layer)
        tile->sheet = layer; /* all were closed on the way */
}

/* The slabs that a splat lies in: first, last. */
struct range {
    uint32_t first, last;
};

static struct range find_slabs(const struct sp_blend *blend, const struct sp_splat *s,
                               const struct sp_span *span) {
    float from = floorf((span->distance - span->reach - blend->nearest) / blend->thickness);
    float to = floorf((span->distance + span->reach - blend->nearest) / blend->thickness);
    float low = (float)s->sheet, high = (float)(s->sheet + blend->slots - 1);
    from = fminf(fmaxf(from, low), high);
    to = fminf(fmaxf(to, from), high);
    return (struct range){ (uint32_t)from, (uint32_t)to };
}

/* Adds weights times what the splat adds. */
static inline void add_to(float *sums, sp_wide weight, const float adds[SP_PLANES + 1],
                          uint32_t planes) {
    for (uint32_t p = 0; p < planes; p++)
        sp_wide_store(sums + p * SP_TILE, sp_wide_load(sums + p * SP_TILE) + weight * adds[p]);
}

static void add_weights(sp_wide weight, const float adds[SP_PLANES + 1], bool is_post,
                        float *sums) {
    if (is_post)
        add_to(sums, weight, adds, SP_PLANES + 1);
    else
        add_to(sums, weight, adds, SP_PLANES);
}

/* Depth of the far face of slab k on the rays of the pixels, in standard deviations, no farther
 * than planes let them see. `count`: of the columns, from the box's first on. */
static inline sp_wide find_depth(const struct sp_blend *blend, const struct sp_splat *s,
                                 const struct sp_span *span, const struct sp_pixels *px, uint32_t k,
                                 float first_dx, sp_wide count) {
    float face = blend->nearest + (float)(k + 1) * blend->thickness - span->distance;
    float first = (face - span->slope[0] * first_dx - span->slope[1] * px->dy) * span->sharpness;
    sp_wide depth = first - span->slope[0] * span->sharpness * count;
    return s->cuts ? sp_wide_min(depth, px->high) : depth;
}

/* Pixels of row y in the columns from x on: their shares in each of the slabs. */
static void add_pixels(struct sp_tile *tile, const struct sp_blend *blend,
                       const struct sp_splats *records, uint32_t n, const struct range *slabs,
                       const struct sp_box *box, int x, int y) {
    const struct sp_splat *s = &records->splat[n];
    const struct sp_span *span = &records->span[n];
    const float adds[] = { s->depth, s->emission[0], s->emission[1], s->emission[2], s->value };
    const sp_wide zero = sp_wide_all(0), one = sp_wide_all(1);
    struct sp_pixels px;
    sp_footprint_pixels(blend, tile, s, records->cut ? &records->cut[n] : NULL, box, x, y, &px);
    float first_dx = (float)(box->x0 + tile->x) + 0.5f - s->x;
    sp_wide count = sp_wide_from_int(sp_wide_int_count() + (x - box->x0));
    sp_wide before = s->cuts ? sp_footprint_share(blend, px.exponent, px.low) : zero;
    for (uint32_t k = slabs->first; k <= slabs->last; k++) {
        sp_wide next = one; /* the share before the far face, not less than that before the near */
        if (k < slabs->last)
            next = sp_footprint_share(blend, px.exponent,
                                      find_depth(blend, s, span, &px, k, first_dx, count));
        else if (s->cuts)
            next = sp_footprint_share(blend, px.exponent, px.high);
        next = sp_wide_max(next, before);
        sp_wide weight = (next - before) * px.weight;
        if (sp_wide_any(sp_wide_lt(zero, weight)))
            add_weights(weight, adds, blend->post != NULL,
                        sp_sums_row(tile, blend, k % blend->slots, y) + x);
        before = next;
    }
}

/* Whether all rays of a splat meet it at the same depth, within a thousandth of its deviation: so
 * with isotropic kernels, always. */
static bool is_even(const struct sp_blend *blend, const struct sp_splat *s,
                    const struct sp_span *span) {
    float across = fabsf(span->slope[0]) * (float)(s->x1 - s->x0) +
                   fabsf(span->slope[1]) * (float)(s->y1 - s->y0);
    return !blend->cubic && !s->cuts && across * span->sharpness < 1e-3f;
}

/* Shares of every pixel of a splat that is even. */
static void find_shares(const struct sp_blend *blend, const struct sp_span *span,
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

/* The same for a splat that is even: its shares are those of every pixel. */
static void add_even(struct sp_tile *tile, const struct sp_blend *blend, const struct sp_splat *s,
                     const struct sp_span *span, const struct range *slabs,
                     const struct sp_box *box) {
    float share[SP_SLOTS_MAX + SP_WIDE];
    size_t step = blend->planes * (size_t)SP_TILE;
    find_shares(blend, span, slabs, share);
    for (int x = sp_column_first(box); x < box->x1; x += SP_WIDE) {
        sp_wide weight[SP_TILE];
        for (int y = box->y0; y < box->y1; y++) {
            struct sp_pixels px;
            sp_footprint_pixels(blend, tile, s, NULL, box, x, y, &px);
            weight[y] = px.weight;
        }
        for (uint32_t k = slabs->first; k <= slabs->last; k++) {
            float part = share[k - slabs->first], *sums;
            const float adds[] = { s->depth * part, s->emission[0] * part, s->emission[1] * part,
                                   s->emission[2] * part, s->value * part };
            sums = sp_sums_row(tile, blend, k % blend->slots, box->y0) + x;
            for (int y = box->y0; y < box->y1; y++, sums += step)
                add_weights(weight[y], adds, blend->post != NULL, sums);
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
    struct range slabs = find_slabs(blend, s, span);
    if (is_even(blend, s, span))
        add_even(tile, blend, s, span, &slabs, &box);
    else
        for (int y = box.y0; y < box.y1; y++)
            for (int x = sp_column_first(&box); x < box.x1; x += SP_WIDE)
                add_pixels(tile, blend, records, n, &slabs, &box, x, y);
    for (uint32_t k = slabs.first; k <= slabs.last; k++)
        sp_slot_touch(&tile->dirty[k % blend->slots], &box);
}
