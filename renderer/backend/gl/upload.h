/* SPDX-License-Identifier: Apache-2.0
 *
 * What a frame sends to the GPU beside its lists: constants, a few hundred bytes; and when they
 * were made anew, the order of sheets and the chunks of bricks that batches are made of.
 */
#ifndef GL_UPLOAD_H
#define GL_UPLOAD_H

#include "backend/gl/buffer.h"
#include "backend/gl/cut.h"
#include "backend/gl/frame.h"

struct gl_upload {
    struct gl_buffer constants; /* struct gl_constants, then the order of sheets */
    struct gl_buffer chunks;
    uint64_t sheets_made, chunks_made; /* of the cut: what is there */
    uint64_t bytes;                    /* sent since the beginning */
};

/* `most` as in gl_buffer_reserve(). A context must be current. SP_ERR_MEMORY, SP_ERR_BUDGET. */
bool gl_upload_frame(struct gl_upload *upload, const struct gl_frame *frame,
                     const struct gl_cut *cut, uint64_t most, struct sp_error *err);
bool gl_upload_chunks(struct gl_upload *upload, const struct gl_cut *cut, uint64_t most,
                      struct sp_error *err);

void gl_upload_finish(struct gl_upload *upload);

#endif
