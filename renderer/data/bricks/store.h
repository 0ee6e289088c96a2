/* SPDX-License-Identifier: Apache-2.0
 *
 * The bricks of a file that are in memory, as windows: boxes of one level with the bricks that a
 * frame needs. A window is a volume like any other, so that every backend and mode draws it.
 *
 *   need ─► is there a window? ─► its volume
 *              └► a thread fills one: a coarser level first if there are many bricks; while it
 *                 reads, windows with what it has, whose other bricks are coarse
 *
 * Windows are shared by all frames of the volume. The least recently used ones are dropped when
 * they exceed the budget; frames keep a reference to what they draw. All functions are thread-safe.
 */
#ifndef SP_BRICKS_STORE_H
#define SP_BRICKS_STORE_H

#include "data/bricks/fill.h"
#include "sp/volume.h"

struct sp_brick_store;

/* Opens a brick file, of which it takes over the descriptor, also on failure: a volume of its
 * finest small level, whose source is a store. Calls options->reserve() for the budget of windows
 * and the index. The name and the source are written to the description. The file has a shared lock
 * (flock()) as long as the volume lives, so that the brick cache knows which files are open. */
struct sp_volume *sp_brick_store_open(int fd, const char *name, const char *source,
                                      const struct sp_load_options *options, struct sp_error *err);

/* The same for chunks. Takes over their source, also on failure. Calls options->progress() while it
 * reads the volume that it returns. SP_ERR_BUDGET: the coarsest level is too large. */
struct sp_volume *sp_brick_store_open_chunks(const struct sp_chunk_source *chunks, const char *name,
                                             const char *source,
                                             const struct sp_load_options *options,
                                             struct sp_error *err);

/* The store of a volume; NULL = all of it is in memory. Valid as long as the volume. */
struct sp_brick_store *sp_brick_store_of(const struct sp_volume *volume);

const struct sp_brick_file *sp_brick_store_file(const struct sp_brick_store *store);
/* The level of the volume that was opened. */
unsigned sp_brick_store_base(const struct sp_brick_store *store);
/* Most bytes that one window costs (sp_brick_need_cost()). */
uint64_t sp_brick_store_window_max(const struct sp_brick_store *store);

/* True if no other store of the memory was asked by a frame in the last 30 s. */
bool sp_brick_store_is_alone(const struct sp_brick_store *store);

/* The need for a coarser level of the same box: the bricks that cover those of `need`. False
 * without memory, or if it is none finer than the volume that was opened. */
bool sp_brick_store_coarsen(const struct sp_brick_store *store, const struct sp_brick_need *need,
                            unsigned steps, struct sp_brick_need *coarser);

/* Where the samples of a window lie in the whole volume. */
struct sp_brick_window {
    struct sp_volume *volume; /* a reference; NULL = none */
    unsigned level;
    uint32_t first[3], size[3]; /* samples of the level */
    uint64_t lost;              /* bricks of which an array that the need has could not be read */
    uint32_t lost_box[2][3];    /* of one of them, voxels of level 0: first, and past the last */
    bool is_wanted;    /* it has all wanted bricks; false: it is coarser, until these are read */
    uint64_t bytes;    /* that it costs; 0 = it is the volume that was opened */
    uint64_t missing;  /* of the need: bricks that a coarser level shows */
    unsigned coarsest; /* the coarsest level that it shows */
};

/* Returns the window of a need. If it is not there, the store reads it: the call waits up to
 * wait_ms [ms] for it, INFINITY = until it is there, and then returns what is there: a part of it,
 * the finest coarser one, or the volume that was opened. With `takes_parts` it also returns when
 * the store has read another part, or a coarser level. False if `is_cancelled` became true
 * (SP_ERR_CANCELLED), or, after waiting without limit, out of memory. */
bool sp_brick_store_get(struct sp_brick_store *store, const struct sp_brick_need *need,
                        double wait_ms, bool takes_parts, bool (*is_cancelled)(void *user),
                        void *user, struct sp_brick_window *window, struct sp_error *err);

/* Returns the volume that was opened, which has all vectors. Those that are lost count if
 * `has_vectors`: the frame shows them. */
void sp_brick_store_get_base(struct sp_brick_store *store, bool has_vectors,
                             struct sp_brick_window *window);

/* Bricks in windows, and bytes that these cost. */
void sp_brick_store_usage(struct sp_brick_store *store, uint64_t *bricks, uint64_t *bytes);

#endif
