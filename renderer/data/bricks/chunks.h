/* SPDX-License-Identifier: Apache-2.0
 *
 * A volume whose levels come in chunks from another source, such as OME-Zarr. It is used like a
 * brick file (file.h): bricks are cut from chunks when a frame needs them. The range of a brick is
 * known once the brick and its neighbours have been read (learned.h).
 */
#ifndef SP_BRICKS_CHUNKS_H
#define SP_BRICKS_CHUNKS_H

#include "data/bricks/format.h"

struct sp_chunk_level {
    uint32_t dims[3];
    uint32_t chunk[3];         /* samples of a chunk; fewer at the far ends */
    double step[3], offset[3]; /* as in struct sp_brick_level */
};

struct sp_chunk_source {
    /* Of level 0: grid, type, unit, names, anatomy, steps; no range and no histogram. */
    struct sp_volume_info info;
    unsigned levels; /* in [1, BRICK_LEVELS_MAX]; each is coarser than the one before */
    struct sp_chunk_level level[BRICK_LEVELS_MAX];
    unsigned readers; /* threads that may read at the same time, in [1, 64] */
    uint64_t bytes;   /* memory that the readers need */
    bool is_remote;   /* reading is slow: the volume in memory is smaller */
    void *user;
    /* Reads the chunk at a place of the grid of chunks: all its samples that lie in the level, i0
     * fastest. Each thread has a reader of its own. Returns within 100 ms after is_cancelled() is
     * true. SP_ERR_CANCELLED; any other code is an error of this chunk alone. */
    bool (*read)(void *user, unsigned reader, unsigned level, const uint32_t place[3], void *out,
                 bool (*is_cancelled)(void *cancel), void *cancel, struct sp_error *err);
    void (*close)(void *user);
};

/* Computes the first sample and the size of a chunk. */
void sp_chunk_box(const struct sp_chunk_level *level, const uint32_t place[3], uint32_t first[3],
                  uint32_t size[3]);

/* Returns the bytes of the largest chunk. */
uint64_t sp_chunk_bytes_max(const struct sp_chunk_source *source);

#endif
