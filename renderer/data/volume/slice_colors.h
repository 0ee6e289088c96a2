/* SPDX-License-Identifier: Apache-2.0
 *
 * How slices show values.
 */
#ifndef SP_VOLUME_SLICE_COLORS_H
#define SP_VOLUME_SLICE_COLORS_H

#include "sp/view.h"

/* Writes the colour of a value that is not NaN, between the points of a transfer function, whatever
 * their opacity. */
void sp_points_color(const struct sp_transfer_function *tf, double value, double rgb[3]);

/* Writes the colour of a value that is not NaN as the slices of a view show it. */
void sp_slice_color(const struct sp_view *view, double value, double rgb[3]);

#endif
