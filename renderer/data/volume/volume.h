/* SPDX-License-Identifier: Apache-2.0
 *
 * Volumes in memory, private to the renderer: how one is created. This folder holds the grid, the
 * samples, their statistics and the built-in volumes; files are the business of import/.
 *
 *   procedural.c ─► samples ─┐
 *   import/      ─► mapping ─┴► sp_volume_adopt() ─► range, histogram ─► struct sp_volume
 */
#ifndef SP_VOLUME_VOLUME_H
#define SP_VOLUME_VOLUME_H

#include "data/volume/blocks.h"
#include "data/volume/grid.h"

/* Releases the samples when the last reference is gone. Called once, from any thread. */
typedef void sp_voxel_source_release(void *voxels, size_t bytes);

/* Where the vectors lie in the memory of samples: after them, 64-byte aligned. Returns the size of
 * the memory, a multiple of 64, with vectors or without. */
uint64_t sp_volume_layout(uint64_t voxel_bytes, uint64_t voxels, bool has_vectors,
                          uint64_t *vectors_at);

/* Creates a volume from existing samples without copying them. `info` gives grid, type, unit,
 * names and source (coordinates are copied); range, histogram, nonfinite, longest, components and
 * sizes are filled in. The grid must have passed sp_grid_check(). `voxels` is 64-byte aligned and
 * `bytes` long; the volume owns it from now on, also when the call fails (then it is released at
 * once). `vectors` lies in the same memory; NULL = none. One reference, or NULL with *err set. */
struct sp_volume *sp_volume_adopt(const struct sp_volume_info *info, void *voxels,
                                  const float (*vectors)[3], size_t bytes,
                                  sp_voxel_source_release *release, struct sp_error *err);

/* The same for elements in memory of sp_elements_bytes(): `info` gives their shape, unit, names and
 * source; the grid, and of points range and histogram, are filled in. SP_ERR_FORMAT if a triangle
 * names a vertex that does not exist. */
struct sp_volume *sp_volume_adopt_elements(const struct sp_volume_info *info, void *memory,
                                           size_t bytes, sp_voxel_source_release *release,
                                           struct sp_error *err);

/* Creates a volume with other samples on the grid of `original`, for the same readers: of its
 * description only the type, the size and the number of samples that are not finite differ, and the
 * vectors are the original's. Samples as above. */
struct sp_volume *sp_volume_derive(const struct sp_volume *original, enum sp_type type,
                                   uint64_t nonfinite, void *voxels, size_t bytes,
                                   sp_voxel_source_release *release, struct sp_error *err);

/* The same on another grid, which shows a part of the original at another resolution: `part` says
 * where. The range, the histogram, the longest vector and what projections show are those of the
 * original. `vectors` lies in the same memory; NULL = none. */
struct sp_volume *sp_volume_derive_part(const struct sp_volume *original,
                                        const struct sp_grid *grid,
                                        const struct sp_whole_part *part, void *voxels,
                                        const float (*vectors)[3], size_t bytes,
                                        sp_voxel_source_release *release, struct sp_error *err);

/* The same without vectors, and with blocks, which lie at the beginning of their memory. `bytes`
 * counts that memory and the samples that its pointers name. `coarser` has the coarser grid, whose
 * memory stays as long as the blocks; NULL = no block needs it. Such a volume has no array of
 * samples: sp_volume_voxels() must not be called. */
struct sp_volume *sp_volume_derive_blocks(const struct sp_volume *original,
                                          const struct sp_grid *grid,
                                          const struct sp_whole_part *part,
                                          struct sp_blocks *blocks, const struct sp_volume *coarser,
                                          size_t bytes, sp_voxel_source_release *release,
                                          struct sp_error *err);
/* NULL = the samples are an array. */
const struct sp_blocks *sp_volume_blocks(const struct sp_volume *volume);

/* The source of a volume that holds a coarse level only: `source` is destroyed with the volume. Set
 * once, before the volume is shared. sp_volume_source() returns it; NULL = there is none. */
void sp_volume_set_source(struct sp_volume *volume, void *source, void (*destroy)(void *source));
void *sp_volume_source(const struct sp_volume *volume);

/* Creates a volume whose range, histogram and so on *info gives, all of it. Samples and vectors as
 * above. */
struct sp_volume *sp_volume_adopt_measured(const struct sp_volume_info *info, void *voxels,
                                           const float (*vectors)[3], size_t bytes,
                                           sp_voxel_source_release *release, struct sp_error *err);

/* True if `volume`, which may be NULL, is `original` or derived from it, or if `original` is NULL.
 * Caches evict by this rule. */
bool sp_volume_is_of(const struct sp_volume *volume, const struct sp_volume *original);

/* The volume that this one was derived from, or itself. Only for comparisons: it may be gone. */
const struct sp_volume *sp_volume_original(const struct sp_volume *volume);

/* A volume remembers the last one that was derived from it, under a key of any bytes. get() returns
 * a reference and copies the key to `key`, of which *key_bytes says the capacity and then the size;
 * NULL = there is none, or its key is larger. set() adds a reference; NULL = forget it. Both are
 * thread-safe. set() fails silently without memory for the key. */
struct sp_volume *sp_volume_derived(struct sp_volume *volume, void *key, size_t *key_bytes);
void sp_volume_set_derived(struct sp_volume *volume, struct sp_volume *derived, const void *key,
                           size_t key_bytes);

/* Length of the longest finite one of `count` vectors; 0 = there is none. */
bool sp_volume_measure_vectors(const float (*vectors)[3], uint64_t count, double *longest,
                               struct sp_error *err);

/* The lengths of `count` vectors: samples that are called "magnitude". */
void sp_volume_lengths(const float (*vectors)[3], uint64_t count, float *lengths);

/* Between which all finite samples of the volume and of windows of it lie. */
static inline const double *sp_volume_limits(const struct sp_volume_info *info) {
    return info->whole.dims[0] ? info->whole.limits : info->range;
}

/* Range, histogram and count of non-finite samples of `count` samples, into *info (whose type is
 * set). Subnormal numbers count as zero. The result does not depend on the number of threads. False
 * with *err set when threads cannot be started. */
bool sp_volume_measure(struct sp_volume_info *info, const void *voxels, uint64_t count,
                       struct sp_error *err);

/* Fills info->projected from some samples of a grid, whose range is set. SP_ERR_MEMORY. */
bool sp_volume_project(struct sp_volume_info *info, const void *voxels, struct sp_error *err);

/* The number of threads for work on a whole volume: one per core that this process may use, at most
 * 16. */
unsigned sp_volume_threads(void);

#endif
