/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/buffer.h"

#include <assert.h>
#include <epoxy/gl.h>

static const GLenum usages[] = { [GL_USE_KEPT] = GL_STATIC_DRAW,
                                 [GL_USE_STREAM] = GL_STREAM_DRAW,
                                 [GL_USE_SCRATCH] = GL_DYNAMIC_COPY,
                                 [GL_USE_READ] = GL_STREAM_READ };

/* Waits until the GPU has ended all commands. A driver must let the processor change a buffer, or
 * give its memory to another one, only when no command uses it. NVIDIA's driver 580 does not notice
 * that compute shaders use it. */
static void await(void) {
    glFinish();
}

bool gl_buffer_stays_mapped(enum gl_usage usage) {
    return usage == GL_USE_READ &&
           (epoxy_gl_version() >= 44 || epoxy_has_gl_extension("GL_ARB_buffer_storage"));
}

static void allocate(uint64_t bytes, enum gl_usage usage) {
    if (gl_buffer_stays_mapped(usage))
        glBufferStorage(GL_SHADER_STORAGE_BUFFER, (GLsizeiptr)bytes, NULL,
                        GL_MAP_READ_BIT | GL_MAP_PERSISTENT_BIT | GL_MAP_COHERENT_BIT |
                            GL_CLIENT_STORAGE_BIT);
    else
        glBufferData(GL_SHADER_STORAGE_BUFFER, (GLsizeiptr)bytes, NULL, usages[usage]);
}

bool gl_buffer_reserve(struct gl_buffer *buffer, const char *what, uint64_t bytes, uint64_t most,
                       enum gl_usage usage, struct sp_error *err) {
    uint64_t asked = bytes > buffer->asked ? bytes : buffer->asked;
    buffer->asked = asked;
    if (bytes <= buffer->bytes)
        return true;
    if (most && bytes > most)
        return sp_fail(err, SP_ERR_BUDGET, "",
                       "the %s take %llu bytes and a buffer of this GPU has at most %llu", what,
                       (unsigned long long)bytes, (unsigned long long)most);
    /* Reserves a quarter more, so that a camera that moves closer does not reallocate in every
     * frame. */
    uint64_t capacity = usage == GL_USE_KEPT ? bytes : bytes + bytes / 4;
    capacity = most && capacity > most ? bytes : capacity;
    gl_buffer_finish(buffer);
    glGenBuffers(1, &buffer->name);
    glBindBuffer(GL_SHADER_STORAGE_BUFFER, buffer->name);
    glGetError(); /* clears errors of earlier commands */
    allocate(capacity, usage);
    if (glGetError() != GL_NO_ERROR) {
        gl_buffer_finish(buffer);
        return sp_fail(err, SP_ERR_MEMORY, "", "the GPU has no %llu bytes for the %s",
                       (unsigned long long)capacity, what);
    }
    buffer->bytes = capacity;
    buffer->asked = asked;
    return true;
}

void gl_buffer_finish(struct gl_buffer *buffer) {
    if (buffer->name) {
        await();
        glDeleteBuffers(1, &buffer->name);
    }
    *buffer = (struct gl_buffer){ 0 };
}

void gl_buffer_write(const struct gl_buffer *buffer, const void *data, uint64_t bytes) {
    assert(bytes <= buffer->bytes);
    await();
    glBindBuffer(GL_SHADER_STORAGE_BUFFER, buffer->name);
    glBufferSubData(GL_SHADER_STORAGE_BUFFER, 0, (GLsizeiptr)bytes, data);
}

void gl_buffer_update(const struct gl_buffer *buffer, uint64_t at, const void *data,
                      uint64_t bytes) {
    assert(at + bytes <= buffer->bytes);
    glBindBuffer(GL_SHADER_STORAGE_BUFFER, buffer->name);
    glBufferSubData(GL_SHADER_STORAGE_BUFFER, (GLintptr)at, (GLsizeiptr)bytes, data);
}

void gl_buffer_bind(const struct gl_buffer *buffer, unsigned binding) {
    glBindBufferBase(GL_SHADER_STORAGE_BUFFER, binding, buffer->name);
}

void gl_buffer_bind_constants(const struct gl_buffer *buffer, unsigned binding) {
    glBindBufferBase(GL_UNIFORM_BUFFER, binding, buffer->name);
}

void *gl_buffer_map(const struct gl_buffer *buffer, uint64_t bytes, struct sp_error *err) {
    assert(bytes <= buffer->bytes);
    await();
    glBindBuffer(GL_SHADER_STORAGE_BUFFER, buffer->name);
    void *data = glMapBufferRange(GL_SHADER_STORAGE_BUFFER, 0, (GLsizeiptr)bytes,
                                  GL_MAP_WRITE_BIT | GL_MAP_INVALIDATE_BUFFER_BIT);
    if (!data)
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory while filling %llu bytes of GPU memory",
                (unsigned long long)bytes);
    return data;
}

bool gl_buffer_unmap(const struct gl_buffer *buffer, struct sp_error *err) {
    glBindBuffer(GL_SHADER_STORAGE_BUFFER, buffer->name);
    return glUnmapBuffer(GL_SHADER_STORAGE_BUFFER) ||
           sp_fail(err, SP_ERR_BACKEND, "",
                   "the driver discarded a buffer that was being written (glUnmapBuffer)");
}
