/* SPDX-License-Identifier: Apache-2.0 */
#include "volume/volume.h"

#include <assert.h>
#include <inttypes.h>
#include <math.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct sp_volume {
    atomic_uint references;
    struct sp_volume_info info;
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

/* Voxels may be as far from the origin as 2^40 of their size: views keep 12 bits below a voxel. */
#define ORIGIN_SAMPLES_MAX 0x1p40

static bool check_direction(const double m[3][3], const char *place, struct sp_error *err) {
    for (int axis = 0; axis < 3; axis++) {
        double length =
            sqrt(m[0][axis] * m[0][axis] + m[1][axis] * m[1][axis] + m[2][axis] * m[2][axis]);
        if (!(fabs(length - 1) <= 1e-6))
            return sp_fail(err, SP_ERR_FORMAT, place,
                           "direction of axis %d has length %g instead of 1", axis, length);
    }
    double det = m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) -
                 m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
                 m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
    if (!(fabs(det) >= 1e-6))
        return sp_fail(err, SP_ERR_FORMAT, place,
                       "directions are singular (determinant %g): the axes lie in one plane", det);
    return true;
}

static bool check_dims(const struct sp_grid *grid, const char *place, struct sp_error *err) {
    uint64_t voxels = 1;
    for (int axis = 0; axis < 3; axis++) {
        if (grid->dims[axis] < 1 || grid->dims[axis] > SP_DIM_MAX)
            return sp_fail(err, SP_ERR_FORMAT, place, "dims[%d] is %" PRIu32 ", outside [1, %u]",
                           axis, grid->dims[axis], SP_DIM_MAX);
        voxels *= grid->dims[axis]; /* 2^48 at most */
    }
    if (voxels > SP_VOXELS_MAX)
        return sp_fail(err, SP_ERR_FORMAT, place,
                       "dims %" PRIu32 " x %" PRIu32 " x %" PRIu32 " are more than %" PRIu64
                       " voxels",
                       grid->dims[0], grid->dims[1], grid->dims[2], SP_VOXELS_MAX);
    return true;
}

static bool check_spacing(const struct sp_grid *grid, const char *place, struct sp_error *err) {
    for (int axis = 0; axis < 3; axis++)
        if (!(grid->spacing[axis] >= 1e-12 && grid->spacing[axis] <= 1e12))
            return sp_fail(err, SP_ERR_FORMAT, place, "spacing[%d] is %g, outside [1e-12, 1e12]",
                           axis, grid->spacing[axis]);
    return true;
}

static bool check_origin(const struct sp_grid *grid, const char *place, struct sp_error *err) {
    double least = fmin(grid->spacing[0], fmin(grid->spacing[1], grid->spacing[2]));
    for (int axis = 0; axis < 3; axis++) {
        if (!(fabs(grid->origin[axis]) <= 1e15))
            return sp_fail(err, SP_ERR_FORMAT, place, "origin[%d] is %g, outside [-1e15, 1e15]",
                           axis, grid->origin[axis]);
        if (fabs(grid->origin[axis]) > ORIGIN_SAMPLES_MAX * least)
            return sp_fail(err, SP_ERR_FORMAT, place,
                           "origin[%d] is %g, more than 2^40 times the spacing of %g: too far away "
                           "to be looked at; move it nearer to 0",
                           axis, grid->origin[axis], least);
    }
    return true;
}

enum sp_grid_part sp_grid_bad_part(const struct sp_grid *grid) {
    struct sp_error unused;
    return !check_dims(grid, "", &unused)                   ? SP_GRID_DIMS
           : !check_spacing(grid, "", &unused)              ? SP_GRID_SPACING
           : !check_origin(grid, "", &unused)               ? SP_GRID_ORIGIN
           : !check_direction(grid->direction, "", &unused) ? SP_GRID_DIRECTION
                                                            : SP_GRID_GOOD;
}

bool sp_grid_check(const struct sp_grid *grid, enum sp_type type, const char *place,
                   uint64_t *bytes, struct sp_error *err) {
    if (!check_dims(grid, place, err) || !check_spacing(grid, place, err) ||
        !check_origin(grid, place, err) || !check_direction(grid->direction, place, err))
        return false;
    *bytes = (uint64_t)grid->dims[0] * grid->dims[1] * grid->dims[2] * sp_type_size(type);
    return true;
}

static void release_heap(void *voxels, size_t bytes) {
    (void)bytes;
    free(voxels);
}

struct sp_volume *sp_volume_adopt(const struct sp_volume_info *info, void *voxels, size_t bytes,
                                  sp_voxels_release *release, struct sp_error *err) {
    assert((uintptr_t)voxels % 64 == 0);
    struct sp_volume *volume = malloc(sizeof *volume);
    if (!volume) {
        release(voxels, bytes);
        sp_fail(err, SP_ERR_MEMORY, info->source, "no memory for a volume");
        return NULL;
    }
    atomic_init(&volume->references, 1);
    volume->info = *info;
    volume->voxels = voxels;
    volume->bytes = bytes;
    volume->release = release;
    const uint32_t *dims = info->grid.dims;
    uint64_t count = (uint64_t)dims[0] * dims[1] * dims[2];
    volume->info.components = 1;
    volume->info.voxel_bytes = count * sp_type_size(info->type);
    assert(volume->info.voxel_bytes <= bytes);
    if (!sp_volume_measure(&volume->info, voxels, count, err))
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
    size_t room = (bytes + 63) & ~(uint64_t)63;
    void *copy = aligned_alloc(64, room);
    if (!copy) {
        sp_fail(err, SP_ERR_MEMORY, name, "no memory for %" PRIu64 " bytes of samples", bytes);
        return NULL;
    }
    memcpy(copy, voxels, bytes);
    return sp_volume_adopt(&info, copy, room, release_heap, err);
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
    free(v);
}

const struct sp_volume_info *sp_volume_info(const struct sp_volume *volume) {
    return &volume->info;
}

const void *sp_volume_voxels(const struct sp_volume *volume) {
    return volume->voxels;
}
