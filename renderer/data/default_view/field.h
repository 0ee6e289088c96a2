/* SPDX-License-Identifier: Apache-2.0
 *
 * Transfer functions of fields, whose values matter more than their surfaces.
 */
#ifndef SP_DEFAULT_VIEW_FIELD_H
#define SP_DEFAULT_VIEW_FIELD_H

#include "data/default_view/samples.h"
#include "sp/view.h"

/* Computes the colour of a value; share: its position in the range, [0, 1]. The colour map is
 * viridis without its darkest part: equal differences of the value look equal (Smith and van der
 * Walt 2015). */
void sp_default_field_color(double share, float color[3]);

/* True if values of both signs lie around 0, and 0 is the usual one: a wind along an axis, an
 * orbital, the result of a test. */
bool sp_default_is_signed(const struct sp_default_samples *samples);

/* Chooses blue below 0 and red above 0, symmetric; values near 0 are transparent. Fills points and
 * point_count of *tf, whose reference length is set. */
void sp_default_show_signed(const struct sp_default_samples *samples,
                            struct sp_transfer_function *tf);

/* True if the samples are distances from a closed surface at 0, in any unit: the file says so, or
 * their slope is the same nearly everywhere, per world unit or per voxel. *per_voxel is the
 * usual slope, > 0. */
bool sp_default_is_distance(const struct sp_volume *volume,
                            const struct sp_default_samples *samples, double *per_voxel);

/* Adds the surface at 0 as a layer, and sets a transfer function that shows the inside. */
void sp_default_show_distance(const struct sp_default_samples *samples, double per_voxel,
                              struct sp_view *view);

#endif
