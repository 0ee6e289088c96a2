/* SPDX-License-Identifier: Apache-2.0
 *
 * Buffers on the GPU that keep their memory from frame to frame and grow when more is asked for. A
 * context must be current.
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
    uint64_t asked; /* the most that was reserved; whoever looks sets it back */
};

/* What is done with a buffer; a hint to the driver. */
enum gl_usage {
    GL_USE_KEPT,    /* written rarely, read by shaders often */
    GL_USE_STREAM,  /* written once a frame by the processor */
    GL_USE_SCRATCH, /* written and read by shaders alone */
    GL_USE_READ     /* written by the GPU, read by the processor */
};

/* Sees to it that the buffer has at least `bytes`, > 0. What it held is lost when it grows. `what`
 * names it in errors. SP_ERR_BUDGET with both numbers beyond `most` (what a shader can see of one
 * buffer; 0 = not known), SP_ERR_MEMORY when the GPU has no memory for it. */
bool gl_buffer_reserve(struct gl_buffer *buffer, const char *what, uint64_t bytes, uint64_t most,
                       enum gl_usage usage, struct sp_error *err);
void gl_buffer_finish(struct gl_buffer *buffer);

/* Whether a buffer for this may stay mapped while the GPU works on it. */
bool gl_buffer_stays_mapped(enum gl_usage usage);

/* Writes all of the first `bytes`; what follows is undefined. The buffer must be large enough. */
void gl_buffer_write(const struct gl_buffer *buffer, const void *data, uint64_t bytes);

/* Writes `bytes` from byte `at` on; what is beside them stays. */
void gl_buffer_update(const struct gl_buffer *buffer, uint64_t at, const void *data,
                      uint64_t bytes);

/* Binds it as the storage block `binding` of shaders. */
void gl_buffer_bind(const struct gl_buffer *buffer, unsigned binding);

/* Memory to fill the first `bytes` of the buffer through, or NULL with SP_ERR_MEMORY set;
 * gl_buffer_unmap() hands it over: false with SP_ERR_BACKEND when the contents were lost. */
void *gl_buffer_map(const struct gl_buffer *buffer, uint64_t bytes, struct sp_error *err);
bool gl_buffer_unmap(const struct gl_buffer *buffer, struct sp_error *err);

#endif
