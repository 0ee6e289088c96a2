/* SPDX-License-Identifier: Apache-2.0
 *
 * Extracts the shell of a volume (Botha and Post 2003, section 2.2) from masks into a list: its
 * voxels with their codes, normals and classes.
 *
 *   in the shell:  opacity >= low, and the opacity of one of the six neighbours < high
 *
 * Beyond the border of the volume the opacity is 0. A sample that is not finite also has opacity 0.
 * A voxel with opacity 0 is never in the shell. A voxel with an opacity of `high` or more is
 * opaque: it hides everything behind it.
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
    /* from: an older list of the same volume. changed: by pair of sides (masks.h), whether a block
     * there has changed since. Rows that no change can have reached are copied from the older list.
     * from: NULL = extract all rows. */
    const struct sp_voxel_list *from;
    const uint8_t *changed; /* NULL = no block has changed */
    /* By row, the interval that clipping keeps. Voxels outside count as transparent, so that a cut
     * through opaque material belongs to the shell. `from` is not clipped. NULL = nothing is
     * clipped. */
    const struct sp_voxel_interval *clip;
    bool same_classes;  /* copied voxels also keep their classes */
    uint64_t bytes_max; /* of the list */
    struct sp_pool *pool;
    const struct sp_interrupt *interrupt;
};

/* Fills an empty list with the shell. SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED; the list is
 * then empty. */
bool sp_shell_extract(const struct sp_shell_extract *job, struct sp_voxel_list *list,
                      struct sp_error *err);

#endif
