/* SPDX-License-Identifier: Apache-2.0
 *
 * The bricks of a file that are in memory, as subvolumes: boxes of one level with the bricks that a
 * frame needs. A subvolume is an ordinary volume, so every backend and mode can draw it.
 *
 *   need ─► is there a subvolume? ─► its volume
 *              └► a thread fills one: a coarser level first if there are many bricks; while it
 *                 reads, subvolumes with what it has, whose other bricks are coarse
 *
 * Subvolumes are shared by all frames of the volume. The least recently used ones are dropped when
 * they exceed the budget; frames keep a reference to what they draw. All functions are thread-safe.
 */
#ifndef SP_BRICKS_STORE_H
#define SP_BRICKS_STORE_H

#include "data/bricks/fill.h"
#include "sp/volume.h"

struct sp_brick_store;

/* Opens a brick file as a volume of its finest small level, whose source is a store. Takes over the
 * descriptor, also on failure. Calls options->reserve() for the budget of subvolumes and the index.
 * The name and the source are written to the description. The file has a shared lock (flock()) as
 * long as the volume lives, so that the brick cache knows which files are open. */
struct sp_volume *sp_brick_store_open(int fd, const char *name, const char *source,
                                      const struct sp_load_options *options, struct sp_error *err);

/* Like sp_brick_store_open(), for chunks. Takes over their source, also on failure. Calls
 * options->progress() while it reads the volume that it returns. SP_ERR_BUDGET: the coarsest level
 * is too large. */
struct sp_volume *sp_brick_store_open_chunks(const struct sp_chunk_source *chunks, const char *name,
                                             const char *source,
                                             const struct sp_load_options *options,
                                             struct sp_error *err);

/* Returns the store of a volume; NULL = the whole volume is in memory. Valid as long as the
 * volume. */
struct sp_brick_store *sp_brick_store_of(const struct sp_volume *volume);

const struct sp_brick_file *sp_brick_store_file(const struct sp_brick_store *store);
/* Returns the level of the opened volume. */
unsigned sp_brick_store_base(const struct sp_brick_store *store);
/* Returns the most bytes that one subvolume may cost (sp_brick_need_cost()). */
uint64_t sp_brick_store_subvolume_max(const struct sp_brick_store *store);

/* True if no other store of the memory was asked by a frame in the last 30 s. */
bool sp_brick_store_is_alone(const struct sp_brick_store *store);

/* Computes the need for a coarser level of the same box: the bricks that cover the bricks of
 * `need`. False if memory runs out, or if the level is not finer than the opened volume. */
bool sp_brick_store_coarsen(const struct sp_brick_store *store, const struct sp_brick_need *need,
                            unsigned steps, struct sp_brick_need *coarser);

/* Where the samples of a subvolume lie in the whole volume. */
struct sp_brick_subvolume {
    struct sp_volume *volume; /* a reference; NULL = none */
    unsigned level;
    uint32_t first[3], size[3]; /* samples of the level */
    uint64_t lost;              /* bricks with an array of the need that could not be read */
    uint32_t lost_box[2][3]; /* one lost brick, voxels of level 0: the first voxel, and one past the
                                last */
    bool is_wanted; /* the subvolume has all wanted bricks; false: it is coarser until they are read
                     */
    uint64_t bytes; /* cost of the subvolume; 0 = it is the opened volume */
    uint64_t missing;  /* bricks of the need that a coarser level shows */
    unsigned coarsest; /* the coarsest level that it shows */
};

/* Returns the subvolume of a need. If the subvolume is not in memory, the store reads it, and the
 * call waits for it up to wait_ms; INFINITY = without limit. After that it returns the best
 * available data: a part of the subvolume, the finest coarser subvolume, or the opened volume. With
 * `takes_parts`, the call also returns when the store has read another part or a coarser level.
 * False if `is_cancelled` became true (SP_ERR_CANCELLED), or if memory ran out after waiting
 * without limit. */
bool sp_brick_store_get(struct sp_brick_store *store, const struct sp_brick_need *need,
                        double wait_ms, bool takes_parts, bool (*is_cancelled)(void *user),
                        void *user, struct sp_brick_subvolume *subvolume, struct sp_error *err);

/* Returns the opened volume, which has all vectors. Lost vectors count only if has_vectors is true:
 * the frame shows them. */
void sp_brick_store_get_base(struct sp_brick_store *store, bool has_vectors,
                             struct sp_brick_subvolume *subvolume);

/* Gets the number of bricks in subvolumes, and the bytes that the subvolumes cost. */
void sp_brick_store_usage(struct sp_brick_store *store, uint64_t *bricks, uint64_t *bytes);

#endif
