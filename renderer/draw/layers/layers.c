/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/layers.h"

#include <math.h>

#include "draw/layers/surface/merge.h"

/* The memory of one worker. */
struct sp_layers_worker {
    struct sp_fragment_tile tile;
    struct sp_surface_scratch surface;
    struct sp_mesh_scratch *mesh;
};

static bool is_volume(const struct sp_layer *layer) {
    return layer->type == SP_LAYER_VOLUME || layer->type == SP_LAYER_CHANNEL;
}

bool sp_layers_have_volume(const struct sp_view *view) {
    for (uint32_t i = 0; i < view->layer_count; i++)
        if (is_volume(&view->layers[i]))
            return true;
    return false;
}

bool sp_layers_are_wanted(const struct sp_view *view) {
    for (uint32_t i = 0; i < view->layer_count; i++)
        if (!is_volume(&view->layers[i]))
            return true;
    return view->layer_count == 0;
}

void sp_layers_channel_view(const struct sp_view *view, uint32_t layer,
                            const struct sp_volume_info *info, struct sp_view *out) {
    *out = *view;
    sp_channel_function(view, &view->layers[layer], info, &out->transfer_function);
    out->layer_count = 1;
    out->layers[0] = sp_layer_default(SP_LAYER_VOLUME);
    out->compositing.center = out->compositing.width = out->compositing.zero = NAN;
}

/* The memory that the other caches leave for the cache of `type`. */
static uint64_t bytes_for(const struct sp_layers_input *from, enum sp_layer_type type) {
    uint64_t used = 0;
    if (type != SP_LAYER_SURFACE)
        used += sp_surface_cache_bytes(from->surfaces, NULL);
    if (type != SP_LAYER_SHELL)
        used += sp_shell_bytes(from->shells, NULL);
    if (type != SP_LAYER_VECTORS && from->vectors)
        used += sp_vectors_bytes(from->vectors, NULL);
    if (type != SP_LAYER_POINTS && from->clouds)
        used += sp_cloud_bytes(from->clouds, NULL);
    return used < from->bytes_max ? from->bytes_max - used : 0;
}

static bool prepare_surface(struct sp_layers *l, const struct sp_layer *layer,
                            struct sp_error *err) {
    const struct sp_layers_input *from = l->input;
    const struct sp_grid *grid = &sp_volume_info(from->volume)->grid;
    const unsigned level = sp_surface_level(from->view, grid, from->camera);
    const unsigned most = sp_surface_can_merge(grid) ? SURFACE_LEVELS - 1 : 0;
    const unsigned preview = from->mip_level < most ? from->mip_level : most;
    const struct sp_surface_cache_job points = { .volume = from->volume,
                                                 .value = layer->value,
                                                 .level = preview > level ? preview : level,
                                                 .bytes_max = bytes_for(from, SP_LAYER_SURFACE),
                                                 .pool = from->pool,
                                                 .interrupt = from->interrupt };
    struct sp_surface_input input = { .view = from->view,
                                      .layer = layer,
                                      .volume = from->volume,
                                      .grid = grid,
                                      .points = sp_surface_cache_get(from->surfaces, &points, err),
                                      .camera = from->camera,
                                      .shade = from->shade,
                                      .is_enlarged = preview > level,
                                      .interrupt = from->interrupt,
                                      .pool = from->pool,
                                      .arena = from->arena };
    return input.points && sp_surface_prepare(&input, &l->surfaces[l->surface_count++], err);
}

static const struct sp_voxel_list *get_shell(const struct sp_layers_input *from,
                                             const struct sp_layer *layer, struct sp_error *err) {
    const struct sp_shell_job job = { .volume = from->volume,
                                      .tf = &from->view->transfer_function,
                                      .low = layer->low,
                                      .high = layer->high,
                                      .clip = &from->view->clip,
                                      .bytes_max = bytes_for(from, SP_LAYER_SHELL),
                                      .pool = from->pool,
                                      .interrupt = from->interrupt };
    return sp_shell_cache_get(from->shells, &job, err);
}

static const struct sp_voxel_list *get_vectors(const struct sp_layers_input *from, uint32_t number,
                                               struct sp_error *err) {
    const struct sp_layer *layer = &from->view->layers[number];
    struct sp_vectors_job job = { .volume = from->volume,
                                  .tf = &from->view->transfer_function,
                                  .clip = &from->view->clip,
                                  .density = layer->density,
                                  .bytes_max = bytes_for(from, SP_LAYER_VECTORS),
                                  .pool = from->pool,
                                  .interrupt = from->interrupt };
    sp_coloring_init(&job.coloring, layer, job.tf, from->volume, from->colors[number]);
    return sp_vectors_cache_get(from->vectors, from->volume, &job, err);
}

