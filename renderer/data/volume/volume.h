/* SPDX-License-Identifier: Apache-2.0
 *
 * Creation of volumes in memory; private to the renderer. This folder holds the grid, the samples,
 * their statistics and the built-in volumes. import/ reads files.
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

/* Computes the layout of the memory of samples: the vectors follow the samples, 64-byte aligned.
 * Returns the size of the memory, a multiple of 64, with or without vectors. */
uint64_t sp_volume_layout(uint64_t voxel_bytes, uint64_t voxels, bool has_vectors,
                          uint64_t *vectors_at);

/* Creates a volume from existing samples without copying them. `info` gives grid, type, unit,
 * names and source (coordinates are copied); range, histogram, noise, nonfinite, longest,
 * components and sizes are filled in. The grid must have passed sp_grid_check(). `voxels` is
 * 64-byte aligned and `bytes` long; the volume owns it from now on, also when the call fails (then
 * it is released at once). `vectors` lies in the same memory; NULL = none. One reference, or NULL
 * with *err set. */
struct sp_volume *sp_volume_adopt(const struct sp_volume_info *info, void *voxels,
                                  const float (*vectors)[3], size_t bytes,
                                  sp_voxel_source_release *release, struct sp_error *err);

/* Like sp_volume_adopt(), without vectors and with `most` of sp_volume_measure(). */
struct sp_volume *sp_volume_adopt_quickly(const struct sp_volume_info *info, void *voxels,
                                          size_t bytes, uint64_t most,
                                          sp_voxel_source_release *release, struct sp_error *err);

/* Like sp_volume_adopt(), for elements in memory of sp_elements_bytes() bytes. `info` gives their
 * shape, unit, names and source. The grid is filled in, and for points also range and histogram.
 * SP_ERR_FORMAT if a triangle names a vertex that does not exist. */
struct sp_volume *sp_volume_adopt_elements(const struct sp_volume_info *info, void *memory,
                                           size_t bytes, sp_voxel_source_release *release,
                                           struct sp_error *err);

/* Creates a volume with other samples on the grid of `original`. Only the type, the size and the
 * number of non-finite samples of its description differ; the vectors are the original's. Samples
 * as in sp_volume_adopt(). */
struct sp_volume *sp_volume_derive(const struct sp_volume *original, enum sp_type type,
                                   uint64_t nonfinite, void *voxels, size_t bytes,
                                   sp_voxel_source_release *release, struct sp_error *err);

/* Like sp_volume_derive(), on another grid that shows a part of the original at another resolution.
 * `part` gives its position. The range, the histogram, the noise, the longest vector and the
 * projected ranges are the original's. `vectors` lies in the memory of the samples; NULL = none. */
struct sp_volume *sp_volume_derive_part(const struct sp_volume *original,
                                        const struct sp_grid *grid,
                                        const struct sp_whole_part *part, void *voxels,
                                        const float (*vectors)[3], size_t bytes,
                                        sp_voxel_source_release *release, struct sp_error *err);

/* Like sp_volume_derive_part(), without vectors and with blocks, which lie at the beginning of
 * their memory. `bytes` counts this memory and the samples to which its pointers point. `coarser`
 * has the coarser grid; its memory lives as long as the blocks; NULL = no block needs it. Such a
 * volume has no array of samples: sp_volume_voxels() must not be called. */
struct sp_volume *sp_volume_derive_blocks(const struct sp_volume *original,
                                          const struct sp_grid *grid,
                                          const struct sp_whole_part *part,
                                          struct sp_blocks *blocks, const struct sp_volume *coarser,
                                          size_t bytes, sp_voxel_source_release *release,
                                          struct sp_error *err);
/* Returns the blocks of a volume; NULL = the samples are an array. */
const struct sp_blocks *sp_volume_blocks(const struct sp_volume *volume);

/* The source of a volume that holds a coarse level only: `source` is destroyed with the volume. Set
 * once, before the volume is shared. sp_volume_source() returns it; NULL = there is none. */
void sp_volume_set_source(struct sp_volume *volume, void *source, void (*destroy)(void *source));
void *sp_volume_source(const struct sp_volume *volume);

/* Creates a volume from a complete description: range, histogram and all other fields of *info are
 * set. Samples and vectors as in sp_volume_adopt(). */
struct sp_volume *sp_volume_adopt_measured(const struct sp_volume_info *info, void *voxels,
                                           const float (*vectors)[3], size_t bytes,
                                           sp_voxel_source_release *release, struct sp_error *err);

/* True if `volume`, which may be NULL, is `original` or derived from it, or if `original` is NULL.
 * Caches evict by this rule. */
bool sp_volume_is_of(const struct sp_volume *volume, const struct sp_volume *original);

/* Returns the volume from which this one was derived, or the volume itself. Only for comparisons:
 * the original may have been freed. */
const struct sp_volume *sp_volume_original(const struct sp_volume *volume);

/* A volume remembers the last one that was derived from it, under a key of any bytes.
 * sp_volume_derived() returns a reference and copies the key to `key`. *key_bytes is the capacity
 * before the call and the size of the key after it. NULL = there is no derived volume, or its key
 * is larger. sp_volume_set_derived() adds a reference; derived NULL = drop the last one. It fails
 * silently if memory runs out. Both functions are thread-safe. */
struct sp_volume *sp_volume_derived(struct sp_volume *volume, void *key, size_t *key_bytes);
void sp_volume_set_derived(struct sp_volume *volume, struct sp_volume *derived, const void *key,
                           size_t key_bytes);

/* Computes the length of the longest finite vector of `count` vectors; 0 = there is none. */
bool sp_volume_measure_vectors(const float (*vectors)[3], uint64_t count, double *longest,
                               struct sp_error *err);

/* Computes the lengths of `count` vectors, the samples with the name "magnitude". */
void sp_volume_lengths(const float (*vectors)[3], uint64_t count, float *lengths);

/* Returns the range that contains all finite samples of the volume and of its subvolumes. */
static inline const double *sp_volume_limits(const struct sp_volume_info *info) {
    return info->whole.dims[0] ? info->whole.limits : info->range;
}

/* Computes range, histogram, noise and number of non-finite samples of `count` samples. Writes them
 * to *info, whose type and shape are set. Subnormal numbers count as zero. `most`: the histogram of
 * more samples than this is an estimate from an even choice of about so many, unless they are
 * labels; 0 = it counts all. The result does not depend on the number of threads. False with *err
 * set when threads cannot be started or memory runs out. */
bool sp_volume_measure(struct sp_volume_info *info, const void *voxels, uint64_t count,
                       uint64_t most, struct sp_error *err);

/* Fills info->projected from some samples of a grid, whose range is set. SP_ERR_MEMORY. */
bool sp_volume_project(struct sp_volume_info *info, const void *voxels, struct sp_error *err);

/* Returns the number of threads for work on a whole volume: one per core that this process may use,
 * at most 16. */
unsigned sp_volume_threads(void);

#endif
