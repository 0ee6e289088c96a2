/* SPDX-License-Identifier: Apache-2.0
 *
 * The samples that a layer of vectors draws: those that the transfer function makes visible, each
 * with the direction of its vector and a phase of its own.
 *
 *   sample, vector ─► class, packed direction, phase = hash of the index ─► splat_list/list.h
 *
 * No voxel of the list is opaque: the codes are 0.
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
    const struct sp_volume *volume; /* with vectors */
    const struct sp_transfer_function *tf;
    struct sp_coloring coloring;
    const struct sp_clip *clip; /* voxels are clipped by their centres */
    double density;             /* as in struct sp_layer */
    uint64_t bytes_max;         /* of the list */
    struct sp_pool *pool;
    struct sp_interrupt interrupt;
};

/* Makes an empty list. Samples that are not finite are left out. `normal` is the direction of the
 * vector in world space, packed like a gradient (classify/gradient.h), and 0 if the vector is 0 or
 * not finite. Which samples have a place in the list depends on the density alone, and on their
 * index in the volume, or in a level of it if that is larger than memory. SP_ERR_MEMORY,
 * SP_ERR_BUDGET, SP_ERR_CANCELLED; the list is then empty. */
bool sp_vectors_extract(const struct sp_vectors_job *job, struct sp_voxel_list *list,
                        struct sp_error *err);

#endif
