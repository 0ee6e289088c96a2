/* SPDX-License-Identifier: Apache-2.0
 *
 * Uploads the data of a frame besides its lists: constants, and if they have changed, the order of
 * sheets and the chunks of bricks of the batches.
 */
#ifndef GL_UPLOAD_H
#define GL_UPLOAD_H

#include "backend/gl/buffer.h"
#include "backend/gl/frame.h"
#include "backend/gl/partition.h"

/* The constants of one frame. The GPU may still read the constants of the previous frame; therefore
 * both frames have their own. */
struct gl_frame_constants {
    struct gl_buffer buffer; /* struct gl_constants, then the order of sheets */
    uint64_t sheets_made;    /* generation of the partition whose sheets are uploaded */
};

struct gl_upload {
    struct gl_frame_constants constants, before; /* of this frame; of the previous one */
    struct gl_buffer chunks;
    uint64_t chunks_made;            /* generation of the partition that is uploaded */
    uint32_t chunk_first, chunk_end; /* the chunks that are uploaded */
    uint32_t chunk_capacity;         /* capacity of the buffer */
    uint64_t bytes;                  /* sent since the start */
};

/* Begins a frame: its uploads do not overwrite data that the previous frame may still read. */
void gl_upload_next(struct gl_upload *upload);

/* Uploads the constants, and the order of sheets if it has changed. `most` as in
 * gl_buffer_reserve(). A context must be current, here and below. SP_ERR_MEMORY, SP_ERR_BUDGET. */
bool gl_upload_frame(struct gl_upload *upload, const struct gl_frame *frame,
                     const struct gl_partition *partition, uint64_t most, struct sp_error *err);

/* Uploads the constants for shading of a frame without a partition. Errors as above. */
bool gl_upload_shading(struct gl_upload *upload, const struct sp_camera_transform *camera,
                       const struct sp_view *view, uint64_t most, struct sp_error *err);

/* Reserves memory for the partition's chunks: at most `enough` bytes, but at least the chunks of
 * one batch. */
bool gl_upload_chunks(struct gl_upload *upload, const struct gl_partition *partition,
                      uint64_t enough, uint64_t most, struct sp_error *err);

/* Uploads the batch's chunks, unless they are uploaded already, and as many of the following chunks
 * as fit. Chunk c of the partition is then number c - chunk_first of the buffer. */
void gl_upload_batch(struct gl_upload *upload, const struct gl_partition *partition,
                     const struct gl_batch *batch);

void gl_upload_finish(struct gl_upload *upload);

#endif
