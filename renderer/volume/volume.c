/* SPDX-License-Identifier: Apache-2.0 */
#include "volume/volume.h"

#include <assert.h>
#include <inttypes.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct sp_volume {
    atomic_uint references;
    struct sp_volume_info info;
    double *coordinates; /* of all rectilinear axes, one after the other; NULL = none */
    void *voxels;
    size_t bytes;
    sp_voxels_release *release;
};

size_t sp_type_size(enum sp_type type) {
    static const unsigned char sizes[SP_TYPE_COUNT] = { 1, 1, 2, 2, 4, 4, 8 };
    assert(type < SP_TYPE_COUNT);
    return sizes[type];
}

const char *sp_type_name(enum sp_type type) {
    static const char *const names[SP_TYPE_COUNT] = { "uint8", "int8",    "uint16", "int16",
                                                      "int32", "float32", "float64" };
    assert(type < SP_TYPE_COUNT);
    return names[type];
}

static void release_heap(void *voxels, size_t bytes) {
    (void)bytes;
    free(voxels);
}

/* Copies the grid's coordinates into memory that the volume owns. */
static bool keep_coordinates(struct sp_volume *volume, struct sp_error *err) {
    struct sp_grid *grid = &volume->info.grid;
    size_t count = 0;
    for (int a = 0; a < 3; a++)
        count += grid->coordinates[a] ? grid->dims[a] : 0;
    if (count == 0)
        return true;
    double *next = volume->coordinates = malloc(count * sizeof *next);
    if (!next)
        return sp_fail(err, SP_ERR_MEMORY, volume->info.source,
                       "out of memory for the coordinates");
    for (int a = 0; a < 3; a++)
        if (grid->coordinates[a]) {
            grid->coordinates[a] = memcpy(next, grid->coordinates[a], grid->dims[a] * sizeof *next);
            next += grid->dims[a];
        }
    return true;
}

struct sp_volume *sp_volume_adopt(const struct sp_volume_info *info, void *voxels, size_t bytes,
                                  sp_voxels_release *release, struct sp_error *err) {
    assert((uintptr_t)voxels % 64 == 0);
    struct sp_volume *volume = malloc(sizeof *volume);
    if (!volume) {
        release(voxels, bytes);
        sp_fail(err, SP_ERR_MEMORY, info->source, "out of memory for a volume");
        return NULL;
    }
    atomic_init(&volume->references, 1);
    volume->info = *info;
    volume->coordinates = NULL;
    volume->voxels = voxels;
    volume->bytes = bytes;
    volume->release = release;
    const uint32_t *dims = info->grid.dims;
    uint64_t count = (uint64_t)dims[0] * dims[1] * dims[2];
    volume->info.components = 1;
    volume->info.voxel_bytes = count * sp_type_size(info->type);
    assert(volume->info.voxel_bytes <= bytes);
    if (!keep_coordinates(volume, err) || !sp_volume_measure(&volume->info, voxels, count, err))
        sp_volume_unref(&volume);
    return volume;
}

struct sp_volume *sp_volume_create(const struct sp_grid *grid, enum sp_type type,
                                   const void *voxels, const char *name, struct sp_error *err) {
    struct sp_volume_info info = { .grid = *grid, .type = type };
    uint64_t bytes;
    if (!sp_grid_check(grid, type, name, &bytes, err))
        return NULL;
    snprintf(info.name, sizeof info.name, "%s", name);
    snprintf(info.source, sizeof info.source, "memory:%s", name);
    size_t capacity = (bytes + 63) & ~(uint64_t)63;
    void *copy = aligned_alloc(64, capacity);
    if (!copy) {
        sp_fail(err, SP_ERR_MEMORY, name, "out of memory for %" PRIu64 " bytes of samples", bytes);
        return NULL;
    }
    memcpy(copy, voxels, bytes);
    return sp_volume_adopt(&info, copy, capacity, release_heap, err);
}

struct sp_volume *sp_volume_ref(struct sp_volume *volume) {
    unsigned before = atomic_fetch_add_explicit(&volume->references, 1, memory_order_relaxed);
    assert(before > 0);
    (void)before;
    return volume;
}

void sp_volume_unref(struct sp_volume **volume) {
    struct sp_volume *v = *volume;
    *volume = NULL;
    if (!v || atomic_fetch_sub_explicit(&v->references, 1, memory_order_acq_rel) != 1)
        return;
    v->release(v->voxels, v->bytes);
    free(v->coordinates);
    free(v);
}

const struct sp_volume_info *sp_volume_info(const struct sp_volume *volume) {
    return &volume->info;
}

const void *sp_volume_voxels(const struct sp_volume *volume) {
    return volume->voxels;
}
