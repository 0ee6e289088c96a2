/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/cpu/layers.h"

#include "backend/cpu/caches.h"
#include "frame/depth.h"

/* Fragments that are there at a time: a frame of 1920 × 1080 is drawn in three bands. A small
 * budget gives them a quarter. */
#define FRAGMENT_BYTES ((uint64_t)256 << 20)

static size_t fragment_bytes(const struct sp_budget *budget) {
    const uint64_t quarter = sp_budget_limit(budget) / 4;
    return (size_t)(quarter < FRAGMENT_BYTES ? quarter : FRAGMENT_BYTES);
}

/* Writes the depth of `count` pixels of row y of the tile. light: their transmittances. */
static void resolve_depth(const struct cpu_layers *l, const struct sp_fragment_tile *tile, int y,
                          uint32_t count, const float *light) {
    const struct sp_frame *frame = l->job->frame;
    const size_t row = (size_t)(tile->y + y);
    float moment[2][SP_FRAGMENT_TILE], place[2][SP_FRAGMENT_TILE];
    const float *const planes[3] = { light, moment[0], moment[1] };
    const float *const places[2] = { place[0], place[1] };
    for (uint32_t x = 0; x < count; x++) {
        const int i = y * SP_FRAGMENT_TILE + (int)x;
        const struct sp_fragment *list = tile->list[i];
        float through = 1;
        moment[0][x] = moment[1][x] = 0;
        place[0][x] = tile->count[i] ? list[0].depth : 0;
        place[1][x] = 1;
        for (int k = 0; k < tile->count[i]; k++) {
            const float share = through * list[k].alpha, d = list[k].depth - list[0].depth;
            moment[0][x] += share * d;
            moment[1][x] += share * d * d;
            through *= 1 - list[k].alpha;
        }
    }
    l->state->kernels.resolve_depth(planes, places, count,
                                    sp_depth_row(frame, frame->depth, row) + tile->x,
                                    sp_depth_row(frame, frame->spread, row) + tile->x);
}

/* Composites the tile's fragments into the frame. */
static bool resolve(void *user, const struct sp_fragment_tile *tile, unsigned worker) {
    const struct cpu_layers *l = user;
    struct sp_frame *frame = l->job->frame;
    const float *background = l->job->view->background;
    int left = (int)frame->width - tile->x, below = (int)frame->height - tile->y;
    uint32_t width = (uint32_t)(left < SP_FRAGMENT_TILE ? left : SP_FRAGMENT_TILE);
    _Alignas(64) float row[4][SP_FRAGMENT_TILE];
    const float *const planes[4] = { row[0], row[1], row[2], row[3] };
    (void)worker;
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
        if (frame->depth)
            resolve_depth(l, tile, y, width, row[0]);
    }
    return true;
}

static void init(struct cpu_layers *l, struct cpu_state *state, const struct sp_backend_job *job) {
    const struct sp_view *view = job->view;
    bool is_lit = view->shading.mode == SP_SHADING_PHONG;
    l->state = state;
    l->job = job;
    sp_camera_transform_init(&l->camera, &view->camera, view->size);
    if (is_lit)
        sp_shade_init(&l->shade, &l->camera, &view->shading);
    l->input =
        (struct sp_layers_input){ .view = view,
                                  .volume = job->volume,
                                  .layer_volumes = job->layer_volumes,
                                  .colors = job->colors,
                                  .camera = &l->camera,
                                  .shade = is_lit ? &l->shade : NULL,
                                  .surfaces = &state->surfaces,
                                  .shells = &state->shells,
                                  .vectors = &state->vectors,
                                  .clouds = &state->clouds,
                                  .bytes_max = cpu_cache_rest(state, CPU_CACHE_SURFACES) +
                                               cpu_cache_bytes(state, CPU_CACHE_SHELLS, NULL) +
                                               cpu_cache_bytes(state, CPU_CACHE_VECTORS, NULL) +
                                               cpu_cache_bytes(state, CPU_CACHE_CLOUDS, NULL),
                                  .surface_tile = state->kernels.surface_tile,
                                  .voxel_kernels = &state->kernels.voxels,
                                  .cloud_set_up = state->kernels.cloud_set_up,
                                  .mesh_kernels = &state->kernels.mesh,
                                  .mip_level = job->mip_level,
                                  .interrupt = sp_job_interrupt(job),
                                  .pool = state->pool,
                                  .arena = &state->arena };
}