bool sp_layers_voxels(const struct sp_layers_input *from, uint32_t number,
                      struct sp_voxel_input *input, struct sp_error *err) {
    const struct sp_layer *layer = &from->view->layers[number];
    bool is_shell = layer->type == SP_LAYER_SHELL;
    *input = (struct sp_voxel_input){ .view = from->view,
                                      .layer = layer,
                                      .grid = &sp_volume_info(from->volume)->grid,
                                      .list = is_shell ? get_shell(from, layer, err)
                                                       : get_vectors(from, number, err),
                                      .camera = from->camera,
                                      .shade = from->shade,
                                      .kernels = from->voxel_kernels,
                                      .by_depth = from->view->layer_count > 1,
                                      .interrupt = from->interrupt,
                                      .pool = from->pool,
                                      .arena = from->arena };
    return input->list != NULL;
}

/* Prepares a shell or a layer of vectors. */
static bool prepare_voxels(const struct sp_layers_input *from, uint32_t layer,
                           struct sp_layers_voxels *to, struct sp_error *err) {
    to->is_there = true;
    if (!sp_layers_voxels(from, layer, &to->input, err))
        return false;
    return from->voxel_kernels ? sp_voxel_prepare(&to->input, &to->layer, err)
                               : sp_voxel_source_acquire(&to->input, &to->layer, err);
}

bool sp_layers_cloud(const struct sp_layers_input *from, uint32_t layer, struct sp_layers_cloud *to,
                     struct sp_error *err) {
    const struct sp_cloud_input input = { .view = from->view,
                                          .layer = &from->view->layers[layer],
                                          .volume = from->layer_volumes[layer],
                                          .colors = from->colors[layer],
                                          .clipped = &sp_volume_info(from->volume)->grid,
                                          .camera = from->camera,
                                          .set_up = from->cloud_set_up,
                                          .trees = from->clouds,
                                          .bytes_max = bytes_for(from, SP_LAYER_POINTS),
                                          .mip_level = from->mip_level,
                                          .interrupt = from->interrupt,
                                          .pool = from->pool,
                                          .arena = from->arena };
    to->number = layer;
    to->voxels = (struct sp_layers_voxels){ .is_there = true };
    to->voxels.input = (struct sp_voxel_input){ .view = from->view,
                                                .layer = input.layer,
                                                .source = &to->source,
                                                .camera = from->camera,
                                                .kernels = from->voxel_kernels,
                                                .interrupt = from->interrupt,
                                                .pool = from->pool,
                                                .arena = from->arena };
    return sp_cloud_prepare(&input, &to->cloud, &to->source, err);
}

bool sp_layers_is_cloud(const struct sp_layers_input *from, uint32_t layer) {
    const enum sp_layer_type type = from->view->layers[layer].type;
    return type == SP_LAYER_POINTS || type == SP_LAYER_GAUSSIANS ||
           (type == SP_LAYER_VECTORS && from->layer_volumes[layer]);
}

static bool prepare_cloud(struct sp_layers *l, uint32_t layer, struct sp_error *err) {
    struct sp_layers_cloud *to = &l->clouds[l->cloud_count++];
    return sp_layers_cloud(l->input, layer, to, err) &&
           (!l->input->voxel_kernels ||
            sp_voxel_prepare(&to->voxels.input, &to->voxels.layer, err));
}

static bool prepare_mesh(struct sp_layers *l, uint32_t number, struct sp_error *err) {
    const struct sp_layers_input *from = l->input;
    const struct sp_mesh_input input = { .view = from->view,
                                         .layer = &from->view->layers[number],
                                         .elements =
                                             sp_volume_elements(from->layer_volumes[number]),
                                         .grid = &sp_volume_info(from->volume)->grid,
                                         .camera = from->camera,
                                         .shade = from->shade,
                                         .kernels = from->mesh_kernels,
                                         .interrupt = from->interrupt,
                                         .pool = from->pool,
                                         .arena = from->arena };
    if (input.layer->opacity <= 0)
        return true;
    l->mesh_layers[l->mesh_count] = number;
    if (from->mesh_kernels)
        return sp_mesh_prepare(&input, &l->meshes[l->mesh_count++], err);
    sp_mesh_init(&input, &l->meshes[l->mesh_count++]);
    return true;
}

static bool prepare_layer(struct sp_layers *l, uint32_t number, struct sp_error *err) {
    const struct sp_layer *layer = &l->input->view->layers[number];
    if (sp_layers_is_cloud(l->input, number))
        return prepare_cloud(l, number, err);
    switch (layer->type) {
    case SP_LAYER_SURFACE:
        return layer->opacity <= 0 || prepare_surface(l, layer, err);
    case SP_LAYER_SHELL:
        return prepare_voxels(l->input, number, &l->shell, err);
    case SP_LAYER_VECTORS:
        return prepare_voxels(l->input, number, &l->vectors, err);
    case SP_LAYER_GEOMETRY:
        return prepare_mesh(l, number, err);
    case SP_LAYER_POINTS:
    case SP_LAYER_GAUSSIANS:
    case SP_LAYER_VOLUME:
    case SP_LAYER_CHANNEL:
        break;
    }
    return true;
}

