/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/upload.h"

#include <stddef.h>

/* Reserves memory. The first *made items stay valid unless the buffer has to grow. */
static bool reserve(struct gl_buffer *buffer, const char *what, uint64_t bytes, uint64_t most,
                    uint64_t *made, struct sp_error *err) {
    if (bytes > buffer->bytes)
        *made = 0;
    return gl_buffer_reserve(buffer, what, bytes, most, GL_USE_STREAM, err);
}

static void send(struct gl_upload *upload, const struct gl_buffer *to, uint64_t at,
                 const void *data, uint64_t bytes) {
    gl_buffer_update(to, at, data, bytes);
    upload->bytes += bytes;
}

void gl_upload_next(struct gl_upload *upload) {
    const struct gl_frame_constants before = upload->before;
    upload->before = upload->constants;
    upload->constants = before;
}

static void send_shading(struct gl_upload *upload, const struct gl_constants *c) {
    send(upload, &upload->constants.buffer, 0, c,
         offsetof(struct gl_constants, lights) + c->choice[2] * sizeof c->lights[0]);
}

bool gl_upload_shading(struct gl_upload *upload, const struct sp_camera_transform *camera,
                       const struct sp_view *view, uint64_t most, struct sp_error *err) {
    struct gl_constants constants = { .choice = { 0 } };
    if (!reserve(&upload->constants.buffer, "constants", sizeof constants, most,
                 &upload->constants.sheets_made, err))
        return false;
    gl_frame_write_shading(&constants, camera, view);
    send_shading(upload, &constants);
    return true;
}

bool gl_upload_frame(struct gl_upload *upload, const struct gl_frame *f,
                     const struct gl_partition *partition, uint64_t most, struct sp_error *err) {
    const struct gl_constants *c = &f->constants;
    uint64_t sheets = partition->sheet_count * sizeof *partition->sheets;
    if (!reserve(&upload->constants.buffer, "constants", sizeof *c + sheets, most,
                 &upload->constants.sheets_made, err))
        return false;
    uint32_t planes = c->image_info[3];
    send_shading(upload, c);
    for (unsigned part = 0; f->parts >> part; part++) {
        if (!(f->parts >> part & 1))
            continue;
        send(upload, &upload->constants.buffer, offsetof(struct gl_constants, parts[part]),
             &c->parts[part], sizeof c->parts[part]);
        if (planes)
            send(upload, &upload->constants.buffer, offsetof(struct gl_constants, planes[part]),
                 c->planes[part], planes * sizeof c->planes[part][0]);
    }
    if (sheets && upload->constants.sheets_made != partition->sheets_made)
        send(upload, &upload->constants.buffer, sizeof *c, partition->sheets, sheets);
    upload->constants.sheets_made = partition->sheets_made;
    return true;
}

/* The chunks of a batch are contiguous across levels. */
static void sum_chunks(const struct gl_batch *batch, uint32_t *first, uint32_t *count) {
    *first = *count = 0;
    for (int l = SP_LEVELS - 1; l >= 0; l--) {
        *first = batch->chunks[l] ? batch->chunk[l] : *first;
        *count += batch->chunks[l];
    }
}

bool gl_upload_chunks(struct gl_upload *upload, const struct gl_partition *partition,
                      uint64_t enough, uint64_t most, struct sp_error *err) {
    uint64_t capacity = enough / sizeof *partition->chunks;
    for (uint32_t i = 0; i < partition->batch_count; i++) {
        uint32_t first, count;
        sum_chunks(&partition->batches[i], &first, &count);
        capacity = capacity > count ? capacity : count;
    }
    capacity = capacity < partition->chunk_count ? capacity : partition->chunk_count;
    if (!reserve(&upload->chunks, "bricks", capacity * sizeof *partition->chunks + 1, most,
                 &upload->chunks_made, err))
        return false;
    if (upload->chunks_made != partition->chunks_made)
        upload->chunk_first = upload->chunk_end = 0;
    upload->chunks_made = partition->chunks_made;
    upload->chunk_capacity = (uint32_t)capacity;
    return true;
}

void gl_upload_batch(struct gl_upload *upload, const struct gl_partition *partition,
                     const struct gl_batch *batch) {
    uint32_t first, count;
    sum_chunks(batch, &first, &count);
    if (first >= upload->chunk_first && first + count <= upload->chunk_end)
        return;
    uint32_t left = partition->chunk_count - first;
    uint32_t n = left < upload->chunk_capacity ? left : upload->chunk_capacity;
    gl_buffer_write(&upload->chunks, partition->chunks + first, n * sizeof *partition->chunks);
    upload->bytes += n * sizeof *partition->chunks;
    upload->chunk_first = first;
    upload->chunk_end = first + n;
}

void gl_upload_finish(struct gl_upload *upload) {
    gl_buffer_finish(&upload->constants.buffer);
    gl_buffer_finish(&upload->before.buffer);
    gl_buffer_finish(&upload->chunks);
    upload->constants.sheets_made = upload->before.sheets_made = upload->chunks_made = 0;
}
