/* SPDX-License-Identifier: Apache-2.0
 *
 * One edit of a copy of a volume's samples.
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

/* Mixes sample `at` with the empty value: 1 = it stays, 0 = it is removed. If that is NaN, a sample
 * stays as it is from ½ on. A sample that is not finite is transparent, and stays. Returns true if
 * it became NaN. */
bool sp_edited_keep(const struct sp_edited *edited, uint64_t at, double share);

/* A plane, a box or a sphere (shapes.c). */
void sp_edit_cut(struct sp_edited *edited, const struct sp_edit *edit);

/* A connected part (part.c). SP_ERR_MEMORY. */
bool sp_edit_part(struct sp_edited *edited, const struct sp_edit *edit, struct sp_error *err);

#endif
