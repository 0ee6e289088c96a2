/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/cell_bounds.h"

#include <epoxy/gl.h>
#include <stdlib.h>

#include "backend/gl/pass.h"
#include "backend/gl/program.h"
#include "classify/reach.h"

enum { RANGE_BYTES = 2 * sizeof(int32_t), CELLS = SP_BRICK / SP_CELL };

bool gl_cell_bounds_init(struct gl_cell_bounds *bounds, struct sp_error *err) {
    return (bounds->measure =
                gl_program_open("samples compute_cell_bounds", "#define PASS 0\n", err)) &&
           (bounds->widen =
                gl_program_open("samples compute_cell_bounds", "#define PASS 1\n", err));
}

void gl_cell_bounds_finish(struct gl_cell_bounds *bounds) {
    glDeleteProgram(bounds->measure);
    glDeleteProgram(bounds->widen);
    gl_buffer_finish(&bounds->ends);
    gl_cell_bounds_drop(bounds);
}

void gl_cell_bounds_drop(struct gl_cell_bounds *bounds) {
    gl_buffer_finish(&bounds->scratch[0]);
    gl_buffer_finish(&bounds->scratch[1]);
}

static uint32_t bricks_along(const struct sp_grid *grid, int axis) {
    return (grid->dims[axis] + SP_BRICK - 1) / SP_BRICK;
}

static uint32_t count_bricks(const struct sp_grid *grid) {
    return bricks_along(grid, 0) * bricks_along(grid, 1) * bricks_along(grid, 2);
}

uint64_t gl_cell_bounds_bytes(const struct sp_grid *grid) {
    return count_bricks(grid) * (uint64_t)(CELLS * CELLS * CELLS * RANGE_BYTES);
}

bool gl_cell_bounds_load(struct gl_cell_bounds *bounds, struct gl_voxels *voxels, uint32_t most,
                         uint64_t block_bytes, const atomic_bool *cancel, struct sp_error *err) {
    const struct sp_grid *grid = &sp_volume_info(voxels->volume)->grid;
    if (voxels->cells.name)
        return true;
    bool ok = gl_buffer_reserve(&voxels->cells, "ranges of cells", gl_cell_bounds_bytes(grid),
                                block_bytes, GL_USE_KEPT, err);
    if (ok) {
        gl_pass_use(bounds->measure, voxels, 0);
        gl_buffer_bind(&voxels->cells, 1);
        ok = gl_pass_run(count_bricks(grid), most, cancel, err);
    }
    if (!ok)
        gl_buffer_finish(&voxels->cells);
    return ok;
}

/* Uploads pairs of the first and the last cell that each cell along the axis is joined with. */
static bool write_ends(struct gl_cell_bounds *bounds, const struct sp_level *level, unsigned axis,
                       uint64_t *uploaded, struct sp_error *err) {
    uint32_t count = bricks_along(&level->grid, (int)axis) * CELLS;
    uint64_t bytes = count * (uint64_t)(2 * sizeof(uint32_t));
    uint32_t *pairs = malloc(2 * bytes);
    if (!pairs)
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for %u cells", count);
    bool ok =
        gl_buffer_reserve(&bounds->ends, "cells that kernels bounds", bytes, 0, GL_USE_STREAM, err);
    uint32_t *first = pairs + 2 * (size_t)count, *last = first + count;
    sp_reach_ends(&level->grid, axis, level->reach, count, first, last);
    for (uint32_t i = 0; i < count; i++) {
        pairs[2 * i] = first[i];
        pairs[2 * i + 1] = last[i];
    }
    if (ok) {
        gl_buffer_write(&bounds->ends, pairs, bytes);
        *uploaded += bytes;
    }
    free(pairs);
    return ok;
}

bool gl_cell_bounds_widen(struct gl_cell_bounds *bounds, const struct gl_voxels *voxels,
                          const struct sp_level *level, uint32_t most, uint64_t block_bytes,
                          uint64_t *uploaded, const atomic_bool *cancel, struct sp_error *err) {
    const struct gl_buffer *from = &voxels->cells;
    for (unsigned axis = 0; axis < 3; axis++) {
        struct gl_buffer *to = &bounds->scratch[axis % 2];
        if (!gl_buffer_reserve(to, "ranges around cells", gl_cell_bounds_bytes(&level->grid),
                               block_bytes, GL_USE_SCRATCH, err) ||
            !write_ends(bounds, level, axis, uploaded, err))
            return false;
        gl_pass_use(bounds->widen, voxels, 0);
        glUniform1ui(3, axis);
        gl_buffer_bind(from, 1);
        gl_buffer_bind(to, 3);
        gl_buffer_bind(&bounds->ends, 4);
        if (!gl_pass_run(count_bricks(&level->grid), most, cancel, err))
            return false;
        from = to;
    }
    return true;
}
