/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SP_SPLAT_LEVEL_FRAME_H
#define SP_SPLAT_LEVEL_FRAME_H

#include "classify/classification.h"
#include "splat/ewa.h"

/* One mip level of the volume, as a frame draws it. Element 0 of each array serves bricks whose
 * voxels are small enough in the image, element 1 enlarged bricks (sp_detail_brick.is_enlarged). */
struct sp_level_frame {
    const struct sp_level *level; /* NULL = the frame draws nothing of this level */
    struct sp_ewa_frame ewa[2];
    const uint8_t *modes[2]; /* enum sp_filter_mode by brick; NULL = not the adaptive filter */
};

#endif
