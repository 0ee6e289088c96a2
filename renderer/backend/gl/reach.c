/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/reach.h"

#include <epoxy/gl.h>
#include <stdlib.h>

#include "backend/gl/pass.h"
#include "backend/gl/program.h"
#include "classify/reach.h"

enum { RANGE_BYTES = 2 * sizeof(int32_t), CELLS = SP_BRICK / SP_CELL };

bool gl_reach_init(struct gl_reach *reach, struct sp_error *err) {
    return (reach->measure = gl_program_open("samples 00_reach", "#define PASS 0\n", err)) &&
           (reach->widen = gl_program_open("samples 00_reach", "#define PASS 1\n", err));
}

void gl_reach_finish(struct gl_reach *reach) {
    glDeleteProgram(reach->measure);
    glDeleteProgram(reach->widen);
    gl_buffer_finish(&reach->ends);
    gl_reach_drop(reach);
}

void gl_reach_drop(struct gl_reach *reach) {
    gl_buffer_finish(&reach->scratch[0]);
    gl_buffer_finish(&reach->scratch[1]);
}

static uint32_t bricks_along(const struct sp_grid *grid, int axis) {
    return (grid->dims[axis] + SP_BRICK - 1) / SP_BRICK;
}

static uint32_t count_bricks(const struct sp_grid *grid) {
    return bricks_along(grid, 0) * bricks_along(grid, 1) * bricks_along(grid, 2);
}

uint64_t gl_reach_bytes(const struct sp_grid *grid) {
    return count_bricks(grid) * (uint64_t)(CELLS * CELLS * CELLS * RANGE_BYTES);
}

bool gl_reach_load(struct gl_reach *reach, struct gl_voxels *voxels, uint32_t most,
                   uint64_t block_bytes, const atomic_bool *cancel, struct sp_error *err) {
    const struct sp_grid *grid = &sp_volume_info(voxels->volume)->grid;
    if (voxels->cells.name)
        return true;
    bool ok = gl_buffer_reserve(&voxels->cells, "ranges of cells", gl_reach_bytes(grid),
                                block_bytes, GL_USE_KEPT, err);
    if (ok) {
        gl_pass_use(reach->measure, voxels, 0);
        gl_buffer_bind(&voxels->cells, 1);
        ok = gl_pass_run(count_bricks(grid), most, cancel, err);
    }
    if (!ok)
        gl_buffer_finish(&voxels->cells);
    return ok;
}

/* First and last cell in turn. */
static bool write_ends(struct gl_reach *reach, const struct sp_level *level, unsigned axis,
                       uint64_t *uploaded, struct sp_error *err) {
    uint32_t count = bricks_along(&level->grid, (int)axis) * CELLS;
    uint64_t bytes = count * (uint64_t)(2 * sizeof(uint32_t));
    uint32_t *pairs = malloc(2 * bytes);
    if (!pairs)
        return sp_fail(err, SP_ERR_MEMORY, "", "no memory for %u cells", count);
    bool ok =
        gl_buffer_reserve(&reach->ends, "cells that kernels reach", bytes, 0, GL_USE_STREAM, err);
    uint32_t *first = pairs + 2 * (size_t)count, *last = first + count;
    sp_reach_ends(&level->grid, axis, level->reach, count, first, last);
    for (uint32_t i = 0; i < count; i++) {
        pairs[2 * i] = first[i];
        pairs[2 * i + 1] = last[i];
    }
    if (ok) {
        gl_buffer_write(&reach->ends, pairs, bytes);
        *uploaded += bytes;
    }
    free(pairs);
    return ok;
}

bool gl_reach_widen(struct gl_reach *reach, const struct gl_voxels *voxels,
                    const struct sp_level *level, uint32_t most, uint64_t block_bytes,
                    uint64_t *uploaded, const atomic_bool *cancel, struct sp_error *err) {
    const struct gl_buffer *from = &voxels->cells;
    for (unsigned axis = 0; axis < 3; axis++) {
        struct gl_buffer *to = &reach->scratch[axis % 2];
        if (!gl_buffer_reserve(to, "ranges around cells", gl_reach_bytes(&level->grid), block_bytes,
                               GL_USE_SCRATCH, err) ||
            !write_ends(reach, level, axis, uploaded, err))
            return false;
        gl_pass_use(reach->widen, voxels, 0);
        glUniform1ui(3, axis);
        gl_buffer_bind(from, 1);
        gl_buffer_bind(to, 3);
        gl_buffer_bind(&reach->ends, 4);
        if (!gl_pass_run(count_bricks(&level->grid), most, cancel, err))
            return false;
        from = to;
    }
    return true;
}
