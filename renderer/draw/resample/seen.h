/* SPDX-License-Identifier: Apache-2.0
 *
 * Where an interval between two sheets is seen. The gradient at this place lights the interval: in
 * its middle there may be the plateau behind a surface, whose gradient is only noise.
 *
 *         value ▁▁▂▄▆████                  Each half of the interval has a visible part: where the
 *   interval    ├────┼────┤                value lies in the curve's bins. `front` is where the ray
 *   first half  ├─▒▒▒┤                     enters that part.
 *   second half      ├▒▒▒▒┤
 *   seen           ▲
 *
 * Light that a layer of constant extinction and optical depth d sends to the eye comes on average
 * from the share
 *
 *   x(d) = ∫ t e^(−d t) dt / ∫ e^(−d t) dt = 1/d − 1/(e^d − 1)        t from 0 to 1
 *
 * of its thickness (ours; the weights of the volume rendering integral, Max 1995). Where the second
 * half emits more light than the first, light also rises inside the halves. The more of the first
 * half is visible and the more the light rises, the farther back both halves are seen, by up to an
 * eighth. Light that rises linearly from zero would want a third; an eighth is nearer to images by
 * brute force (measured).
 *
 * The interval is seen at the mean of both halves' places, weighted by the light that they send to
 * the eye.
 */
#ifndef SP_RESAMPLE_SEEN_H
#define SP_RESAMPLE_SEEN_H

#include "base/wide.h"

struct sp_seen_half {
    sp_wide front, length; /* of the visible part [shares of the half] */
    sp_wide depth;         /* optical depth */
    sp_wide light;         /* emitted: brightness times optical depth, in any unit */
};

/* Returns x(d) for d >= 0 with an error below 0.02: the inverse of the first terms of the series of
 * 1/x, which has no cancellation at small d. */
static inline sp_wide sp_seen_share(sp_wide d) {
    return sp_wide_fast_inverse(2 + d * (1 / 3.0f + d * (1 / 18.0f)));
}

/* Returns the place where the interval is seen: 0 at its start, 1 at its end. opacity: of the first
 * half, and of both. */
static inline sp_wide sp_seen_place(const struct sp_seen_half half[2], const sp_wide opacity[2]) {
    const sp_wide tiny = sp_wide_all(1e-30f), one = sp_wide_all(1);
    const sp_wide light[2] = { half[0].light, half[1].light };
    sp_wide both = sp_wide_fast_inverse(sp_wide_max(light[0] + light[1], tiny));
    sp_wide more = sp_wide_max(light[1] - light[0], sp_wide_all(0));
    sp_wide rise = 1 + 0.125f * half[0].length * more * both;
    sp_wide place[2];
    for (int k = 0; k < 2; k++)
        place[k] = half[k].front + half[k].length * sp_seen_share(half[k].depth) * rise;
    /* Of each half: opacity · light / depth, both times the product of the depths. */
    const float faint = 1e-6f; /* keeps the light of a half beside one without depth */
    sp_wide first = opacity[0] * light[0] * (half[1].depth + faint);
    sp_wide second = (opacity[1] - opacity[0]) * light[1] * (half[0].depth + faint);
    sp_wide all = sp_wide_max(first + sp_wide_max(second, sp_wide_all(0)), tiny);
    first = sp_wide_min(first * sp_wide_fast_inverse(all), one);
    return 0.5f * (1 + place[1] + first * (place[0] - place[1] - 1));
}

#endif
