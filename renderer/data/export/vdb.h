/* SPDX-License-Identifier: Apache-2.0
 *
 * The two parts of the OpenVDB writer.
 *
 *   samples ─► vdb_blocks.c: cubes of 128³, in the order of the file
 *           ─► vdb.c: topology, then values
 */
#ifndef SP_EXPORT_VDB_H
#define SP_EXPORT_VDB_H

#include <stdint.h>

#include "data/export/job.h"

enum {
    VDB_LEAF = 8,    /* voxels of a leaf, per axis */
    VDB_BLOCK = 128, /* of a block, the inner node above leaves */
    VDB_ROOT = 4096, /* of a child of the root, the inner node above blocks */
    VDB_LEAF_VOXELS = VDB_LEAF * VDB_LEAF * VDB_LEAF,
    VDB_BLOCK_VOXELS = VDB_BLOCK * VDB_BLOCK * VDB_BLOCK,
};

/* The samples of the volume in a temporary file, block after block. Blocks lie in the order of
 * OpenVDB: axis 0 slowest. In a block axis 0 is fastest, as in the volume, and samples outside are
 * 0. */
struct sp_vdb_blocks {
    uint32_t count[3]; /* blocks per axis */
    uint8_t *is_used;  /* [blocks]: it has samples other than 0, or a corner of the volume */
    uint64_t used;     /* number of these */
    size_t bytes;      /* of a block */
    int file;          /* descriptor */
};

/* Progress goes from 0 to `share`. SP_ERR_IO, SP_ERR_MEMORY, SP_ERR_CANCELLED. Finish it also after
 * an error. */
bool sp_vdb_blocks_init(struct sp_vdb_blocks *blocks, const struct sp_export_job *job, double share,
                        struct sp_error *err);
void sp_vdb_blocks_finish(struct sp_vdb_blocks *blocks);

/* Reads the samples of a block; false with errno set. */
bool sp_vdb_blocks_read(const struct sp_vdb_blocks *blocks, uint64_t block, void *samples);

#endif
