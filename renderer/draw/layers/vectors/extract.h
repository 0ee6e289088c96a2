/* SPDX-License-Identifier: Apache-2.0
 *
 * Extracts the samples that a layer of vectors draws: the samples that the transfer function makes
 * visible, each with the direction of its vector and its own phase.
 *
 *   sample, vector ─► class, packed direction, phase = hash of the index ─► splat_list/list.h
 *
 * No voxel of the list is opaque: all codes are 0.
 */
#ifndef SP_VECTORS_EXTRACT_H
#define SP_VECTORS_EXTRACT_H

#include "base/interrupt.h"
#include "base/parallel_for.h"
#include "classify/coloring.h"
#include "draw/layers/splat_list/list.h"
#include "sp/view.h"
#include "sp/volume.h"

struct sp_vectors_job {
    const struct sp_volume *volume; /* must have vectors */
    const struct sp_transfer_function *tf;
    struct sp_coloring coloring;
    const struct sp_clip *clip; /* voxels are clipped by their centres */
    double density;             /* as in struct sp_layer */
    uint64_t bytes_max;         /* of the list */
    struct sp_pool *pool;
    struct sp_interrupt interrupt;
};

/* Fills an empty list. Leaves out samples that are not finite. `normal` is the direction of the
 * vector in world space, packed like a gradient (classify/gradient.h); 0 = the vector is 0 or not
 * finite. The density selects samples by their index in the volume; if the volume is a subvolume of
 * a larger one, by their index in the whole level. SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED;
 * the list is then empty. */
bool sp_vectors_extract(const struct sp_vectors_job *job, struct sp_voxel_list *list,
                        struct sp_error *err);

#endif
