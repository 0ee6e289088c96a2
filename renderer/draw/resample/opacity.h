/* SPDX-License-Identifier: Apache-2.0
 *
 * Opacities and optical depths.
 */
#ifndef SP_RESAMPLE_OPACITY_H
#define SP_RESAMPLE_OPACITY_H

#include "draw/resample/resample.h"
#include "splat/exp2.h"

/* 1 − opacity of an optical depth. */
static inline sp_wide sp_transmit(const struct sp_resample *r, sp_wide depth) {
    if (r->is_linear)
        return sp_wide_max(1 - depth, sp_wide_all(0));
    return sp_wide_exp2(depth * -SP_LOG2E);
}

/* The depth of an opacity that is multiplied by `scale`. */
static inline sp_wide sp_scale_depth(sp_wide depth, sp_wide scale) {
    sp_wide opacity = scale * (1 - sp_wide_exp2(depth * -SP_LOG2E));
    return sp_wide_log2(sp_wide_max(1 - opacity, sp_wide_all(1e-30f))) * (-1 / SP_LOG2E);
}

/* The scale of the opacity at the gradient's magnitude. */
static inline sp_wide sp_gradient_scale(const struct sp_transfer_function *tf, sp_wide magnitude) {
    sp_wide scale;
    for (int i = 0; i < SP_WIDE; i++)
        scale[i] = (float)sp_transfer_function_scale(tf, (double)magnitude[i]);
    return scale;
}

#endif
