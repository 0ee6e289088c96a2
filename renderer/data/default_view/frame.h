/* SPDX-License-Identifier: Apache-2.0
 *
 * Chooses the distance of the camera, so that the visible matter fills the image.
 */
#ifndef SP_DEFAULT_VIEW_FRAME_H
#define SP_DEFAULT_VIEW_FRAME_H

#include "data/default_view/orient.h"
#include "sp/view.h"

/* Sets position, target, up and height for camera->fov_y. If nothing is visible or memory is short,
 * the camera does not change. */
void sp_default_frame(const struct sp_default_samples *samples,
                      const double extinction[SP_FIRST_BINS],
                      const struct sp_default_orientation *orientation, struct sp_camera *camera);

#endif
