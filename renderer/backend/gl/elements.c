/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/elements.h"

#include <epoxy/gl.h>
#include <stdlib.h>
#include <string.h>

#include "backend/gl/pass.h"

enum { CHUNK = 64 << 20 }; /* bytes that are uploaded together */

/* Copies `bytes` of the array from its byte `done` on, whole items, to `to`. */
static void gather(const struct gl_elements_array *array, uint64_t done, uint64_t bytes, char *to) {
    const char *from = (const char *)array->data + done / array->item * array->stride;
    for (uint64_t n = 0; n < bytes; n += array->item, from += array->stride)
        memcpy(to + n, from, array->item);
}

static bool send_array(const struct gl_band *band, struct gl_resident *item, uint64_t at,
                       const struct gl_elements_array *array, char *chunk, struct sp_error *err) {
    const uint64_t most = array->stride ? CHUNK / array->item * array->item : CHUNK;
    for (uint64_t done = 0, n; done < array->bytes; done += n) {
        const char *from = (const char *)array->data + done;
        n = array->bytes - done < most ? array->bytes - done : most;
        if (gl_pass_cancelled(band->job->cancel, err))
            return false;
        if (array->stride) {
            gather(array, done, n, chunk);
            from = chunk;
        }
        gl_buffer_update(&item->buffer, at + done, from, n);
        band->state->residency.uploaded += n;
    }
    return true;
}

static bool send(const struct gl_band *band, struct gl_resident *item,
                 const struct gl_elements_array *arrays, int count, struct sp_error *err) {
    uint64_t at = 0;
    bool ok = true, has_strides = false;
    for (int i = 0; i < count; i++)
        has_strides = has_strides || arrays[i].stride;
    char *chunk = has_strides ? malloc(CHUNK) : NULL;
    if (has_strides && !chunk)
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for an upload to the GPU");
    for (int i = 0; ok && i < count; at += arrays[i].bytes, i++)
        ok = send_array(band, item, at, &arrays[i], chunk, err);
    free(chunk);
    item->is_filled = ok;
    return ok;
}

struct gl_resident *gl_elements_load(const struct gl_band *band, struct sp_volume *volume,
                                     enum gl_resident_kind kind, uint64_t made,
                                     const struct gl_elements_array *arrays, int count,
                                     const char *what, struct sp_error *err) {
    uint64_t bytes = 0;
    for (int i = 0; i < count; i++)
        bytes += arrays[i].bytes;
    struct gl_resident *item =
        gl_residency_get_item(&band->state->residency, volume, kind, made, bytes, what, err);
    if (!item)
        return NULL;
    if (!item->held)
        item->held = sp_volume_ref(volume);
    return item->is_filled || send(band, item, arrays, count, err) ? item : NULL;
}

bool gl_elements_reserve(const struct gl_band *band, uint32_t records, uint32_t layers,
                         uint32_t record_bytes, struct sp_error *err) {
    struct gl_state *s = band->state;
    const uint64_t most = s->block_bytes, all = records;
    return gl_buffer_reserve(&s->buffers.spans, "tiles of elements", all * GL_SPAN_BYTES, most,
                             GL_USE_SCRATCH, err) &&
           (!record_bytes || gl_buffer_reserve(&s->buffers.records, "splats", all * record_bytes,
                                               most, GL_USE_SCRATCH, err)) &&
           gl_bins_reserve(&s->bins, (uint64_t)gl_band_tiles(band) * layers, s->workload.pairs,
                           most, err);
}

struct gl_bins_space gl_elements_space(const struct gl_band *band, uint32_t layers) {
    return (struct gl_bins_space){ band->columns, band->y, band->end, gl_band_rows(band), layers };
}

bool gl_elements_sort(struct gl_band *band, const struct gl_bins_space *space, uint32_t records,
                      struct sp_error *err) {
    struct gl_state *s = band->state;
    const struct gl_pieces *pieces = &band->slot->pieces;
    if (sp_job_is_cancelled(band->job))
        return sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
    gl_bins_set_space(space);
    glUniform2ui(4, (GLuint)pieces->pairs, pieces->splat_rounds);
    gl_bins_clear(&s->bins, space);
    gl_buffer_bind(&s->buffers.spans, 6);
    gl_buffer_bind(&s->bins.counts, 7);
    glDispatchCompute(gl_divide_up(records, GL_GROUP), 1, 1);
    gl_band_barrier();
    gl_bins_sort(&s->bins, space, &s->buffers.spans, records, (uint32_t)pieces->pairs);
    gl_timer_stamp(&band->slot->timer, GL_STAGE_LAYERS);
    return gl_band_follow(band, err);
}
