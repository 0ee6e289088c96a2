/* SPDX-License-Identifier: Apache-2.0
 *
 * Chooses the subvolume that a frame draws of a volume that is larger than memory
 * (data/bricks/README.md).
 *
 *   view ─► the level that pixels ask for ─► bricks that may be seen ─► bricks/store.h ─► a volume
 *              └── a coarser one if they do not fit ◄──┘
 */
#ifndef SP_WORKING_SET_WORKING_SET_H
#define SP_WORKING_SET_WORKING_SET_H

#include "data/bricks/store.h"
#include "splat/camera.h"

struct sp_working_set_job {
    struct sp_brick_store *store;
    const struct sp_view *view;
    unsigned level;    /* the finest level that the frame asks for */
    unsigned least;    /* no finer level is drawn, not even the volume that was opened */
    bool reads_blocks; /* the backend can draw volumes whose samples lie in blocks */
    double wait_ms;    /* for bricks; INFINITY = until the frame is complete */
    bool takes_parts;  /* as in sp_brick_store_get() */
    bool (*is_cancelled)(void *user);
    void *user;
};

struct sp_working_set {
    struct sp_volume *volume; /* a reference */
    unsigned level;           /* of its samples */
    unsigned coarsest;  /* coarsest level that the subvolume shows where finer bricks are missing */
    unsigned asked;     /* the finest level that fits into memory */
    bool is_being_read; /* a later frame can have more bricks */
    bool is_complete;   /* no brick that the frame needs is missing */
    uint64_t wanted, resident; /* bricks of level `asked`: needed, and of these in memory */
    bool is_empty;             /* the frame shows no part of the volume */
};

/* Fills *set, and *subvolume with its volume and the place of that in the whole volume.
 * SP_ERR_CANCELLED, SP_ERR_MEMORY. */
bool sp_working_set_choose(const struct sp_working_set_job *job, struct sp_working_set *set,
                           struct sp_brick_subvolume *subvolume, struct sp_error *err);

/* Converts the view for the subvolume's volume: the clip box and the boxes of edits, which are
 * fractions of the whole volume, become fractions of the subvolume. */
void sp_working_set_view(const struct sp_brick_header *header,
                         const struct sp_brick_subvolume *subvolume, const struct sp_view *view,
                         struct sp_view *out);

/* True if a frame needs the whole level, also beside the image: light comes through the matter
 * there, and connected parts may continue there. */
bool sp_working_set_needs_whole(const struct sp_view *view);

/* True if a frame reads the vectors of the file. (need.c) */
bool sp_working_set_needs_vectors(const struct sp_brick_file *file, const struct sp_view *view);

/* Sets the bricks of a level that the view may show. need->count is 0 if the view shows no brick.
 * False if out of memory. (need.c) */
bool sp_working_set_need(const struct sp_brick_file *file, const struct sp_view *view,
                         unsigned level, bool is_whole, struct sp_brick_need *need);

#endif