/* A frame of nothing but splats needs no fragments. */
static bool draws_alone(const struct sp_view *view) {
    const uint32_t splats = SP_CAN(SP_LAYER_SHELL) | SP_CAN(SP_LAYER_VECTORS) |
                            SP_CAN(SP_LAYER_POINTS) | SP_CAN(SP_LAYER_GAUSSIANS);
    return view->layer_count == 1 && splats & SP_CAN(view->layers[0].type);
}

static bool draw_alone(const struct cpu_layers *l, struct sp_error *err) {
    struct sp_layers_cloud cloud;
    struct sp_voxel_input voxels, *input = &voxels;
    double begin = sp_job_clock_ms(l->job);
    if (sp_layers_is_cloud(&l->input, 0)) {
        input = &cloud.voxels.input;
        if (!sp_layers_cloud(&l->input, 0, &cloud, err))
            return false;
    } else if (!sp_layers_voxels(&l->input, 0, input, err)) {
        return false;
    }
    double found_ms = sp_job_clock_ms(l->job) - begin;
    input->frame = l->job->frame;
    if (!sp_voxel_draw(input, err))
        return false;
    l->job->frame->stats.stages[0].ms += found_ms; /* "classify" */
    return true;
}

static void add_stats(struct sp_frame_stats *stats, const struct sp_voxel_layer *layer) {
    stats->visible_voxels += layer->source.count;
    stats->splats += layer->drawn;
    stats->fragments += (uint64_t)layer->area;
}

/* sp_fragments.fill */
static bool fill(void *user, int begin, int end, struct sp_error *err) {
    struct cpu_layers *l = user;
    const double start_ms = sp_job_clock_ms(l->job);
    const bool ok =
        sp_layers_collect(&l->layers, begin, end, l->state->worker_arenas, &l->fragments, err);
    l->fragments.ms += sp_job_clock_ms(l->job) - start_ms;
    return ok;
}

static bool open_fragments(struct cpu_layers *l, struct sp_error *err) {
    struct sp_arena *arena = &l->state->arena;
    if (!sp_fragments_init(&l->fragments, l->job->view->size, arena))
        return sp_arena_fail(arena, "data", err);
    sp_fragments_limit(&l->fragments, fragment_bytes(arena->budget));
    l->fragments.fill = fill;
    l->fragments.user = l;
    return true;
}

bool cpu_layers_draw(struct cpu_state *state, const struct sp_backend_job *job,
                     struct cpu_layers *l, struct sp_error *err) {
    struct sp_frame_stats *stats = &job->frame->stats;
    const struct sp_view *view = job->view;
    double begin = sp_job_clock_ms(job);
    init(l, state, job);
    if (draws_alone(view))
        return draw_alone(l, err);
    if (!sp_layers_prepare(&l->input, &l->layers, err))
        return false;
    if (sp_layers_have_volume(view))
        return open_fragments(l, err);
    double prepared = sp_job_clock_ms(job);
    const int rows = (int)((view->size[1] + SP_FRAGMENT_TILE - 1) / SP_FRAGMENT_TILE);
    if (!sp_layers_draw(&l->layers, 0, rows, resolve, l, err))
        return false;
    const struct sp_layers *layers = &l->layers;
    if (layers->shell.is_there)
        add_stats(stats, &layers->shell.layer);
    if (layers->vectors.is_there)
        add_stats(stats, &layers->vectors.layer);
    for (unsigned i = 0; i < layers->cloud_count; i++)
        add_stats(stats, &layers->clouds[i].voxels.layer);
    for (unsigned i = 0; i < layers->surface_count; i++) {
        stats->visible_voxels += layers->surfaces[i].points->count;
        stats->splats += layers->surfaces[i].drawn;
    }
    for (unsigned i = 0; i < layers->mesh_count; i++) {
        const struct sp_mesh *mesh = &layers->meshes[i];
        stats->splats += mesh->first[mesh->columns * mesh->rows];
    }
    stats->stage_count = 2;
    stats->stages[0] = (struct sp_stage_time){ "splat", prepared - begin };
    stats->stages[1] = (struct sp_stage_time){ "tile", sp_job_clock_ms(job) - prepared };
    return true;
}
