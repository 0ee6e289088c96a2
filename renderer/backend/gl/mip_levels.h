/* SPDX-License-Identifier: Apache-2.0
 *
 * Brings the lists of a frame's mip levels up to date. The CPU decides which lists change
 * (classify/cache.h). The entries are made by:
 *
 *   8, 16 and 32 bits, both orders      GPU, all levels; only the counts per brick are read back
 *   64-bit reals, or too little memory  CPU
 */
#ifndef GL_MIP_LEVELS_H
#define GL_MIP_LEVELS_H

#include "backend/gl/residency.h"
#include "classify/cache.h"

struct gl_mip_levels {
    const struct gl_visible_list *lists[SP_LEVELS]; /* NULL = level not in job->levels */
    uint64_t visible;                               /* voxels of the volume */
};

/* Gets the lists of job->levels, which are valid until the next call. The function sets
 * job->counter. A context must be current. SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED,
 * SP_ERR_BACKEND. */
bool gl_mip_levels_get(struct gl_mip_levels *levels, struct gl_residency *residency,
                       struct sp_classify_cache *cache, struct sp_volume *volume,
                       const struct sp_classify_job *job, struct sp_error *err);

#endif
