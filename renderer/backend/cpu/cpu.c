/* SPDX-License-Identifier: Apache-2.0 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "backend/cpu/caches.h"
#include "backend/cpu/draw.h"
#include "sp/probe.h"

/* Returns the processor's name as the system reports it. */
static void read_device(char *text, size_t size) {
    snprintf(text, size, "CPU");
    FILE *file = fopen("/proc/cpuinfo", "r");
    if (!file)
        return;
    char line[256];
    while (fgets(line, sizeof line, file)) {
        char *colon = strchr(line, ':');
        if (strncmp(line, "model name", 10) == 0 && colon) {
            colon += 1 + strspn(colon + 1, " \t");
            colon[strcspn(colon, "\n")] = 0;
            snprintf(text, size, "%s", colon);
            break;
        }
    }
    fclose(file);
}

static void cpu_destroy(void *pointer) {
    struct cpu_state *state = pointer;
    for (enum cpu_cache cache = 0; cache < CPU_CACHES; cache++)
        cpu_cache_evict(state, cache, NULL);
    for (unsigned w = 0; state->worker_arenas && w < sp_pool_threads(state->pool); w++)
        sp_arena_finish(&state->worker_arenas[w]);
    free(state->worker_arenas);
    sp_pool_destroy(&state->pool);
    sp_arena_finish(&state->arena);
    free(state);
}

static void *cpu_create(const struct sp_backend_options *options, struct sp_error *err) {
    struct cpu_state *state = calloc(1, sizeof *state);
    if (!state) {
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the cpu backend");
        return NULL;
    }
    sp_arena_init(&state->arena);
    state->arena.budget = options->frame_budget;
    sp_cubic_table_init(&state->cubic);
    sp_postconv_tables_init(&state->postconv);
    state->memory_bytes = options->memory_bytes;
    if (cpu_kernels_init(&state->kernels, options->isa, err))
        state->pool = sp_pool_create(options->threads, err);
    if (state->pool) {
        state->worker_arenas = calloc(options->threads, sizeof *state->worker_arenas);
        if (!state->worker_arenas)
            sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the cpu backend");
    }
    if (!state->worker_arenas) {
        cpu_destroy(state);
        return NULL;
    }
    for (unsigned w = 0; w < options->threads; w++) {
        sp_arena_init(&state->worker_arenas[w]);
        state->worker_arenas[w].budget = options->frame_budget;
    }
    read_device(state->device, sizeof state->device);
    return state;
}

static void cpu_info(const void *pointer, struct sp_renderer_info *info) {
    const struct cpu_state *state = pointer;
    *info = (struct sp_renderer_info){ .backend = "cpu",
                                       .isa = state->kernels.isa,
                                       .threads = sp_pool_threads(state->pool),
                                       .can_pause = true,
                                       .has_depth = true,
                                       .lanes = state->kernels.lanes,
                                       .vectorised = state->kernels.vectorised };
    memcpy(info->device, state->device, sizeof info->device);
}

static void cpu_evict(void *pointer, const struct sp_volume *volume) {
    for (enum cpu_cache cache = 0; cache < CPU_CACHES; cache++)
        cpu_cache_evict(pointer, cache, volume);
}

static uint64_t cpu_memory(const void *pointer, const struct sp_volume *volume) {
    uint64_t bytes = 0;
    for (enum cpu_cache cache = 0; cache < CPU_CACHES; cache++)
        bytes += cpu_cache_bytes(pointer, cache, volume);
    return bytes;
}

static void cpu_trim(void *pointer) {
    struct cpu_state *state = pointer;
    sp_arena_trim(&state->arena);
    for (unsigned w = 0; w < sp_pool_threads(state->pool); w++)
        sp_arena_trim(&state->worker_arenas[w]);
}

static void cpu_probe(const struct sp_backend_options *options, sp_device_visit *visit,
                      void *user) {
    struct sp_device device = {
        .backend = "cpu", .place = "processor", .gpu = -1, .threads = options->threads
    };
    struct cpu_kernels kernels;
    size_t used = 0;
    read_device(device.name, sizeof device.name);
    for (unsigned i = 0; cpu_isa_at(i); i++)
        if (cpu_kernels_init(&kernels, cpu_isa_at(i), NULL))
            used += (size_t)snprintf(device.version + used, sizeof device.version - used, "%s%s",
                                     used ? ", " : "", cpu_isa_at(i));
    visit(user, &device);
}

extern const struct sp_backend cpu_backend;
const struct sp_backend cpu_backend = {
    .entry = { "cpu", "EWA splatting on the processor, the reference of all backends" },
    .capabilities = { .projections = SP_CAN(SP_PERSPECTIVE) | SP_CAN(SP_ORTHOGRAPHIC),
                      .filters = SP_CAN_ALL,
                      .kernels = SP_CAN_ALL,
                      .compositings = SP_CAN_ALL,
                      .attenuations = SP_CAN_ALL,
                      .orders = SP_CAN_ALL,
                      .shadings = SP_CAN(SP_SHADING_NONE) | SP_CAN(SP_SHADING_PHONG),
                      .levels_of_detail = SP_CAN(SP_LOD_AUTO) | SP_CAN(SP_LOD_OFF),
                      .gradient_axis = true,
                      .interpolated_sheets = true,
                      .blocks = true,
                      .light = true,
                      .layers = SP_CAN_ALL,
                      .clip_box = true,
                      .clip_planes = true,
                      .depth = true },
    .create = cpu_create,
    .destroy = cpu_destroy,
    .info = cpu_info,
    .render = cpu_draw,
    .evict = cpu_evict,
    .memory = cpu_memory,
    .trim = cpu_trim,
    .probe = cpu_probe,
};
