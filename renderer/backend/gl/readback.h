/* SPDX-License-Identifier: Apache-2.0
 *
 * The way of a picture back from the GPU: a buffer that the processor sees, and a fence that tells
 * when it is filled. Frames in flight have one each, so that what one of them left there is read
 * while the next is drawn. A context must be current.
 *
 *   gl_readback_copy ─► … the GPU draws, and copies … ─► gl_fence_wait ─► gl_readback_read,
 * gl_readback_close
 *
 * Where OpenGL lets a buffer stay mapped (4.4, or GL_ARB_buffer_storage) it does, else it is mapped
 * each time.
 */
#ifndef GL_READBACK_H
#define GL_READBACK_H

#include <stdatomic.h>

#include "backend/gl/buffer.h"

struct gl_readback {
    struct gl_buffer buffer;
    const unsigned char *mapped; /* for as long as the buffer lives; NULL: only while it is read */
    uint64_t used;               /* bytes copied */
    void *fence;                 /* behind the last copy; NULL = none */
};

/* Sees to it that there is room for `bytes`. As gl_buffer_reserve(). */
bool gl_readback_reserve(struct gl_readback *readback, uint64_t bytes, struct sp_error *err);
void gl_readback_finish(struct gl_readback *readback);

/* Begins a picture; then appends `bytes` of a buffer from its beginning on, and sends all of it. */
void gl_readback_begin(struct gl_readback *readback);
void gl_readback_copy(struct gl_readback *readback, const struct gl_buffer *from, uint64_t bytes);
void gl_readback_send(struct gl_readback *readback);

/* What was copied, in that order, once its fence was waited for; NULL with *err set. False from
 * gl_readback_close(): it was lost while it was read. SP_ERR_BACKEND, SP_ERR_MEMORY. */
const unsigned char *gl_readback_read(struct gl_readback *readback, struct sp_error *err);
bool gl_readback_close(struct gl_readback *readback, struct sp_error *err);

/* A fence behind all that was asked of the GPU so far, in the place of the one that is there. */
void gl_fence_set(void **fence);
void gl_fence_drop(void **fence);

/* Waits for the fence and drops it; one that is not there is passed. SP_ERR_CANCELLED when *cancel
 * is set (NULL = never), SP_ERR_BACKEND when the GPU is gone. */
bool gl_fence_wait(void **fence, const atomic_bool *cancel, struct sp_error *err);

/* SP_ERR_MEMORY or SP_ERR_BACKEND when GL has failed since the last call. `what` the frame was. */
bool gl_check(const char *what, struct sp_error *err);

#endif
