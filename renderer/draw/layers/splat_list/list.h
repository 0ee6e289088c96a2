/* SPDX-License-Identifier: Apache-2.0
 *
 * Voxels of a volume that are drawn one by one, in the lists of Botha and Post (2003, section 2.2).
 *
 *   P   first[row]  ─► voxels [first[row], first[row + 1]) of the row, rising along axis 0
 *   D   voxels      row by row and slice by slice
 */
#ifndef SP_SPLAT_LIST_LIST_H
#define SP_SPLAT_LIST_LIST_H

#include <stdbool.h>
#include <stdint.h>

#include "sp/status.h"

/* Bits of a voxel's code: the neighbour on the low or high side of an axis is opaque. */
#define SP_VOXEL_LOW(axis) (1u << (2 * (axis)))
#define SP_VOXEL_HIGH(axis) (2u << (2 * (axis)))
enum { SP_VOXEL_OPAQUE = 64 /* the voxel itself is opaque */ };

struct sp_voxel {
    uint16_t at[3];    /* index in the volume */
    uint16_t code;     /* bits as above */
    uint32_t normal;   /* packed gradient (classify/gradient.h), or packed vector */
    uint16_t color[3]; /* of the class, in 65535ths */
    uint16_t phase;    /* of a streak, in 65536ths (vectors/); shells: 0 */
    float depth;       /* optical depth over the reference length, > 0 */
};

struct sp_voxel_list {
    uint32_t dims[3];
    uint32_t *first;         /* P: [dims[1] · dims[2] + 1], owned; NULL = no list */
    struct sp_voxel *voxels; /* D: [count], owned */
    uint32_t count;
    /* Which rows have voxels, and how many voxels each slice has: [0] by slice of axis 1, [1] by
     * slice of axis 2. A bit of rows[0] stands for a slice of axis 2, a bit of rows[1] for a slice
     * of axis 1. Owned. */
    uint64_t *rows[2];
    uint32_t *slice_counts[2];
};

static inline uint64_t sp_voxel_list_rows(const struct sp_voxel_list *list) {
    return (uint64_t)list->dims[1] * list->dims[2];
}

/* To make a list: set `dims`, call start(), and write the number of voxels of each row to
 * first[row + 1]. Then call sum(), which turns the counts into starts and allocates `voxels`, and
 * write the voxels. SP_ERR_MEMORY; sum() also SP_ERR_BUDGET with `remedy` in the message. After a
 * failure, call finish(). */
bool sp_voxel_list_start(struct sp_voxel_list *list, struct sp_error *err);
bool sp_voxel_list_sum(struct sp_voxel_list *list, uint64_t bytes_max, const char *remedy,
                       struct sp_error *err);
void sp_voxel_list_finish(struct sp_voxel_list *list);
uint64_t sp_voxel_list_bytes(const struct sp_voxel_list *list);

#endif
