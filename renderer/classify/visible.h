/* SPDX-License-Identifier: Apache-2.0
 *
 * Lists of the visible voxels, slice by slice along one axis of the grid: what sheets are made of.
 *
 *   slice s ─► entries [first[s], first[s+1])      entry e: position[e], key[e], normal[e]
 *
 * The list along axis 2 is made by one pass over the volume; the other two are permutations of it
 * and are made when a view first needs them. 8 bytes an entry, 12 with normals.
 */
#ifndef SP_CLASSIFY_VISIBLE_H
#define SP_CLASSIFY_VISIBLE_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#include "base/parallel_for.h"
#include "classify/transfer.h"

struct sp_visible {
    uint32_t slices;    /* dims[axis]; 0 = no list */
    uint64_t count;     /* entries */
    uint64_t *first;    /* slices + 1 */
    uint32_t *position; /* index along the lower of the other two axes, the higher one << 16 */
    uint32_t *key;      /* see transfer.h */
    uint32_t *normal;   /* packed gradient (gradient.h); NULL = not made */
};

void sp_visible_finish(struct sp_visible *list);

/* The visible voxels at one resolution. */
struct sp_level {
    struct sp_grid grid;
    struct sp_transfer transfer; /* of the lists' keys */
    struct sp_visible lists[3];  /* by axis */
};
enum { SP_LEVELS = 3 };

/* Everything derived from one volume under one transfer function: all voxels in levels[0], then
 * coarser and coarser ones (coarse.h), made when they are first asked for. */
struct sp_classification {
    struct sp_volume *volume; /* one reference */
    struct sp_level levels[SP_LEVELS];
};

/* Frees what the level holds; it is then empty. */
void sp_level_finish(struct sp_level *level);

/* One reference to the volume is taken. */
void sp_classification_init(struct sp_classification *c, struct sp_volume *volume);
void sp_classification_finish(struct sp_classification *c);

/* What an update needs beside the classification. */
struct sp_classify_job {
    const struct sp_transfer_function *tf;
    unsigned level;     /* that will be used, below SP_LEVELS */
    unsigned axis;      /* of its list that will be used, 0 … 2 */
    bool normals;       /* that list must have them */
    uint64_t bytes_max; /* of the whole classification; 0 = no limit */
    struct sp_pool *pool;
    const atomic_bool *cancel; /* NULL = never */
};

/* Brings the list of job->level and job->axis up to date, doing only what the changes ask for: a
 * new colour costs a table (and the coarse levels), a new set of visible values a pass over the
 * volume. On failure what is out of date is dropped: SP_ERR_MEMORY, SP_ERR_BUDGET,
 * SP_ERR_CANCELLED. */
bool sp_classification_update(struct sp_classification *c, const struct sp_classify_job *job,
                              struct sp_error *err);

/* Memory for list->count entries, with normals or without; SP_ERR_MEMORY. */
bool sp_visible_allocate(struct sp_visible *list, bool normals, struct sp_error *err);

/* Bytes kept, without the volume itself. */
uint64_t sp_classification_bytes(const struct sp_classification *c);

#endif
