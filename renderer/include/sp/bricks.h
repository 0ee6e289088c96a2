/* SPDX-License-Identifier: Apache-2.0
 *
 * Brick files: volumes that are larger than memory. A brick file holds the samples and their
 * coarser levels in compressed bricks. A brick is read when a frame needs it. sp_volume_load()
 * opens a brick file like any other file.
 */
#ifndef SP_BRICKS_H
#define SP_BRICKS_H

#include "sp/volume.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SP_BRICKS_SUFFIX ".bricks"
enum { SP_BRICKS_VERSION = 3 }; /* version version of the files that are read and written */

/* Reads the volume `source` like sp_volume_load(), and writes it to the brick file `out`,
 * completely or not at all. Built-in volumes may have up to 4096 samples per axis here. The samples
 * pass through an unnamed file in the folder of `out`; memory holds only a strip of 72 × 72 rows.
 * Of a time series, one step is converted: options->step. The brick file keeps the names of the
 * source's other fields and its time steps. `options` may be NULL; options->reserve() is not
 * called. Blocks until the file is complete. Errors are those of sp_volume_load(), and
 * SP_ERR_UNSUPPORTED for volumes that are not grids of samples. */
SP_API bool sp_bricks_convert(const char *source, const char *out,
                              const struct sp_load_options *options, struct sp_error *err);

/* Memory for the samples of brick files that frames show. All files that are opened with the same
 * sp_load_options.subvolumes share one memory. The least recently used samples are dropped first.
 * Thread-safe. */
struct sp_brick_memory;
/* Returns one reference, or NULL: SP_ERR_MEMORY. `bytes`: the limit, any number. */
SP_API struct sp_brick_memory *sp_brick_memory_create(uint64_t bytes, struct sp_error *err);
/* Adds a reference and returns its argument. Each open file has a reference of its own. */
SP_API struct sp_brick_memory *sp_brick_memory_ref(struct sp_brick_memory *memory);
/* Drops a reference and nulls *memory, which may be NULL. */
SP_API void sp_brick_memory_unref(struct sp_brick_memory **memory);
/* Changes the limit, and drops samples that exceed it. Frames that are being drawn keep their
 * samples. */
SP_API void sp_brick_memory_set(struct sp_brick_memory *memory, uint64_t bytes);
struct sp_brick_usage {
    uint64_t files;            /* files that are open or being opened */
    uint64_t bytes, bytes_max; /* bytes of samples in memory, and their limit */
};
SP_API void sp_brick_memory_usage(struct sp_brick_memory *memory, struct sp_brick_usage *usage);

/* Bricks that could not be read so far, because the file is damaged or its disk fails. */
struct sp_bricks_damage {
    uint64_t count;      /* bricks bricks of all levels */
    uint32_t box[2][3];  /* voxels of the first such brick in the whole volume: the first voxel, and
                            one past the last */
    uint32_t level;      /* level of the first such brick */
    struct sp_error why; /* error of the first such brick */
};
/* Returns false if no brick is damaged, or if the volume is not a brick file. Thread-safe. */
SP_API bool sp_bricks_get_damage(const struct sp_volume *volume, struct sp_bricks_damage *damage);

/* Returns a volume of the samples around `count` world positions. *level is the wanted level. If
 * the memory does not suffice for it, the function takes the finest coarser level that fits, and
 * sets *level. Reads the bricks in the box around the points, and waits for them up to wait_ms;
 * INFINITY = until they are read. If the volume is not a brick file, it is returned itself, with
 * *level = 0. Returns one reference, or NULL with *err set: SP_ERR_TIMEOUT, SP_ERR_IO (a brick in
 * the box cannot be read), SP_ERR_MEMORY. Thread-safe. */
SP_API struct sp_volume *sp_bricks_around(struct sp_volume *volume, const double (*points)[3],
                                          unsigned count, double wait_ms, unsigned *level,
                                          struct sp_error *err);
/* Returns the level of the samples that the volume itself holds; 0 if it is not a brick file.
 * Thread-safe. */
SP_API unsigned sp_bricks_base(const struct sp_volume *volume);
/* Describes the volume as if all of it were loaded at the level. struct sp_grid defines the spacing
 * of a rectilinear axis at a level. False if the volume has no such level. Thread-safe.
 */
SP_API bool sp_bricks_describe(const struct sp_volume *volume, unsigned level,
                               struct sp_volume_info *info);
/* Returns the coarsest level whose samples are at most `spacing` wide [world unit]; 0 if the volume
 * is not a brick file. Thread-safe. */
SP_API unsigned sp_bricks_level(const struct sp_volume *volume, double spacing);

#ifdef __cplusplus
}
#endif

#endif
