/* SPDX-License-Identifier: Apache-2.0
 *
 * The first view of a volume without a grid.
 */
#ifndef SP_DEFAULT_VIEW_ELEMENTS_H
#define SP_DEFAULT_VIEW_ELEMENTS_H

#include "sp/view.h"

/* Sets the camera of a view that sp_view_init() has filled, so that the elements fill the image:
 *
 *   points      from the front, z up, as grids without anatomy
 *   gaussians   as most trained scenes are stored: y points down, the front to −z
 *   mesh        y up, the front to +z
 *
 * Of points and Gaussians, the few that lie far away do not count. If there is nothing to see or
 * memory is short, the camera does not change. */
void sp_default_elements(const struct sp_volume *volume, struct sp_view *view);

#endif
