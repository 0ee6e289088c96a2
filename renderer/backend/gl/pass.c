/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/pass.h"

#include <epoxy/gl.h>

#include "backend/gl/readback.h"
#include "classify/transfer.h"
#include "data/volume/grid.h"

enum {
    IN_FLIGHT = 2, /* dispatches that the GPU may lie behind */
    UNSIGNED = 0,
    SIGNED,
    REAL /* samples.glsl */
};

bool gl_pass_cancelled(const atomic_bool *cancel, struct sp_error *err) {
    if (!cancel || !atomic_load_explicit(cancel, memory_order_relaxed))
        return false;
    sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
    return true;
}

void gl_pass_use(unsigned program, const struct gl_voxels *voxels, uint32_t normal_bytes) {
    const struct sp_volume_info *info = sp_volume_info(voxels->volume);
    bool has_keys = sp_type_size(info->type) <= 2;
    int kind = info->type == SP_FLOAT32                            ? REAL
               : info->type == SP_UINT8 || info->type == SP_UINT16 ? UNSIGNED
                                                                   : SIGNED;
    glUseProgram(program);
    glUniform3ui(1, info->grid.dims[0], info->grid.dims[1], info->grid.dims[2]);
    glUniform4i(2, (GLint)sp_type_size(info->type), kind, has_keys ? sp_transfer_first(info) : 0,
                (GLint)normal_bytes);
    gl_buffer_bind(&voxels->samples, 0);
    gl_buffer_bind(&voxels->ranges, 1);
}

bool gl_pass_run(uint32_t bricks, uint32_t most, const atomic_bool *cancel, struct sp_error *err) {
    void *sent[IN_FLIGHT] = { NULL };
    uint32_t slot = 0;
    bool ok = true;
    for (uint32_t done = 0, n; ok && done < bricks; done += n, slot = (slot + 1) % IN_FLIGHT) {
        n = bricks - done < most ? bricks - done : most;
        ok = gl_fence_wait(&sent[slot], cancel, err) && !gl_pass_cancelled(cancel, err);
        if (!ok)
            break;
        glUniform1ui(0, done);
        glDispatchCompute(n, 1, 1);
        gl_fence_set(&sent[slot]);
    }
    glMemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT | GL_BUFFER_UPDATE_BARRIER_BIT);
    for (int i = 0; i < IN_FLIGHT; i++)
        ok = ok && gl_fence_wait(&sent[(slot + (uint32_t)i) % IN_FLIGHT], cancel, err);
    for (int i = 0; i < IN_FLIGHT; i++)
        gl_fence_drop(&sent[i]);
    return ok && gl_check("classified", err);
}
