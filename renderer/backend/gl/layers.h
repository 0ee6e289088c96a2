/* SPDX-License-Identifier: Apache-2.0
 *
 * The part of the layers other than the volume that the processor computes (draw/layers/layers.h):
 * points of surfaces and voxels, front to back, and the points of a cloud that are drawn.
 * surfaces.h, meshes.h and splat_layers.h draw them.
 */
#ifndef GL_LAYERS_H
#define GL_LAYERS_H

#include "backend/backend.h"
#include "draw/layers/layers.h"

/* The caches of these layers, which persist from frame to frame. */
struct gl_layers {
    struct sp_surface_cache surfaces;
    struct sp_shell_cache shells;
    struct sp_vectors_cache vectors;
    struct sp_cloud_cache clouds;
};

/* What the layers of one frame need: the job, which says what to draw, memory and threads. */
struct gl_layers_job {
    const struct sp_backend_job *job;
    uint64_t bytes_max; /* of the caches */
    struct sp_pool *pool;
    struct sp_arena *arena; /* of the frame */
};

enum gl_splat_kind {
    GL_SPLAT_SHELL,
    GL_SPLAT_VECTORS,
    GL_SPLAT_POINTS,
    GL_SPLAT_POINT_VECTORS, /* a layer of vectors of points */
    GL_SPLAT_GAUSSIANS,
    GL_SPLAT_KINDS
};

struct gl_layers_made {
    unsigned splat_count; /* layers that are drawn splat by splat, in order */
    struct gl_splats_made {
        enum gl_splat_kind kind;
        struct sp_voxel_source source; /* `from` is the list; not used for clouds */
        struct sp_cloud cloud;         /* clouds only */
        struct sp_volume *volume;      /* the job's */
        struct sp_volume *colors;      /* the job's, with the numbers of colours; NULL = none */
    } splats[SP_LAYERS_MAX];
    unsigned surface_count;
    struct sp_surface surfaces[SP_LAYERS_MAX];
    unsigned mesh_count;
    struct sp_mesh meshes[SP_LAYERS_MAX];          /* sp_mesh_init() */
    struct sp_volume *mesh_volumes[SP_LAYERS_MAX]; /* the job's */
};

/* Returns the number of elements and merged points of a cloud. */
static inline uint32_t gl_cloud_elements(const struct sp_cloud *cloud) {
    return cloud->elements->shape.count + (cloud->tree ? cloud->tree->count : 0);
}

/* Prepares the layers of a frame; they are valid until the next call, or until the arena is reset.
 * SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED. */
bool gl_layers_make(struct gl_layers *layers, const struct gl_layers_job *job,
                    struct gl_layers_made *made, struct sp_error *err);

/* Returns how many voxels, points and Gaussians the layers have. Sets *drawn to the number of
 * surface points in the image. */
uint64_t gl_layers_count(const struct gl_layers_made *made, uint64_t *drawn);

/* Return the bytes that are cached of the volume, or evict them; NULL = of all volumes. */
uint64_t gl_layers_bytes(const struct gl_layers *layers, const struct sp_volume *volume);
void gl_layers_evict(struct gl_layers *layers, const struct sp_volume *volume);

#endif
