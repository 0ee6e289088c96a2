/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/surface/filter.h"

#include "splat/adaptive.h"

struct sp_filter sp_surface_filter(const struct sp_filter *view) {
    struct sp_filter filter = *view;
    const double adaptive_lowpass = 0.5;
    filter.kernel = SP_KERNEL_GAUSSIAN;
    filter.sigma = sp_kernel_sigma(view);
    if (view->kernel == SP_KERNEL_CUBIC)
        filter.cutoff = 3;
    if (view->mode == SP_FILTER_ADAPTIVE)
        filter.lowpass *= adaptive_lowpass;
    else if (view->mode == SP_FILTER_RECONSTRUCTION || view->mode == SP_FILTER_NONE)
        filter.lowpass = 0;
    return filter;
}
