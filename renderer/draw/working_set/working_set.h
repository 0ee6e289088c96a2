/* SPDX-License-Identifier: Apache-2.0
 *
 * Of a volume that is larger than memory (data/bricks/README.md), a frame draws a window.
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
    unsigned level;    /* the finest one that the frame asks for */
    unsigned least;    /* no finer one is drawn, not even the volume that was opened */
    bool reads_blocks; /* what draws the frame reads volumes whose samples lie in blocks */
    double wait_ms;    /* for bricks; INFINITY = until the frame is complete */
    bool takes_parts;  /* as in sp_brick_store_get() */
    bool (*is_cancelled)(void *user);
    void *user;
};

struct sp_working_set {
    struct sp_volume *volume;  /* a reference */
    unsigned level;            /* of its samples */
    unsigned coarsest;         /* of those that are interpolated between coarser ones */
    unsigned asked;            /* the finest level that fits into memory */
    bool is_being_read;        /* more bricks will be there later */
    bool is_complete;          /* nothing is missing on that level */
    uint64_t wanted, resident; /* bricks of it */
    bool is_empty;             /* nothing is seen */
};

/* Finds what to draw, and its place in the whole volume. SP_ERR_CANCELLED, SP_ERR_MEMORY. */
bool sp_working_set_choose(const struct sp_working_set_job *job, struct sp_working_set *window,
                           struct sp_brick_window *place, struct sp_error *err);

/* Writes the view for the window's volume: what a view gives in fractions of the whole volume, its
 * clip box and boxes of edits, becomes fractions of the window. */
void sp_working_set_view(const struct sp_brick_header *header, const struct sp_brick_window *window,
                         const struct sp_view *view, struct sp_view *out);

/* True if a frame needs the whole level: light comes through what lies beside the image, and parts
 * are connected there. */
bool sp_working_set_needs_whole(const struct sp_view *view);

/* True if a frame reads the vectors of the file. (need.c) */
bool sp_working_set_needs_vectors(const struct sp_brick_file *file, const struct sp_view *view);

/* Finds the bricks of a level that the view may show. False without memory. `need->count` is 0 if
 * it shows none. (need.c) */
bool sp_working_set_need(const struct sp_brick_file *file, const struct sp_view *view,
                         unsigned level, bool is_whole, struct sp_brick_need *need);

#endif
