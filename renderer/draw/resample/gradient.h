/* SPDX-License-Identifier: Apache-2.0
 *
 * The gradient that gives an interval its normal. It is mixed from two gradients:
 *
 *   fine     differences over one sample (integrate.c): sharp, with the noise of the samples
 *   smooth   over two samples, with means across (smooth.h): half as sharp, a third of the noise
 *
 * The directions of both may differ more than noise explains: then the fine gradient sees a detail,
 * and stays. If they differ less, the difference is noise, and the fine gradient turns into the
 * direction of the smooth gradient:
 *
 *             fine                  fine  = along + aside    along: its part in the direction of
 *            ▲╲ aside                                        the smooth one
 *            │ ╲                    mixed = along + keep·aside
 *   smooth ◄─┴──┘                   keep  = a⁴/(a⁴ + n⁴)     a = |aside|, n: what noise explains
 *
 * `keep` resembles a Wiener filter, but only across the smooth gradient: light depends on the
 * direction of a gradient, not on its length. (Ours. The fourth power gives images nearer to exact
 * ones than the second power: tests/bench/results/notes/exact.md.)
 */
#ifndef SP_RESAMPLE_GRADIENT_H
#define SP_RESAMPLE_GRADIENT_H

#include "base/wide.h"

/* Mixes the smooth gradient into the fine one, in the lanes of `lanes`. noise_square: n² [square of
 * the gradients' unit]; keep_max: upper limit of `keep`, [0, 1]. */
static inline void sp_gradient_mix(const sp_wide smooth[3], sp_wide noise_square, sp_wide keep_max,
                                   sp_wide_mask lanes, sp_wide fine[3]) {
    const sp_wide zero = sp_wide_all(0), one = sp_wide_all(1), tiny = sp_wide_all(1e-20f);
    sp_wide square = tiny, along = zero, aside_square = tiny, aside[3];
    for (int c = 0; c < 3; c++) {
        square += smooth[c] * smooth[c];
        along += fine[c] * smooth[c];
    }
    along =
        sp_wide_max(along * sp_wide_fast_inverse(square), zero); /* in lengths of the smooth one */
    for (int c = 0; c < 3; c++) {
        aside[c] = fine[c] - along * smooth[c];
        aside_square += aside[c] * aside[c];
    }
    sp_wide ratio =
        sp_wide_min(noise_square * sp_wide_fast_inverse(aside_square), sp_wide_all(1e9f));
    sp_wide keep = keep_max * sp_wide_fast_inverse(1 + ratio * ratio);
    along += (one - keep) * sp_wide_max(one - along, zero);
    for (int c = 0; c < 3; c++)
        fine[c] = sp_wide_select(lanes, along * smooth[c] + keep * aside[c], fine[c]);
}

#endif
