/* SPDX-License-Identifier: Apache-2.0
 *
 * The shell of a volume (Botha and Post 2003, section 2.2), from masks to lists: its voxels, their
 * codes, normals and classes.
 *
 *   in the shell:  opacity >= low, and the opacity of one of the six neighbours < high
 *
 * Beyond the border of the volume the opacity is 0; so is that of a sample that is not finite. A
 * voxel without any opacity is never in the shell. One of opacity `high` or more is opaque: it
 * hides what is behind it.
 */
#ifndef SP_SHELL_EXTRACT_H
#define SP_SHELL_EXTRACT_H

#include "draw/layers/shell/masks.h"
#include "draw/layers/splat_list/clip.h"
#include "draw/layers/splat_list/list.h"

struct sp_shell_extract {
    const struct sp_shell_masks *masks;
    const struct sp_shell_states *states;
    const struct sp_volume *volume;
    /* An older list of the same volume, and by pair of sides (masks.h) whether a block there has
     * changed since. Rows that no change can have reached are copied from it. NULL = extract
     * all. */
    const struct sp_voxel_list *from;
    const uint8_t *changed; /* NULL = nothing has */
    /* By row, what clipping leaves of it: the rest counts as transparent, so that a cut through
     * opaque material belongs to the shell. `from` is not clipped. NULL = nothing is clipped. */
    const struct sp_voxel_interval *clip;
    bool same_classes;  /* copied voxels keep their classes, too */
    uint64_t bytes_max; /* of the list */
    struct sp_pool *pool;
    const struct sp_interrupt *interrupt;
};

/* Makes an empty list into the shell. SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED; the list is
 * then empty. */
bool sp_shell_extract(const struct sp_shell_extract *job, struct sp_voxel_list *list,
                      struct sp_error *err);

#endif
