/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/band.h"

#include <epoxy/gl.h>
#include <string.h>

#include "backend/gl/memory.h"
#include "frame/depth.h"

enum { HEAD_BYTES = GL_BINS_HEAD * sizeof(uint32_t) };

static uint32_t pixel_bytes(const struct sp_frame *frame) {
    return frame->format == SP_RGBAF32 ? 16 : 4;
}

/* The same with depth and spread, which follow the pixels. */
static uint32_t read_bytes(const struct sp_frame *frame) {
    return pixel_bytes(frame) + (frame->depth ? 2 * sizeof(float) : 0);
}

static uint32_t image_bytes(const struct sp_frame *frame) {
    return GL_PIXEL_BYTES + (frame->depth ? 4 * sizeof(float) : 0);
}

void gl_band_end(struct gl_band *band, uint32_t rows) {
    uint32_t left = band->job->frame->height - band->y;
    band->end = band->y + (rows * GL_TILE < left ? rows * GL_TILE : left);
}

bool gl_band_reserve(struct gl_band *band, struct sp_error *err) {
    const struct gl_fragments_band fragments = gl_band_fragments(band);
    struct gl_state *s = band->state;
    uint64_t most = s->block_bytes, pixels = gl_band_pixels(band);
    uint64_t bytes = pixels * read_bytes(band->job->frame);
    uint64_t image = pixels * image_bytes(band->job->frame);
    return gl_buffer_reserve(&s->buffers.image, "pixels", image, most, GL_USE_SCRATCH, err) &&
           gl_buffer_reserve(&s->buffers.pixels, "pixels", bytes, most, GL_USE_SCRATCH, err) &&
           gl_readback_reserve(&band->slot->readback, HEAD_BYTES + bytes, err) &&
           gl_fragments_reserve(&fragments, err);
}

static bool plan(struct gl_band *band, uint32_t rows, struct sp_error *err) {
    struct gl_state *s = band->state;
    gl_band_end(band, rows);
    return gl_band_reserve(band, err) && gl_bins_reserve(&s->bins, 1, 1, s->block_bytes, err) &&
           gl_memory_fit(s, err);
}

bool gl_band_plan(struct gl_band *band, struct sp_error *err) {
    struct gl_state *s = band->state;
    uint32_t rows = gl_workload_limits(&s->workload).tiles / band->columns;
    if (band->slot->has_pieces && s->workload.rows < rows)
        rows = s->workload.rows;
    struct sp_error why = { .code = SP_OK };
    rows = rows < 1 ? 1 : rows;
    bool ok = plan(band, rows, &why);
    while (!ok && rows > 1 && (why.code == SP_ERR_MEMORY || why.code == SP_ERR_BUDGET)) {
        rows = rows < gl_band_rows(band) ? rows / 2 : (gl_band_rows(band) + 1) / 2;
        gl_memory_release(s);
        gl_readback_finish(&band->slot->readback);
        ok = plan(band, rows, &why);
    }
    return ok || sp_fail(err, why.code, why.place, "%s", why.text);
}

bool gl_band_start(const struct gl_band *band, struct sp_error *err) {
    static const float clear_pixel[4] = { 1, 0, 0, 0 };
    const struct gl_fragments_band fragments = gl_band_fragments(band);
    gl_timer_start(&band->slot->timer);
    glBindBuffer(GL_SHADER_STORAGE_BUFFER, band->state->buffers.image.name);
    glClearBufferSubData(GL_SHADER_STORAGE_BUFFER, GL_RGBA32F, 0,
                         (GLsizeiptr)gl_band_pixels(band) * (GLsizeiptr)sizeof clear_pixel, GL_RGBA,
                         GL_FLOAT, clear_pixel);
    gl_bins_clear_head(&band->state->bins);
    return gl_fragments_start(&fragments, &band->slot->fragments_most, err);
}

