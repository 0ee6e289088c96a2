/* SPDX-License-Identifier: Apache-2.0
 *
 * The volume that the tests of classify/ share.
 */
#ifndef UNIT_CLASSIFY_VOLUME_H
#define UNIT_CLASSIFY_VOLUME_H

#include "data/volume/volume.h"

/* Returns a regular grid of unit spacing with these values, x fastest. The caller unrefs it. */
struct sp_volume *classify_make_volume(const uint32_t dims[3], enum sp_type type,
                                       const void *voxels);

#endif
