/* SPDX-License-Identifier: Apache-2.0
 *
 * Compositing: the constants of a frame, and the functions that all compositors share.
 *
 *   sheet   splats of one slice of the grid are added, then composited        (sheet.h)
 *   slab    the same for slabs of equal distance from the eye                 (slab.h)
 *   splat   every splat is composited on its own                              (splat.h)
 *
 *   T = Σ τ_k,  E = Σ c_k τ_k,  α = 1 − e^{−T} (linear: min(T, 1)),  C = (E/T)·α
 *   colour += transmittance·C,  transmittance ·= 1 − α
 *
 * A tile is saturated when all its pixels have a transmittance below 1/512. No more splats are
 * added to a saturated tile.
 */
#ifndef SP_FOOTPRINTS_BLEND_H
#define SP_FOOTPRINTS_BLEND_H

#include "base/isa.h"
#include "base/minmax.h"
#include "draw/footprints/tile.h"
#include "frame/resolve.h"
#include "sp/view.h"
#include "splat/exp2.h"

enum { SP_SLOTS_MAX = 512 }; /* layers open at once */

struct sp_insert;
struct sp_layer_places;
struct sp_post;

struct sp_blend {
    enum sp_compositing mode;
    bool linear;     /* attenuation */
    uint32_t planes; /* sums per pixel of a layer: 4; post-classification: 5 */
    uint32_t slots;  /* layers that can be open at a time: 1; slabs: up to SP_SLOTS_MAX */
    float cut;       /* as in sp_ewa_frame */
    const struct sp_cubic_table *cubic; /* NULL = Gaussian */
    float thickness;                    /* of a slab [cells] */
    float nearest;              /* slab k begins at nearest + k·thickness from the eye [cells] */
    const struct sp_post *post; /* NULL = splats are classified already */
    const struct sp_insert *insert;       /* fragments of other layers; NULL = none */
    const struct sp_layer_places *places; /* of layers; NULL = the frame has no depth */
};

/* Composites the sums of an open layer, if it has any, together with the fragments of other layers
 * in front of it and inside it. Clears the sums. Checks for saturation from time to time. */
void sp_layer_close(struct sp_tile *tile, const struct sp_blend *blend, int64_t layer);

/* Sets tile->saturated. */
void sp_tile_check(struct sp_tile *tile);

/* Returns row y of plane 0 of a slot's sums; plane p begins p · SP_TILE floats after it. */
static inline float *sp_sums_row(const struct sp_tile *tile, const struct sp_blend *blend,
                                 uint32_t slot, int y) {
    return tile->sums + ((size_t)slot * SP_TILE + (size_t)y) * blend->planes * SP_TILE;
}

/* Returns the factor of E, (1 − e^{−t})/t, and sets *transmittance to e^{−t}. Linear attenuation:
 * the factor is 1 for t ≤ 1 and 1/t above, and the transmittance is 1 − min(t, 1). */
static inline sp_wide sp_wide_attenuate(bool linear, sp_wide t, sp_wide *transmittance) {
    const sp_wide one = sp_wide_all(1);
    if (linear) {
        *transmittance = sp_wide_keep(sp_wide_lt(t, one), 1 - t);
        return sp_wide_select(sp_wide_lt(one, t), 1 / t, one);
    }
    sp_wide_mask is_small = sp_wide_lt(t, sp_wide_all(0.01f));
    sp_wide e = sp_wide_exp2(-SP_LOG2E * t);
    sp_wide exact = (1 - e) / sp_wide_max(t, sp_wide_all(1e-20f));
    sp_wide series = 1 - t * (0.5f - t * (1.0f / 6));
    *transmittance = sp_wide_select(is_small, 1 - t * series, e);
    return sp_wide_select(is_small, series, exact);
}

/* Returns the first column of the aligned groups of SP_WIDE columns that a box touches. */
static inline int sp_column_first(const struct sp_box *box) {
    return box->x0 & -SP_WIDE;
}

/* Masks the columns from x on that lie in the box. */
static inline sp_wide_mask sp_columns_inside(const struct sp_box *box, int x) {
    return sp_wide_first(box->x1 - x) & ~sp_wide_first(box->x0 - x);
}

/* Grows a slot's dirty box so that it contains `box`. */
static inline void sp_slot_touch(struct sp_box *dirty, const struct sp_box *box) {
    if (dirty->x1 <= dirty->x0) {
        *dirty = *box;
        return;
    }
    *dirty = (struct sp_box){ sp_mini(dirty->x0, box->x0), sp_mini(dirty->y0, box->y0),
                              sp_maxi(dirty->x1, box->x1), sp_maxi(dirty->y1, box->y1) };
}

/* Returns the part of the splat's box that lies in the tile [tile px]. They must overlap. */
static inline struct sp_box sp_tile_box(const struct sp_tile *tile, const struct sp_splat *s) {
    return (struct sp_box){ sp_maxi(s->x0 - tile->x, 0), sp_maxi(s->y0 - tile->y, 0),
                            sp_mini(s->x1 - tile->x, SP_TILE), sp_mini(s->y1 - tile->y, SP_TILE) };
}

/* Composites all open layers. */
void sp_tile_close(struct sp_tile *tile, const struct sp_blend *blend);

#endif
