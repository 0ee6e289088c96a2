/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/layers.h"

#include <stdlib.h>
#include <string.h>

static const struct sp_shell_kernels shell_kernels = { .set_up = sp_shell_set_up,
                                                       .start = sp_shell_start,
                                                       .add = sp_shell_add,
                                                       .resolve = sp_shell_resolve,
                                                       .merge = sp_shell_merge };

bool gl_layers_init(struct gl_layers *l, unsigned threads, struct sp_error *err) {
    l->arenas = calloc(threads, sizeof *l->arenas);
    if (!l->arenas)
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the gl backend");
    l->threads = threads;
    for (unsigned w = 0; w < threads; w++)
        sp_arena_init(&l->arenas[w]);
    return true;
}

void gl_layers_finish(struct gl_layers *l) {
    gl_layers_evict(l, NULL);
    for (unsigned w = 0; w < l->threads; w++)
        sp_arena_finish(&l->arenas[w]);
    free(l->arenas);
    *l = (struct gl_layers){ .arenas = NULL };
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
                                           .camera = &camera,
                                           .shade = is_lit ? &shade : NULL,
                                           .surfaces = &l->surfaces,
                                           .shells = &l->shells,
                                           .bytes_max = from->bytes_max,
                                           .shell_kernels = &shell_kernels,
                                           .mip_level = from->job->mip_level,
                                           .interrupt = sp_job_interrupt(from->job),
                                           .pool = from->pool,
                                           .arena = from->arena };
    if (!sp_layers_prepare(&input, &layers, err))
        return false;
    made->has_shell = layers.has_shell;
    made->surface_count = layers.surface_count;
    memcpy(made->surfaces, layers.surfaces, sizeof made->surfaces);
    made->visible = layers.has_shell ? layers.shell.list->count : 0;
    made->splats = layers.shell.drawn;
    made->area = layers.shell.area;
    layers.surface_count = 0;
    return !layers.has_shell || sp_layers_collect(&layers, l->arenas, &made->fragments, err);
}

uint64_t gl_layers_bytes(const struct gl_layers *l, const struct sp_volume *volume) {
    return sp_surface_cache_bytes(&l->surfaces, volume) + sp_shell_bytes(&l->shells, volume);
}

void gl_layers_evict(struct gl_layers *l, const struct sp_volume *volume) {
    sp_surface_cache_evict(&l->surfaces, volume);
    sp_shell_evict(&l->shells, volume);
}