static bool allocate_workers(struct sp_layers *l) {
    const unsigned threads = sp_pool_threads(l->input->pool);
    struct sp_arena *arena = l->input->arena;
    int sheets = 0;
    l->workers = sp_arena_alloc(arena, "tiles of layers", threads, sizeof *l->workers);
    for (unsigned i = 0; i < l->mesh_count; i++)
        sheets = l->meshes[i].sheets > sheets ? l->meshes[i].sheets : sheets;
    for (unsigned w = 0; w < threads && l->workers && sheets; w++)
        if (!(l->workers[w].mesh = sp_mesh_scratch_alloc(arena, sheets)))
            return false;
    return l->workers;
}

bool sp_layers_prepare(const struct sp_layers_input *input, struct sp_layers *l,
                       struct sp_error *err) {
    *l = (struct sp_layers){ .input = input };
    sp_surface_cache_begin(input->surfaces);
    for (uint32_t i = 0; i < input->view->layer_count; i++)
        if (!prepare_layer(l, i, err))
            return false;
    return allocate_workers(l) || sp_arena_fail(input->arena, "layers", err);
}

static int columns_of(const struct sp_view *view) {
    return (int)((view->size[0] + SP_FRAGMENT_TILE - 1) / SP_FRAGMENT_TILE);
}

struct drawing {
    const struct sp_layers *layers;
    int begin; /* row of tiles */
    sp_layers_tile_fn *tile;
    void *user;
    atomic_bool is_out_of_memory;
};

/* Surfaces come first, because they have the fewest fragments: voxels then merge around them. */
static void draw_tile(const struct sp_layers *l, struct sp_layers_worker *w, int column, int row) {
    sp_fragment_tile_clear(&w->tile, column * SP_FRAGMENT_TILE, row * SP_FRAGMENT_TILE);
    for (unsigned i = 0; i < l->surface_count; i++)
        l->input->surface_tile(&l->surfaces[i], &w->surface, &w->tile);
    for (unsigned i = 0; i < l->mesh_count; i++)
        l->input->mesh_kernels->tile(&l->meshes[i], w->mesh, &w->tile);
    if (l->shell.is_there)
        sp_voxel_tile(&l->shell.layer, column, row, &w->tile);
    if (l->vectors.is_there)
        sp_voxel_tile(&l->vectors.layer, column, row, &w->tile);
    for (unsigned i = 0; i < l->cloud_count; i++)
        sp_voxel_tile(&l->clouds[i].voxels.layer, column, row, &w->tile);
}

static void draw_tiles(void *user, size_t begin, size_t end, unsigned worker) {
    struct drawing *d = user;
    const struct sp_layers *l = d->layers;
    const int columns = columns_of(l->input->view);
    for (size_t t = begin; t < end && !sp_interrupt_is_cancelled(&l->input->interrupt); t++) {
        draw_tile(l, &l->workers[worker], (int)t % columns, d->begin + (int)t / columns);
        if (!d->tile(d->user, &l->workers[worker].tile, worker))
            atomic_store_explicit(&d->is_out_of_memory, true, memory_order_relaxed);
    }
}

bool sp_layers_draw(const struct sp_layers *l, int begin, int end, sp_layers_tile_fn *tile,
                    void *user, struct sp_error *err) {
    const size_t tiles = (size_t)columns_of(l->input->view) * (size_t)(end - begin);
    struct drawing d = { .layers = l, .begin = begin, .tile = tile, .user = user };
    sp_parallel_for(l->input->pool, tiles, 1, draw_tiles, &d);
    if (sp_interrupt_is_cancelled(&l->input->interrupt))
        return sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
    return !atomic_load(&d.is_out_of_memory) ||
           sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the frame's fragments");
}

struct collection {
    struct sp_fragments *fragments;
    struct sp_arena *arenas;
};

static bool store(void *user, const struct sp_fragment_tile *tile, unsigned worker) {
    const struct collection *c = user;
    uint32_t count = sp_fragment_tile_count(tile);
    if (!count)
        return true;
    uint32_t *first =
        sp_arena_alloc(&c->arenas[worker], "fragments", SP_FRAGMENT_PIXELS + 1, sizeof *first);
    struct sp_fragment *list = sp_arena_alloc(&c->arenas[worker], "fragments", count, sizeof *list);
    if (!first || !list)
        return false;
    sp_fragments_store(c->fragments, tile, first, list);
    return true;
}

bool sp_layers_collect(const struct sp_layers *l, int begin, int end,
                       struct sp_arena *worker_arenas, struct sp_fragments *fragments,
                       struct sp_error *err) {
    struct collection collection = { fragments, worker_arenas };
    for (unsigned w = 0; w < sp_pool_threads(l->input->pool); w++)
        sp_arena_reset(&worker_arenas[w]);
    if (sp_layers_draw(l, begin, end, store, &collection, err))
        return true;
    for (unsigned w = 0; w < sp_pool_threads(l->input->pool); w++)
        if (worker_arenas[w].failed)
            return sp_arena_fail(&worker_arenas[w], "fragments", err);
    return false;
}
