/* SPDX-License-Identifier: Apache-2.0
 *
 * Evaluates a transfer function for SP_WIDE values at a time, for types without a table. Linear
 * pieces in single precision, relative to the base of the keys (transfer.h):
 *
 *   piece s: values from start[s] on       class = at[s] + (value − start[s]) · slope[s]
 *
 * with the opacity in place of the depth. Piece 0 holds everything below the first point.
 */
#ifndef SP_SPLAT_PIECES_H
#define SP_SPLAT_PIECES_H

#include "base/wide.h"
#include "classify/transfer.h"
#include "splat/exp2.h"

/* −ln(1 − a) for a in [0, 1]. */
static inline sp_wide sp_pieces_depth(sp_wide a) {
    sp_wide s = a / (2.0f - a), t = s * s;
    sp_wide thin = s * (2.0f + t * (2.0f / 3 + t * (2.0f / 5 + t * (2.0f / 7 + t * (2.0f / 9)))));
    sp_wide_mask is_thick = sp_wide_lt(sp_wide_all(0.4f), a);
    if (!sp_wide_any(is_thick))
        return thin;
    sp_wide left = sp_wide_max(1.0f - a, sp_wide_all(1e-30f));
    return sp_wide_select(is_thick, sp_wide_log2(left) * -0.693147181f, thin);
}

/* Fills the classes of SP_WIDE values, relative to the base and finite. */
static inline void sp_pieces_classify(const struct sp_pieces *p, sp_wide value,
                                      struct sp_class out[SP_WIDE]) {
    typedef float four __attribute__((vector_size(16)));
    sp_wide_int piece = sp_wide_int_all(0);
    for (uint32_t s = 1; s < p->count; s++)
        piece += sp_wide_to_int(
            sp_wide_keep(sp_wide_le(sp_wide_all(p->start[s]), value), sp_wide_all(1)));
    int32_t at[SP_WIDE];
    float along[SP_WIDE], depth[SP_WIDE];
    sp_wide_int_store(at, piece);
    sp_wide_store(along, value - sp_wide_gather(p->start, piece));
    for (int i = 0; i < SP_WIDE; i++) {
        four from, slope;
        memcpy(&from, p->at[at[i]], sizeof from);
        memcpy(&slope, p->slope[at[i]], sizeof slope);
        from += along[i] * slope;
        memcpy(&out[i], &from, sizeof from);
        depth[i] = from[3];
    }
    sp_wide opacity = sp_wide_min(sp_wide_max(sp_wide_load(depth), sp_wide_all(0)), sp_wide_all(1));
    sp_wide_store(depth, sp_pieces_depth(opacity));
    for (int i = 0; i < SP_WIDE; i++)
        out[i].depth = depth[i];
}

#endif
