/* SPDX-License-Identifier: Apache-2.0
 *
 * The cached data of one volume under one transfer function: a pyramid of levels, each with its
 * list of visible voxels. Also the job that brings the levels up to date.
 *
 *   levels[0]     all voxels (collect.h)
 *   levels[n]     2^n × 2^n × 2^n voxels averaged into one (mip.h), made when first needed
 */
#ifndef SP_CLASSIFY_LEVEL_H
#define SP_CLASSIFY_LEVEL_H

#include "classify/visible.h"
#include "sp/inflight.h"

/* The visible voxels at one resolution. All memory is owned by the level. */
struct sp_level {
    struct sp_grid grid;
    double *coordinates[3]; /* of `grid`, owned; NULL = the axis is evenly spaced, or `grid` borrows
                               the volume's coordinates */
    struct sp_transfer transfer; /* gives the meaning of the list's keys */
    struct sp_visible visible;
    /* By key: 1 if the list holds voxels of that key, which may be more than the visible ones (see
     * sp_classification_fit()). Only the finest level of types with a table, order pre; else NULL.
     */
    uint8_t *listed;
    struct sp_range *ranges; /* by brick, of all its values; finest level only; NULL = not made */
    /* By axis of the slices, brick and slice: the largest depth of a class (depths.h); NULL = not
     * made. */
    float (*depths[3])[SP_BRICK];
    double reach; /* order post: kernel radius that the list was made for [voxels] */
    /* Serial numbers of the list with its normals, and of the table. Each number changes whenever
     * its data is made, so that the owner of a copy can tell that the copy is stale. 0 = none. */
    uint64_t list_made, table_made;
    uint64_t
        *cells; /* order post, only while the list is being made: by brick, reach.h; else NULL */
};

enum { SP_LEVELS = 8 }; /* 16 · 2^7 = 2048 voxels per axis are one brick of the last level */

struct sp_classification {
    struct sp_volume *volume; /* one reference */
    uint64_t *histogram;      /* number of voxels of each key, owned; NULL = not made */
    uint64_t visible;         /* visible voxels in the finest list */
    struct sp_level levels[SP_LEVELS];
};

/* Counts list entries on a device other than the CPU, which then makes the lists. The
 * classification keeps only the inputs of the lists (`listed`, `reach`, grids) and the number of
 * entries of each brick. It has no entries, and no classes of coarse levels. */
struct sp_counter {
    /* Fills counts[bricks of the level's list] with the number of entries of each brick. Finest
     * level: counts the voxels whose keys are in `listed`. Without `listed` counts the visible
     * voxels (order post: the voxels that can matter, reach.h). Coarse level: counts the cells that
     * contain such a voxel; finer levels are complete. False with *err set. */
    bool (*count)(void *user, const struct sp_classification *c, unsigned level, uint64_t *counts,
                  struct sp_error *err);
    /* Fills counts[keys of the finest level's transfer] with the number of voxels of each key; only
     * for types with a table. False with *err set. */
    bool (*histogram)(void *user, const struct sp_classification *c, uint64_t *counts,
                      struct sp_error *err);
    void *user; /* passed to both */
};

enum { SP_NO_AXIS = 3 };

/* The inputs of an update besides the classification. All pointers are borrowed for the call. */
struct sp_classify_job {
    const struct sp_transfer_function *tf;
    uint32_t levels; /* bit l = level l is needed, l < SP_LEVELS */
    unsigned axis; /* [0, 2]: slices of the bricks are perpendicular to this axis; SP_NO_AXIS = any
                      axis, but always the same one */
    bool normals;  /* the lists must have normals */
    double reach;  /* order post: kernel radius [voxels] */
    /* Another classification of the same volume, from which lists are copied where possible; NULL =
     * none. */
    const struct sp_classification *from;
    bool widens; /* a new list may include more voxels than the visible ones, so that similar edits
                    need no new list */
    uint64_t *made; /* last serial number given to a list or table; NULL = no numbers */
    const struct sp_counter
        *counter;       /* NULL = the CPU makes the lists; otherwise `made` is needed */
    uint64_t bytes_max; /* limit of the whole classification; 0 = none */
    struct sp_pool *pool;
    const atomic_bool *cancel; /* NULL = never */
    struct sp_pause *pause;    /* NULL = never */
};

/* Frees the list and its inputs. */
void sp_level_drop_list(struct sp_level *level);

/* Frees the depths. Call it when the list or the table changes. */
void sp_level_drop_depths(struct sp_level *level);

/* Frees all memory of the level; it is then empty. */
void sp_level_finish(struct sp_level *level);

/* True if the job is cancelled; *err is then SP_ERR_CANCELLED. While the frame is paused, the call
 * waits. */
bool sp_classify_cancelled(const struct sp_classify_job *job, struct sp_error *err);

#endif
