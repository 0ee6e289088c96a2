/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/readback.h"

#include <assert.h>
#include <epoxy/gl.h>

enum { POLL_NS = 5 * 1000000 }; /* between two checks of the cancel flag */

bool gl_check(const char *what, struct sp_error *err) {
    GLenum error = glGetError();
    if (error == GL_NO_ERROR)
        return true;
    return sp_fail(err, error == GL_OUT_OF_MEMORY ? SP_ERR_MEMORY : SP_ERR_BACKEND, "",
                   "GL error 0x%04x while the frame was %s", error, what);
}

void gl_fence_set(void **fence) {
    gl_fence_drop(fence);
    *fence = glFenceSync(GL_SYNC_GPU_COMMANDS_COMPLETE, 0);
    if (!*fence) /* a fence that does not exist counts as passed */
        glFinish();
}

void gl_fence_drop(void **fence) {
    if (*fence)
        glDeleteSync(*fence);
    *fence = NULL;
}

bool gl_fence_wait(void **fence, const atomic_bool *cancel, struct sp_error *err) {
    GLenum got = *fence ? GL_TIMEOUT_EXPIRED : GL_ALREADY_SIGNALED;
    while (got == GL_TIMEOUT_EXPIRED &&
           !(cancel && atomic_load_explicit(cancel, memory_order_relaxed)))
        got = glClientWaitSync(*fence, GL_SYNC_FLUSH_COMMANDS_BIT, POLL_NS);
    gl_fence_drop(fence);
    if (got == GL_TIMEOUT_EXPIRED)
        return sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
    bool is_passed = got == GL_ALREADY_SIGNALED || got == GL_CONDITION_SATISFIED;
    return is_passed || sp_fail(err, SP_ERR_BACKEND, "", "the GPU does not answer");
}

bool gl_readback_reserve(struct gl_readback *readback, uint64_t bytes, struct sp_error *err) {
    bool grows = bytes > readback->buffer.bytes;
    if (grows)
        readback->mapped = NULL; /* the mapping ends with the old buffer */
    if (!gl_buffer_reserve(&readback->buffer, "image that is read back", bytes, 0, GL_USE_READ,
                           err))
        return false;
    if (!grows)
        return true;
    glBindBuffer(GL_COPY_READ_BUFFER, readback->buffer.name);
    if (gl_buffer_stays_mapped(GL_USE_READ))
        readback->mapped =
            glMapBufferRange(GL_COPY_READ_BUFFER, 0, (GLsizeiptr)readback->buffer.bytes,
                             GL_MAP_READ_BIT | GL_MAP_PERSISTENT_BIT | GL_MAP_COHERENT_BIT);
    return gl_check("mapped for readback", err);
}

void gl_readback_finish(struct gl_readback *readback) {
    gl_fence_drop(&readback->fence);
    gl_buffer_finish(&readback->buffer);
    *readback = (struct gl_readback){ 0 };
}

void gl_readback_begin(struct gl_readback *readback) {
    readback->used = 0;
}

void gl_readback_copy(struct gl_readback *readback, const struct gl_buffer *from, uint64_t bytes) {
    assert(readback->used + bytes <= readback->buffer.bytes);
    glBindBuffer(GL_COPY_WRITE_BUFFER, readback->buffer.name);
    glBindBuffer(GL_COPY_READ_BUFFER, from->name);
    glCopyBufferSubData(GL_COPY_READ_BUFFER, GL_COPY_WRITE_BUFFER, 0, (GLintptr)readback->used,
                        (GLsizeiptr)bytes);
    readback->used += bytes;
}

void gl_readback_send(struct gl_readback *readback) {
    gl_fence_set(&readback->fence);
}

const unsigned char *gl_readback_read(struct gl_readback *readback, struct sp_error *err) {
    if (readback->mapped)
        return readback->mapped;
    glBindBuffer(GL_COPY_READ_BUFFER, readback->buffer.name);
    const unsigned char *data =
        glMapBufferRange(GL_COPY_READ_BUFFER, 0, (GLsizeiptr)readback->used, GL_MAP_READ_BIT);
    if (!data && gl_check("read back", err))
        sp_fail(err, SP_ERR_BACKEND, "", "the frame cannot be read back");
    return data;
}

bool gl_readback_close(struct gl_readback *readback, struct sp_error *err) {
    if (readback->mapped)
        return true;
    glBindBuffer(GL_COPY_READ_BUFFER, readback->buffer.name);
    return glUnmapBuffer(GL_COPY_READ_BUFFER) ||
           sp_fail(err, SP_ERR_BACKEND, "",
                   "the driver discarded a buffer that was being read (glUnmapBuffer)");
}
