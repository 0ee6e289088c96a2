/* SPDX-License-Identifier: Apache-2.0
 *
 * The processor's part of surfaces, shells and vectors (layers/layers.h): their points and voxels,
 * front to back. surfaces.h and voxels.h draw them.
 */
#ifndef GL_LAYERS_H
#define GL_LAYERS_H

#include "backend/backend.h"
#include "layers/layers.h"

/* What is kept of them from frame to frame. */
struct gl_layers {
    struct sp_surface_cache surfaces;
    struct sp_shell_cache shells;
    struct sp_vectors_cache vectors;
};

/* What a frame is made from. */
struct gl_layers_job {
    const struct sp_backend_job *job;
    uint64_t bytes_max; /* of the caches */
    struct sp_pool *pool;
    struct sp_arena *arena; /* of the frame */
};

enum gl_voxel_layer { GL_SHELL, GL_VECTORS, GL_VOXEL_LAYERS };

struct gl_layers_made {
    struct gl_voxels_made {
        bool is_there;
        struct sp_voxel_layer layer; /* sp_voxel_find() */
    } voxels[GL_VOXEL_LAYERS];
    unsigned surface_count;
    struct sp_surface surfaces[SP_LAYERS_MAX];
};

/* Prepares the layers of a frame; they are valid until the next call, or until the arena is reset.
 * SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED. */
bool gl_layers_make(struct gl_layers *layers, const struct gl_layers_job *job,
                    struct gl_layers_made *made, struct sp_error *err);

/* Returns how many voxels and points the layers have; *drawn: without hidden voxels, and without
 * points outside of the image. */
uint64_t gl_layers_count(const struct gl_layers_made *made, uint64_t *drawn);

/* Bytes that are cached of the volume; NULL = of all volumes. The same for dropping them. */
uint64_t gl_layers_bytes(const struct gl_layers *layers, const struct sp_volume *volume);
void gl_layers_evict(struct gl_layers *layers, const struct sp_volume *volume);

#endif
