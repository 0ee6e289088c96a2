/* SPDX-License-Identifier: Apache-2.0
 *
 * Everything derived from one volume under one transfer function, kept from frame to frame and
 * brought up to date with as little work as a change asks for.
 */
#ifndef SP_CLASSIFY_CLASSIFICATION_H
#define SP_CLASSIFY_CLASSIFICATION_H

#include "classify/visible.h"
#include "sp/inflight.h"

/* The visible voxels at one resolution. */
struct sp_level {
    struct sp_grid grid;
    double *coordinates[3];      /* of `grid`, where they are the level's own */
    struct sp_transfer transfer; /* of the list's keys */
    struct sp_visible visible;
    uint8_t *listed; /* finest level, types with a table, order pre: by key, what the list holds:
                        what is visible and more (see sp_classification_fit()); else NULL */
    struct sp_range *ranges; /* by brick: of all values; finest level; NULL = not made */
    double reach;            /* order post: the kernel's radius that the list was made for */
    /* Numbers of the list with its normals and of the table: others whenever they are made anew, so
     * that whoever copied them knows. */
    uint64_t list_made, table_made;
    uint64_t *cells; /* order post: reach.h, by brick; while the list is being made, else NULL */
};
enum { SP_LEVELS = 8 }; /* 16 · 2^7 = 2048 voxels an axis are one brick of the last */

/* All voxels in levels[0], then coarser and coarser ones (mip.h), made when they are first asked
 * for. */
struct sp_classification {
    struct sp_volume *volume; /* one reference */
    uint64_t *histogram;      /* voxels by key; NULL = not made */
    uint64_t visible;         /* voxels that are, of those that the finest list holds */
    struct sp_level levels[SP_LEVELS];
};

/* Frees what the level holds; it is then empty. */
void sp_level_finish(struct sp_level *level);

/* One reference to the volume is taken. */
void sp_classification_init(struct sp_classification *c, struct sp_volume *volume);
void sp_classification_finish(struct sp_classification *c);

enum { SP_NO_AXIS = 3 };

struct sp_classification;

/* Who makes the lists where it is not the processor. The classification then keeps what they are
 * made of (`listed`, `reach`, grids) and how many entries each brick has, and no entries, nor
 * classes of coarse levels. */
struct sp_counter {
    /* Fills counts[bricks of the level's list]: the voxels of each that are in `listed`, and
     * without it those that are visible (order post: that can matter, reach.h); of a coarse level
     * the cells with such a voxel. Finer levels are there, with their numbers. False with *err set.
     */
    bool (*count)(void *user, const struct sp_classification *c, unsigned level, uint64_t *counts,
                  struct sp_error *err);
    /* Fills counts[keys of the finest level's transfer] with the volume's voxels of each; types
     * with a table alone. */
    bool (*histogram)(void *user, const struct sp_classification *c, uint64_t *counts,
                      struct sp_error *err);
    void *user;
};

/* What an update needs beside the classification. */
struct sp_classify_job {
    const struct sp_transfer_function *tf;
    uint32_t levels; /* bit l: level l will be used, l < SP_LEVELS */
    unsigned axis;   /* that the bricks are to be cut along, or SP_NO_AXIS: always the same */
    bool normals;    /* their lists must have them */
    double reach;    /* order post: the kernel's radius, voxels */
    const struct sp_classification
        *from;      /* of the same volume, to derive lists from; NULL = none */
    bool widens;    /* a new list is to serve more edits like the one that made it necessary */
    uint64_t *made; /* counts the lists and tables that are made; NULL = they get no numbers */
    const struct sp_counter *counter; /* NULL = the processor makes the lists; needs `made` */
    uint64_t bytes_max;               /* of the whole classification; 0 = no limit */
    struct sp_pool *pool;
    const atomic_bool *cancel; /* NULL = never */
    struct sp_pause *pause;    /* NULL = never */
};

/* Brings the lists of job->levels up to date, doing only what the changes ask for: a
 * new colour costs a table (and the coarse levels); a new set of visible values, given lists to
 * derive from, the bricks that have such values (change.h), else a pass over the volume. On failure
 * what is out of date is dropped: SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED. */
bool sp_classification_update(struct sp_classification *c, const struct sp_classify_job *job,
                              struct sp_error *err);

/* How far the list is one for another transfer function. A list may hold voxels that are not
 * visible: their depth is 0, set-up leaves them out, and the picture is the same. So an edit that
 * hides values is a new table and nothing else, and one that shows some is as well if the list was
 * widened to hold them. */
struct sp_fit {
    uint64_t visible; /* voxels under the new one */
    uint64_t missing; /* of them, not in the list */
    uint64_t excess;  /* in the list and not visible */
};

/* False when the list cannot serve: none, another order, a type without a table; SP_ERR_MEMORY is
 * set when that is why, else *err is left alone. */
bool sp_classification_fit(struct sp_classification *c, const struct sp_transfer *to,
                           const struct sp_classify_job *job, struct sp_fit *fit,
                           struct sp_error *err);

/* Whether a list that lacks nothing is still good enough: at most a quarter too long. */
bool sp_fit_is_close(const struct sp_fit *fit);

/* Bytes kept, without the volume itself. */
uint64_t sp_classification_bytes(const struct sp_classification *c);

/* Whether the job is to stop; SP_ERR_CANCELLED is then set. Stands still while the frame is to. */
bool sp_classify_cancelled(const struct sp_classify_job *job, struct sp_error *err);

#endif
