/* SPDX-License-Identifier: Apache-2.0
 *
 * Where an interval between two sheets is seen. The gradient at this place lights the interval: in
 * its middle there may be the plateau behind a surface, whose gradient is only noise.
 *
 *         value ▁▁▂▄▆████                  Each half of the interval has a visible part: where the
 *   interval    ├────┼────┤                value lies in the curve's bins. Its front is the place
 *   first half  ├─▒▒▒┤                     where the ray enters that part, its depth the optical
 *   second half      ├▒▒▒▒┤                depth of the half.
 *   seen           ▲
 *
 * Light that a layer of constant extinction and optical depth d sends to the eye comes on average
 * from the share
 *
 *   ∫ t e^(−d t) dt / ∫ e^(−d t) dt = 1/d − 1/(e^d − 1)        t from 0 to 1
 *
 * of its thickness (ours; the weights are those of the volume rendering integral, Max 1995). The
 * interval is seen at the mean of both halves' places, each with the opacity that it adds.
 */
#ifndef SP_RESAMPLE_SEEN_H
#define SP_RESAMPLE_SEEN_H

#include "base/wide.h"

/* The visible part of half an interval [shares of the half]. */
struct sp_seen_half {
    sp_wide front, length;
};

/* Returns 1/d − 1/(e^d − 1) for d >= 0 with an error below 0.02: the inverse of the first terms of
 * the inverse's series, which has no cancellation at small d. */
static inline sp_wide sp_seen_share(sp_wide d) {
    return sp_wide_fast_inverse(2 + d * (1 / 3.0f + d * (1 / 18.0f)));
}

/* Returns the place where the interval is seen: 0 at its start, 1 at its end. depth: optical depth
 * of each half. opacity: of the first half, and of both. */
static inline sp_wide sp_seen_place(const struct sp_seen_half half[2], const sp_wide depth[2],
                                    const sp_wide opacity[2]) {
    const sp_wide tiny = sp_wide_all(1e-20f), one = sp_wide_all(1);
    sp_wide place[2];
    for (int k = 0; k < 2; k++)
        place[k] = half[k].front + half[k].length * sp_seen_share(depth[k]);
    sp_wide first = opacity[0] * sp_wide_fast_inverse(sp_wide_max(opacity[1], tiny));
    first = sp_wide_min(first, one);
    return 0.5f * (1 + place[1] + first * (place[0] - place[1] - 1));
}

#endif
