/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/cpu/layers.h"
#include "backend/cpu/caches.h"

#include "shell/shell.h"

/* What a worker needs. */
struct worker {
    struct sp_fragment_tile tile;
    struct sp_surface_scratch surface;
};

struct layers {
    struct cpu_state *state;
    const struct sp_backend_job *job;
    struct sp_camera_transform camera;
    struct sp_shade shade;
    unsigned surface_count;
    struct sp_surface surfaces[SP_LAYERS_MAX];
    bool has_shell;
    struct sp_shell_input shell_input;
    struct sp_shell shell;
    struct worker *workers;
    struct sp_fragments *fragments; /* NULL = tiles are composited */
    atomic_bool is_out_of_memory;
};

const struct sp_layer *cpu_layers_volume(const struct sp_view *view) {
    for (uint32_t i = 0; i < view->layer_count; i++)
        if (view->layers[i].type == SP_LAYER_VOLUME)
            return &view->layers[i];
    return NULL;
}

bool cpu_layers_are_wanted(const struct sp_view *view) {
    return view->layer_count != 1 || !cpu_layers_volume(view);
}

static bool prepare_surface(struct layers *l, const struct sp_layer *layer, struct sp_error *err) {
    struct cpu_state *state = l->state;
    const struct sp_backend_job *job = l->job;
    const struct sp_surface_cache_job points = { .volume = job->volume,
                                                 .value = layer->value,
                                                 .bytes_max =
                                                     cpu_cache_rest(state, CPU_CACHE_SURFACES),
                                                 .pool = state->pool,
                                                 .interrupt = sp_job_interrupt(job) };
    struct sp_surface_input input = {
        .view = job->view,
        .layer = layer,
        .grid = &sp_volume_info(job->volume)->grid,
        .points = sp_surface_cache_get(&state->surfaces, &points, err),
        .camera = &l->camera,
        .shade = job->view->shading.mode == SP_SHADING_PHONG ? &l->shade : NULL,
        .interrupt = points.interrupt,
        .pool = state->pool,
        .arena = &state->arena
    };
    return input.points && sp_surface_prepare(&input, &l->surfaces[l->surface_count++], err);
}

static void init_shell(struct layers *l, const struct sp_layer *layer) {
    struct cpu_state *state = l->state;
    const struct sp_backend_job *job = l->job;
    l->shell_input =
        (struct sp_shell_input){ .view = job->view,
                                 .layer = layer,
                                 .volume = job->volume,
                                 .frame = job->frame,
                                 .camera = &l->camera,
                                 .shade =
                                     job->view->shading.mode == SP_SHADING_PHONG ? &l->shade : NULL,
                                 .cache = &state->shells,
                                 .bytes_max = cpu_cache_rest(state, CPU_CACHE_SHELLS),
                                 .kernels = &state->kernels.shell,
                                 .interrupt = sp_job_interrupt(job),
                                 .pool = state->pool,
                                 .arena = &state->arena };
}

static bool prepare_layer(struct layers *l, const struct sp_layer *layer, struct sp_error *err) {
    switch (layer->type) {
    case SP_LAYER_SURFACE:
        return layer->opacity <= 0 || prepare_surface(l, layer, err);
    case SP_LAYER_SHELL:
        init_shell(l, layer);
        l->has_shell = true;
        return sp_shell_prepare(&l->shell_input, &l->shell, err);
    case SP_LAYER_VOLUME:
        break;
    }
    return true;
}

static bool prepare(struct layers *l, struct sp_error *err) {
    const struct sp_view *view = l->job->view;
    struct sp_arena *arena = &l->state->arena;
    sp_surface_cache_begin(&l->state->surfaces);
    for (uint32_t i = 0; i < view->layer_count; i++)
        if (!prepare_layer(l, &view->layers[i], err))
            return false;
    l->workers = sp_arena_alloc(arena, "tiles of layers", sp_pool_threads(l->state->pool),
                                sizeof *l->workers);
    if (!l->workers || (l->fragments && !sp_fragments_init(l->fragments, view->size, arena)))
        return cpu_fail_memory(arena, err);
    return true;
}

/* Keeps the tile's fragments for the volume. */
static void store(struct layers *l, const struct sp_fragment_tile *tile, unsigned worker) {
    struct sp_arena *arena = &l->state->worker_arenas[worker];
    uint32_t count = sp_fragment_tile_count(tile);
    if (!count)
        return;
    uint32_t *first = sp_arena_alloc(arena, "fragments", SP_FRAGMENT_PIXELS + 1, sizeof *first);
    struct sp_fragment *list = sp_arena_alloc(arena, "fragments", count, sizeof *list);
    if (first && list)
        sp_fragments_store(l->fragments, tile, first, list);
    else
        atomic_store_explicit(&l->is_out_of_memory, true, memory_order_relaxed);
}

