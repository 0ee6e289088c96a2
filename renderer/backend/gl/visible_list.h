/* SPDX-License-Identifier: Apache-2.0
 *
 * The visible voxels of one mip level on the GPU, as shaders/passes/project.glsl reads them.
 *
 *   entries   one word per entry, in the order of the bricks: i0 | i1 << 4 | i2 << 8 | key << 12
 *   tables    [scale of the opacity by packed magnitude, four per row][rows of rectilinear axes]
 *             [classes: colour and depth, by key; by entry where keys do not fit the word]
 *   normals   gradients or microflakes as classify/ packs them
 *
 * The order of entries inside a brick does not matter to frames.
 */
#ifndef GL_VISIBLE_LIST_H
#define GL_VISIBLE_LIST_H

#include "backend/gl/buffer.h"
#include "classify/classification.h"

struct gl_visible_list {
    /* Not references, see gl_residency_evict(); NULL = empty. `original` is sp_volume_original().
     */
    const struct sp_volume *volume, *original;
    uint64_t list_made, table_made; /* generation numbers of the level when it was uploaded */
    uint64_t used;                  /* clock of the last use */
    struct sp_grid grid;            /* of the level */
    uint32_t bricks[3];             /* per axis, axis 0 fastest */
    uint64_t count;                 /* entries */
    const uint64_t *first;          /* [bricks + 1]: entries of brick b begin at first[b] */
    double base;                    /* values are relative to this (order post) [data units] */
    struct gl_buffer entries, tables, normals;
    bool has_keys;         /* the words contain keys */
    bool has_scales;       /* the tables contain scales of the opacity */
    bool is_rising;        /* entries of a brick are sorted by place, because the GPU made them */
    uint32_t normal_bytes; /* 0 = no normals; 2, 4, 8: as in classify/visible.h */
    uint32_t axis_row[3];  /* row of the tables for sample 0 of each rectilinear axis */
    uint32_t first_class;  /* row of the tables */
};

#endif