void gl_band_clear(const struct gl_band *band, uint32_t layer) {
    static const float zero[4] = { 0, 0, 0, 0 };
    GLsizeiptr bytes = (GLsizeiptr)gl_band_pixels(band) * (GLsizeiptr)sizeof zero;
    glBindBuffer(GL_SHADER_STORAGE_BUFFER, band->state->buffers.image.name);
    glClearBufferSubData(GL_SHADER_STORAGE_BUFFER, GL_RGBA32F, layer * bytes, bytes, GL_RGBA,
                         GL_FLOAT, zero);
}

void gl_band_barrier(void) {
    glMemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT | GL_BUFFER_UPDATE_BARRIER_BIT);
}

bool gl_band_follow(struct gl_band *band, struct sp_error *err) {
    void **last = &band->sent[band->sent_count++ % band->queued_max];
    if (!gl_fence_wait(last, band->job->cancel, err))
        return false;
    gl_fence_set(last);
    return true;
}

bool gl_band_draw_layer(struct gl_band *band, struct sp_error *err) {
    glDispatchCompute(band->columns, gl_band_rows(band), 1);
    gl_band_barrier();
    gl_timer_stamp(&band->slot->timer, GL_STAGE_LAYERS);
    return gl_band_follow(band, err);
}

void gl_band_drop_fences(struct gl_band *band) {
    for (int i = 0; i < GL_QUEUED_MAX; i++)
        gl_fence_drop(&band->sent[i]);
}

static void resolve(const struct gl_band *band) {
    struct gl_state *s = band->state;
    glUseProgram(s->resolve);
    glUniform2ui(0, gl_band_pixels(band), band->job->frame->format == SP_RGBAF32);
    glUniform4fv(1, 1, band->job->view->background);
    glUniform1ui(2, band->layer * gl_band_pixels(band));
    glUniform2f(3, band->job->frame->depth ? 1 : 0, band->slot->depth_origin);
    gl_buffer_bind(&s->buffers.image, 1);
    gl_buffer_bind(&s->buffers.pixels, 2);
    glDispatchCompute(gl_divide_up(gl_band_pixels(band), GL_GROUP), 1, 1);
    gl_band_barrier(); /* pixels stay bound: the next program may have a block there */
    gl_timer_stamp(&band->slot->timer, GL_STAGE_RESOLVE);
}

bool gl_band_send(const struct gl_band *band, struct sp_error *err) {
    struct gl_state *s = band->state;
    struct gl_slot *slot = band->slot;
    resolve(band);
    slot->y = band->y;
    slot->end = band->end;
    gl_readback_begin(&slot->readback);
    gl_readback_copy(&slot->readback, &s->bins.counts, HEAD_BYTES);
    gl_readback_copy(&slot->readback, &s->buffers.pixels,
                     (uint64_t)gl_band_pixels(band) * read_bytes(band->job->frame));
    gl_timer_stamp(&slot->timer, GL_STAGE_READ);
    gl_readback_send(&slot->readback);
    return gl_check("drawn", err);
}

/* Copies the depths of the band, then the spreads, which begin at `from`. */
static void read_depth(const struct gl_slot *slot, const unsigned char *from,
                       struct sp_frame *frame) {
    float *const planes[2] = { frame->depth, frame->spread };
    const size_t row = frame->width * sizeof(float);
    for (int k = 0; k < 2; k++)
        for (uint32_t y = slot->y; y < slot->end; y++, from += row)
            memcpy(sp_depth_row(frame, planes[k], y), from, row);
}

bool gl_band_read(struct gl_slot *slot, struct sp_frame *frame, struct gl_bins_head *head,
                  struct sp_error *err) {
    size_t row = (size_t)frame->width * pixel_bytes(frame);
    const unsigned char *from = gl_readback_read(&slot->readback, err);
    if (!from)
        return false;
    memcpy(head, from, sizeof *head);
    for (uint32_t y = slot->y; y < slot->end; y++)
        memcpy((unsigned char *)frame->pixels + (size_t)y * frame->stride_bytes,
               from + HEAD_BYTES + (y - slot->y) * row, row);
    if (frame->depth)
        read_depth(slot, from + HEAD_BYTES + (slot->end - slot->y) * row, frame);
    return gl_readback_close(&slot->readback, err);
}
