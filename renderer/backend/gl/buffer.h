/* SPDX-License-Identifier: Apache-2.0
 *
 * Buffers on the GPU. They keep their memory from frame to frame and grow on demand. A context must
 * be current.
 */
#ifndef GL_BUFFER_H
#define GL_BUFFER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sp/status.h"

struct gl_buffer {
    unsigned name; /* in GL; 0 = none */
    uint64_t bytes;
    uint64_t asked; /* largest reservation since memory.c reset this field [bytes] */
};

/* How a buffer is used; a hint to the driver. */
enum gl_usage {
    GL_USE_KEPT,    /* written rarely, read by shaders often */
    GL_USE_STREAM,  /* written once per frame by the processor */
    GL_USE_SCRATCH, /* written and read by shaders alone */
    GL_USE_READ     /* written by the GPU, read by the processor */
};

/* Makes the buffer at least `bytes` > 0 large; its contents are lost if it grows. `what` names the
 * buffer in errors. `most`: largest buffer that a shader can read [bytes]; 0 = not known.
 * SP_ERR_BUDGET, with both numbers, if bytes > most; SP_ERR_MEMORY if the GPU is out of memory. */
bool gl_buffer_reserve(struct gl_buffer *buffer, const char *what, uint64_t bytes, uint64_t most,
                       enum gl_usage usage, struct sp_error *err);
void gl_buffer_finish(struct gl_buffer *buffer);

/* True if a buffer of this usage may stay mapped while the GPU uses it. */
bool gl_buffer_stays_mapped(enum gl_usage usage);

/* Writes the first `bytes` of the buffer; the rest becomes undefined. The buffer must be large
 * enough. Waits for the GPU. */
void gl_buffer_write(const struct gl_buffer *buffer, const void *data, uint64_t bytes);

/* Writes `bytes` from byte `at` on and leaves all other bytes unchanged. Does not wait: no command
 * of a frame in flight may use these bytes. */
void gl_buffer_update(const struct gl_buffer *buffer, uint64_t at, const void *data,
                      uint64_t bytes);

/* Binds the buffer as the storage block `binding` of shaders. */
void gl_buffer_bind(const struct gl_buffer *buffer, unsigned binding);

/* Binds the buffer as the uniform block `binding`. GPUs read uniform blocks faster than storage
 * blocks if all threads read the same value. */
void gl_buffer_bind_constants(const struct gl_buffer *buffer, unsigned binding);

/* gl_buffer_map() waits for the GPU and maps the first `bytes` for writing, or returns NULL with
 * SP_ERR_MEMORY. gl_buffer_unmap() hands the bytes to the GPU; false with SP_ERR_BACKEND if the
 * contents were lost. */
void *gl_buffer_map(const struct gl_buffer *buffer, uint64_t bytes, struct sp_error *err);
bool gl_buffer_unmap(const struct gl_buffer *buffer, struct sp_error *err);

#endif
