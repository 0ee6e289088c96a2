/* SPDX-License-Identifier: Apache-2.0
 *
 * Brick files: volumes that are larger than memory. A brick file has the samples and coarser levels
 * of them in compressed bricks, which are read when a frame needs them. sp_volume_load() opens it
 * as any other file.
 */
#ifndef SP_BRICKS_H
#define SP_BRICKS_H

#include "sp/volume.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SP_BRICKS_SUFFIX ".bricks"
enum { SP_BRICKS_VERSION = 3 }; /* of the files that are read and written */

/* Converts what sp_volume_load() reads from `source` to the brick file `out`, which is written
 * completely or not at all. Built-in volumes may have up to 4096 samples per axis here. The samples
 * pass through a file without a name in the folder of `out`; memory holds a strip of 72 × 72 rows
 * of them. Of a time series it converts options->step. The file stands for the source: it has the
 * names of its other fields and its time steps. `options` may be NULL; its reserve() is not called.
 * Blocks until it is done. Errors are those of sp_volume_load(), and SP_ERR_UNSUPPORTED for volumes
 * that are not grids of samples. */
SP_API bool sp_bricks_convert(const char *source, const char *out,
                              const struct sp_load_options *options, struct sp_error *err);

/* Memory for the samples of brick files that frames show. All files that are opened with it share
 * it (sp_load_options.windows). The least recently used samples are dropped. Thread-safe. */
struct sp_brick_memory;
/* One reference, or NULL: SP_ERR_MEMORY. `bytes`: the limit, any number. */
SP_API struct sp_brick_memory *sp_brick_memory_create(uint64_t bytes, struct sp_error *err);
/* Files that are open have references of their own. */
SP_API struct sp_brick_memory *sp_brick_memory_ref(struct sp_brick_memory *memory);
/* Drops a reference and nulls *memory, which may be NULL. */
SP_API void sp_brick_memory_unref(struct sp_brick_memory **memory);
/* Changes the limit, and drops what exceeds it. Frames that are being drawn keep what they show. */
SP_API void sp_brick_memory_set(struct sp_brick_memory *memory, uint64_t bytes);
struct sp_brick_usage {
    uint64_t files;            /* that are open, or being opened */
    uint64_t bytes, bytes_max; /* of samples in memory, and the limit */
};
SP_API void sp_brick_memory_usage(struct sp_brick_memory *memory, struct sp_brick_usage *usage);

/* Bricks that could not be read so far, because the file is damaged or its disk fails. */
struct sp_bricks_damage {
    uint64_t count;      /* of all levels */
    uint32_t box[2][3];  /* of the first one, voxels of the whole volume: from, and past the last */
    uint32_t level;      /* its level */
    struct sp_error why; /* of the first one */
};
/* Returns false if there are none, or if the volume is no brick file. Thread-safe. */
SP_API bool sp_bricks_get_damage(const struct sp_volume *volume, struct sp_bricks_damage *damage);

/* A volume of the samples around some points (world): of the level *level, or of the finest coarser
 * one for which the memory suffices, which is written to it. Reads the bricks in the box around the
 * points, and waits up to wait_ms for them [ms], INFINITY = until they are read. A volume that is
 * no brick file is returned itself, with *level 0. One reference; NULL with *err set:
 * SP_ERR_TIMEOUT, SP_ERR_IO (bricks there cannot be read), SP_ERR_MEMORY. Thread-safe. */
SP_API struct sp_volume *sp_bricks_around(struct sp_volume *volume, const double (*points)[3],
                                          unsigned count, double wait_ms, unsigned *level,
                                          struct sp_error *err);
/* The level of the samples that the volume itself has; 0 if it is no brick file. Thread-safe. */
SP_API unsigned sp_bricks_base(const struct sp_volume *volume);
/* Describes the volume as if all of it had been loaded at that level; the spacing of a rectilinear
 * axis is that of struct sp_grid for levels. False if the volume has no such level. Thread-safe.
 */
SP_API bool sp_bricks_describe(const struct sp_volume *volume, unsigned level,
                               struct sp_volume_info *info);
/* The coarsest level whose samples are at most `spacing` wide [world unit]; 0 if the volume is no
 * brick file. Thread-safe. */
SP_API unsigned sp_bricks_level(const struct sp_volume *volume, double spacing);

#ifdef __cplusplus
}
#endif

#endif
