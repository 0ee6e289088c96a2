/* SPDX-License-Identifier: Apache-2.0
 *
 * Connected parts: the samples in a range of values that are connected with a point, through the
 * faces of neighbouring samples in the range.
 */
#ifndef SP_PART_CONNECT_H
#define SP_PART_CONNECT_H

#include "inspect/part/mask.h"
#include "sp/volume.h"

/* Fills *all with the samples in the range, and *mine with the connected part of the sample in the
 * range that is nearest to the point (world). Only samples at most two samples from the point along
 * each axis are tried; *is_found = false: none of them is in the range. Both masks must be {0}
 * before the call; the caller finishes them, also after a failure. SP_ERR_MEMORY. */
bool sp_part_connect(const struct sp_volume_info *info, const void *voxels, const double point[3],
                     const double range[2], struct sp_pool *pool, struct sp_mask *all,
                     struct sp_mask *mine, bool *is_found, struct sp_error *err);

#endif
