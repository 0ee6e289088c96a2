/* SPDX-License-Identifier: Apache-2.0
 *
 * Applies one edit to a copy of a volume's samples.
 */
#ifndef SP_EDIT_APPLY_H
#define SP_EDIT_APPLY_H

#include <stdatomic.h>

#include "base/parallel_for.h"
#include "sp/view.h"
#include "sp/volume.h"

/* The samples that are edited. */
struct sp_edited {
    const struct sp_volume_info *info; /* grid and type */
    void *voxels;
    double empty; /* the new value of removed samples; NaN needs a floating-point type */
    atomic_uint_fast64_t holes; /* samples that became NaN */
    struct sp_pool *pool;
};

/* Mixes sample `at` with the empty value; share in [0, 1]: 1 = the sample is unchanged, 0 = the
 * sample is removed. If the empty value is NaN, a sample with a share of ½ or more is unchanged,
 * and any other becomes NaN. A sample that is not finite is transparent already and is unchanged.
 * Returns true if the sample became NaN. */
bool sp_edited_keep(const struct sp_edited *edited, uint64_t at, double share);

/* Applies a cut by a plane, a box or a sphere (shapes.c). */
void sp_edit_cut(struct sp_edited *edited, const struct sp_edit *edit);

/* Applies an edit of a connected part (part.c). SP_ERR_MEMORY. */
bool sp_edit_part(struct sp_edited *edited, const struct sp_edit *edit, struct sp_error *err);

#endif
