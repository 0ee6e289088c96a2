/* SPDX-License-Identifier: Apache-2.0
 *
 * Computes the pixels of a footprint, SP_WIDE pixels of a row at a time, in columns that are
 * aligned in the tile: the weights, and where planes cut the kernel on the rays of the pixels. It
 * serves every kernel and compositor; the sheet compositor has a faster loop for plain Gaussians.
 */
#ifndef SP_FOOTPRINTS_FOOTPRINT_H
#define SP_FOOTPRINTS_FOOTPRINT_H

#include "draw/footprints/blend.h"
#include "splat/normal.h"

/* The value of a bound that does not exist. */
#define SP_UNBOUNDED 1e4f

struct sp_pixels {
    sp_wide dx; /* from the splat's centre to the centres of the pixels [px] */
    float dy;
    sp_wide weight;    /* 0 outside the box and beyond the cutoff */
    sp_wide exponent;  /* p of sp_splat */
    sp_wide low, high; /* bounds of depth, in standard deviations */
};

/* Returns the share of the kernel along the ray that lies before `depth` [standard deviations from
 * the mean], at pixels with this exponent. */
static inline sp_wide sp_footprint_share(const struct sp_blend *blend, sp_wide exponent,
                                         sp_wide depth) {
    if (blend->cubic)
        return sp_wide_cubic_share(blend->cubic, exponent / blend->cut, depth);
    return sp_wide_normal_share(depth);
}

/* Applies the planes that cut the splat: planes along the ray are factors of the weights, other
 * planes bound the depth. */
static inline void sp_footprint_cut(const struct sp_blend *blend, const struct sp_splat *s,
                                    const struct sp_cut *cut, struct sp_pixels *px) {
    for (uint32_t i = 0; i < s->cuts; i++) {
        const struct sp_cut_plane *plane = &cut->planes[i];
        sp_wide eta = plane->e + plane->k[0] * px->dx + plane->k[1] * px->dy;
        if (plane->side > 0)
            px->low = sp_wide_max(px->low, -eta);
        else if (plane->side < 0)
            px->high = sp_wide_min(px->high, eta);
        else
            px->weight *= sp_footprint_share(blend, px->exponent, eta);
    }
}

/* Computes the pixels of row y in the aligned columns from x on [tile px]. `cut`: the splat's
 * planes; not read if s->cuts is 0. */
static inline void sp_footprint_pixels(const struct sp_blend *blend, const struct sp_tile *tile,
                                       const struct sp_splat *s, const struct sp_cut *cut,
                                       const struct sp_box *box, int x, int y,
                                       struct sp_pixels *px) {
    float first = (float)(box->x0 + tile->x) + 0.5f - s->x;
    px->dx = first + sp_wide_from_int(sp_wide_int_count() + (x - box->x0));
    px->dy = (float)(y + tile->y) + 0.5f - s->y;
    float l = s->b * px->dy, q = s->c * px->dy * px->dy;
    px->exponent = (s->a * px->dx + l) * px->dx + q;
    sp_wide_mask inside = sp_columns_inside(box, x);
    if (blend->cubic)
        px->weight = sp_wide_cubic_weight(blend->cubic, px->exponent * (1 / blend->cut));
    else
        px->weight = sp_wide_exp2(-px->exponent);
    inside &= sp_wide_le(px->exponent, sp_wide_all(blend->cut));
    px->weight = sp_wide_keep(inside, px->weight);
    px->low = sp_wide_all(-SP_UNBOUNDED);
    px->high = sp_wide_all(SP_UNBOUNDED);
    if (s->cuts)
        sp_footprint_cut(blend, s, cut, px);
}

/* Like sp_footprint_pixels(), but also multiplies the weights by the share of the kernel between
 * the bounds of depth. */
static inline void sp_footprint_weights(const struct sp_blend *blend, const struct sp_tile *tile,
                                        const struct sp_splat *s, const struct sp_cut *cut,
                                        const struct sp_box *box, int x, int y,
                                        struct sp_pixels *px) {
    sp_footprint_pixels(blend, tile, s, cut, box, x, y, px);
    if (!s->cuts)
        return;
    sp_wide share = sp_footprint_share(blend, px->exponent, px->high) -
                    sp_footprint_share(blend, px->exponent, px->low);
    px->weight *= sp_wide_max(share, sp_wide_all(0));
}

#endif
