/* SPDX-License-Identifier: Apache-2.0
 *
 * Draws a shell (Botha and Post 2003) on the CPU. README.md of this folder explains how.
 *
 *   volume ─► masks ─► lists P and D ─► order ─► records ─► tiles ─┬► image
 *            (cached, cache.h)         (order.h)       (kernels.h) └► fragments
 */
#ifndef SP_SHELL_SHELL_H
#define SP_SHELL_SHELL_H

#include "shell/cache.h"
#include "shell/kernels.h"
#include "shell/order.h"

/* All pointers are borrowed until the frame is drawn. */
struct sp_shell_input {
    const struct sp_view *view;
    const struct sp_layer *layer; /* of type SP_LAYER_SHELL */
    struct sp_volume *volume;
    struct sp_frame *frame; /* sp_shell_draw(): its pixels; NULL for sp_shell_prepare() */
    const struct sp_camera_transform *camera;
    const struct sp_shade *shade; /* NULL = not lit */
    struct sp_shell_cache *cache;
    uint64_t bytes_max; /* of the cache */
    const struct sp_shell_kernels *kernels;
    struct sp_interrupt interrupt;
    bool keeps_hidden; /* draws hidden voxels as well; for tests */
    struct sp_pool *pool;
    struct sp_arena *arena;
};

/* A prepared frame. */
struct sp_shell {
    const struct sp_shell_input *input;
    const struct sp_shell_list *list;
    struct sp_shell_frame frame;
    struct sp_shell_order order;
    int columns, rows;               /* of tiles */
    struct sp_shell_record *records; /* of the voxels that are in the image */
    uint32_t *first;                 /* [columns · rows + 1] */
    uint32_t *entries;               /* of tile t: record numbers [first[t], first[t + 1]) */
    uint64_t drawn;                  /* records */
    double area;                     /* of their footprints, px */
};

/* Draws a frame that shows nothing but the shell: every pixel, and the stats (visible_voxels: of
 * the shell; splats: without hidden ones and those outside of the image). Memory of the frame does
 * not depend on the number of voxels but for 4 bytes each. SP_ERR_MEMORY, SP_ERR_BUDGET,
 * SP_ERR_CANCELLED. */
bool sp_shell_draw(const struct sp_shell_input *input, struct sp_error *err);

/* Finds what a shell is drawn from: `list`, `frame` and `order`. Errors as above. */
bool sp_shell_find(const struct sp_shell_input *input, struct sp_shell *shell,
                   struct sp_error *err);

/* Prepares the same shell for sp_shell_tile(). The arena holds about 80 bytes per drawn voxel.
 * Errors as above. */
bool sp_shell_prepare(const struct sp_shell_input *input, struct sp_shell *shell,
                      struct sp_error *err);

/* Adds the fragments of tile (column, row) of SP_FRAGMENT_TILE px to `tile`, which is empty and
 * lies there. Splats of a pixel whose depths differ by less than half a voxel become one fragment.
 * Tiles may be drawn on several threads at a time. */
void sp_shell_tile(const struct sp_shell *shell, int column, int row,
                   struct sp_fragment_tile *tile);

#endif
