/* SPDX-License-Identifier: Apache-2.0
 *
 * Chooses which side of the volume is up, and from where the camera looks.
 */
#ifndef SP_DEFAULT_VIEW_ORIENT_H
#define SP_DEFAULT_VIEW_ORIENT_H

#include "base/vec.h"
#include "data/default_view/samples.h"

struct sp_default_orientation {
    struct sp_vec3 up, away; /* unit vectors: up; from the target to the camera */
};

struct sp_default_orientation sp_default_orient(const struct sp_default_samples *samples,
                                                const double extinction[SP_FIRST_BINS]);

#endif
