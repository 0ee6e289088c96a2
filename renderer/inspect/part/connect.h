/* SPDX-License-Identifier: Apache-2.0
 *
 * Connected parts: the samples in a range of values that faces of such samples connect with a
 * point.
 */
#ifndef SP_PART_CONNECT_H
#define SP_PART_CONNECT_H

#include "inspect/part/mask.h"
#include "sp/volume.h"

/* Fills *all with the samples in the range, and *mine with those that are connected with the one
 * nearest to the point (world), which is at most two samples from it along each axis; *is_found =
 * false: there is none. The masks are all zero; the caller finishes them, whatever is returned.
 * SP_ERR_MEMORY. */
bool sp_part_connect(const struct sp_volume_info *info, const void *voxels, const double point[3],
                     const double range[2], struct sp_pool *pool, struct sp_mask *all,
                     struct sp_mask *mine, bool *is_found, struct sp_error *err);

#endif
