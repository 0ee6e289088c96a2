/* SPDX-License-Identifier: Apache-2.0
 *
 * What a frame sends to the GPU beside its lists: constants, a few hundred bytes; and when they
 * were made anew, the order of sheets and the chunks of bricks that batches are made of.
 */
#ifndef GL_UPLOAD_H
#define GL_UPLOAD_H

#include "backend/gl/buffer.h"
#include "backend/gl/frame.h"
#include "backend/gl/partition.h"

struct gl_upload {
    struct gl_buffer constants; /* struct gl_constants, then the order of sheets */
    struct gl_buffer chunks;
    uint64_t sheets_made, chunks_made; /* of the cut: what is there */
    uint32_t chunk_first, chunk_end;   /* those of the cut that are there … */
    uint32_t chunk_room;               /* … and how many have room */
    uint64_t bytes;                    /* sent since the beginning */
};

/* `most` as in gl_buffer_reserve(). A context must be current. SP_ERR_MEMORY, SP_ERR_BUDGET. */
bool gl_upload_frame(struct gl_upload *upload, const struct gl_frame *frame,
                     const struct gl_partition *partition, uint64_t most, struct sp_error *err);

/* Makes room for the cut's chunks; where they take more than `enough` bytes, for as many, and at
 * the least for those of one batch. */
bool gl_upload_chunks(struct gl_upload *upload, const struct gl_partition *partition,
                      uint64_t enough, uint64_t most, struct sp_error *err);

/* Sends the batch's chunks, unless they are there, and those that follow as far as there is room:
 * chunk c of the cut is then number c - chunk_first. */
void gl_upload_batch(struct gl_upload *upload, const struct gl_partition *partition,
                     const struct gl_batch *batch);

void gl_upload_finish(struct gl_upload *upload);

#endif
