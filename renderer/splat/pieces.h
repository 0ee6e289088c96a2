/* SPDX-License-Identifier: Apache-2.0
 *
 * Evaluates a transfer function for SP_WIDE values at a time, for types without a table. The
 * function consists of linear pieces in single precision; values are relative to the base of the
 * keys (transfer.h):
 *
 *   piece s: values from start[s] on       plane c = at[c][s] + (value − start[s]) · slope[c][s]
 *
 * The planes c are red, green, blue and the opacity, from which the depth follows. Piece 0 holds
 * all values below the first point.
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

/* Red, green, blue and depth of SP_WIDE values, relative to the base and finite. */
static inline void sp_pieces_planes(const struct sp_pieces *p, sp_wide value, sp_wide out[4]) {
    sp_wide_int piece = sp_wide_int_all(0);
    for (uint32_t s = 1; s < p->count; s++)
        piece += sp_wide_to_int(
            sp_wide_keep(sp_wide_le(sp_wide_all(p->start[s]), value), sp_wide_all(1)));
    value -= sp_wide_look_up(p->start, p->count, piece);
    for (int c = 0; c < 4; c++)
        out[c] = sp_wide_look_up(p->at[c], p->count, piece) +
                 value * sp_wide_look_up(p->slope[c], p->count, piece);
    out[3] = sp_pieces_depth(sp_wide_clamp(out[3], 0, 1));
}

/* Like sp_pieces_planes(), but writes one class per value. */
static inline void sp_pieces_classify(const struct sp_pieces *p, sp_wide value,
                                      struct sp_class out[SP_WIDE]) {
    sp_wide plane[4];
    float lane[4][SP_WIDE];
    sp_pieces_planes(p, value, plane);
    for (int c = 0; c < 4; c++)
        sp_wide_store(lane[c], plane[c]);
    for (int i = 0; i < SP_WIDE; i++)
        out[i] = (struct sp_class){ { lane[0][i], lane[1][i], lane[2][i] }, lane[3][i] };
}

#endif
