/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SP_SURFACE_FILTER_H
#define SP_SURFACE_FILTER_H

#include "sp/view.h"

/* The filter of a surface. Kernels end where the view says, and not later than where the rest is
 * below the rounding of coverage. */
struct sp_filter sp_surface_filter(const struct sp_filter *view);

#endif
