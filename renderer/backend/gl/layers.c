/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/layers.h"

#include <string.h>

bool gl_layers_make(struct gl_layers *l, const struct gl_layers_job *from,
                    struct gl_layers_made *made, struct sp_error *err) {
    const struct sp_view *view = from->job->view;
    bool is_lit = view->shading.mode == SP_SHADING_PHONG;
    struct sp_camera_transform camera;
    struct sp_shade shade;
    struct sp_layers layers;
    sp_camera_transform_init(&camera, &view->camera, view->size);
    if (is_lit)
        sp_shade_init(&shade, &camera, &view->shading);
    const struct sp_layers_input input = { .view = view,
                                           .volume = from->job->volume,
                                           .camera = &camera,
                                           .shade = is_lit ? &shade : NULL,
                                           .surfaces = &l->surfaces,
                                           .shells = &l->shells,
                                           .vectors = &l->vectors,
                                           .bytes_max = from->bytes_max,
                                           .mip_level = from->job->mip_level,
                                           .interrupt = sp_job_interrupt(from->job),
                                           .pool = from->pool,
                                           .arena = from->arena };
    if (!sp_layers_prepare(&input, &layers, err))
        return false;
    made->voxels[GL_SHELL] = (struct gl_voxels_made){ layers.shell.is_there, layers.shell.layer };
    made->voxels[GL_VECTORS] =
        (struct gl_voxels_made){ layers.vectors.is_there, layers.vectors.layer };
    for (int i = 0; i < GL_VOXEL_LAYERS; i++)
        made->voxels[i].layer.input = NULL; /* it ends here */
    made->surface_count = layers.surface_count;
    memcpy(made->surfaces, layers.surfaces, sizeof made->surfaces);
    return true;
}

uint64_t gl_layers_count(const struct gl_layers_made *made, uint64_t *drawn) {
    uint64_t count = 0;
    *drawn = 0;
    for (int i = 0; i < GL_VOXEL_LAYERS; i++) {
        if (!made->voxels[i].is_there)
            continue;
        count += made->voxels[i].layer.list->count;
        *drawn += made->voxels[i].layer.order.count;
    }
    for (unsigned i = 0; i < made->surface_count; i++) {
        count += made->surfaces[i].points->count;
        *drawn += made->surfaces[i].drawn;
    }
    return count;
}

uint64_t gl_layers_bytes(const struct gl_layers *l, const struct sp_volume *volume) {
    return sp_surface_cache_bytes(&l->surfaces, volume) + sp_shell_bytes(&l->shells, volume) +
           sp_vectors_bytes(&l->vectors, volume);
}

void gl_layers_evict(struct gl_layers *l, const struct sp_volume *volume) {
    sp_surface_cache_evict(&l->surfaces, volume);
    sp_shell_evict(&l->shells, volume);
    sp_vectors_evict(&l->vectors, volume);
}
