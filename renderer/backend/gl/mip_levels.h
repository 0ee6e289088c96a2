/* SPDX-License-Identifier: Apache-2.0
 *
 * The lists of a frame's levels, brought up to date: which of them change is what the processor
 * decides (classify/cache.h), and entries are made where the samples are.
 *
 *   8, 16 and 32 bits, both orders   GPU, coarse levels too: counts a brick come back, entries stay
 *   64-bit reals, or no room         processor
 */
#ifndef GL_MIP_LEVELS_H
#define GL_MIP_LEVELS_H

#include "backend/gl/residency.h"
#include "classify/cache.h"

struct gl_mip_levels {
    const struct gl_visible_list
        *lists[SP_LEVELS]; /* of the levels that were asked for; else NULL */
    uint64_t visible;      /* voxels of the volume */
};

/* The levels in job->levels; valid until the next call. job->counter is set here. A context must be
 * current. SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED, SP_ERR_BACKEND. */
bool gl_mip_levels_get(struct gl_mip_levels *levels, struct gl_residency *residency,
                       struct sp_classify_cache *cache, struct sp_volume *volume,
                       const struct sp_classify_job *job, struct sp_error *err);

#endif
