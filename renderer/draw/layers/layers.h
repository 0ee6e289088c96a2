/* SPDX-License-Identifier: Apache-2.0
 *
 * Draws the layers of a frame other than the volume on the processor: computes, per tile, the
 * fragments of all these layers.
 *
 *   view ─► sp_layers_prepare() ─► per tile ─┬► sp_layers_draw(): to the caller
 *   surface/, splat_list/, cloud/, mesh/     └► sp_layers_collect(): kept for the volume
 */
#ifndef SP_LAYERS_LAYERS_H
#define SP_LAYERS_LAYERS_H

#include "draw/layers/cloud/cloud.h"
#include "draw/layers/mesh/mesh.h"
#include "draw/layers/shell/cache.h"
#include "draw/layers/splat_list/draw.h"
#include "draw/layers/surface/cache.h"
#include "draw/layers/surface/surface.h"
#include "draw/layers/vectors/cache.h"
#include "frame/fragments.h"

/* All pointers are borrowed until the frame is drawn. */
struct sp_layers_input {
    const struct sp_view *view;
    struct sp_volume *volume;
    struct sp_volume *const
        *layer_volumes;              /* by layer: the volume whose elements it shows; NULL = none */
    struct sp_volume *const *colors; /* by layer: the volume that its color_by names; NULL = none */
    const struct sp_camera_transform *camera;
    const struct sp_shade *shade; /* NULL = not lit */
    struct sp_surface_cache *surfaces;
    struct sp_shell_cache *shells;
    struct sp_cloud_cache *clouds;    /* the same for layers of points */
    struct sp_vectors_cache *vectors; /* NULL = layers of vectors cannot be drawn */
    uint64_t bytes_max;               /* of all these caches */
    /* All NULL: the frame is prepared for a GPU. Splats are then prepared by
     * sp_voxel_source_acquire() only, and meshes by sp_mesh_init() only. */
    sp_surface_tile_fn *surface_tile;
    const struct sp_voxel_kernels *voxel_kernels;
    sp_voxel_set_up_fn *cloud_set_up;
    const struct sp_mesh_kernels *mesh_kernels;
    unsigned mip_level; /* surfaces are drawn at this level or a coarser one */
    struct sp_interrupt interrupt;
    struct sp_pool *pool;
    struct sp_arena *arena; /* of the frame */
};

/* A prepared frame. */
struct sp_layers {
    const struct sp_layers_input *input;
    unsigned surface_count;
    struct sp_surface surfaces[SP_LAYERS_MAX];
    unsigned mesh_count;
    uint32_t mesh_layers[SP_LAYERS_MAX]; /* number of each mesh's layer in the view */
    struct sp_mesh meshes[SP_LAYERS_MAX];
    struct sp_layers_voxels {
        bool is_there;
        struct sp_voxel_input input;
        struct sp_voxel_layer layer;
    } shell, vectors;
    unsigned cloud_count;
    struct sp_layers_cloud {
        uint32_t number; /* of the layer in the view */
        struct sp_layers_voxels voxels;
        struct sp_cloud cloud;
        struct sp_voxel_source source;
    } clouds[SP_LAYERS_MAX];
    struct sp_layers_worker *workers; /* [threads] */
};

/* Receives a tile of the image with all its fragments. Several threads call the function at the
 * same time; `worker` is the number of the thread. Returns false if out of memory. */
typedef bool sp_layers_tile_fn(void *user, const struct sp_fragment_tile *tile, unsigned worker);

/* True if the view has layers other than the volume and channels, or no layers at all. */
bool sp_layers_are_wanted(const struct sp_view *view);

/* True if the view has the volume, or a channel. */
bool sp_layers_have_volume(const struct sp_view *view);

/* Writes to *out the view that shows one channel alone: layer number `layer` of the view. `info`
 * describes the volume of the channel. */
void sp_layers_channel_view(const struct sp_view *view, uint32_t layer,
                            const struct sp_volume_info *info, struct sp_view *out);

/* Fills the input for drawing layer number `layer`, which is a shell or a layer of vectors.
 * SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED. */
bool sp_layers_voxels(const struct sp_layers_input *input, uint32_t layer,
                      struct sp_voxel_input *voxels, struct sp_error *err);

/* True for a layer of points or Gaussians, or of vectors of points. */
bool sp_layers_is_cloud(const struct sp_layers_input *input, uint32_t layer);

/* Fills the input for drawing layer number `layer`, for which sp_layers_is_cloud() is true.
 * SP_ERR_MEMORY, SP_ERR_CANCELLED. */
bool sp_layers_cloud(const struct sp_layers_input *input, uint32_t layer,
                     struct sp_layers_cloud *cloud, struct sp_error *err);

/* Prepares the layers other than the volume. *layers is valid until the arena is reset.
 * SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED. */
bool sp_layers_prepare(const struct sp_layers_input *input, struct sp_layers *layers,
                       struct sp_error *err);

/* Draws the rows of tiles [begin, end) and passes each tile to tile(). SP_ERR_MEMORY,
 * SP_ERR_CANCELLED. */
bool sp_layers_draw(const struct sp_layers *layers, int begin, int end, sp_layers_tile_fn *tile,
                    void *user, struct sp_error *err);

/* Collects the fragments of the rows of tiles [begin, end). Resets the arenas, of which each thread
 * has one, and stores the fragments there. They are valid until one of the arenas is reset. Errors
 * as above, and SP_ERR_FRAME_BUDGET. */
bool sp_layers_collect(const struct sp_layers *layers, int begin, int end,
                       struct sp_arena *worker_arenas, struct sp_fragments *fragments,
                       struct sp_error *err);

#endif
