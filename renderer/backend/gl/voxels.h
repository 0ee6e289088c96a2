/* SPDX-License-Identifier: Apache-2.0
 *
 * The samples of a volume on the GPU.
 */
#ifndef GL_VOXELS_H
#define GL_VOXELS_H

#include "backend/gl/buffer.h"
#include "sp/volume.h"

struct gl_voxels {
    struct sp_volume *volume; /* one reference, so that the address is not reused; NULL = empty */
    uint64_t used;            /* clock of the last use */
    struct gl_buffer samples; /* copy of the samples in memory; none = not uploaded */
    struct gl_buffer ranges;  /* by brick: smallest and largest ordinal (shaders/samples.glsl) */
    struct gl_buffer cells; /* likewise by cell of 4³ voxels (cell_bounds.h); none = not computed */
    uint32_t refusals;      /* how often GPU memory was too small */
    uint32_t skips;         /* frames for which the CPU still classifies this volume */
};

static inline uint64_t gl_voxels_bytes(const struct gl_voxels *voxels) {
    return voxels->samples.bytes + voxels->ranges.bytes + voxels->cells.bytes;
}

/* Frees the samples. A context must be current. */
static inline void gl_voxels_drop(struct gl_voxels *voxels) {
    gl_buffer_finish(&voxels->samples);
    gl_buffer_finish(&voxels->ranges);
    gl_buffer_finish(&voxels->cells);
}

#endif
