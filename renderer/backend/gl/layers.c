/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/layers.h"

#include <string.h>

static void add_list(struct gl_layers_made *made, enum gl_splat_kind kind,
                     const struct sp_voxel_source *source) {
    made->splats[made->splat_count++] = (struct gl_splats_made){ .kind = kind, .source = *source };
}

static void add_cloud(struct gl_layers_made *made, const struct sp_layers_cloud *from,
                      const struct sp_backend_job *job) {
    const struct sp_voxel_frame *frame = &from->source.frame;
    made->splats[made->splat_count++] =
        (struct gl_splats_made){ .kind = frame->is_trained    ? GL_SPLAT_GAUSSIANS
                                         : frame->has_streaks ? GL_SPLAT_POINT_VECTORS
                                                              : GL_SPLAT_POINTS,
                                 .source = from->source,
                                 .cloud = from->cloud,
                                 .volume = job->layer_volumes[from->number],
                                 .colors = from->cloud.color_vectors
                                               ? job->layer_volumes[from->number]
                                               : job->colors[from->number] };
}

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
                                           .layer_volumes = from->job->layer_volumes,
                                           .colors = from->job->colors,
                                           .camera = &camera,
                                           .shade = is_lit ? &shade : NULL,
                                           .surfaces = &l->surfaces,
                                           .shells = &l->shells,
                                           .vectors = &l->vectors,
                                           .clouds = &l->clouds,
                                           .bytes_max = from->bytes_max,
                                           .mip_level = from->job->mip_level,
                                           .interrupt = sp_job_interrupt(from->job),
                                           .pool = from->pool,
                                           .arena = from->arena };
    if (!sp_layers_prepare(&input, &layers, err))
        return false;
    made->splat_count = 0;
    if (layers.shell.is_there)
        add_list(made, GL_SPLAT_SHELL, &layers.shell.layer.source);
    if (layers.vectors.is_there)
        add_list(made, GL_SPLAT_VECTORS, &layers.vectors.layer.source);
    for (unsigned i = 0; i < layers.cloud_count; i++)
        add_cloud(made, &layers.clouds[i], from->job);
    made->surface_count = layers.surface_count;
    memcpy(made->surfaces, layers.surfaces, sizeof made->surfaces);
    made->mesh_count = layers.mesh_count;
    memcpy(made->meshes, layers.meshes, sizeof made->meshes);
    for (unsigned i = 0; i < layers.mesh_count; i++)
        made->mesh_volumes[i] = from->job->layer_volumes[layers.mesh_layers[i]];
    return true;
}

uint64_t gl_layers_count(const struct gl_layers_made *made, uint64_t *drawn) {
    uint64_t count = 0;
    *drawn = 0;
    for (unsigned i = 0; i < made->splat_count; i++)
        count += made->splats[i].source.count;
    for (unsigned i = 0; i < made->surface_count; i++) {
        count += made->surfaces[i].points->count;
        *drawn += made->surfaces[i].drawn;
    }
    return count;
}

uint64_t gl_layers_bytes(const struct gl_layers *l, const struct sp_volume *volume) {
    return sp_surface_cache_bytes(&l->surfaces, volume) + sp_shell_bytes(&l->shells, volume) +
           sp_vectors_bytes(&l->vectors, volume) + sp_cloud_bytes(&l->clouds, volume);
}

void gl_layers_evict(struct gl_layers *l, const struct sp_volume *volume) {
    sp_surface_cache_evict(&l->surfaces, volume);
    sp_shell_evict(&l->shells, volume);
    sp_vectors_evict(&l->vectors, volume);
    sp_cloud_evict(&l->clouds, volume);
}
