/* SPDX-License-Identifier: Apache-2.0
 *
 * Copies an image from the GPU to the processor: a buffer that the processor can map, and a fence
 * that signals that the buffer is filled. Each frame in flight has its own readback, so that one
 * image is read while the next is drawn. A context must be current.
 *
 *   gl_readback_copy ─► … the GPU draws and copies … ─► gl_fence_wait ─► gl_readback_read
 *                                                                    ─► gl_readback_close
 *
 * The buffer stays mapped where OpenGL allows it (4.4, or GL_ARB_buffer_storage); otherwise it is
 * mapped for each read.
 */
#ifndef GL_READBACK_H
#define GL_READBACK_H

#include <stdatomic.h>

#include "backend/gl/buffer.h"

struct gl_readback {
    struct gl_buffer buffer;
    /* Mapped for the life of the buffer; NULL = the buffer is mapped only for each read. */
    const unsigned char *mapped;
    uint64_t used; /* bytes copied */
    void *fence;   /* after the last copy; NULL = none */
};

/* Reserves `bytes`. Errors as gl_buffer_reserve(). */
bool gl_readback_reserve(struct gl_readback *readback, uint64_t bytes, struct sp_error *err);
void gl_readback_finish(struct gl_readback *readback);

/* Begin an image; append the first `bytes` of a buffer; submit all copies with a fence. */
void gl_readback_begin(struct gl_readback *readback);
void gl_readback_copy(struct gl_readback *readback, const struct gl_buffer *from, uint64_t bytes);
void gl_readback_send(struct gl_readback *readback);

/* Returns the copied bytes, in the order of the copies; wait for the fence first. NULL with *err
 * set. gl_readback_close() returns false if the contents were lost during the read. SP_ERR_BACKEND,
 * SP_ERR_MEMORY. */
const unsigned char *gl_readback_read(struct gl_readback *readback, struct sp_error *err);
bool gl_readback_close(struct gl_readback *readback, struct sp_error *err);

/* gl_fence_set() replaces *fence by a new fence after all commands so far; gl_fence_drop() deletes
 * it. */
void gl_fence_set(void **fence);
void gl_fence_drop(void **fence);

/* Waits for the fence and drops it; returns true at once if *fence is NULL. SP_ERR_CANCELLED if
 * *cancel is set (cancel: NULL = never), SP_ERR_BACKEND if the context is lost. */
bool gl_fence_wait(void **fence, const atomic_bool *cancel, struct sp_error *err);

/* Checks for errors: false with SP_ERR_MEMORY or SP_ERR_BACKEND if GL has reported an error since
 * the last call. `what`: past participle for the message, for instance "drawn". */
bool gl_check(const char *what, struct sp_error *err);

#endif