/* Composites the tile's fragments into the frame. */
static void resolve(const struct layers *l, const struct sp_fragment_tile *tile) {
    struct sp_frame *frame = l->job->frame;
    const float *background = l->job->view->background;
    int left = (int)frame->width - tile->x, below = (int)frame->height - tile->y;
    uint32_t width = (uint32_t)(left < SP_FRAGMENT_TILE ? left : SP_FRAGMENT_TILE);
    _Alignas(64) float row[4][SP_FRAGMENT_TILE];
    const float *const planes[4] = { row[0], row[1], row[2], row[3] };
    for (int y = 0; y < SP_FRAGMENT_TILE && y < below; y++) {
        for (int x = 0; x < SP_FRAGMENT_TILE; x++) {
            int i = y * SP_FRAGMENT_TILE + x;
            float rgbt[4] = { 0, 0, 0, 1 };
            for (int k = 0; k < tile->count[i]; k++)
                sp_fragment_over(&tile->list[i][k], rgbt);
            row[0][x] = rgbt[3];
            for (int c = 0; c < 3; c++)
                row[1 + c][x] = rgbt[c];
        }
        unsigned char *out =
            (unsigned char *)frame->pixels + (size_t)(tile->y + y) * frame->stride_bytes;
        if (frame->format == SP_RGBAF32)
            l->state->kernels.resolve_rgbaf32(planes, width, background,
                                              (float *)(void *)out + 4 * (size_t)tile->x);
        else
            l->state->kernels.resolve_rgba8(planes, width, background, out + 4 * (size_t)tile->x);
    }
}

static int columns_of(const struct sp_frame *frame) {
    return (int)((frame->width + SP_FRAGMENT_TILE - 1) / SP_FRAGMENT_TILE);
}

static void draw_tiles(void *user, size_t begin, size_t end, unsigned worker) {
    struct layers *l = user;
    struct worker *w = &l->workers[worker];
    int columns = columns_of(l->job->frame);
    for (size_t t = begin; t < end && !sp_job_is_cancelled(l->job); t++) {
        sp_fragment_tile_clear(&w->tile, (int)t % columns * SP_FRAGMENT_TILE,
                               (int)t / columns * SP_FRAGMENT_TILE);
        if (l->has_shell)
            sp_shell_tile(&l->shell, (int)t % columns, (int)t / columns, &w->tile);
        for (unsigned i = 0; i < l->surface_count; i++)
            l->state->kernels.surface_tile(&l->surfaces[i], &w->surface, &w->tile);
        if (l->fragments)
            store(l, &w->tile, worker);
        else
            resolve(l, &w->tile);
    }
}

bool cpu_layers_draw(struct cpu_state *state, const struct sp_backend_job *job,
                     struct sp_fragments *fragments, struct sp_error *err) {
    struct layers l = { .state = state, .job = job };
    struct sp_frame_stats *stats = &job->frame->stats;
    const struct sp_frame *frame = job->frame;
    const struct sp_view *view = job->view;
    double begin = sp_job_clock_ms(job);
    l.fragments = cpu_layers_volume(view) ? fragments : NULL;
    for (unsigned w = 0; w < sp_pool_threads(state->pool); w++)
        sp_arena_reset(&state->worker_arenas[w]);
    sp_camera_transform_init(&l.camera, &view->camera, view->size);
    if (view->shading.mode == SP_SHADING_PHONG)
        sp_shade_init(&l.shade, &l.camera, &view->shading);
    if (view->layer_count == 1 && view->layers[0].type == SP_LAYER_SHELL) {
        init_shell(&l, &view->layers[0]); /* needs no fragments */
        return sp_shell_draw(&l.shell_input, err);
    }
    if (!prepare(&l, err))
        return false;
    double prepared = sp_job_clock_ms(job);
    size_t rows = (frame->height + SP_FRAGMENT_TILE - 1) / SP_FRAGMENT_TILE;
    sp_parallel_for(state->pool, (size_t)columns_of(frame) * rows, 1, draw_tiles, &l);
    if (sp_job_is_cancelled(job))
        return sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
    if (atomic_load(&l.is_out_of_memory))
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the frame's fragments");
    if (!l.fragments) {
        stats->stage_count = 2;
        stats->stages[0] = (struct sp_stage_time){ "splat", prepared - begin };
        stats->stages[1] = (struct sp_stage_time){ "tile", sp_job_clock_ms(job) - prepared };
    }
    return true;
}
